"""The stages of a training: what computes the loss Jacobian, and of which terms, at each of its steps."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.data.dataset import Floats
from eigenode_cli.engines.base import Engine, unheard
from eigenode_cli.engines.composite import SPECTRAL, SplitEngine
from eigenode_cli.engines.factory import build_engine
from eigenode_cli.engines.problem import Problem
from eigenode_cli.model import VectorField
from eigenode_cli.terms import canonical, split_grads
from eigenode_cli.terms.user import UserTerm
from eigenode_cli.training.trainer import Stage


def build_stages(
    config: TrainConfig, field: VectorField, problem: Problem, user_terms: Mapping[str, UserTerm], whole: Engine
) -> tuple[Stage, ...]:
    """Pre-training if there is any, then the growing horizon, whose fractions share the other steps equally.

    `trainer.spectral_steps` pre-trains the spectral terms at the data states, where nothing is solved;
    `trainer.pretrain` any terms over the whole horizon.

    Args:
        config: of the run.
        field: the vector field.
        problem: over the whole horizon.
        user_terms: the user's own terms by name.
        whole: engine of `problem`.
    """

    def engine_of(part: Problem) -> Engine:
        return build_engine(config, field, part, dict(user_terms), unheard)

    trainer, stages = config.trainer, []
    if trainer.spectral_steps > 0:
        stages.append(Stage(0, engine_of(problem.unsolved()), gradient_scales(config, problem.terms)))
    if trainer.pretrain is not None:
        first = canonical(split_grads(trainer.pretrain))
        stages.append(Stage(0, engine_of(replace(problem, terms=first)), gradient_scales(config, first)))
    spectral = tuple(term for term in problem.terms if term in SPECTRAL)
    rest = tuple(term for term in problem.terms if term not in SPECTRAL)
    split = config.eigen.at == "data" and spectral and rest

    def over(fraction: float) -> Engine:
        if split:
            states = engine_of(replace(problem.unsolved(), terms=spectral))
            solved = engine_of(replace(problem.until(fraction), terms=rest))
            return SplitEngine(problem.terms, solved, states, problem.stabilise)
        return whole if fraction == 1.0 else engine_of(problem.until(fraction))

    lead = trainer.spectral_steps + trainer.pretrain_steps
    scales, shares = gradient_scales(config, problem.terms), len(trainer.horizons)
    for number, fraction in enumerate(trainer.horizons):
        first_step = lead - (-number * (trainer.steps - lead) // shares)
        stages.append(Stage(first_step, over(fraction), scales))
    return tuple(stages)


def gradient_scales(config: TrainConfig, terms: Sequence[str]) -> Floats:
    """Factor of each term's gradient `(L,)`.

    Under `eigen.eigenvalue_count=times` the terms that average over eigenvalues count N/2 of them (N data times)
    instead of n. That is a constant factor, so it is applied here and the recorded losses stay what they are.
    """
    scales = np.array([config.scale.get(term, 1.0) for term in terms])
    if config.eigen.eigenvalue_count == "times":
        counted = np.array([term in ("frq", "dmp", "stb", "osc") for term in terms])
        scales[counted] *= len(config.system.initial_state) / (config.system.points / 2.0)
    return scales
