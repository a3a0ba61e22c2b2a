"""protocol=robust does what it is for: one recipe, all three systems."""

from pathlib import Path

import pytest

from tests.runs.test_run import metrics, record, train

SYSTEMS = {
    "oscillator": ("sol+frq+dmp+stb+osc", 1.0),
    "sparse_oscillator": ("sol+frq+dmp+stb+osc", 1.0),
    "vdp": ("sol+frq+dmp+osc", 2.0),
}
"""Terms and amplitude."""


@pytest.mark.slow
@pytest.mark.parametrize("system", SYSTEMS)
def test_a_seed_that_no_one_tuned_for(system: str, tmp_path: Path) -> None:
    grads, amplitude = SYSTEMS[system]
    run = train(tmp_path, "protocol=robust", f"system={system}", f"grads={grads}", "seed=4711", "trainer.figures=false")
    assert record(run)["unsolvable_steps"] == 0
    assert float(metrics(run)[-1]["dense_error"]) <= 0.03 * amplitude


def test_spectra_come_first_then_the_horizon_grows(tmp_path: Path) -> None:
    short = ("trainer.steps=60", "stages.0.steps=20", "trainer.record_every=20", "trainer.figures=false")
    rows = metrics(train(tmp_path, "protocol=robust", "system=sparse_oscillator", "grads=sol+frq+dmp+stb+osc", *short))
    assert [row["lr"] for row in rows] == ["0.01", "", "", ""]  # Adam's ends with the spectral steps
