"""Composition for many runs: what differs in the seed alone is composed once in each process."""

import copy
import json
import re

from omegaconf import DictConfig, flag_override

from eigenode_cli.config.composer import Loader
from eigenode_cli.config.plugins import forced

_SEED = re.compile(r"seed=(\d{1,18})")
_SUBDIR = "hydra.sweep.subdir="

_composed: dict[tuple[str, ...], DictConfig] = {}
"""Of this process, by everything that a composition depends on: seconds of Hydra's work for each short run else."""


class SweepLoader(Loader):
    """Hydra's loader, which launchers ask for the configuration of each run."""

    def load_sweep_config(self, master_config: DictConfig, sweep_overrides: list[str]) -> DictConfig:
        """Return the configuration of one run; see Hydra's method of this name."""
        seeds = [match[1] for word in sweep_overrides if (match := _SEED.fullmatch(word))]
        shared = [word for word in sweep_overrides if not (_SEED.fullmatch(word) or word.startswith(_SUBDIR))]
        if not seeds:
            return super().load_sweep_config(master_config, forced(sweep_overrides))
        path = [str(element) for element in self.get_search_path().get_path()]
        key = (*path, str(master_config.hydra.job.config_name), *master_config.hydra.overrides.hydra, *shared)
        if key not in _composed:
            _composed[key] = super().load_sweep_config(master_config, forced(shared))
        return _with_seed(copy.deepcopy(_composed[key]), int(seeds[-1]), sweep_overrides)


def _with_seed(config: DictConfig, seed: int, words: list[str]) -> DictConfig:
    """Return the same configuration with another seed, and with the words that make it."""
    own = [word for word in words if not word.startswith(_SUBDIR)]
    with flag_override(config, ["struct", "readonly"], [False, False]):
        config.seed = seed
        config.hydra.overrides.task = own
        config.hydra.job.override_dirname = ",".join(sorted(own))
        for word in words:
            if word.startswith(_SUBDIR):
                config.hydra.sweep.subdir = json.loads(word.removeprefix(_SUBDIR))
    return config
