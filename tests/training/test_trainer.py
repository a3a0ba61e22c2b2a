"""The training loop with stub engines: order of events, failed solves, interruption."""

import contextlib
import dataclasses
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file

from eigenode_cli.arrays import Floats
from eigenode_cli.console import LineCounter, RunDisplay
from eigenode_cli.engines.base import Advance, Evaluation, LossJacobian, single_step
from eigenode_cli.engines.combine import SEQUENTIAL
from eigenode_cli.engines.update import Update
from eigenode_cli.runs.recorder import Recorder, load_last, metrics_header
from eigenode_cli.solve.status import Status
from eigenode_cli.training.methods import AdamBfgs, Sgd
from eigenode_cli.training.optimizers import Optimizer, build_optimizer
from eigenode_cli.training.options import TrainerOptions
from eigenode_cli.training.progress import Progress, summary
from eigenode_cli.training.stages import Phase
from eigenode_cli.training.trainer import Trainer, Unsolvable

TIMES = np.linspace(0.0, 1.0, 1000)
SCALES = np.array([1.0, 2.0])


class Bowl:
    """Two terms, theta^2 and theta; not solvable while theta is larger than a limit."""

    name = "stub"
    compile_seconds = 0.0

    def __init__(self, limit: float = np.inf) -> None:
        self.limit = limit
        self.seen: list[float] = []

    def loss_jacobian(self, theta: Floats) -> LossJacobian:
        self.seen.append(float(theta[0]))
        solved = theta[0] <= self.limit
        x = theta[0]
        return LossJacobian(
            values=np.array([x**2 if solved else np.nan, x]),
            gradients=np.array([[2 * x if solved else np.nan], [1.0]]),
            trajectory=np.zeros((3, 2)),
            spectra=np.full((3, 2), x + 0j),
            status=Status.OK if solved else Status.UNDERFLOW,
            n_accepted=3,
            n_rejected=1,
            guard_count=2,
        )

    def advance(self, theta: Floats, update: Update, rates: Floats, halt: bool) -> Advance:
        return single_step(self, theta, update, rates, halt)

    def evaluate(self, theta: Floats, times: Floats) -> Evaluation:
        jacobian = self.loss_jacobian(theta)
        return Evaluation(
            values=np.array([jacobian.values[0], 0.0, 0.0, jacobian.values[1], 0.0, 0.0]),
            trajectory=jacobian.trajectory,
            spectra=jacobian.spectra,
            status=jacobian.status,
            n_accepted=3,
            n_rejected=1,
            dense=np.full((times.size, 2), theta[0]),
        )


Make = Callable[..., Trainer]


@pytest.fixture
def make() -> Iterator[Make]:
    """Build trainers whose files are closed at the end of the test."""
    trainers: list[Trainer] = []

    def build(folder: Path, engine: Bowl, start: float, **changes: object) -> Trainer:
        trainers.append(make_trainer(folder, engine, start, **changes))
        return trainers[-1]

    yield build
    for trainer in trainers:
        trainer.recorder.close()


def make_trainer(
    folder: Path,
    engine: Bowl,
    start: float,
    phases: list[Phase] | None = None,
    opened: bool = True,
    **changes: object,
) -> Trainer:
    options = {"steps": 10, "record_every": 4, "checkpoint_every": 5, "on_unsolvable": "stabilise"}
    given = TrainerOptions(**(options | changes))  # type: ignore[arg-type]
    recorder = Recorder(folder, ("sol", "frq", "dmp", "stb", "osc", "stf"), np.zeros(TIMES.size))
    if opened:
        recorder.open(None)
    return Trainer(
        engine=engine,
        phases=phases or [Phase(0, engine, SCALES)],
        optimizer=Optimizer(Sgd(lr=0.1), 1),
        combination=SEQUENTIAL,
        terms=("sol", "stb"),
        weights=np.array([*SCALES, 0.0, 0.0, 0.0, 0.0])[[0, 2, 3, 1, 4, 5]],
        options=given,
        recorder=recorder,
        display=RunDisplay(10, LineCounter("stub  step", 10)),
        dense_times=TIMES,
        theta=np.array([start]),
        network=lambda theta: {"layers.0.weight": torch.from_numpy(theta.copy())},
        progress=Progress(),
    )


def test_updates_follow_one_another_from_one_loss_jacobian(make: Make, tmp_path: Path) -> None:
    trainer = make(tmp_path, Bowl(), 1.0, steps=1)
    trainer.run()
    assert trainer.theta[0] == pytest.approx(1.0 - 0.1 * 2.0 - 0.1 * 2.0 * 1.0)


def test_records_and_checkpoints_fall_on_their_steps_and_on_the_last(make: Make, tmp_path: Path) -> None:
    last = make(tmp_path, Bowl(), 1.0).run()
    rows = (tmp_path / "metrics.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in rows] == ["step", "0", "4", "8", "10"]
    names = sorted(path.name for path in (tmp_path / "checkpoints").iterdir())
    assert names == [
        "last.json",
        "last.safetensors",
        "step-000000.safetensors",
        "step-000005.safetensors",
        "step-000010.safetensors",
    ]
    assert last["step"] == 10


def test_stages_take_their_steps_with_their_scales(make: Make, tmp_path: Path) -> None:
    before, *rest = engines = [Bowl(), Bowl(), Bowl()]
    phases = [Phase(0, before, np.array([0.0, 0.5])), Phase(4, rest[0], SCALES), Phase(7, rest[1], SCALES)]
    whole = Bowl()
    make(tmp_path, whole, 1.0, phases=phases).run()
    assert [len(engine.seen) for engine in engines] == [4, 3, 3]
    assert len(whole.seen) == 4  # the records look at the whole horizon
    np.testing.assert_allclose(before.seen, 1.0 - 0.05 * np.arange(4), rtol=1e-12)  # its own scales: 0.1 times 0.5


def searching(trainer: Trainer, adam_steps: int) -> Trainer:
    config = AdamBfgs(lr=0.1, adam_steps=adam_steps)
    return dataclasses.replace(trainer, optimizer=build_optimizer(config, trainer.theta.size))


def test_bfgs_descends_on_the_sum_of_the_scaled_terms(make: Make, tmp_path: Path) -> None:
    trainer = searching(make(tmp_path, Bowl(), 5.0), adam_steps=2)
    trainer.run()
    assert trainer.theta[0] == pytest.approx(-1.0)  # of x^2 + 2 x
    assert trainer.progress.unsolvable_steps == 0
    rates = [row.split(",")[2] for row in (tmp_path / "metrics.csv").read_text().splitlines()[1:]]
    assert rates == ["0.1", "", "", ""]  # BFGS has no learning rate


def test_bfgs_leaves_a_failed_solve_by_adam(make: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trainer = searching(make(tmp_path, Bowl(limit=0.75), 1.0, steps=20), adam_steps=0)
    trainer.run()
    assert trainer.theta[0] == pytest.approx(-1.0)
    assert trainer.progress.unsolvable_steps == 3
    assert "solvable again after 3 steps" in capsys.readouterr().out


def test_bfgs_forgets_the_curvature_where_another_stage_begins(make: Make, tmp_path: Path) -> None:
    phases = [Phase(0, Bowl(), SCALES), Phase(5, Bowl(), SCALES)]
    trainer = searching(make(tmp_path, Bowl(), 5.0, phases=phases), adam_steps=0)
    restarts: list[int] = []
    trainer.optimizer.bfgs.restart = lambda: restarts.append(trainer.progress.step)  # type: ignore[attr-defined]
    trainer.run()
    assert restarts == [5]


def test_a_failed_solve_heals_and_says_so(make: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trainer = make(tmp_path, Bowl(limit=0.5), 1.0)
    row = trainer.run()
    said = capsys.readouterr().out
    assert "step 0: the solve failed (underflow); SOL is skipped, the spectral terms go on until it succeeds" in said
    assert "step 3: solvable again after 3 steps" in said
    assert trainer.progress.unsolvable_steps == 3
    assert trainer.progress.unsolvable_since is None
    assert "3 unsolvable steps" in summary(row, trainer.progress)
    first = (tmp_path / "metrics.csv").read_text().splitlines()[1].split(",")
    assert first[3] == ""  # SOL is not defined there, and an absent metric is never 0
    assert "underflow" in first


def test_skip_leaves_the_parameters_alone(make: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    class Undefined(Bowl):
        def loss_jacobian(self, theta: Floats) -> LossJacobian:
            nothing = np.full((2, 1), np.nan)
            return dataclasses.replace(super().loss_jacobian(theta), values=nothing[:, 0], gradients=nothing)

    trainer = make(tmp_path, Undefined(limit=0.5), 1.0, on_unsolvable="skip")
    trainer.run()
    assert trainer.theta[0] == 1.0
    assert trainer.progress.unsolvable_steps == 4  # one is like the other, so that it ends at the next record
    assert trainer.ending.status == "stalled"
    assert "leaves the parameters as they are" in capsys.readouterr().out


def test_stop_ends_the_run_with_a_name(make: Make, tmp_path: Path) -> None:
    with pytest.raises(Unsolvable, match=r"underflow\) at step 0"):
        make(tmp_path, Bowl(limit=0.5), 1.0, on_unsolvable="stop").run()


class Flat(Bowl):
    """Defined and without a slope from a parameter on; the slope of a jump before."""

    def __init__(self, slope: float, value: float) -> None:
        super().__init__()
        self.slope, self.value = slope, value

    def loss_jacobian(self, theta: Floats) -> LossJacobian:
        jacobian = super().loss_jacobian(theta)
        return dataclasses.replace(
            jacobian, values=np.array([self.value, 0.0]), gradients=np.array([[self.slope], [0.0]])
        )


def recorded(folder: Path) -> list[str]:
    return [row.split(",")[0] for row in (folder / "metrics.csv").read_text().splitlines()[1:]]


def test_terms_without_a_slope_have_converged(make: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    engine = Flat(0.0, 0.0)
    trainer = make(tmp_path, engine, 1.0, steps=1000, record_every=100)
    row = trainer.run()
    assert (trainer.ending.status, trainer.progress.converged_at) == ("finished", 0)
    assert len(engine.seen) < 30  # the records, and not the thousand steps
    assert recorded(tmp_path) == [str(step) for step in range(0, 1001, 100)]
    assert "step 0: converged" in capsys.readouterr().out
    assert "converged at step 0" in summary(row, trainer.progress)
    assert trainer.progress.guard_count == 2000  # as if each had been taken


def test_bfgs_that_finds_no_lower_point_on_a_slope_is_stuck(make: Make, tmp_path: Path) -> None:
    trainer = searching(make(tmp_path, Flat(1.0, 1.0), 1.0, steps=1000), adam_steps=0)
    trainer.run()
    assert trainer.ending.status == "stalled"
    assert trainer.ending.reason is not None
    assert "BFGS finds no lower point" in trainer.ending.reason
    assert recorded(tmp_path) == ["0", "4", "5"]  # an event later than it is seen, so that it never depends on time


def test_bfgs_at_the_minimum_has_converged(make: Make, tmp_path: Path) -> None:
    trainer = searching(make(tmp_path, Bowl(), 5.0, steps=200), adam_steps=0)
    trainer.run()
    assert trainer.theta[0] == pytest.approx(-1.0)
    assert trainer.ending.status == "finished"
    assert trainer.progress.converged_at is not None
    assert trainer.progress.step == 200


def test_a_stage_in_which_nothing_changes_gives_way_to_the_next(make: Make, tmp_path: Path) -> None:
    stuck, free = Flat(1.0, 1.0), Bowl()
    phases = [Phase(0, stuck, SCALES), Phase(500, free, SCALES)]
    trainer = searching(make(tmp_path, Bowl(), 5.0, phases=phases, steps=520, record_every=100), adam_steps=0)
    trainer.run()
    assert trainer.theta[0] == pytest.approx(-1.0)
    assert trainer.ending.status == "finished"
    assert recorded(tmp_path) == ["0", "100", "200", "300", "400", "500", "520"]
    assert len(stuck.seen) < 40


class Falling(Bowl):
    """No gradient where it cannot be solved."""

    def loss_jacobian(self, theta: Floats) -> LossJacobian:
        jacobian = super().loss_jacobian(theta)
        failed = jacobian.status is not Status.OK
        return dataclasses.replace(jacobian, gradients=np.full((2, 1), np.nan)) if failed else jacobian


def test_where_no_gradient_acts_it_ends_and_keeps_the_last_weights_that_could_be_solved(
    make: Make, tmp_path: Path
) -> None:
    trainer = make(tmp_path, Falling(limit=1.0), 0.4, steps=1000)
    trainer.optimizer.lr = lambda step: -0.3  # type: ignore[method-assign]  # uphill
    trainer.run()
    assert trainer.ending.status == "stalled"
    assert trainer.ending.reason is not None
    assert "the solve fails (underflow) and no gradient acts" in trainer.ending.reason
    assert "checkpoints/step-000000.safetensors" in trainer.ending.reason
    kept = load_file(tmp_path / "checkpoints" / "step-000000.safetensors")
    assert kept["layers.0.weight"] == 0.4
    assert trainer.progress.step <= 8


def test_parameters_that_are_not_finite_end_it(make: Make, tmp_path: Path) -> None:
    trainer = make(tmp_path, Bowl(), 1.0, steps=100_000)
    trainer.optimizer.lr = lambda step: -1e200  # type: ignore[method-assign]
    with np.errstate(over="ignore", invalid="ignore"):
        trainer.run()
    assert trainer.ending.status == "diverged"
    assert trainer.progress.step in (4, 5)


def test_sol_far_above_the_start_and_the_data_has_diverged(make: Make, tmp_path: Path) -> None:
    for zero, status in ((0.5, "diverged"), (1e6, "finished"), (np.nan, "finished")):
        trainer = dataclasses.replace(make(tmp_path / str(zero), Bowl(), 1.0), zero_sol=zero)
        trainer.optimizer.lr = lambda step: -0.2  # type: ignore[method-assign]
        assert trainer.run()["sol"] > 1e3
        assert trainer.ending.status == status


@dataclasses.dataclass
class Interrupter:
    """Ctrl-C before a certain line of this package's code; counts the lines."""

    at: float = np.inf
    lines: int = 0

    def __enter__(self) -> "Interrupter":
        sys.settrace(self._enter)
        return self

    def __exit__(self, *error: object) -> None:
        sys.settrace(None)

    def _enter(self, frame: FrameType, event: str, argument: object) -> object:
        return self._line if "eigenode_cli" in frame.f_code.co_filename else None

    def _line(self, frame: FrameType, event: str, argument: object) -> object:
        self.lines += 1
        if self.lines == self.at:
            raise KeyboardInterrupt
        return self._line


def momentum(trainer: Trainer) -> Trainer:
    config = Sgd(lr=0.1, momentum=0.5)
    return dataclasses.replace(trainer, optimizer=build_optimizer(config, trainer.theta.size))


def grown(trainer: Trainer) -> Trainer:
    """Two stages, each with a part of BFGS."""
    phases = [Phase(0, trainer.engine, SCALES), Phase(6, trainer.engine, 2.0 * SCALES)]
    return searching(dataclasses.replace(trainer, phases=phases), adam_steps=3)


def failing(trainer: Trainer) -> Trainer:
    """The first solves fail, and the others again where momentum carries it too far."""
    trainer.engine.limit = 0.5  # type: ignore[attr-defined]
    return momentum(trainer)


def outcome(folder: Path) -> tuple[list[str], dict[str, bytes]]:
    """metrics.csv but for the time, and every checkpoint."""
    rows = [row.split(",") for row in (folder / "metrics.csv").read_text().splitlines()]
    checkpoints = sorted((folder / "checkpoints").glob("*.safetensors"))
    tensors = {f"{path.name} {key}": array.tobytes() for path in checkpoints for key, array in load_file(path).items()}
    return [str(row[:1] + row[2:]) for row in rows], tensors


def resumed(make: Make, folder: Path, prepare: Callable[[Trainer], Trainer]) -> None:
    """Go on in a folder as a new process does, with whatever was saved there."""
    trainer, saved = prepare(make(folder, Bowl(), 1.0, opened=False)), load_last(folder)
    if saved is not None:
        trainer.go_on(saved)
    trainer.recorder.open(None if saved is None else trainer.progress.step)
    trainer.run()
    trainer.recorder.close()


@pytest.mark.parametrize("prepare", [momentum, grown, failing])
def test_interrupted_before_any_line_it_resumes_to_the_same_bytes(
    make: Make, tmp_path: Path, prepare: Callable[[Trainer], Trainer]
) -> None:
    whole = prepare(make(tmp_path / "whole", Bowl(), 1.0))
    with Interrupter() as counter:
        whole.run()
    expected, interrupted = outcome(tmp_path / "whole"), 0
    for line in range(1, counter.lines, 1 + counter.lines // 60):
        folder = tmp_path / str(line)
        cut = prepare(make(folder, Bowl(), 1.0))
        with contextlib.suppress(KeyboardInterrupt), Interrupter(line):
            cut.run()
        interrupted += cut.ending.status == "running"
        cut.recorder.close()
        resumed(make, folder, prepare)
        assert outcome(folder) == expected, line
    assert interrupted > 40


def test_after_an_interruption_the_trainer_itself_goes_on(make: Make, tmp_path: Path) -> None:
    whole, cut = (grown(make(tmp_path / name, Bowl(), 1.0)) for name in ("whole", "cut"))
    whole.run()
    with pytest.raises(KeyboardInterrupt), Interrupter(700):
        cut.run()
    assert 0 < cut.progress.step < 10
    cut.run()
    assert cut.theta.tobytes() == whole.theta.tobytes()


def test_a_half_written_row_is_cut_off(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, ("sol", "frq", "dmp", "stb", "osc", "stf"), np.zeros(3))
    header = metrics_header(recorder.names)
    rest = "," * header.count(",")
    (tmp_path / "metrics.csv").write_text(f"{header}\n0{rest}\n4{rest}\n8{rest}\n12,0.")
    recorder.open(8)
    recorder.close()
    assert [row.split(",")[0] for row in (tmp_path / "metrics.csv").read_text().splitlines()] == ["step", "0", "4"]
