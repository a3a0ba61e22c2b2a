"""Which engine a training gets."""

from collections.abc import Callable, Mapping
from typing import Any, cast

import numpy as np

from eigenode_cli.engines.base import Engine, unheard
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.engines.compiled.mlp import MlpShape
from eigenode_cli.engines.problem import Problem
from eigenode_cli.engines.several import SeveralEngine
from eigenode_cli.engines.support import obstacle
from eigenode_cli.model import VectorField
from eigenode_cli.model.mlp import Mlp
from eigenode_cli.terms import AT_TARGET
from eigenode_cli.terms.user import UserTerm, on_arrays


def build_engine(
    field: VectorField,
    problem: Problem,
    user_terms: Mapping[str, UserTerm] | None = None,
    engine: str = "auto",
    sensitivity: str = "auto",
    announce: Callable[[str], None] = unheard,
) -> Engine:
    """Return the engine of a problem.

    Args:
        field: the vector field.
        problem: data, targets, terms, solver.
        user_terms: the user's own terms by name.
        engine: compiled | torch | auto: the compiled one where it can.
        sensitivity: of the compiled engine: auto | forward | adjoint.
        announce: called with a line that the user should see.

    Raises:
        ValueError: `engine=compiled` for what it can't do.
    """
    if problem.resting is not None:
        return _at_rest(field, problem, user_terms, engine, sensitivity, announce)
    if problem.others:
        single = [build_engine(field, one, user_terms, engine, sensitivity, announce) for one in problem.trajectories]
        return SeveralEngine(single, problem.trajectories)
    network = "mlp" if type(field.network) is Mlp else type(field.network).__name__.lower()
    reason = obstacle(network, problem.solver.name if problem.solver.tableau is None else None, problem.jacobian)
    own = dict(user_terms or {})
    if engine == "torch" or (engine == "auto" and reason is not None):
        if reason is not None and engine == "auto":
            announce(f"engine: torch, because the compiled one has no {reason}")
        from eigenode_cli.engines.torch_engine import TorchEngine  # noqa: PLC0415  # torchdiffeq, only where it is used

        return TorchEngine(field, problem, own)
    if reason is not None:
        raise ValueError(f"engine=compiled has no {reason}")
    data = problem.data
    terms = {name: on_arrays(term, data.times, data.seen, field) for name, term in own.items()}
    return CompiledEngine(shape_of(field), problem, terms, sensitivity, announce)


def _at_rest(field: VectorField, problem: Problem, *others: Any) -> Engine:
    """Return the engine of terms at the equilibrium; it solves even where they are all that trains."""
    from eigenode_cli.engines.at_rest import EquilibriumEngine  # noqa: PLC0415  # SciPy, only where it is used

    rest = tuple(term for term in problem.terms if term not in AT_TARGET)
    filler = () if rest else ("sol",) if problem.solved else ("stb",)
    along = build_engine(field, problem.changed(resting=None, terms=rest or filler), *others)
    return EquilibriumEngine(field, problem, along, len(filler))


def shape_of(field: VectorField) -> MlpShape:
    """Return the description of a multilayer perceptron's field that kernels are built for.

    Raises:
        ValueError: its network is no multilayer perceptron.
    """
    network = cast(Mlp, field.network)
    if not isinstance(network, Mlp):
        raise ValueError(f"{type(field.network).__name__}: the compiled engine knows multilayer perceptrons")
    width, m = network.sizes[0], network.sizes[-1]
    return MlpShape(
        sizes=network.sizes,
        activation=network.activation,
        structure=field.structure,
        input_scale=np.ones(width) if network.input_scale is None else network.input_scale.numpy(),
        output_scale=np.ones(m) if network.output_scale is None else network.output_scale.numpy(),
        linear=field.linear is not None,
        inputs=field.inputs,
    )
