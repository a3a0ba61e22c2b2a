"""Spectra of records: peaks, and memory that does not grow with the record."""

import tracemalloc

import numpy as np
import pytest

from eigenode_cli.data import spectrum


def test_peaks_of_two_modes_at_unequal_times() -> None:
    rng = np.random.default_rng(0)
    times = np.sort(rng.uniform(0.0, 50.0, 1500))
    signal = np.sin(2.0 * np.pi * 1.3 * times) + 0.2 * np.cos(2.0 * np.pi * 4.0 * times)
    first, second = spectrum.peaks(spectrum.periodogram(times, signal), 2)
    assert first == pytest.approx(1.3, rel=2e-3)
    assert second == pytest.approx(4.0, rel=2e-3)


def test_frequencies_in_parts_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    times = np.linspace(0.0, 20.0, 801)
    signal = np.exp(-0.05 * times) * np.sin(2.0 * np.pi * 0.7 * times)
    whole = spectrum.periodogram(times, signal)
    monkeypatch.setattr(spectrum, "AT_ONCE", 1000)
    parts = spectrum.periodogram(times, signal)
    np.testing.assert_allclose(parts.amplitude, whole.amplitude, atol=1e-13)


def test_memory_is_bounded() -> None:
    """3,000 samples at 12,000 frequencies were 288 MB an array."""
    times = np.linspace(0.0, 3000.0, 3001)
    signal = np.sin(2.0 * np.pi * 0.1 * times)
    tracemalloc.start()
    spectrum.periodogram(times, signal)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 150e6
