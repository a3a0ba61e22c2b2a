"""Methods of optimization with their constants, as plain data."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field

from eigenode_cli.arrays import Floats


@dataclass(frozen=True)
class Method:
    """What every first-order method has.

    Attributes:
        lr: learning rate.
        clip: largest norm of an update's gradient, a longer one is shortened to it; None for any.
    """

    lr: float = 1e-3
    clip: float | None = field(default=None, kw_only=True)


@dataclass(frozen=True)
class Adam(Method):
    """D. P. Kingma, J. Ba, Adam: a method for stochastic optimization, ICLR 2015, Algorithm 1.

    https://arxiv.org/abs/1412.6980
    """

    beta1: float = 0.9
    beta2: float = 0.999
    eps: float = 1e-8


@dataclass(frozen=True)
class Sgd(Method):
    """Gradient descent with heavy-ball momentum, in the form of torch.optim.SGD."""

    momentum: float = 0.0


@dataclass(frozen=True)
class AdamBfgs(Adam):
    """Adam, then BFGS with a line search on the sum of the scaled terms.

    Attributes:
        adam_steps: leading training steps that Adam takes.
        pairs: how many of the last steps BFGS remembers (L-BFGS, for thousands of parameters); 0 for all of them, in a
            dense matrix.
    """

    adam_steps: int = 1000
    pairs: int = 0


@dataclass(frozen=True)
class LevenbergMarquardt(Adam):
    """Levenberg-Marquardt on the residuals of all terms; Adam's update only where the solve fails.

    Attributes:
        damping: the first one of each phase, in units of the mean of the diagonal of `J^T J`.
        tolerance: a phase has converged where a step lowers the sum of squares by less than this share.
        ridge: factor of the squared parameters of the network, added to the sum of squares; the first one where it
            follows the evidence.
        evidence: whether the ridge follows the evidence (`LeastSquares.evidence_ridge`) in the last phase, from step to
            step. While the horizon grows nearly everything is noise to it.
        evidence_ridge: ridge that it starts from there. The evidence has several maxima: from a small ridge it finds
            one that takes noise for signal, from a large one the simplest model.
        huber: residuals of SOL beyond this size count linearly; infinite for plain squares.
    """

    lr: float = 1e-2
    damping: float = 1e-3
    tolerance: float = 1e-4
    ridge: float = 0.0
    evidence: bool = False
    evidence_ridge: float = 1e-3
    huber: float = math.inf


class OwnMethod(ABC):
    """A first-order method of the user's own; its update runs in Python, for either engine.

    Its constructor takes `lr` and options of its own, and keeps `lr`.
    """

    lr: float

    @abstractmethod
    def memory(self, parameters: int) -> dict[str, Floats]:
        """Return arrays, by name, of all that the next update depends on besides parameters and gradient.

        They are saved with the run, so that it resumes to the same bytes. Names are lower case.
        """

    @abstractmethod
    def update(self, theta: Floats, gradient: Floats, lr: float, memory: dict[str, Floats]) -> None:
        """Change `theta (P,)` in place by one step against `gradient (P,)`, and the arrays of `memory` with it."""
