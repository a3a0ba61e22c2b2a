"""All parts of a run, built from its configuration in the order of the data flow."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch

from eigenode_cli.arrays import Floats
from eigenode_cli.config.build import (
    build_field,
    build_solver,
    build_source,
    build_stages,
    build_target,
    gradient_scales,
)
from eigenode_cli.config.names import STABILISING, training_terms
from eigenode_cli.config.schema import CompiledEngineConfig, LeastSquaresConfig, TrainConfig
from eigenode_cli.config.warm_start import warm_start
from eigenode_cli.data.dataset import Dataset, Series
from eigenode_cli.data.reconstruct import Estimate, reconstruct
from eigenode_cli.data.simulate import Truth
from eigenode_cli.data.source import Source
from eigenode_cli.data.targets import Target
from eigenode_cli.engines.base import Engine, unheard
from eigenode_cli.engines.factory import build_engine
from eigenode_cli.engines.problem import Problem
from eigenode_cli.model import VectorField, block_slices, flat_parameters, load_flat, with_own_parameters
from eigenode_cli.model.modes import fitted_matrix, modal_matrix, stated_pairs, with_inputs
from eigenode_cli.solve.stability import region_of
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
        source: where the data come from.
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
    source: Source
    target: Target
    problem: Problem
    field: VectorField
    theta: Floats
    engine: Engine
    phases: tuple[Phase, ...]
    names: tuple[str, ...]
    weights: Floats

    @property
    def truth(self) -> Truth:
        """What the data are sampled from; training does not see it.

        Raises:
            ValueError: the data are measured.
        """
        if self.source.truth is None:
            raise ValueError("measured data have no truth")
        return self.source.truth

    @property
    def dataset(self) -> Dataset:
        """What training sees."""
        return self.source.dataset

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

        The linear part stands under `linear`, trained entries of initial states under `initial_state`, trained offsets
        under `offset`; all in internal units.
        """
        load_flat(self.field, theta)
        tensors = self.field.network.state_dict()
        if self.field.linear is not None:
            tensors["linear"] = self.field.linear.weight.detach().clone()
        for name in ("initial_state", "offset"):
            if name in self.blocks:
                tensors[name] = torch.from_numpy(theta[self.blocks[name]].copy())
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
    source = build_source(config)
    every = source.dataset.series
    estimates = [reconstruct(series, config.network.structure) for series in every]
    target = build_target(config.target, source)
    first, *others = [build_problem(config, source, *one, target) for one in zip(every, estimates, strict=True)]
    problem = replace(first, others=tuple(others))
    field = build_field(
        config.network,
        *scaling_samples(config, source, every, estimates),
        config.seed,
        initial_linear(config, problem, estimates[0]),
        np.concatenate([series.driven for series in every]),
    )
    user_terms = load_user_terms(config.terms, training_terms(config), announce)
    engine = engine_of(config, field, problem, user_terms, announce)
    rebuilt = partial(engine_of, config, field, user_terms=user_terms)
    blocks = block_slices(field, every)
    stages, scales = build_stages(config), gradient_scales(config)
    if isinstance(config.optimizer, LeastSquaresConfig):
        scales = relative_scales(scales, problem)
    phases = build_phases(stages, config.trainer.steps, problem, scales, engine, rebuilt, blocks)
    theta = with_own_parameters(flat_parameters(field), every, estimates)
    if config.trainer.start is not None:
        theta = warm_start(config.trainer.start, field, theta)
    names = (*NAMES, *user_terms)
    weights = np.array([scales[name] if name in problem.terms else 0.0 for name in names])
    return Setup(config, source, target, problem, field, theta, engine, phases, names, weights)


def build_problem(config: TrainConfig, source: Source, series: Series, estimate: Estimate, target: Target) -> Problem:
    """Build the problem of one trajectory over the whole horizon: measurements, targets, terms, solver."""
    every, time = config.eigen.every, source.scaling.time
    region = np.empty(0) if config.stp.step is None else region_of(config.stp.method, config.stp.step / time)
    return Problem(
        data=series,
        targets=replace(target.rows(series.times).rows(np.arange(0, series.times.size, every)), region=region),
        resting=target.resting(series.times)[1] if config.target.at == "equilibrium" else None,
        terms=canonical(split_grads(config.grads)),
        every=every,
        states=estimate.states if estimate.complete else None,
        errors=np.array([ERRORS[getattr(config.error, name)] for name in NAMES], dtype=np.int64),
        huber_delta=config.error.huber_delta,
        margin=config.eigen.margin * time,
        max_condition=config.eigen.max_condition,
        jacobian=config.eigen.jacobian,
        solver=build_solver(config.solver, time),
        stabilise=config.trainer.on_unsolvable in STABILISING,
    )


def initial_linear(config: TrainConfig, problem: Problem, estimate: Estimate) -> Floats | None:
    """Return the initial value of the linear part that `network.linear` names, None for zero or for no linear part."""
    structure, driven = config.network.structure, problem.data.driven
    if config.network.linear == "fitted":
        return fitted_matrix(estimate, structure, driven)
    if config.network.linear == "modes":
        targets = problem.targets if problem.resting is None else problem.resting
        matrix = modal_matrix(stated_pairs(targets), estimate, structure)
        return with_inputs(matrix, estimate, driven)
    return None


def scaling_samples(
    config: TrainConfig, source: Source, every: Sequence[Series], estimates: Sequence[Estimate]
) -> tuple[Floats, Floats]:
    """Return states and rates `(N, n)` that the network's scales are taken from, as `network.scaling_from` says."""
    if getattr(config.network, "scaling_from", "data") == "truth" and source.truth is not None:
        states = source.truth.states(every[0].times)
        return states, source.truth.system.dynamics(states)
    states = np.concatenate([estimate.states for estimate in estimates])
    return np.nan_to_num(states), np.nan_to_num(np.concatenate([estimate.rates for estimate in estimates]))


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
