"""The way of one `eigenode reproduce`: experiments, units, training, measuring, verdicts, files."""

import copy
import hashlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from time import perf_counter
from typing import Any

from filelock import FileLock, Timeout

from eigenode_cli.config.check import examine as examine_words
from eigenode_cli.config.compose import run_config, typed
from eigenode_cli.config.composer import Composer
from eigenode_cli.console import counted, counter, duration
from eigenode_cli.errors import UserError, unknown
from eigenode_cli.reproduce.library import load, names, run_lines, words_of
from eigenode_cli.reproduce.measures import Result
from eigenode_cli.reproduce.planned_runs import Unit, distinct, in_parallel, pending, seeded, train_unit
from eigenode_cli.reproduce.schema import Experiment
from eigenode_cli.reproduce.verdicts import Verdict, judge
from eigenode_cli.runs.paths import OUTPUTS, slug
from eigenode_cli.training.ending import FINAL

DEFAULT_PROTOCOL = "paper"
INTERRUPTED = 130
"""Exit status of a run that the user interrupted."""
LOCK = ".lock"
"""File in the output folder that is held by who writes there."""


@dataclass(frozen=True)
class Study:
    """Experiments under one protocol with a number of seeds.

    Attributes:
        protocol: of every run that names none of its own.
        experiments: by name.
        units: of every run of every experiment, one a seed.
    """

    protocol: str
    repetitions: int
    experiments: dict[str, Experiment]
    units: dict[str, dict[str, list[Unit]]]

    @property
    def all_units(self) -> list[Unit]:
        """All units, each once, seed after seed, so that an interrupted study has whole repetitions."""
        listed = [unit for runs in self.units.values() for units in runs.values() for unit in units]
        return sorted(distinct(listed), key=lambda unit: unit.config.seed)

    @cached_property
    def results(self) -> dict[str, dict[str, list[Result]]]:
        """The result of every unit, in the order of `units`; read when a measure first asks for it."""
        known = {unit.folder: Result(unit) for unit in self.all_units}
        return {
            name: {label: [known[unit.folder] for unit in units] for label, units in runs.items()}
            for name, runs in self.units.items()
        }

    def measured(self, measure: str) -> list[Unit]:
        """Units that a claim asks this measure of."""
        return distinct(
            [
                unit
                for name, experiment in self.experiments.items()
                for claim in experiment.claims
                if claim.measure == measure
                for label in (claim.run, claim.against)
                if label is not None
                for unit in self.units[name][label]
            ]
        )

    def tabled(self) -> list[Unit]:
        """Units of the experiments that ask for the journal's table."""
        listed = [self.units[name] for name, experiment in self.experiments.items() if experiment.table]
        return distinct([unit for runs in listed for units in runs.values() for unit in units])

    def verdicts(self) -> list[Verdict]:
        """Return the verdict on every claim."""
        return [
            judge(name, claim, self.results[name])
            for name, experiment in self.experiments.items()
            for claim in experiment.claims
        ]


def choose(wanted: Sequence[str], protocol: str | None) -> tuple[str, dict[str, Experiment]]:
    """Protocol and experiments: those named, or all that are made for the protocol.

    Args:
        wanted: names of shipped experiments, or paths of files of your own, which end in .yaml.
        protocol: of all runs; None for the first that the first experiment is made for.

    Raises:
        UserError: with all that are wrong, or no experiment is made for the protocol.
    """
    experiments: dict[str, Experiment] = {}
    faults: list[str] = []
    for name in wanted or names():
        try:
            experiments[Path(name).stem] = load(name)
        except UserError as error:
            faults += error.faults
    if faults:
        raise UserError(faults)
    if wanted:
        return protocol or next(iter(experiments.values())).protocols[0], experiments
    chosen = protocol or DEFAULT_PROTOCOL
    mine = {name: one for name, one in experiments.items() if chosen in one.protocols and not one.by_name}
    if not mine:
        raise UserError(f"--protocol {chosen}: no experiment is made for it; name the experiments to run under it")
    return chosen, mine


def prepare(wanted: Sequence[str], protocol: str | None, repetitions: int) -> Study:
    """Check everything and plan the units.

    Raises:
        UserError: with all faults, before anything is trained.
    """
    composer = Composer()
    if protocol is not None and protocol not in composer.choices("protocol"):
        raise UserError(f"--protocol {protocol}: {unknown('protocol', protocol, composer.choices('protocol'))}")
    chosen, experiments = choose(wanted, protocol)
    faults: list[str] = []
    units: dict[str, dict[str, list[Unit]]] = {name: {} for name in experiments}
    for name, experiment in experiments.items():
        for label, run in experiment.runs.items():
            words = words_of(run, chosen)
            found = examine_words(composer, words)
            faults += run_lines(name, label, found)
            if not faults:
                composed = copy.deepcopy(found.config)
                units[name][label] = seeded(typed(run_config(found)), words, repetitions, composed)
    if faults:
        raise UserError(faults)
    return Study(chosen, repetitions, experiments, units)


def train(study: Study, jobs: int) -> None:
    """Train what is not finished yet."""
    units = study.all_units
    todo = pending(units)
    print(f"protocol {study.protocol}: {counted(len(units), 'run')}, {len(units) - len(todo)} of them finished before")
    start = perf_counter()
    failed = 0
    for status in _counted("training", in_parallel(train_unit, todo, jobs), len(todo)):
        if status == INTERRUPTED:  # the run has saved where it stands; the same command goes on from there
            raise KeyboardInterrupt
        failed += status != 0
    if todo:
        print(
            f"trained {counted(len(todo), 'run')} in {duration(perf_counter() - start)}"
            + (f", {failed} failed" * (failed > 0))
        )


def examine(study: Study, jobs: int) -> None:
    """Measure what the records do not hold: the test of the journal in parallel, times alone and one by one."""
    from eigenode_cli.reproduce.post_training import measure_gradient_cost, measure_test, measure_tight  # noqa: PLC0415  # torch

    tested = [unit for unit in distinct([*study.tabled(), *study.measured("test_sol")]) if unit.status in FINAL]
    for _ in _counted("testing", in_parallel(measure_test, tested, jobs), len(tested)):
        pass
    solved = [unit for unit in study.measured("tight_error") if unit.status in FINAL]
    for _ in _counted("solving again", in_parallel(measure_tight, solved, jobs), len(solved)):
        pass
    for unit in study.measured("gradient_cost"):
        if unit.status in FINAL:
            measure_gradient_cost(unit)


def default_output(study: Study) -> Path:
    """Where verdicts and figures go if the user says nothing: a folder that only the same study finds again.

    It is named for people, and by a hash of everything that the page shows: experiments, their runs and seeds.
    """
    name = f"{slug('+'.join(study.experiments))}_{counted(study.repetitions, 'seed').replace(' ', '-')}"
    shown = [*map(repr, study.experiments.values()), *sorted(str(unit.folder) for unit in study.all_units)]
    mark = hashlib.sha1("\n".join(shown).encode()).hexdigest()[:8]
    return OUTPUTS / "reproduce" / slug(study.protocol) / f"{name}-{mark}"


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Make the output folder, and keep other processes from writing into it.

    Raises:
        UserError: another one does, or the folder cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"--output {folder}: no folder can be made there ({error.strerror})") from error
    lock = FileLock(folder / LOCK)
    try:
        lock.acquire(blocking=False)
    except Timeout:
        hint = "wait until it ends, or name another folder with --output"
        raise UserError(f"{folder}: another eigenode reproduce writes into it; {hint}") from None
    try:
        yield
    finally:
        with suppress(OSError):  # Windows keeps a file that is open; elsewhere who waits for it sees that it is gone
            (folder / LOCK).unlink()
        lock.release()


def _counted(what: str, results: Iterable[Any], total: int) -> Iterator[Any]:
    """Yield the results, each counted as it comes."""
    if total:
        with counter(what, total, start=1) as shown:
            for done, result in enumerate(results, start=1):
                yield result
                shown.show(done)
