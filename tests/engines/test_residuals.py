"""Residual Jacobians: both engines agree, J^T r is half the gradient of the sum of squares, differences agree."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from eigenode_cli.data.dataset import Series
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.engines.compiled.mlp import MlpShape
from eigenode_cli.engines.factory import shape_of
from eigenode_cli.engines.problem import Problem
from eigenode_cli.engines.torch_engine import TorchEngine
from eigenode_cli.model import VectorField, flat_parameters
from eigenode_cli.model.mlp import Mlp
from eigenode_cli.terms import NAMES
from tests.engines.compiled import oracle

SQUARES = np.ones(len(NAMES), dtype=np.int64)


def field_of(n: int, structure: str, linear: bool, seed: int = 3) -> VectorField:
    generator = torch.Generator().manual_seed(seed)
    outputs = n // 2 if structure == "second_order" else n
    matrix = torch.randn((outputs, n), generator=generator, dtype=torch.float64) if linear else None
    scale = 0.5 + torch.rand(n, generator=generator, dtype=torch.float64)
    return VectorField(Mlp(n, (7,), outputs, generator=generator, input_scale=scale), structure, matrix)


def problem_of(n: int, unknown: bool, terms: tuple[str, ...] = NAMES, every: int = 1) -> Problem:
    problem = oracle.make_problem(n, count=7, every=every, errors=SQUARES, terms=terms)
    if not unknown:
        return problem
    start = problem.data.initial_state.copy()
    start[::2] = np.nan
    return replace(problem, data=Series(problem.data.times, problem.data.values, start))


CASES = [
    (2, "second_order", True, True),
    (2, "full", False, True),
    (4, "second_order", True, False),
    (3, "full", True, True),
]


@pytest.mark.parametrize(("n", "structure", "linear", "unknown"), CASES)
@pytest.mark.parametrize("every", [1, 3])
def test_both_engines_and_the_gradient_agree(n: int, structure: str, linear: bool, unknown: bool, every: int) -> None:
    field, problem = field_of(n, structure, linear), problem_of(n, unknown, every=every)
    theta = np.concatenate([flat_parameters(field), np.linspace(0.3, 0.8, problem.data.unknown.size)])
    compiled, reference = CompiledEngine(shape_of(field), problem), TorchEngine(field, problem, {})
    gradients = compiled.loss_jacobian(theta)
    steps = compiled.steps
    ours, theirs = (
        compiled.residual_jacobian(theta, steps=steps),
        reference.residual_jacobian(theta, steps=steps.tolist()),
    )
    np.testing.assert_allclose(ours.residuals, theirs.residuals, rtol=1e-8, atol=1e-11)
    np.testing.assert_allclose(ours.jacobian, theirs.jacobian, rtol=1e-6, atol=1e-8 * np.abs(theirs.jacobian).max())
    for row, term in enumerate(problem.terms):
        part = ours.rows[term]
        count = problem.measured if term == "sol" else problem.spectral_index.size
        half = ours.jacobian[part].T @ ours.residuals[part] / count
        np.testing.assert_allclose((ours.residuals[part] ** 2).sum() / count, gradients.values[row], rtol=1e-9)
        scale = np.abs(gradients.gradients[row]).max()
        np.testing.assert_allclose(2.0 * half, gradients.gradients[row], rtol=1e-8, atol=1e-10 * scale)


@pytest.mark.parametrize(("n", "structure", "linear", "unknown"), CASES)
def test_gradients_of_both_ways_and_both_engines_agree(n: int, structure: str, linear: bool, unknown: bool) -> None:
    """The linear part and the initial state, by adjoint, forward sensitivities and autograd."""
    field, problem = field_of(n, structure, linear), problem_of(n, unknown)
    theta = np.concatenate([flat_parameters(field), np.linspace(0.3, 0.8, problem.data.unknown.size)])
    adjoint = CompiledEngine(shape_of(field), problem, sensitivity="adjoint")
    found = adjoint.loss_jacobian(theta)
    steps = adjoint.steps
    forward = CompiledEngine(shape_of(field), problem, sensitivity="forward").loss_jacobian(theta, steps)
    reference = TorchEngine(field, problem, {}).loss_jacobian(theta, steps.tolist())
    scale = np.abs(reference.gradients).max(axis=1, keepdims=True) + 1e-12
    assert found.gradients.shape == (len(NAMES), theta.size)
    np.testing.assert_allclose(found.gradients / scale, reference.gradients / scale, atol=1e-9)
    np.testing.assert_allclose(forward.gradients / scale, reference.gradients / scale, atol=1e-9)
    if unknown:
        assert (found.gradients[0, -problem.data.unknown.size :] != 0.0).all()


def test_jacobian_is_that_of_central_differences() -> None:
    field, problem = field_of(4, "second_order", True), problem_of(4, True)
    theta = np.concatenate([flat_parameters(field), [0.4, -0.2]])
    engine = CompiledEngine(shape_of(field), problem)
    found, steps = engine.residual_jacobian(theta), engine.residual_jacobian(theta)
    del steps
    frozen = engine._residuals.steps  # type: ignore[union-attr]
    direction = np.random.default_rng(1).normal(size=theta.size)
    ahead, behind = (
        engine.residual_jacobian(theta + sign * 1e-5 * direction, False, frozen).residuals for sign in (1.0, -1.0)
    )
    slope = (ahead - behind) / 2e-5
    np.testing.assert_allclose(found.jacobian @ direction, slope, rtol=1e-5, atol=1e-6 * np.abs(slope).max())


def test_residuals_without_derivatives_are_the_same() -> None:
    field, problem = field_of(2, "second_order", False), problem_of(2, False)
    engine, theta = CompiledEngine(shape_of(field), problem), flat_parameters(field)
    with_them, without = engine.residual_jacobian(theta), engine.residual_jacobian(theta, False)
    np.testing.assert_array_equal(with_them.residuals, without.residuals)
    assert without.jacobian.shape == (0, theta.size)


def test_what_has_no_residuals_is_refused() -> None:
    field, problem = field_of(2, "second_order", False), problem_of(2, False).unsolved()
    for engine in (CompiledEngine(shape_of(field), problem), TorchEngine(field, problem, {})):
        with pytest.raises(ValueError, match="residuals are those of the six terms along a solution"):
            engine.residual_jacobian(flat_parameters(field))


def test_a_linear_field_is_its_matrix() -> None:
    """A network of zeros beside a matrix: A is the matrix, and the solution that of the matrix exponential."""
    shape = MlpShape((2, 3, 1), "tanh", "second_order", np.ones(2), np.ones(1), linear=True)
    theta = np.concatenate([np.zeros(shape.network_parameters), [-25.0, -0.05]])
    problem = oracle.make_problem(2, solver=oracle.adaptive(rtol=1e-10, atol=1e-12))
    found = CompiledEngine(shape, problem).loss_jacobian(theta)
    matrix = np.array([[0.0, 1.0], [-25.0, -0.05]])
    values, vectors = np.linalg.eig(matrix)
    weights = np.linalg.solve(vectors, problem.data.initial_state.astype(complex))
    exact = (vectors @ (weights[:, None] * np.exp(np.outer(values, problem.data.times)))).real.T
    np.testing.assert_allclose(found.trajectory, exact, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(np.sort_complex(found.spectra[0]), np.sort_complex(values), rtol=1e-12)
