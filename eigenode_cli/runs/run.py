"""One run: from a configuration to a folder with curves."""

import shlex
import subprocess
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import torch
from omegaconf import OmegaConf

from eigenode_cli import __version__
from eigenode_cli.config.build import build_field, build_solver, build_system
from eigenode_cli.config.schema import (
    CombineConfig,
    SequentialConfig,
    StatedTargetConfig,
    TrainConfig,
    TruthTargetConfig,
)
from eigenode_cli.console import Display, QuietDisplay, display
from eigenode_cli.data.dataset import Data, Floats, Targets
from eigenode_cli.data.simulate import reference_solution, sample, stated_targets, truth_targets, with_noise
from eigenode_cli.engines.base import Engine, unheard
from eigenode_cli.engines.factory import build_engine
from eigenode_cli.engines.problem import Problem
from eigenode_cli.interruption import check
from eigenode_cli.model import VectorField, flat_parameters, load_flat
from eigenode_cli.runs.atomic import Reserve, WriteError, write_text
from eigenode_cli.runs.final_outputs import write_eigenvalues, write_solution
from eigenode_cli.runs.lock import locked
from eigenode_cli.runs.recorder import Progress, Recorder, load_last, metrics_header, write_data, write_json
from eigenode_cli.runs.resumption import check_saved
from eigenode_cli.runs.runfile import VERSION, resume_command
from eigenode_cli.systems import System
from eigenode_cli.terms import NAMES, canonical, split_grads, training_terms
from eigenode_cli.terms.errors import ERRORS, error_value
from eigenode_cli.terms.user import TermFailed, load_user_terms
from eigenode_cli.training.combine import COMBINATIONS, SEQUENTIAL_REPEATING_LAST
from eigenode_cli.training.curriculum import build_stages
from eigenode_cli.training.ending import DIVERGED, FAILED, FINISHED, INTERRUPTED, STALLED, Ending
from eigenode_cli.training.optimizers import build_optimizer
from eigenode_cli.training.trainer import Stage, Trainer, Unsolvable, summary

DENSE = 1000
"""Number of equidistant times of the horizon at which dense_error compares."""

EXIT = {FINISHED: 0, FAILED: 1, STALLED: 1, DIVERGED: 1, INTERRUPTED: 130}
"""Exit status by the status of the run."""

PACKAGES = ("torch", "torchdiffeq", "numba", "numpy", "scipy", "hydra-core", "omegaconf", "pandas", "matplotlib")


@dataclass(frozen=True)
class Setup:
    """The parts that a configuration describes, built."""

    config: TrainConfig
    system: System
    data: Data
    problem: Problem
    field: VectorField
    engine: Engine
    stages: tuple[Stage, ...]
    """What trains at each step; `engine` is that of the records."""
    names: tuple[str, ...]
    """All terms that are recorded: the six and the user's own."""

    @property
    def engines(self) -> set[Engine]:
        """All of them, each once."""
        return {self.engine, *(stage.engine for stage in self.stages)}


def build(config: TrainConfig, announce: Callable[[str], None] = print) -> Setup:
    """Build everything that a run needs, in the order of the data flow.

    Args:
        config: the checked configuration.
        announce: called with a line that the user should see.

    Raises:
        ValueError: something that only shows when it is built: a system without a solution, a term without a function.
    """
    torch.set_num_threads(1)  # the matrices are small, and a launcher's setting must not change a result
    torch.manual_seed(config.seed)
    system = build_system(config.system)
    start = np.array(config.system.initial_state, dtype=np.float64)
    truth = sample(system, start, config.system.horizon, config.system.points, config.system.observed)
    data = with_noise(truth, config.system.noise, config.seed)
    terms = canonical(split_grads(config.grads))
    problem = Problem(
        data=data,
        targets=build_targets(config, system, truth),
        every=config.eigen.every,
        terms=terms,
        errors=np.array([ERRORS[getattr(config.error, name)] for name in NAMES], dtype=np.int64),
        huber_delta=config.error.huber_delta,
        margin=config.eigen.margin,
        max_condition=config.eigen.max_condition,
        jacobian=config.eigen.jacobian,
        solver=build_solver(config.solver),
        stabilise=config.trainer.on_unsolvable == "stabilise",
    )
    field = build_field(config.network, truth.states, system.dynamics(truth.states), config.seed)
    user_terms = load_user_terms(config.terms, training_terms(config.grads, config.trainer.pretrain), announce)
    engine = build_engine(config, field, problem, user_terms, announce)
    stages = build_stages(config, field, problem, user_terms, engine)
    return Setup(config, system, data, problem, field, engine, stages, (*NAMES, *user_terms))


def build_targets(config: TrainConfig, system: System, truth: Data) -> Targets:
    """The targets of every spectrum; `truth` is the data before any noise."""
    states = truth.states[:: config.eigen.every]
    target = config.target
    if isinstance(target, StatedTargetConfig):
        targets = stated_targets(target.frequency, target.damping, states.shape[0])
    elif isinstance(target, TruthTargetConfig):
        targets = truth_targets(system, states, target.frequency_factor)
    else:
        raise TypeError(f"no targets come from a {type(target).__name__}")
    if target.stiffness is not None:
        targets.stiffness[:] = target.stiffness
    return targets


def combination(config: CombineConfig) -> int:
    """Code of the combination that a configuration names."""
    if isinstance(config, SequentialConfig) and config.repeat_last_update:
        return SEQUENTIAL_REPEATING_LAST
    return COMBINATIONS[config.name]


def train(
    config: TrainConfig, folder: Path, overrides: Sequence[str], quiet: bool = False, watch: Display | None = None
) -> int:
    """Run one training in `folder`; returns the exit status (0 done, 1 failed, stalled or diverged, 130 interrupted).

    Args:
        config: the checked configuration.
        folder: exists, and holds no other run.
        overrides: what the user changed; with them run.json names the command that repeats this run.
        quiet: print nothing, for one run among many; everything that happened stands in the folder.
        watch: is shown every record of a quiet run.
    """
    record = _identity(config)
    record["command"] = shlex.join(["eigenode", "train", *overrides])
    with locked(folder):
        return _attended(config, folder, record, resumed=False, quiet=quiet, watch=watch)


def resume(
    config: TrainConfig, folder: Path, previous: dict[str, Any], quiet: bool = False, watch: Display | None = None
) -> int:
    """Go on with the run in `folder` from what it saved last; `previous` is its run.json.

    Raises:
        UserError: what it saved is damaged or does not go with `config`, or another process works in the folder.
    """
    with locked(folder):
        identity = _identity(config)
        names = (*NAMES, *sorted(config.terms))
        check_saved(config, folder, metrics_header(names))
        kept = {key: previous.get(key, identity[key]) for key in ("command", "started", "wall_seconds")}
        return _attended(config, folder, identity | kept, resumed=True, quiet=quiet, watch=watch)


def _attended(
    config: TrainConfig, folder: Path, record: dict[str, Any], resumed: bool, quiet: bool, watch: Display | None
) -> int:
    """Run a training so that run.json, filled from `record` on, tells how it ended, whatever happens."""
    start = perf_counter()
    reserve, full = Reserve(folder), None
    reserve.take()
    write_json(folder / "run.json", record)
    try:
        setup = build(config, unheard if quiet else print)
        record |= _description(setup)
        write_json(folder / "run.json", record)
        ending = _train(setup, folder, record, resumed, (watch or QuietDisplay()) if quiet else None, start)
    except KeyboardInterrupt:
        ending = Ending(INTERRUPTED, "interrupted by the user")
    except Unsolvable as error:
        ending = Ending(FAILED, str(error))
    except WriteError as error:  # once there is room, it goes on from what was saved
        ending, full = Ending(INTERRUPTED, str(error)), error
    except Exception as error:  # whatever it was: the folder tells, a sweep goes on
        with suppress(WriteError):
            write_text(folder / "error.txt", traceback.format_exc())
        said = str(error) if isinstance(error, TermFailed) else f"{type(error).__name__}: {error}"
        ending = Ending(FAILED, f"{said} (traceback in error.txt)")
    record |= {"status": ending.status, "error": ending.reason}
    record["wall_seconds"] += perf_counter() - start
    try:
        reserve.give()
        write_json(folder / "run.json", record)
    except WriteError as error:
        full = full or error
        if not quiet:
            print(f"eigenode: {error}", file=sys.stderr)
    if not quiet:
        _tell(folder, record)
    if full is not None:
        return EXIT[FAILED]
    drawn = draw(folder, quiet) if config.trainer.figures and record["final"] else EXIT[FINISHED]
    return EXIT[ending.status] or drawn


def _train(
    setup: Setup, folder: Path, record: dict[str, Any], resumed: bool, shown: Display | None, start: float
) -> Ending:
    """Train from the start, or from what was saved last, and write the outcome; fills `record` as it gets there.

    Args:
        setup: the parts.
        folder, record: of the run.
        resumed: whether to look for something saved.
        shown: shows the progress, by default what fits standard output.
        start: reading of the clock at which `record` was right about `wall_seconds`.

    Returns:
        How it ended.
    """
    config, horizon = setup.config, setup.config.system.horizon
    saved = load_last(folder) if resumed else None
    theta = flat_parameters(setup.field)
    optimizer = build_optimizer(config.optimizer, theta.size)
    progress = Progress()
    if saved is not None:
        progress, theta, state = saved
        for name, array in optimizer.state().items():
            array[:] = state[name]
    record["wall_seconds"] = max(record["wall_seconds"], progress.wall_seconds)  # a kill leaves the latter alone
    dense_times = np.linspace(0.0, horizon, DENSE)
    truth = reference_solution(setup.system, setup.problem.initial_state, dense_times)
    recorder = Recorder(folder, setup.names, truth[:, 0])
    write_data(folder, [state.name for state in setup.system.states], setup.data)
    label = f"{config.system.name} {'+'.join(setup.problem.terms)} seed {config.seed}"
    shown = shown or display(label, progress.step, config.trainer.steps)
    trainer = Trainer(
        engine=setup.engine,
        stages=setup.stages,
        optimizer=optimizer,
        combination=combination(config.combine),
        terms=setup.problem.terms,
        config=config.trainer,
        recorder=recorder,
        display=shown,
        dense_times=dense_times,
        theta=theta,
        network=partial(_network_state, setup.field),
        progress=progress,
        zero_sol=_sol_of_zero(setup.problem),
        wall=partial(_elapsed, record["wall_seconds"] - start),
    )
    recorder.open(progress.step if saved is not None else None)
    try:
        with shown:
            last = trainer.run()
    finally:
        recorder.close()
        record |= _account(trainer, setup)
    load_flat(setup.field, theta)
    write_solution(folder, setup.system, setup.engine, theta, setup.data, config.system.horizon)
    write_eigenvalues(folder, setup.system, setup.field, setup.engine, theta, setup.problem, config.target)
    record |= {"final": last, "summary": summary(last, trainer.progress)}
    return trainer.ending


def _elapsed(offset: float) -> float:
    return offset + perf_counter()


def _sol_of_zero(problem: Problem) -> float:
    """SOL of a model that stays at zero, NaN where SOL does not train."""
    if "sol" not in problem.terms:
        return float("nan")
    error = getattr(error_value, "py_func", error_value)  # as Python: to compile it would take longer
    seen = problem.data.states[problem.data.mask].tolist()
    return float(np.mean([error(problem.errors[0], problem.huber_delta, value) for value in seen]))


def _account(trainer: Trainer, setup: Setup) -> dict[str, Any]:
    """What a training took so far."""
    progress = trainer.progress
    return {
        "steps": progress.step,
        "train_seconds": progress.train_seconds,
        "compile_seconds": sum(engine.compile_seconds for engine in setup.engines),
        "unsolvable_steps": progress.unsolvable_steps,
        "guard_count": progress.guard_count,
        "converged_at": progress.converged_at,
    }


def _network_state(field: VectorField, theta: Floats) -> dict[str, torch.Tensor]:
    load_flat(field, theta)
    return field.network.state_dict()


def _identity(config: TrainConfig) -> dict[str, Any]:
    """What is known of a run before anything is built."""
    return {
        "version": VERSION,
        "status": "running",
        "error": None,
        "seed": config.seed,
        "grads": "+".join(canonical(split_grads(config.grads))),
        "config": OmegaConf.to_container(OmegaConf.structured(config), resolve=True),
        "command": "",
        "versions": {"eigenode": __version__, "python": sys.version.split()[0], **_versions()},
        "git_commit": _git_commit(),
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "steps": 0,
        "train_seconds": 0.0,
        "compile_seconds": 0.0,
        "wall_seconds": 0.0,
        "final": {},
    }


def _description(setup: Setup) -> dict[str, Any]:
    """What is known of a run once its parts are built."""
    return {
        "engine": setup.engine.name,
        "parameters": sum(p.numel() for p in setup.field.parameters()),
        "system": {
            "name": setup.config.system.name,
            "title": setup.system.title,
            "states": [asdict(state) for state in setup.system.states],
            "parameters": [asdict(parameter) for parameter in setup.system.parameters],
        },
    }


@cache
def _versions() -> dict[str, str]:
    return {package: version(package) for package in PACKAGES}


@cache
def _git_commit() -> str | None:
    """Commit of the checkout that this package runs from, None for an installed one."""
    here = Path(__file__).resolve().parents[1]
    if not (here.parent / ".git").exists():
        return None
    git = subprocess.run(["git", "-C", here, "rev-parse", "HEAD"], capture_output=True, text=True, check=False)
    return git.stdout.strip() or None


def draw(folder: Path, quiet: bool) -> int:
    """Draw figures and page of a run whose record is complete and stays as it is; returns the exit status.

    It is 0 even where the figures fail, which is said in a line on standard error, and 130 where they are interrupted.
    """
    again = f"the run is recorded; draw it again with: eigenode plot {folder} and eigenode report {folder}"
    try:
        from eigenode_cli.reporting.figures import draw_run  # noqa: PLC0415  # matplotlib and pandas, only once they are needed
        from eigenode_cli.reporting.report import write_report  # noqa: PLC0415

        for fault in draw_run(folder).faults:
            print(f"eigenode: {fault}", file=sys.stderr)
        check()
        write_report(folder)
        if not quiet:
            print(f"figures {folder / 'plots'}\nreport  {folder / 'report.html'}")
    except KeyboardInterrupt:
        print(f"eigenode: the figures were interrupted; {again}", file=sys.stderr)
        return EXIT[INTERRUPTED]
    except Exception as error:  # whatever it was: the training is recorded
        print(f"eigenode: the figures failed ({type(error).__name__}: {error}); {again}", file=sys.stderr)
    return EXIT[FINISHED]


def _tell(folder: Path, record: dict[str, Any]) -> None:
    """Say how the run ended and where everything is."""
    if record["status"] != FINISHED:
        print(f"eigenode: {record['status']}: {record['error']}", file=sys.stderr)
    if record["status"] == INTERRUPTED:
        print(f"go on with: {resume_command(folder, record['command'])}", file=sys.stderr)
    if record["final"]:
        print(f"{record['summary']}\nrun     {folder}")
