"""What a run is resumed from: checked like a command before anything in its folder is changed."""

from pathlib import Path

from eigenode_cli.config.build import build_method
from eigenode_cli.config.names import recorded_names
from eigenode_cli.config.outline import outline_of
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.config.warm_start import empty_field
from eigenode_cli.model import flat_parameters
from eigenode_cli.runs.recorder import LAST, complete_rows, load_last, metrics_header
from eigenode_cli.runs.runfile import RUN, RecordError
from eigenode_cli.training.optimizers import build_optimizer
from eigenode_cli.training.options import RETRY


def check_saved(config: TrainConfig, folder: Path) -> None:
    """Refuse what was saved last of a run where it is damaged, or does not go with the configuration.

    Args:
        config: of the run.
        folder: the run's.

    Raises:
        RecordError: the message names file, key and value.
    """
    saved = load_last(folder)
    if saved is None:
        return
    progress, theta, state = saved.progress, saved.theta, saved.optimizer
    steps = config.trainer.steps
    if progress.step > steps:
        raise RecordError(f"{RUN}: config.trainer.steps={steps}: {LAST} is of step {progress.step}; at least that many")
    expected = _parameters(config)
    if theta.shape != (expected,):
        hidden = getattr(config.network, "hidden", None)
        shown = f"config.network.name={config.network.name}" if hidden is None else f"config.network.hidden={hidden}"
        raise RecordError(f"{RUN}: {shown}: makes {expected} parameters, {LAST} holds {theta.size}")
    optimizer = build_optimizer(build_method(config), expected, retries=config.trainer.on_unsolvable == RETRY)
    needed = {name: array.shape for name, array in optimizer.state().items()}
    if {name: array.shape for name, array in state.items()} != needed:
        raise RecordError(
            f"{RUN}: config.optimizer.name={config.optimizer.name}: needs {', '.join(needed)}, {LAST} holds"
            f" {', '.join(state) or 'nothing'}"
        )
    header = metrics_header((*recorded_names(config), *sorted(config.terms)), tuple(optimizer.records))
    complete_rows(folder, header, progress.step)


def _parameters(config: TrainConfig) -> int:
    """Return the number of parameters P of the run."""
    return flat_parameters(empty_field(config)).size + sum(outline_of(config.system).blocks.values())
