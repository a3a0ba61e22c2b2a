"""Composition by Hydra: the schema is registered, config folders are searched, a configuration comes out.

The only module, beside the sweep's expansion, that reaches into Hydra's internals, which its release is pinned for:
the public compose functions take no `--config-dir`.
"""

import copy
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import yaml
from hydra import version
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.config_repository import IConfigRepository
from hydra._internal.hydra import Hydra
from hydra._internal.utils import create_config_search_path
from hydra.core.config_search_path import SearchPathQuery
from hydra.core.config_store import ConfigStore
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.utils import _save_config, setup_globals
from hydra.errors import HydraException
from hydra.types import RunMode, TaskFunction
from omegaconf import DictConfig, OmegaConf, flag_override
from omegaconf.errors import OmegaConfBaseException

from eigenode_cli.config.plugins import forced
from eigenode_cli.config.schema import SCHEMAS
from eigenode_cli.config.structure import Composed, structured
from eigenode_cli.errors import UserError
from eigenode_cli.runs.paths import CONFIG_DIR, EXPERIMENT_DIR

VERSION_BASE = "1.3"
OURS = {
    "hydra/launcher": "joblib",
    "hydra/job_logging": "none",
    "hydra/hydra_logging": "none",
    "hydra.job.name": "train",
    "hydra.job.chdir": "false",
    "hydra.run.dir": "auto",
    "hydra.sweep.dir": "auto",
    "hydra.sweep.subdir": "auto",
}
"""Settings of Hydra that `train.yaml` makes."""
EXPERIMENTS = "experiments"
"""Provider of the shipped experiments, whose folder `measured` is a group of configs."""
COMMAND_LINE = "command-line"
"""Provider of the configs in `--config-dir`."""
DIFFERENCES = ("protocol_system", "protocol_network", "protocol_combine", "protocol_optimizer")
"""Groups that a protocol chooses from, not the user."""


def _register() -> None:
    store = ConfigStore.instance()
    store.store(name="train_schema", node=Composed)
    for group, schemas in SCHEMAS.items():
        for name, schema in schemas.items():
            store.store(group=f"schema/{group}", name=name, node=schema)


_register()


class Loader(ConfigLoaderImpl):
    """Hydra's loader; a primary config that is not built on ours gets our settings of Hydra and the schema as well."""

    def load_configuration(
        self,
        config_name: str | None,
        overrides: list[str],
        run_mode: RunMode,
        from_shell: bool = True,
        validate_sweep_overrides: bool = True,
    ) -> DictConfig:
        """Return the configuration with its `hydra` node; see Hydra's method of this name."""
        load = partial(
            super().load_configuration,
            config_name,
            run_mode=run_mode,
            from_shell=from_shell,
            validate_sweep_overrides=validate_sweep_overrides,
        )
        config = load(overrides)
        if OmegaConf.get_type(config) is Composed:
            return config
        chosen = {word.partition("=")[0].lstrip("+") for word in overrides}
        return structured(load([*(f"{key}={value}" for key, value in OURS.items() if key not in chosen), *overrides]))


class Composer:
    """Composes configurations from the shipped folder and, where given, one of the user's.

    Args:
        config_dir: a further folder of configs (`--config-dir`), relative to the current one.
        config_name: name of the primary config (`--config-name`).
    """

    def __init__(self, config_dir: str | None = None, config_name: str = "train") -> None:
        version.setbase(VERSION_BASE)
        setup_globals()
        search_path = create_config_search_path(str(CONFIG_DIR))
        search_path.prepend(EXPERIMENTS, f"file://{EXPERIMENT_DIR}", SearchPathQuery(provider="schema", path=None))
        if config_dir is not None:
            folder = Path(config_dir).resolve()
            if not folder.is_dir():
                raise UserError(f"--config-dir {config_dir}: no such folder")
            search_path.prepend(COMMAND_LINE, f"file://{folder}", SearchPathQuery(provider="schema", path=None))
        self.config_name = config_name
        self.loader = Loader(search_path)
        self.parser = OverridesParser.create(config_loader=self.loader)
        self._composed: dict[tuple[str, ...], DictConfig] = {}
        self._choices: dict[tuple[str, ...], list[str]] = {}
        self._repositories: dict[tuple[str, ...], IConfigRepository] = {}

    def choices(self, group: str, words: Sequence[str] = ()) -> list[str]:
        """Names of the choices of a group, empty if there is no such group; `words` may add a `hydra.searchpath`."""
        key = (group, *words)
        if key not in self._choices:
            self._choices[key] = self._repository(tuple(words)).get_group_options(group)
        return self._choices[key]

    def _repository(self, words: tuple[str, ...]) -> IConfigRepository:
        """All configs there are to choose from; Hydra itself looks for them again at every question."""
        if words not in self._repositories:
            with _explained():
                _, found = self.loader._parse_overrides_and_create_caching_repo(self.config_name, list(words))
            self._repositories[words] = found
        return self._repositories[words]

    @cached_property
    def defaults(self) -> dict[str, str | None]:
        """The choice of every group where the user makes none."""
        with _explained():
            found = self.loader.compute_defaults_list(self.config_name, [], RunMode.RUN)
        return dict(found.overrides.known_choices)

    @property
    def groups(self) -> list[str]:
        """Groups that the user chooses from with `group=choice`."""
        return [group for group in self.defaults if "/" not in group and group not in DIFFERENCES]

    def composed(self, words: tuple[str, ...]) -> DictConfig:
        """Return a fresh copy of the configuration with its `hydra` node, the words applied by Hydra.

        Raises:
            UserError: Hydra cannot compose it.
        """
        if words not in self._composed:
            with _explained():
                self._composed[words] = self.loader.load_configuration(self.config_name, list(words), RunMode.RUN)
        return copy.deepcopy(self._composed[words])

    def run(self, task: TaskFunction, words: Sequence[str]) -> Any:
        """Run `task` as one job of Hydra's, in the folder and with the configuration that the words give.

        `hydra.main` does the same, but composes twice more, first to find out that this is no sweep.
        """
        return Hydra("train", self.loader).run(self.config_name, task, forced(words)).return_value


def keep_composition(config: DictConfig, folder: Path, words: Sequence[str]) -> None:
    """Write `.hydra/` into the folder of a run that is no job of Hydra's, as Hydra writes it for its own.

    Args:
        config: the run's, with its `hydra` node; nothing is written where `hydra.output_subdir` is null.
        folder: the run's, which becomes `hydra.run.dir`.
        words: the settings of the run.
    """
    if config.hydra.output_subdir is None:
        return
    settings = config.copy()
    with flag_override(settings, ["struct", "readonly"], [False, False]):
        hydra = settings.pop("hydra")
        hydra.run.dir = folder.as_posix()
        hydra.runtime.output_dir = str(folder.resolve())
        hydra.overrides.task = list(words)
    place = folder / config.hydra.output_subdir
    _save_config(settings, "config.yaml", place)
    _save_config(OmegaConf.create({"hydra": hydra}), "hydra.yaml", place)
    _save_config(OmegaConf.select(hydra, "overrides.task"), "overrides.yaml", place)


@contextmanager
def _explained() -> Iterator[None]:
    """Whatever Hydra does not like, warnings included, as the user's mistake."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            yield
        except (HydraException, OmegaConfBaseException, yaml.YAMLError, ValueError, OSError) as error:
            raise UserError(explain(error)) from error
    if caught:
        raise UserError([_one_line(str(warning.message)) for warning in caught])


def own_flags() -> list[str]:
    """Return the flags that gave the present job its configs: `--config-dir=...`, `--config-name=...`."""
    hydra = HydraConfig.get()
    folders = [source.path for source in hydra.runtime.config_sources if source.provider == COMMAND_LINE]
    name = hydra.job.config_name
    return [*(f"--config-dir={folder}" for folder in folders), *([f"--config-name={name}"] if name != "train" else [])]


def explain(error: BaseException) -> str:
    """Any error of Hydra, OmegaConf or YAML in one line."""
    parts = [str(error)]
    if isinstance(error.__cause__, OmegaConfBaseException | HydraException):
        parts.append(str(error.__cause__))
    text = ": ".join(_one_line(part) for part in parts if part)
    return text or type(error).__name__


def _one_line(text: str) -> str:
    """Return the message without the search path, without OmegaConf's appendix, and without line breaks."""
    text = text.partition("Config search path:")[0]
    lines = (line.strip() for line in text.splitlines())
    return " ".join(line for line in lines if line and not line.startswith(("full_key:", "object_type=")))


@contextmanager
def hydra_values(config: DictConfig) -> Iterator[None]:
    """Let `${hydra:...}` in `config` (with its `hydra` node) resolve, as it does inside a job."""
    state = HydraConfig.instance()
    before = state.cfg
    state.set_config(config)
    OmegaConf.set_readonly(config.hydra, None)  # set_config locks it
    try:
        yield
    finally:
        state.cfg = before
