"""Schema of the optimizers and of the schedules of their learning rate."""

from dataclasses import dataclass

from omegaconf import MISSING

from eigenode_cli.config.validators import option


@dataclass
class OptimizerConfig:
    """Turns updates into new parameters."""

    name: str = MISSING
    lr: float = option(above=0)
    """Learning rate; `schedule` says how it changes."""


@dataclass
class OwnOptimizerConfig(OptimizerConfig):
    """An optimizer of the user's own."""

    target: str = MISSING
    """The class, `module:Class`; its constructor takes `lr` and the options that are not here."""


@dataclass
class AdamConfig(OptimizerConfig):
    """Adam (Kingma & Ba 2015)."""

    beta1: float = option(at_least=0, below=1)
    beta2: float = option(at_least=0, below=1)
    eps: float = option(above=0)


@dataclass
class FirstOrderAdamConfig(AdamConfig):
    """Adam from the first step to the last."""

    clip: float | None = option(above=0)
    """Largest norm of an update's gradient; a longer one is shortened to it and counted in the column `clipped`; null
    for any."""


@dataclass
class AdamBfgsConfig(AdamConfig):
    """Adam, then BFGS with a line search."""

    adam_steps: int = option(at_least=0)
    """Leading training steps that Adam takes, with the updates of `combine`; BFGS takes all others, on the sum of the
    scaled terms, whatever `combine` is."""
    pairs: int = option(at_least=0)
    """How many of the last steps BFGS remembers (L-BFGS, for thousands of parameters); 0 for all, in a dense matrix."""


@dataclass
class LeastSquaresConfig(AdamConfig):
    """Levenberg-Marquardt on the residuals of all terms; Adam's update only where the solve fails.

    Scales are relative to the natural unit of each term (the size of the data, of the target), whatever `combine` is.
    """

    damping: float = option(above=0)
    """First damping of each horizon, in units of the mean of the diagonal of J^T J."""
    tolerance: float = option(at_least=0, below=1)
    """A horizon has converged where a step lowers the sum of squares by less than this share."""
    ridge: float = option(at_least=0)
    """Factor of the squared parameters of the network, added to the sum of squares; the first one with `evidence`."""
    evidence: bool = MISSING
    """Whether the ridge follows the evidence of the data (MacKay 1992), which knows noise from signal, over the last
    horizon."""
    evidence_ridge: float = option(above=0)
    """Ridge that the evidence starts from: a large one leads to the simplest model that explains the data."""


@dataclass
class SgdConfig(OptimizerConfig):
    """Gradient descent with momentum."""

    momentum: float = option(at_least=0, below=1)
    clip: float | None = option(above=0)
    """As of Adam."""


@dataclass
class ScheduleConfig:
    """How the learning rate changes with the training steps."""

    name: str = MISSING


@dataclass
class ExponentialConfig(ScheduleConfig):
    """`lr + extra exp(-rate k)` at training step k."""

    extra: float = option(at_least=0)
    """What is added to the learning rate at first."""
    rate: float = option(at_least=0)
    """How fast that decays, per training step."""
    every: int = option(at_least=1)
    """Training steps between changes."""


@dataclass
class CosineConfig(ScheduleConfig):
    """From the learning rate down to a share of it along half a cosine, over the whole training."""

    final: float = option(at_least=0, at_most=1)
    """Learning rate of the last step, as a share of the first."""


@dataclass
class PlateauConfig(ScheduleConfig):
    """Smaller whenever the sum of the scaled terms has not fallen for some records."""

    factor: float = option(above=0, below=1)
    """Of the learning rate at each plateau."""
    patience: int = option(at_least=1)
    """Records without a new lowest value that make a plateau."""
    smallest: float = option(at_least=0, at_most=1)
    """Smallest learning rate, as a share of the first."""
