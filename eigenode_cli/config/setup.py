"""All parts of a run, built from its configuration in the order of the data flow."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch

from eigenode_cli.arrays import Floats
from eigenode_cli.config.build import (
    build_dataset,
    build_field,
    build_solver,
    build_stages,
    build_target,
    build_truth,
    gradient_scales,
)
from eigenode_cli.config.names import training_terms
from eigenode_cli.config.schema import CompiledEngineConfig, LeastSquaresConfig, TrainConfig
from eigenode_cli.config.warm_start import warm_start
from eigenode_cli.data.dataset import Dataset, Series
from eigenode_cli.data.reconstruct import Estimate, reconstruct
from eigenode_cli.data.simulate import Truth
from eigenode_cli.data.targets import Target
from eigenode_cli.engines.base import Engine, unheard
from eigenode_cli.engines.factory import build_engine
from eigenode_cli.engines.problem import Problem
from eigenode_cli.model import VectorField, block_slices, flat_parameters, load_flat, with_own_parameters
from eigenode_cli.model.modes import fitted_matrix, modal_matrix, stated_pairs
from eigenode_cli.terms import NAMES, canonical, split_grads
from eigenode_cli.terms.errors import ERRORS
from eigenode_cli.terms.user import UserTerm, load_user_terms
from eigenode_cli.training.least_squares import relative_scales
from eigenode_cli.training.stages import Phase, build_phases


@dataclass(frozen=True)
class Setup:
    """The parts that a configuration describes, built.

    Attributes:
        config: what they are built from.
        truth: what the data are sampled from; training does not see it.
        dataset: what training sees.
        target: what the spectral terms compare with.
        problem: over the whole horizon.
        field: the vector field with its initial weights.
        theta: initial parameters `(P,)`.
        engine: that of the records.
        phases: what trains at each step.
        names: all terms that are recorded: the six and the user's own.
        weights: factor of each of them in the sum that schedules, stopping and the best weights go by, zero for one
            that does not train `(6 + user's,)`.
    """

    config: TrainConfig
    truth: Truth
    dataset: Dataset
    target: Target
    problem: Problem
    field: VectorField
    theta: Floats
    engine: Engine
    phases: tuple[Phase, ...]
    names: tuple[str, ...]
    weights: Floats

    @property
    def engines(self) -> set[Engine]:
        """All of them, each once."""
        return {self.engine, *(phase.engine for phase in self.phases)}

    @property
    def blocks(self) -> dict[str, slice]:
        """Where each block of parameters stands in theta."""
        return block_slices(self.field, self.dataset.series)

    def tensors(self, theta: Floats) -> dict[str, torch.Tensor]:
        """Return what a checkpoint holds at the parameters `theta (P,)`: the network's state_dict and the other blocks.

        The linear part stands under `linear`, trained entries of the initial state under `initial_state`.
        """
        load_flat(self.field, theta)
        tensors = self.field.network.state_dict()
        if self.field.linear is not None:
            tensors["linear"] = self.field.linear.weight.detach().clone()
        if "initial_state" in self.blocks:
            tensors["initial_state"] = torch.from_numpy(theta[self.blocks["initial_state"]].copy())
        return tensors


def build(config: TrainConfig, announce: Callable[[str], None] = print) -> Setup:
    """Build everything that a run needs, in the order of the data flow.

    Args:
        config: the checked configuration.
        announce: called with a line that the user should see.

    Raises:
        ValueError: something that only shows when it is built: a system without a solution, a term without a function.
    """
    torch.set_num_threads(1)  # the matrices are small, and a launcher's setting must not change a result
    torch.manual_seed(config.seed)
    truth = build_truth(config.system)
    dataset = build_dataset(config.system, truth, config.seed)
    series = dataset.series[0]
    estimate = reconstruct(series, config.network.structure)
    target = build_target(config.target, truth)
    problem = build_problem(config, series, estimate, target)
    samples = scaling_samples(config, truth, series, estimate)
    field = build_field(config.network, *samples, config.seed, initial_linear(config, problem, estimate))
    user_terms = load_user_terms(config.terms, training_terms(config), announce)
    engine = engine_of(config, field, problem, user_terms, announce)
    rebuilt = partial(engine_of, config, field, user_terms=user_terms)
    blocks = block_slices(field, [series])
    stages, scales = build_stages(config), gradient_scales(config)
    if isinstance(config.optimizer, LeastSquaresConfig):
        scales = relative_scales(scales, problem)
    phases = build_phases(stages, config.trainer.steps, problem, scales, engine, rebuilt, blocks)
    theta = with_own_parameters(flat_parameters(field), [series], [estimate])
    if config.trainer.start is not None:
        theta = warm_start(config.trainer.start, field, theta)
    names = (*NAMES, *user_terms)
    weights = np.array([scales[name] if name in problem.terms else 0.0 for name in names])
    return Setup(config, truth, dataset, target, problem, field, theta, engine, phases, names, weights)


def build_problem(config: TrainConfig, series: Series, estimate: Estimate, target: Target) -> Problem:
    """Build the problem over the whole horizon: measurements, targets, terms, solver."""
    every = config.eigen.every
    return Problem(
        data=series,
        targets=target.rows(series.times).rows(np.arange(0, series.times.size, every)),
        terms=canonical(split_grads(config.grads)),
        every=every,
        states=estimate.states if estimate.complete else None,
        errors=np.array([ERRORS[getattr(config.error, name)] for name in NAMES], dtype=np.int64),
        huber_delta=config.error.huber_delta,
        margin=config.eigen.margin,
        max_condition=config.eigen.max_condition,
        jacobian=config.eigen.jacobian,
        solver=build_solver(config.solver),
        stabilise=config.trainer.on_unsolvable == "stabilise",
    )


def initial_linear(config: TrainConfig, problem: Problem, estimate: Estimate) -> Floats | None:
    """Return the initial value of the linear part that `network.linear` names, None for zero or for no linear part."""
    structure = config.network.structure
    if config.network.linear == "fitted":
        return fitted_matrix(estimate, structure)
    if config.network.linear == "modes":
        return modal_matrix(stated_pairs(problem.targets), estimate, structure)
    return None


def scaling_samples(config: TrainConfig, truth: Truth, series: Series, estimate: Estimate) -> tuple[Floats, Floats]:
    """Return states and rates `(N, n)` that the network's scales are taken from, as `network.scaling_from` says."""
    if getattr(config.network, "scaling_from", "data") == "truth":
        states = truth.states(series.times)
        return states, truth.system.dynamics(states)
    return np.nan_to_num(estimate.states), np.nan_to_num(estimate.rates)


def engine_of(
    config: TrainConfig,
    field: VectorField,
    problem: Problem,
    user_terms: Mapping[str, UserTerm] | None = None,
    announce: Callable[[str], None] = unheard,
) -> Engine:
    """Build the engine that `engine=` asks for."""
    sensitivity = config.engine.sensitivity if isinstance(config.engine, CompiledEngineConfig) else "auto"
    return build_engine(field, problem, user_terms, config.engine.name, sensitivity, announce)
