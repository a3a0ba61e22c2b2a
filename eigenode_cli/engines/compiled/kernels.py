"""Every kernel that Python calls, by its name."""

from eigenode_cli.engines.compiled.kernel import advance, evaluate, forward, loss_jacobian, pull_back
from eigenode_cli.engines.compiled.residual_kernel import residual_jacobian

__all__ = ["advance", "evaluate", "forward", "loss_jacobian", "pull_back", "residual_jacobian"]
