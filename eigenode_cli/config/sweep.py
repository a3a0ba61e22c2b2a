"""A sweep, checked as a whole before its first run starts."""

from collections.abc import Sequence

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.types import Override
from omegaconf import DictConfig

from eigenode_cli.config.composer import Composer
from eigenode_cli.config.examine import Examined, examine_overrides, parse

Job = tuple[str, ...]


def examine_sweep(composer: Composer, ground: DictConfig, words: Sequence[str]) -> Examined:
    """Check every run of a sweep; one config may stand for runs that differ in the seed alone.

    Args:
        composer: composes the runs.
        ground: any configuration of the sweep with its `hydra` node, for `hydra.sweeper.params`.
        words: what the user typed.

    Returns:
        The configuration of the first run, the faults of all; an option is useless if no run reads it.
    """
    params = [f"{key}={value}" for key, value in (ground.hydra.sweeper.get("params") or {}).items()]
    overrides, faults = parse(composer, [*params, *words])
    faults += [fault for override in overrides if (fault := _expansion_fault(override))]
    if faults:
        return Examined(None, faults)
    jobs = [tuple(job) for job in BasicSweeper.split_arguments(overrides, None)[0]]
    faults = _twice(jobs)
    found: list[Examined] = []
    for job in _without_equal_seeds(jobs):
        parsed, _ = parse(composer, job)
        found.append(examine_overrides(composer, parsed))
        faults += found[-1].faults
    useless = {key: fault for key, fault in found[0].useless.items() if all(key in job.useless for job in found)}
    return Examined(found[0].config, list(dict.fromkeys(faults)), useless)


def _expansion_fault(override: Override) -> str | None:
    if not override.is_sweep_override():
        return None
    line = override.input_line
    if override.get_key_element().lstrip("+").startswith(("hydra.", "hydra/")):
        return f"{line}: settings of Hydra cannot be swept; give one value"
    if not override.is_discrete_sweep():
        return f"{line}: no finite list of values; write choice(...) or range(...)"
    if not list(override.sweep_iterator()):
        return f"{line}: an empty sweep, no run would start; for example 'seed=range(3)' gives 0, 1, 2"
    return None


def _twice(jobs: Sequence[Job]) -> list[str]:
    """A fault for the first run that is in the sweep twice: the second would write over the first."""
    seen: set[Job] = set()
    for job in jobs:
        if job in seen:
            return [f"{' '.join(job)}: the sweep has this run twice; name each value once"]
        seen.add(job)
    return []


def _without_equal_seeds(jobs: Sequence[Job]) -> list[Job]:
    """The jobs to check: each combination of the other settings once, and each odd seed once."""
    chosen: dict[Job, Job] = {}
    for job in jobs:
        seeds = tuple(word for word in job if word.startswith("seed="))
        plain = all(word.removeprefix("seed=").isdecimal() for word in seeds)
        others = tuple(word for word in job if word not in seeds)
        chosen.setdefault((*others, *(() if plain else seeds)), job)
    return list(chosen.values())
