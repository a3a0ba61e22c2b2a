"""Units, a run of an experiment with one seed: planned once, trained once, found again ever after."""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed
from joblib.externals.loky import get_reusable_executor
from omegaconf import DictConfig, OmegaConf

from eigenode_cli.batch.job import complete
from eigenode_cli.batch.state import WAITING, State, recorded
from eigenode_cli.config.composer import keep_composition
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.config.sweep import of_seed
from eigenode_cli.runs.paths import OUTPUTS, slug
from eigenode_cli.training.ending import FINAL


@dataclass(frozen=True)
class Unit:
    """One training.

    Attributes:
        config: its configuration.
        folder: where it lies.
        words: start it by hand, behind `eigenode train`.
        composed: what Hydra composed for any seed, with its `hydra` node; kept in `.hydra/` where it is given.
    """

    config: TrainConfig
    folder: Path
    words: tuple[str, ...]
    composed: DictConfig | None = None

    @property
    def state(self) -> State:
        """How far it is; of another configuration, or damaged, it waits."""
        found = recorded(self.folder)
        return found if found.record.get("config") == container(self.config) else State(WAITING)

    @property
    def status(self) -> str:
        """How it stands, one of `ending.STATUSES`, or `waiting` where this configuration was never started."""
        return self.state.status


def container(config: TrainConfig) -> dict[str, Any]:
    """Return a configuration as it stands in run.json."""
    plain = OmegaConf.to_container(OmegaConf.structured(config), resolve=True)
    return json.loads(json.dumps(plain))


def folder_of(config: TrainConfig) -> Path:
    """Return the folder of a unit: named for people, and by a hash of every setting but the seed."""
    settings = container(config) | {"seed": None}
    mark = hashlib.sha1(json.dumps(settings, sort_keys=True).encode()).hexdigest()[:8]
    name = slug(f"{config.system.name}_{config.grads}")
    return OUTPUTS / "reproduce" / slug(config.protocol) / "runs" / f"{name}-{mark}" / f"seed{config.seed:04d}"


def seeded(
    config: TrainConfig, words: Sequence[str], repetitions: int, composed: DictConfig | None = None
) -> list[Unit]:
    """Return the units of a run with the seeds 0, 1, ...; the seed alone decides the weights, so they are paired.

    Args:
        config: the run's configuration with any seed.
        words: of `eigenode train`, but for the seed.
        repetitions: number of seeds.
        composed: see `Unit`.
    """
    configs = [replace(config, seed=seed) for seed in range(repetitions)]
    return [Unit(one, folder_of(one), (*words, f"seed={one.seed}"), composed) for one in configs]


def distinct(units: Sequence[Unit]) -> list[Unit]:
    """Return the units without those that another experiment asks for as well."""
    return list({unit.folder: unit for unit in units}.values())


def pending(units: Sequence[Unit]) -> list[Unit]:
    """Return the units that are still to be trained, or again where something failed."""
    return [unit for unit in units if unit.status not in FINAL]


def train_unit(unit: Unit) -> int:
    """Bring one unit to its end, see `batch.job.complete`; returns the exit status."""

    def prepare() -> None:
        if unit.composed is not None:
            keep_composition(of_seed(unit.composed, unit.config.seed), unit.folder, unit.words)

    return complete(unit.config, unit.folder, unit.words, lambda: unit.state, prepare=prepare)


def in_parallel(task: Callable[[Unit], Any], units: Sequence[Unit], jobs: int) -> Iterator[Any]:
    """Results of `task` on every unit as they come, from `jobs` processes.

    An interruption ends the processes as well; what they had saved is where the next call goes on.
    """
    if not units:
        return
    try:
        parallel = Parallel(n_jobs=min(jobs, len(units)), return_as="generator_unordered")
        yield from parallel(delayed(task)(unit) for unit in units)
    except (KeyboardInterrupt, GeneratorExit):
        if jobs > 1:
            get_reusable_executor().shutdown(wait=False, kill_workers=True)
        raise
