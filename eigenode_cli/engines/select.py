"""Which engine a run gets, and the user's own terms."""

import importlib
from collections.abc import Callable
from typing import cast

import numpy as np
import torch
from torch import Tensor

from eigenode_cli.config.schema import CompiledEngineConfig, TrainConfig
from eigenode_cli.engines.base import Complexes, Engine, Floats
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.engines.compiled.engine import UserTerm as ArrayTerm
from eigenode_cli.engines.compiled.mlp import MlpShape
from eigenode_cli.engines.obstacle import obstacle
from eigenode_cli.engines.torch_engine import TorchEngine, UserTerm
from eigenode_cli.field import VectorField
from eigenode_cli.field.mlp import Mlp
from eigenode_cli.problem import Problem


def load_user_terms(paths: dict[str, str]) -> dict[str, UserTerm]:
    """The user's own terms, imported from their `module:function`.

    Raises:
        ValueError: a path that does not lead to a function.
    """
    terms: dict[str, UserTerm] = {}
    for name, path in paths.items():
        module, _, function = path.partition(":")
        try:
            candidate = cast(UserTerm, getattr(importlib.import_module(module), function))
        except (ImportError, AttributeError, ValueError) as error:
            raise ValueError(f"terms.{name}={path}: {error}") from error
        if not callable(candidate):
            raise ValueError(f"terms.{name}={path}: not a function")
        terms[name] = candidate
    return terms


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
        return TorchEngine(field, problem, user_terms)
    if reason is not None:
        raise ValueError(f"engine=compiled has no {reason}")
    sensitivity = config.engine.sensitivity if isinstance(config.engine, CompiledEngineConfig) else "auto"
    times = torch.from_numpy(problem.data.times)
    own = {name: _on_arrays(term, times) for name, term in user_terms.items()}
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


def _on_arrays(term: UserTerm, times: Tensor) -> ArrayTerm:
    """A user's term with its derivatives in trajectory and spectra, from arrays to arrays, by autograd."""

    def value_and_slopes(trajectory: Floats, spectra: Complexes) -> tuple[float, Floats, Complexes]:
        states = torch.from_numpy(trajectory).requires_grad_()
        eigenvalues = torch.from_numpy(spectra).requires_grad_()
        value = term(states, eigenvalues, times)
        slopes = torch.autograd.grad(value, (states, eigenvalues), materialize_grads=True)
        return float(value.detach()), slopes[0].numpy(), slopes[1].resolve_conj().numpy()

    return value_and_slopes
