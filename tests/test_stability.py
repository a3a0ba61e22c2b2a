"""A run says whether what `stb` asks for holds at its end, along the trajectory and at the equilibrium."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

import eigenode_cli as en
from eigenode_cli.spectra.equilibrium import equilibrium, spectrum_at
from tests.batch.helpers import inside

SHORT = ("trainer.steps=3", "trainer.figures=false", "hydra.run.dir=run")


def test_the_equilibrium_of_a_known_field() -> None:
    def field(x: torch.Tensor) -> torch.Tensor:
        a, b = x[..., 0], x[..., 1]
        return torch.stack([b, 1.0 - torch.exp(a) - 0.5 * b], dim=-1)

    rest = equilibrium(field, np.array([[0.8, 0.1], [-0.5, 0.3], [np.nan, 0.0]]))
    assert rest is not None
    np.testing.assert_allclose(rest, 0.0, atol=1e-9)
    np.testing.assert_allclose(np.sort_complex(spectrum_at(field, rest)), np.roots([1.0, 0.5, 1.0])[::-1], rtol=1e-9)


def test_a_field_without_one() -> None:
    assert equilibrium(lambda x: torch.ones_like(x) + x**2, np.zeros((3, 2))) is None
    assert equilibrium(lambda x: x, np.full((3, 2), np.nan)) is None


def test_a_run_that_stays_unstable_says_so(tmp_path: Path) -> None:
    status, out, _ = inside(tmp_path, "train", "system=vdp", "grads=sol+stb", *SHORT)
    assert status == 0
    record = json.loads((tmp_path / "run" / "run.json").read_text())
    real = record["stability"]["trajectory"]
    assert real == pytest.approx(record["final"]["max_real"], rel=1e-6)
    assert real > 0.0
    assert f"stb does not hold: the largest real part is {real:.3g} 1/s along the trajectory" in out


def test_no_word_where_it_holds_or_is_not_asked_for(tmp_path: Path) -> None:
    truth = en.Truth(en.Oscillator(), (1.0, 0.0))
    assert truth.system.states
    words = ("train", "protocol=robust", "system=oscillator", "trainer.figures=false")
    for run, grads in (("one", "sol+stb"), ("two", "sol")):
        status, out, _ = inside(tmp_path, *words, f"grads={grads}", f"hydra.run.dir={run}")
        assert status == 0
        assert "stb does not hold" not in out
        stability = json.loads((tmp_path / run / "run.json").read_text())["stability"]
        assert stability["trajectory"] == pytest.approx(-0.025, rel=1e-3)
        assert stability["equilibrium"] == pytest.approx(-0.025, rel=1e-2)
