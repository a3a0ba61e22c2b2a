"""From the runs of a sweep to one of Hydra's launchers: joblib, submitit, Ray, or one run after the other."""

import importlib.util
from collections.abc import Callable, Iterable, Sequence

from hydra._internal.callbacks import Callbacks
from hydra.core.plugins import Plugins
from hydra.errors import HydraException
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, RunMode, TaskFunction
from omegaconf import DictConfig, flag_override
from omegaconf.errors import OmegaConfBaseException

from eigenode_cli.batch.job import work
from eigenode_cli.batch.loader import SweepLoader
from eigenode_cli.batch.plan import Sweep, quoted
from eigenode_cli.config.composer import Composer, explain
from eigenode_cli.config.sweep import Job, Kind
from eigenode_cli.cpus import usable_cores
from eigenode_cli.errors import UserError

EXTRAS = {
    "submitit_local": ("slurm", "hydra_plugins.hydra_submitit_launcher"),
    "submitit_slurm": ("slurm", "hydra_plugins.hydra_submitit_launcher"),
    "ray": ("ray", "hydra_plugins.hydra_ray_launcher"),
}
"""Extra and module of the launchers that do not come with a plain installation."""

BASIC_SWEEPER = "hydra._internal.core_plugins.basic_sweeper.BasicSweeper"
Start = Callable[[Sequence[Job]], None]
"""Runs the jobs it is given and returns when all have ended."""

SHARES, MOST_TOGETHER = 20, 8
"""In how many portions a joblib worker gets its jobs at least, and how many it gets at once at most."""


def launcher_faults(words: Iterable[str]) -> list[str]:
    """Return a fault with the line that installs it for a launcher that is not there."""
    faults = []
    for word in words:
        name = word.lstrip("+").removeprefix("hydra/launcher=")
        if name == word or name not in EXTRAS:
            continue
        extra, module = EXTRAS[name]
        if importlib.util.find_spec(module) is None:
            faults.append(f"{word}: not installed; pip install 'eigenode[{extra}]'")
    return faults


def sweeper_faults(config: DictConfig) -> list[str]:
    """Return a fault for a sweeper that chooses its runs while it sweeps: here all are checked before the first."""
    if config.hydra.sweeper._target_ == BASIC_SWEEPER:
        return []
    name = config.hydra.runtime.choices["hydra/sweeper"]
    return [
        f"hydra/sweeper={name}: a sweep here runs every combination of listed values, checked before the first starts; "
        "leave it out and list them: key=A,B, choice(...) or range(...)"
    ]


def settings_faults(kinds: Sequence[Kind]) -> list[str]:
    """Faults of the launcher's settings in the configurations of a sweep, which has a single launcher."""
    hydras = [config.hydra for config, _ in kinds]
    if any(hydra.launcher != hydras[0].launcher for hydra in hydras):
        return ["hydra/launcher: the runs of this sweep name different launchers or settings of it; name one for all"]
    if hydras[0].launcher.get("n_jobs") == 0:
        return ["hydra.launcher.n_jobs=0: no run would start; give a number from 1, or -1 for one a core"]
    size = hydras[0].sweeper.max_batch_size
    if size is not None and size < 1:
        return [f"hydra.sweeper.max_batch_size={size}: no run would start; give a number from 1, or null for all"]
    return []


def launch(sweep: Sweep, composer: Composer, checked: DictConfig, words: Sequence[str]) -> Start:
    """Return what runs the pending jobs of a sweep and returns when all have ended; how, stands in their folders.

    Args:
        sweep: the checked sweep.
        composer: composes the jobs.
        checked: the configuration of the first run with its `hydra` node: its launcher runs all.
        words: the user's settings of Hydra itself.

    Raises:
        UserError: the launcher refuses its settings; nothing is written before.
    """
    loader = SweepLoader(composer.loader.get_search_path())
    config = _master(loader, composer, [*words, quoted("hydra.sweep.dir", str(sweep.folder.resolve()))])
    for group in ("launcher", "sweeper"):  # a group of the user's may have chosen them: such words are not Hydra's
        with flag_override(config, ["struct", "readonly"], [False, False]):
            config.hydra[group] = checked.hydra[group]
            config.hydra.runtime.choices[f"hydra/{group}"] = checked.hydra.runtime.choices[f"hydra/{group}"]
    _instantiated(loader, config, work)

    def start(pending: Sequence[Job]) -> None:
        _send_together(config, len(pending))
        launcher = _instantiated(loader, config, work)
        jobs = [[*job.overrides, quoted("hydra.sweep.subdir", job.name)] for job in pending]
        size = _batch(config, len(jobs))
        for first in range(0, len(jobs), size):
            launcher.launch(jobs[first : first + size], initial_job_idx=first)

    return start


def launcher_of(composer: Composer, words: Sequence[str], task: TaskFunction) -> Launcher:
    """Return the launcher of Hydra's that `words` name, which runs `task` for each job.

    Raises:
        UserError: it refuses its settings.
    """
    loader = SweepLoader(composer.loader.get_search_path())
    return _instantiated(loader, _master(loader, composer, words), task)


def _master(loader: SweepLoader, composer: Composer, words: Sequence[str]) -> DictConfig:
    """Return the configuration that a launcher starts from."""
    try:
        return loader.load_configuration(composer.config_name, list(words), RunMode.MULTIRUN)
    except (HydraException, OmegaConfBaseException) as error:
        raise UserError(explain(error)) from error


def _instantiated(loader: SweepLoader, config: DictConfig, task: TaskFunction) -> Launcher:
    try:
        context = HydraContext(config_loader=loader, callbacks=Callbacks(config))
        return Plugins.instance().instantiate_launcher(hydra_context=context, task_function=task, config=config)
    except (HydraException, OmegaConfBaseException) as error:
        raise UserError(explain(error)) from error


def _send_together(config: DictConfig, jobs: int) -> None:
    """Let joblib send several jobs at once where there are many: what Hydra sends along takes as long as 100 steps.

    Workers end at different times by at most as many runs, some per cent of all.
    """
    if "batch_size" in config.hydra.launcher and config.hydra.launcher.batch_size == "auto":
        share = jobs // (SHARES * workers(config, jobs))
        config.hydra.launcher.batch_size = str(min(MOST_TOGETHER, max(1, share)))


def workers(config: DictConfig, jobs: int) -> int:
    """How many runs go on at once, as far as that is known here: on a cluster it is for the cluster to say."""
    name = config.hydra.runtime.choices["hydra/launcher"]
    if name == "basic":
        return 1
    if name == "joblib" and config.hydra.launcher.n_jobs > 0:
        return min(jobs, config.hydra.launcher.n_jobs)
    return min(jobs, usable_cores())


def _batch(config: DictConfig, jobs: int) -> int:
    """How many jobs the launcher gets at a time: submitit's local mode would start all of them at once."""
    if config.hydra.sweeper.max_batch_size is not None:
        return config.hydra.sweeper.max_batch_size
    return usable_cores() if config.hydra.runtime.choices["hydra/launcher"] == "submitit_local" else jobs
