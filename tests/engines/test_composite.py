"""Stages of a training on both engines: spectra without a solve, and beside one."""

from dataclasses import replace

import numpy as np
import pytest

from eigenode_cli.config.compose import compose, typed
from eigenode_cli.config.setup import Setup, build
from eigenode_cli.engines.composite import SplitEngine
from eigenode_cli.engines.problem import Problem
from eigenode_cli.model import flat_parameters
from eigenode_cli.solve.status import Status
from eigenode_cli.training.bfgs import Point
from eigenode_cli.training.total_loss import Objective

ENGINES = ("compiled", "torch")
SPECTRA_FIRST = "stages=[{solve:false,steps:10},{}]"
WORDS = ("system=sparse_oscillator", "grads=sol+frq+dmp+stb+osc", "error.sol=mse")


def setup_of(engine: str, *words: str) -> Setup:
    return build(typed(compose([*WORDS, f"engine={engine}", *words])))


@pytest.mark.parametrize("engine", ENGINES)
def test_unsolved_gives_the_spectral_terms_at_the_data_states(engine: str) -> None:
    setup = setup_of(engine, SPECTRA_FIRST)
    theta = flat_parameters(setup.field)
    found = setup.phases[0].engine.loss_jacobian(theta)
    assert found.status is Status.UNSOLVED
    assert np.isnan(found.values[0])
    assert np.isnan(found.gradients[0]).all()
    assert np.isnan(found.trajectory).all()
    # at the truth's own weights it would be what a solve gives; here the data states stand in for the trajectory
    along = replace_trajectory_by_data(setup)
    np.testing.assert_allclose(found.values[1:], along, rtol=1e-12)


def replace_trajectory_by_data(setup: Setup) -> np.ndarray:
    """Terms from the torch field's Jacobian at the data states, by their torch versions."""
    import torch  # noqa: PLC0415

    from eigenode_cli.spectra.eig import eigvals  # noqa: PLC0415
    from eigenode_cli.spectra.jacobian import jacobian  # noqa: PLC0415
    from eigenode_cli.terms.torch_terms import spectral_values  # noqa: PLC0415

    problem: Problem = setup.problem
    spectra, _ = eigvals(jacobian(setup.field, torch.from_numpy(problem.states), "autodiff"), 1e4)
    values = spectral_values(spectra, list(problem.terms[1:]), problem.targets, 0.0, problem.errors, 1.0)
    return values.detach().numpy()


def test_both_engines_agree_without_a_solve() -> None:
    one, other = (setup_of(name, SPECTRA_FIRST) for name in ENGINES)
    theta = flat_parameters(one.field)
    first, second = (setup.phases[0].engine.loss_jacobian(theta) for setup in (one, other))
    np.testing.assert_allclose(first.gradients, second.gradients, rtol=1e-9, atol=1e-12, equal_nan=True)


@pytest.mark.parametrize("engine", ENGINES)
def test_split_takes_each_term_from_its_place(engine: str) -> None:
    setup = setup_of(engine, "stages=[{solve:false,steps:10},{spectra:data,horizons:[0.5,1]}]")
    theta = flat_parameters(setup.field)
    lead, half, whole = (stage.engine for stage in setup.phases)
    assert isinstance(half, SplitEngine)
    found, spectral = half.loss_jacobian(theta), lead.loss_jacobian(theta)
    plain = (
        build(typed(compose([*WORDS, f"engine={engine}", "grads=sol", "stages=[{horizons:[0.5,1]}]"]))).phases[0].engine
    )
    assert found.status is Status.OK
    np.testing.assert_allclose(found.values[1:], spectral.values[1:], rtol=1e-12)
    np.testing.assert_allclose(found.gradients[1:], spectral.gradients[1:], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.gradients[0], plain.loss_jacobian(theta).gradients[0], rtol=1e-12)
    assert whole.loss_jacobian(theta).trajectory.shape[0] == setup.problem.data.times.size  # type: ignore[union-attr]
    assert setup.engine is not whole


def test_without_spectral_terms_there_is_nothing_to_split() -> None:
    setup = build(typed(compose(["protocol=robust", "grads=sol", "engine=compiled"])))
    assert not any(isinstance(stage.engine, SplitEngine) for stage in setup.phases)
    assert setup.phases[-1].engine is setup.engine


@pytest.mark.parametrize("stabilise", [True, False])
def test_where_the_solve_fails_the_spectral_terms_go_on_if_they_may(stabilise: bool) -> None:
    remedy = "stabilise" if stabilise else "skip"
    setup = setup_of("compiled", "stages.0.spectra=data", "solver.max_steps=2", f"trainer.on_unsolvable={remedy}")
    found = setup.phases[0].engine.loss_jacobian(flat_parameters(setup.field))
    assert found.status is Status.MAX_STEPS
    assert np.isnan(found.values[0])
    assert np.isfinite(found.values[1:]).all() == stabilise


def test_the_objective_is_the_scaled_sum_and_infinite_where_a_solve_fails() -> None:
    setup = setup_of("compiled", "stages.0.spectra=data")
    theta = flat_parameters(setup.field)
    scales = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    objective = Objective(setup.phases[0].engine, scales)
    here = objective.at(theta)
    assert isinstance(here, Point)
    assert here.value == pytest.approx(scales @ here.jacobian.values)
    assert objective.at(theta.copy()) is here  # remembered
    step = 1e-6 * np.sign(here.gradient)
    slope = (objective.at(theta + step).value - objective.at(theta - step).value) / 2.0
    assert slope == pytest.approx(here.gradient @ step, rel=1e-2)
    broken = replace(setup.problem.solver, max_steps=2)
    failing = setup_of("compiled", "stages.0.spectra=data", f"solver.max_steps={broken.max_steps}")
    assert Objective(failing.phases[0].engine, scales).at(theta).value == np.inf
