"""The published protocols to the number, and the quirks of the authors' code as switches that are off elsewhere."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eigenode_cli.batch import run
from eigenode_cli.config.build import gradient_scales
from eigenode_cli.config.compose import compose, typed
from eigenode_cli.config.optimizer_schema import AdamConfig
from eigenode_cli.config.schema import ExponentialConfig, MlpConfig, SequentialConfig, TrainConfig
from eigenode_cli.config.setup import build

ALL = ("sol", "frq", "dmp", "stb", "osc", "stf")


def configuration(*words: str) -> TrainConfig:
    return typed(compose(list(words)))


@pytest.mark.parametrize(
    ("protocol", "system", "points", "horizon", "start", "steps", "scales"),
    [
        ("paper", "oscillator", 101, 10.0, [1, 0], 5000, [1, 10, 1, 1000, 10, 0.1]),
        ("paper", "sparse_oscillator", 14, 9.75, [1, 0], 7500, [1, 10, 1, 1000, 10, 0.1]),
        ("paper", "vdp", 91, 30.0, [2, 0], 5000, [1, 10, 1, 1000, 10, 0.1]),
        ("authors", "oscillator", 101, 10.0, [1, 0], 5000, [1, 10, 1, 1000, 10, 0.1]),
        ("authors", "sparse_oscillator", 14, 9.75, [1, 0], 7500, [1, 10, 1, 1000, 10, 0.1]),
        ("authors", "vdp", 101, 30.0, [2, 0], 5000, [1, 10, 1, 1000, 10, 1e-3]),
        ("journal", "oscillator", 41, 10.0, [1, 0], 5000, [0.5, 10, 10, 0.1, 10, 1e-4]),
        ("journal", "sparse_oscillator", 14, 9.75, [1, 0], 5000, [0.5, 10, 10, 0.1, 10, 1e-4]),
        ("journal", "vdp", 41, 62.8, [1, 0], 5000, [0.5, 10, 10, 0.1, 10, 1e-4]),
    ],
)
def test_side_by_side(
    protocol: str, system: str, points: int, horizon: float, start: list[float], steps: int, scales: list[float]
) -> None:
    config = configuration(f"protocol={protocol}", f"system={system}")
    assert (config.system.points, config.system.horizon) == (points, horizon)
    assert (config.system.initial_state, config.trainer.steps) == (start, steps)
    assert [config.scale[term] for term in ALL] == scales


@pytest.mark.parametrize(
    ("protocol", "init", "scaling", "combination", "repeats", "rate", "count", "every"),
    [
        ("paper", "glorot", "none", "sequential", False, (1e-3, 0.0, 0.0, 1), "spectrum", 25),
        ("authors", "uniform01", "none", "sequential", True, (1e-3, 0.0, 0.0, 1), "spectrum", 25),
        ("journal", "kaiming", "max_abs", "sum", False, (1e-3, 9e-3, 2e-3, 10), "times", 10),
    ],
)
def test_choices(
    protocol: str,
    init: str,
    scaling: str,
    combination: str,
    repeats: bool,
    rate: tuple[float, float, float, int],
    count: str,
    every: int,
) -> None:
    config = configuration(f"protocol={protocol}")
    network, optimizer, combine = config.network, config.optimizer, config.combine
    assert isinstance(network, MlpConfig)
    assert isinstance(optimizer, AdamConfig)
    assert (network.init, network.input_scaling, network.output_scaling) == (init, scaling, scaling)
    assert combine.name == combination
    assert repeats == (isinstance(combine, SequentialConfig) and combine.repeat_last_update)
    schedule = config.schedule
    shape = (
        (schedule.extra, schedule.rate, schedule.every) if isinstance(schedule, ExponentialConfig) else (0.0, 0.0, 1)
    )
    assert (optimizer.lr, *shape) == rate
    assert (config.eigen.eigenvalue_count, config.trainer.record_every) == (count, every)


@pytest.mark.parametrize(("system", "divisor"), [("oscillator", 10.25), ("sparse_oscillator", 3.5), ("vdp", 10.25)])
def test_eigenvalue_count_of_the_journal(system: str, divisor: float) -> None:
    quirk = configuration("protocol=journal", f"system={system}")
    plain = replace(quirk, eigen=replace(quirk.eigen, eigenvalue_count="spectrum"))
    ratio = [gradient_scales(plain)[term] / gradient_scales(quirk)[term] for term in ALL]
    np.testing.assert_allclose(ratio, [1.0, divisor, divisor, divisor, divisor, 1.0], rtol=1e-14)


def test_the_count_changes_the_training_and_no_recorded_loss(tmp_path: Path) -> None:
    words = ("protocol=journal", "system=oscillator", "grads=sol+frq+stb", "trainer.steps=10", "trainer.figures=false")
    rows = {}
    for count in ("times", "spectrum"):
        folder = tmp_path / count
        folder.mkdir()
        assert run.train(configuration(*words, f"eigen.eigenvalue_count={count}"), folder, words, quiet=True) == 0
        rows[count] = [row.split(",")[3:] for row in (folder / "metrics.csv").read_text().splitlines()[1:]]
    assert rows["times"][0] == rows["spectrum"][0]
    assert rows["times"][1] != rows["spectrum"][1]


def test_max_abs_position_is_one_in_the_journal() -> None:
    for system in ("oscillator", "sparse_oscillator", "vdp"):
        setup = build(configuration("protocol=journal", f"system={system}"), lambda message: None)
        assert np.abs(setup.problem.data.values[:, 0]).max() == 1.0
