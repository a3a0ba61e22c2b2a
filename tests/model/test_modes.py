"""Initial values of the linear part: stated modes and least squares."""

import numpy as np
import pytest

from eigenode_cli.config.compose import compose, typed
from eigenode_cli.config.setup import build
from eigenode_cli.data.reconstruct import Estimate
from eigenode_cli.data.simulate import Truth
from eigenode_cli.data.targets import StatedTarget, TruthTarget
from eigenode_cli.model.modes import fitted_matrix, modal_matrix, stated_pairs
from eigenode_cli.systems import VanDerPol

TIMES = np.linspace(0.0, 3.0, 121)


def linear_motion(matrix: np.ndarray, start: np.ndarray) -> Estimate:
    """Exact states and rates of `x' = A x`."""
    values, vectors = np.linalg.eig(matrix)
    weights = np.linalg.solve(vectors, start.astype(complex))
    states = (vectors @ (weights[:, None] * np.exp(np.outer(values, TIMES)))).real.T
    return Estimate(states, states @ matrix.T)


def companion(stiffness: np.ndarray, damping: np.ndarray) -> np.ndarray:
    m = len(stiffness)
    return np.block([[np.zeros((m, m)), np.eye(m)], [-stiffness, -damping]])


CHAIN = companion(np.array([[20.0, -8.0], [-8.0, 12.0]]), np.array([[0.3, -0.1], [-0.1, 0.2]]))


def test_one_degree_of_freedom_has_its_pair_exactly() -> None:
    pairs = stated_pairs(StatedTarget([0.8], [0.02]).rows(np.zeros(5)))
    matrix = modal_matrix(pairs, linear_motion(companion(np.eye(1), np.eye(1)), np.ones(2)), "second_order")
    spectrum = np.linalg.eigvals(np.vstack([[0.0, 1.0], matrix]))
    assert abs(spectrum.imag[0]) / (2 * np.pi) == pytest.approx(0.8, rel=1e-12)
    assert -spectrum.real[0] / abs(spectrum[0]) == pytest.approx(0.02, rel=1e-12)


@pytest.mark.parametrize("structure", ["second_order", "full"])
def test_several_modes_take_their_shapes_from_the_motion(structure: str) -> None:
    estimate = linear_motion(CHAIN, np.array([1.0, -0.3, 0.2, 0.7]))
    np.testing.assert_allclose(fitted_matrix(estimate, structure)[-2:], CHAIN[2:], atol=1e-6)
    values = np.linalg.eigvals(CHAIN)
    upper = np.sort_complex(values[values.imag > 0.0])
    matrix = modal_matrix(1.1 * upper, estimate, structure)
    whole = matrix if structure == "full" else np.vstack([np.eye(4)[2:], matrix])
    found = np.linalg.eigvals(whole)
    np.testing.assert_allclose(np.sort_complex(found[found.imag > 0.0]), 1.1 * upper, rtol=1e-6)
    if structure == "full":
        right, other = (np.linalg.eig(one)[1] for one in (CHAIN, whole))
        overlap = np.abs(right.conj().T @ other)
        assert np.allclose(overlap.max(axis=1), 1.0, atol=1e-6)  # the same shapes


def test_a_pair_that_comes_and_goes_is_none_of_a_linear_system() -> None:
    times = np.linspace(0.0, 30.0, 91)
    assert stated_pairs(TruthTarget(Truth(VanDerPol(), (2.0, 0.0))).rows(times)).size == 0
    assert stated_pairs(StatedTarget().rows(times)).size == 0
    assert not modal_matrix(np.empty(0), Estimate(np.ones((4, 2)), np.ones((4, 2))), "full").any()


def test_more_pairs_than_states_are_refused() -> None:
    with pytest.raises(ValueError, match="2 pairs do not fit into 2 states"):
        modal_matrix(np.array([1j, 2j]), Estimate(np.ones((4, 2)), np.ones((4, 2))), "second_order")


def test_the_field_starts_as_the_stated_system() -> None:
    words = ["system=oscillator", "network.linear=modes", "network.output_gain=0", "grads=sol+frq+dmp"]
    setup = build(typed(compose(words)))
    assert setup.field.linear is not None
    np.testing.assert_allclose(setup.field.linear.weight.detach().numpy(), [[-25.0, -0.05]], rtol=1e-9)
    found = setup.engine.loss_jacobian(setup.theta)
    assert found.values[0] < 1e-3
    assert found.values[1:].max() < 1e-9
