"""Which engine a run gets."""

from collections.abc import Callable
from typing import cast

import numpy as np

from eigenode_cli.config.schema import CompiledEngineConfig, TrainConfig
from eigenode_cli.engines.base import Engine
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.engines.compiled.mlp import MlpShape
from eigenode_cli.engines.problem import Problem
from eigenode_cli.engines.support import obstacle
from eigenode_cli.model import VectorField
from eigenode_cli.model.mlp import Mlp
from eigenode_cli.terms.user import UserTerm, on_arrays


def build_engine(
    config: TrainConfig,
    field: VectorField,
    problem: Problem,
    user_terms: dict[str, UserTerm],
    announce: Callable[[str], None],
) -> Engine:
    """The engine that `engine=` asks for: with `auto` the compiled one where it can.

    Args:
        config: of the run.
        field: the vector field.
        problem: data, targets, terms, solver.
        user_terms: the user's own terms by name.
        announce: called with a line that the user should see.

    Raises:
        ValueError: `engine=compiled` for what it can't do.
    """
    reason = obstacle(config)
    if config.engine.name == "torch" or (config.engine.name == "auto" and reason is not None):
        if reason is not None and config.engine.name == "auto":
            announce(f"engine: torch, because the compiled one has no {reason}")
        from eigenode_cli.engines.torch_engine import TorchEngine  # noqa: PLC0415  # torchdiffeq, only where it is used

        return TorchEngine(field, problem, user_terms)
    if reason is not None:
        raise ValueError(f"engine=compiled has no {reason}")
    sensitivity = config.engine.sensitivity if isinstance(config.engine, CompiledEngineConfig) else "auto"
    data = problem.data
    own = {name: on_arrays(term, data.times, data.seen, field) for name, term in user_terms.items()}
    return CompiledEngine(shape_of(field), problem, own, sensitivity, announce)


def shape_of(field: VectorField) -> MlpShape:
    """The description of a multilayer perceptron's field that kernels are built for."""
    network = cast(Mlp, field.network)
    n, m = network.sizes[0], network.sizes[-1]
    return MlpShape(
        sizes=network.sizes,
        activation=network.activation,
        structure=field.structure,
        input_scale=np.ones(n) if network.input_scale is None else network.input_scale.numpy(),
        output_scale=np.ones(m) if network.output_scale is None else network.output_scale.numpy(),
    )
