"""A sweep, checked as a whole before its first run starts."""

import hashlib
import json
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, cast

from hydra._internal.config_loader_impl import get_overrides_dirname
from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.types import Override
from omegaconf import DictConfig, OmegaConf, open_dict

from eigenode_cli.config.check import Examined, examine_overrides, parse, without_effect
from eigenode_cli.config.compose import finalise
from eigenode_cli.config.composer import Composer, hydra_values
from eigenode_cli.config.plugins import expanded
from eigenode_cli.runs.paths import slug

Words = tuple[str, ...]
Kind = tuple[DictConfig, int]
"""Configuration, with its `hydra` node, and number of the runs that differ in the seed alone."""


@dataclass(frozen=True)
class Job:
    """One run of a sweep.

    Attributes:
        name: its folder within the sweep's: its settings, whatever their order on the command line.
        overrides: its settings, none of them Hydra's own.
        digest: of everything that the run depends on; equal digests mean equal runs.
    """

    name: str
    overrides: Words
    digest: str


@dataclass
class ExaminedSweep(Examined):
    """What came out of the command line of a sweep; `config` is that of its first run, on a fault there are no jobs."""

    jobs: list[Job] = field(default_factory=list)
    kinds: list[Kind] = field(default_factory=list)


def is_hydras(word: str) -> bool:
    """Whether an override is a setting of Hydra, not of the run."""
    return word.lstrip("+~").startswith(("hydra.", "hydra/"))


def examine_sweep(composer: Composer, ground: DictConfig, words: Sequence[str]) -> ExaminedSweep:
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
        return ExaminedSweep(None, faults)
    jobs = [tuple(expanded(job)) for job in BasicSweeper.split_arguments(overrides, None)[0]]
    faults = _twice(jobs)
    found: dict[Words, Examined] = {}
    for job in jobs:
        if _but_seed(job) not in found:
            parsed, _ = parse(composer, job)
            found[_but_seed(job)] = _without_repetitions(examine_overrides(composer, parsed))
    checked = list(found.values())
    faults += [fault for examined in checked for fault in examined.faults]
    useless = {key: fault for key, fault in checked[0].useless.items() if all(key in job.useless for job in checked)}
    if not (faults or useless):
        faults = [fault for examined in checked for fault in without_effect(examined)]
    result = ExaminedSweep(checked[0].config, list(dict.fromkeys(faults)), useless)
    if not result.faults:
        configs = {key: config for key, examined in found.items() if (config := examined.config) is not None}
        settings = {key: _plain(config) for key, config in configs.items()}
        counts = Counter(map(_but_seed, jobs))
        result.kinds = [(config, counts[key]) for key, config in configs.items()]
        result.jobs = [_job(composer, job, settings[_but_seed(job)]) for job in jobs]
    return result


def repeated(composer: Composer, config: DictConfig, words: Sequence[str]) -> list[Job]:
    """Return the runs that `repetitions=N` asks for: N seeds from `seed` on.

    Args:
        composer: reads the words.
        config: checked, with its `hydra` node.
        words: what the user typed.
    """
    own = [word for word in words if word.partition("=")[0] not in ("seed", "repetitions")]
    settings = _plain(config)
    return [_job(composer, (*own, f"seed={config.seed + i}"), settings) for i in range(config.repetitions)]


def settings_of(config: DictConfig, seed: int) -> DictConfig:
    """Return what a single run with this seed reads; `config` is checked and has its `hydra` node."""
    settings = of_seed(config, seed)
    with hydra_values(config), open_dict(settings):
        del settings["hydra"]
        return finalise(settings)


def of_seed(config: DictConfig, seed: int) -> DictConfig:
    """Return the configuration of a single run with this seed."""
    single = config.copy()
    single.seed, single.repetitions = seed, 1
    return single


def _plain(config: DictConfig) -> dict[str, Any]:
    """Every setting of a single run."""
    return cast(dict[str, Any], OmegaConf.to_container(settings_of(config, config.seed)))


def _job(composer: Composer, words: Words, settings: dict[str, Any]) -> Job:
    own = tuple(word for word in words if not is_hydras(word))
    if any(word.startswith("seed=") for word in own):  # it stands among the words; `settings` may be of another seed
        settings = {**settings, "seed": None}
    name = get_overrides_dirname(composer.parser.parse_overrides(list(own)), exclude_keys=[], item_sep=",", kv_sep="=")
    text = json.dumps([settings, sorted(own)], sort_keys=True)
    return Job(slug(name), own, hashlib.sha1(text.encode()).hexdigest())


def _expansion_fault(override: Override) -> str | None:
    line = override.input_line
    key = override.get_key_element().lstrip("+")
    if key == "hydra.sweep.subdir":
        return f"{line}: each run's folder is named by its settings; choose that of the sweep with hydra.sweep.dir"
    if not override.is_sweep_override():
        return None
    if is_hydras(key):
        return f"{line}: settings of Hydra cannot be swept; give one value"
    if not override.is_discrete_sweep():
        return f"{line}: no finite list of values; write choice(...) or range(...)"
    if not list(override.sweep_iterator()):
        return f"{line}: an empty sweep, no run would start; for example 'seed=range(3)' gives 0, 1, 2"
    return None


def _without_repetitions(examined: Examined) -> Examined:
    """In a sweep the seeds are swept; `repetitions` is for a single run."""
    config = examined.config
    if not examined.faults and config is not None and config.repetitions > 1:
        count = config.repetitions
        examined.faults.append(f"repetitions={count}: with -m sweep over the seeds instead: 'seed=range({count})'")
    return examined


def _twice(jobs: Sequence[Words]) -> list[str]:
    """Return a fault for the first run that is in the sweep twice: the second would write over the first."""
    seen: set[Words] = set()
    for job in jobs:
        if job in seen:
            return [f"{' '.join(job)}: the sweep has this run twice; name each value once"]
        seen.add(job)
    return []


def _but_seed(job: Words) -> Words:
    """Return what decides whether a job has to be checked by itself: everything but a plain seed."""
    return tuple(word for word in job if not re.fullmatch(r"seed=\d{1,18}", word))
