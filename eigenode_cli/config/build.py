"""Build the objects that a configuration describes."""

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from eigenode_cli.config.plugins import load_class, own_options
from eigenode_cli.config.schema import (
    AdaptiveSolverConfig,
    FixedSolverConfig,
    NetworkConfig,
    SolverConfig,
    SystemConfig,
)
from eigenode_cli.solve.settings import AdaptiveSolver, FixedStepSolver, Solver
from eigenode_cli.systems import System

if TYPE_CHECKING:
    from eigenode_cli.model import VectorField

Floats = NDArray[np.float64]


def build_system(config: Any) -> System:
    """Build the system of a `SystemConfig`.

    Raises:
        ValueError: what its constructor raises for parameters that do not fit together.
    """
    return load_class(config.target)(**own_options(config, SystemConfig))


def build_solver(config: SolverConfig) -> Solver:
    """Build the solver settings."""
    if isinstance(config, AdaptiveSolverConfig):
        return AdaptiveSolver(config.name, config.rtol, config.atol, config.max_steps)
    return FixedStepSolver(config.name, cast(FixedSolverConfig, config).step)


def build_field(config: NetworkConfig, states: Floats, rates: Floats, seed: int) -> "VectorField":
    """Build the vector field, its network's initial weights drawn from `seed`.

    Args:
        config: of the network.
        states: known states `(N, n)`.
        rates: their derivatives `(N, n)`; scalings are taken from both.
        seed: of the initial weights; nothing else enters the draw, so that runs of one seed are paired.
    """
    import torch  # noqa: PLC0415  # seconds, and a command line is checked without it

    from eigenode_cli.model import VectorField  # noqa: PLC0415

    n = states.shape[1]
    outputs = n // 2 if config.structure == "second_order" else n
    options = own_options(config, NetworkConfig)
    for scaling, scale, samples in (
        ("input_scaling", "input_scale", states),
        ("output_scaling", "output_scale", rates[:, n - outputs :]),
    ):
        if scaling in options:
            largest = torch.from_numpy(_largest(samples))
            factor = 1.0 / largest if scale == "input_scale" else largest
            options[scale] = factor if options.pop(scaling) == "max_abs" else None
    generator = torch.Generator().manual_seed(seed)
    network = load_class(config.target)(inputs=n, outputs=outputs, generator=generator, **options)
    return VectorField(network, config.structure)


def _largest(samples: Floats) -> Floats:
    """Largest modulus of each column of `samples (N, k)`; 1 for a column of zeros."""
    size = np.abs(samples).max(axis=0)
    return np.where(size > 0.0, size, 1.0)
