"""Short runs of every kind that is exported."""

from pathlib import Path

import pytest

import eigenode_cli as en

SHORT = ("trainer.steps=4", "trainer.record_every=2", "system.points=21", "trainer.figures=false", "engine=torch")
KINDS = {
    "oscillator": ("system=oscillator", "system.horizon=2", "grads=sol+frq"),
    "scaled": (
        *("system=oscillator", "system.horizon=2", "system.initial_known=[s]", "network.linear=modes"),
        *("network.input_scaling=max_abs", "network.output_scaling=max_abs", "network.hidden=[9,5]"),
        *("network.activation=softplus", "network.output_gain=0.1"),
    ),
    "polynomial": (
        *("system=vdp", "network=polynomial", "network.structure=full", "network.linear=fitted"),
        *("system.observed=[nu,nu_dot]", "system.horizon=2", "network.spread=0.01", "grads=sol"),
    ),
}


@pytest.fixture(scope="session", params=KINDS)
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> en.RecordedRun:
    """Each of the runs in turn."""
    return trained(request.param, tmp_path_factory)


@pytest.fixture(scope="session")
def one_run(tmp_path_factory: pytest.TempPathFactory) -> en.RecordedRun:
    """One of them, which has a mode."""
    return trained("scaled", tmp_path_factory)


_TRAINED: dict[str, en.RecordedRun] = {}


def trained(kind: str, factory: pytest.TempPathFactory) -> en.RecordedRun:
    """A run, trained once."""
    if kind not in _TRAINED:
        _TRAINED[kind] = en.train(*KINDS[kind], *SHORT, folder=Path(factory.mktemp("runs")) / kind)
    return _TRAINED[kind]
