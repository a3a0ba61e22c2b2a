"""From the runs of a sweep to one of Hydra's launchers: joblib, submitit, Ray, or one run after the other."""

import importlib.util
import os
from collections.abc import Iterable, Sequence

from hydra._internal.callbacks import Callbacks
from hydra.core.plugins import Plugins
from hydra.errors import HydraException
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, RunMode, TaskFunction
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from eigenode_cli.config.composer import Composer, explain
from eigenode_cli.config.sweep import Job
from eigenode_cli.errors import UserError
from eigenode_cli.sweep.job import work
from eigenode_cli.sweep.loader import SweepLoader
from eigenode_cli.sweep.plan import Sweep, quoted

EXTRAS = {
    "submitit_local": ("slurm", "hydra_plugins.hydra_submitit_launcher"),
    "submitit_slurm": ("slurm", "hydra_plugins.hydra_submitit_launcher"),
    "ray": ("ray", "hydra_plugins.hydra_ray_launcher"),
}
"""Extra and module of the launchers that do not come with a plain installation."""


SHARES, MOST_TOGETHER = 20, 8
"""In how many portions a joblib worker gets its jobs at least, and how many it gets at once at most."""


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


def launcher_faults(words: Iterable[str]) -> list[str]:
    """A fault with the line that installs it for a launcher that is not there."""
    faults = []
    for word in words:
        name = word.lstrip("+").removeprefix("hydra/launcher=")
        if name == word or name not in EXTRAS:
            continue
        extra, module = EXTRAS[name]
        if importlib.util.find_spec(module) is None:
            faults.append(f"{word}: not installed; pip install 'eigenode[{extra}]'")
    return faults


def launch(sweep: Sweep, pending: Sequence[Job], composer: Composer, words: Sequence[str]) -> None:
    """Run the pending jobs and return when all have ended; how, stands in their folders.

    Args:
        sweep: the checked sweep.
        pending: its jobs that are not finished.
        composer: composes the jobs.
        words: the user's settings of Hydra itself: the launcher and its options.

    Raises:
        UserError: the launcher refuses its settings.
    """
    own = [*words, quoted("hydra.sweep.dir", str(sweep.folder.resolve()))]
    launcher, config = launcher_of(composer, own, work, len(pending))
    jobs = [[*job.overrides, quoted("hydra.sweep.subdir", job.name)] for job in pending]
    size = _batch(config, len(jobs))
    for start in range(0, len(jobs), size):
        launcher.launch(jobs[start : start + size], initial_job_idx=start)


def launcher_of(composer: Composer, words: Sequence[str], task: TaskFunction, jobs: int) -> tuple[Launcher, DictConfig]:
    """The launcher of Hydra's that `words` name, which runs `task` for each of so many jobs, and its configuration.

    Raises:
        UserError: it refuses its settings.
    """
    try:
        loader = SweepLoader(composer.loader.get_search_path())
        config = loader.load_configuration(composer.config_name, list(words), RunMode.MULTIRUN)
        _send_together(config, jobs)
        context = HydraContext(config_loader=loader, callbacks=Callbacks(config))
        launcher = Plugins.instance().instantiate_launcher(hydra_context=context, task_function=task, config=config)
    except (HydraException, OmegaConfBaseException) as error:
        raise UserError(explain(error)) from error
    return launcher, config


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
    return min(jobs, cores())


def _batch(config: DictConfig, jobs: int) -> int:
    """How many jobs the launcher gets at a time: submitit's local mode would start all of them at once."""
    if config.hydra.sweeper.max_batch_size is not None:
        return config.hydra.sweeper.max_batch_size
    return cores() if config.hydra.runtime.choices["hydra/launcher"] == "submitit_local" else jobs
