"""Every system: Jacobian by complex step, exact solutions, the reference solution's accuracy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from eigenode_cli.config.plugins import GROUPS, load_class
from eigenode_cli.data.dataset import Series
from eigenode_cli.data.simulate import Truth, simulate
from eigenode_cli.data.targets import StatedTarget, TruthTarget, targets_of_spectra
from eigenode_cli.systems import Oscillator, System, VanDerPol

OSCILLATOR = Oscillator(m=2.0)
VDP = VanDerPol()
TRUTH = Truth(VDP, (2.0, 0.0))


def measured(times: np.ndarray, noise: float = 0.0, seed: int = 0) -> Series:
    return simulate(TRUTH, times, ["nu"], noise, seed).series[0]


SHIPPED = [load_class(target) for target in GROUPS["system"].shipped]


@pytest.mark.parametrize("system", [OSCILLATOR, *(plugin() for plugin in SHIPPED)], ids=lambda s: s.title)
def test_jacobian_is_that_of_the_dynamics(system: System) -> None:
    n = len(system.states)
    states = np.random.default_rng(1).normal(size=(5, n))
    jacobian = system.jacobian(states)
    assert jacobian.shape == (5, n, n)
    for i in range(n):
        step = np.zeros(n, dtype=np.complex128)
        step[i] = 1e-30j
        column = system.dynamics(states + step).imag / 1e-30  # type: ignore[arg-type]  # the complex step
        np.testing.assert_allclose(jacobian[..., i], column, rtol=1e-14, atol=1e-14)


def test_oscillator_follows_its_closed_form() -> None:
    system = Oscillator()
    times = np.linspace(0.0, 10.0, 101)
    decay, omega = 0.025, np.sqrt(25.0 - 0.025**2)
    exact = np.exp(-decay * times) * (np.cos(omega * times) + decay / omega * np.sin(omega * times))
    truth = Truth(system, (1.0, 0.0))
    np.testing.assert_allclose(truth.states(times)[:, 0], exact, atol=1e-8)
    targets = TruthTarget(truth).rows(times)
    assert (targets.pairs == 1).all()
    np.testing.assert_allclose(targets.frequency[:, 0], omega / (2.0 * np.pi), rtol=1e-12)
    np.testing.assert_allclose(targets.damping[:, 0], decay / 5.0, rtol=1e-12)
    np.testing.assert_allclose(targets.stiffness, 1.0)


def test_van_der_pol_has_a_pair_at_18_percent_of_the_data_times() -> None:
    times = np.linspace(0.0, 30.0, 91)
    data = measured(times)
    assert data.values.shape == (91, 2)
    assert data.mask[:, 0].all()
    assert not data.mask[:, 1].any()
    assert TruthTarget(TRUTH).rows(times).pairs.mean() == pytest.approx(0.18, abs=0.02)
    assert np.abs(data.values[:, 0]).max() == pytest.approx(2.02, abs=0.02)  # the limit cycle's amplitude


def test_wrong_targets_are_wrong_in_their_frequency_alone() -> None:
    times = np.linspace(0.0, 30.0, 91)
    right, wrong = TruthTarget(TRUTH).rows(times), TruthTarget(TRUTH, 1.2).rows(times)
    np.testing.assert_allclose(wrong.frequency, 1.2 * right.frequency, rtol=1e-12)
    np.testing.assert_allclose(wrong.damping, right.damping, rtol=1e-12)
    np.testing.assert_array_equal(wrong.pairs, right.pairs)
    np.testing.assert_allclose(wrong.stiffness, right.stiffness, rtol=1e-12)


def test_noise_is_drawn_from_the_seed_for_what_is_observed() -> None:
    times = np.linspace(0.0, 300.0, 5001)
    data = measured(times)
    noisy, again, other = (measured(times, 0.1, seed) for seed in (3, 3, 4))
    assert noisy.values.tobytes() == again.values.tobytes() != other.values.tobytes()
    noise = noisy.values - data.values
    assert np.isnan(noise[:, 1]).all()
    assert noise[0, 0] == 0.0
    assert np.std(noise[:, 0]) == pytest.approx(0.1 * np.abs(data.values[:, 0]).max(), rel=0.05)
    assert abs(np.mean(noise[:, 0])) < 0.01


def test_what_is_not_known_of_the_initial_state_is_noisy_like_the_rest() -> None:
    data = simulate(TRUTH, np.linspace(0.0, 3.0, 9), ["nu", "nu_dot"], 0.1, 3, known=["nu_dot"]).series[0]
    assert np.isnan(data.initial_state).tolist() == [True, False]
    assert data.values[0, 0] != 2.0
    assert data.values[0, 1] == 0.0
    assert data.unknown.tolist() == [0]


def test_stated_targets_are_those_of_the_same_spectrum() -> None:
    pairs = np.array([[-0.3 + 9.0j, -0.3 - 9.0j, -0.8 + 4.0j, -0.8 - 4.0j]])
    known = targets_of_spectra(pairs)
    frequency, damping = [9.0 / (2 * np.pi), 4.0 / (2 * np.pi)], [0.3 / abs(-0.3 + 9.0j), 0.8 / abs(-0.8 + 4.0j)]
    stated = StatedTarget(frequency, damping).rows(np.zeros(1))
    for name in ("frequency", "damping", "pairs", "stiffness"):
        np.testing.assert_allclose(getattr(stated, name), getattr(known, name), rtol=1e-12)


def test_a_stiff_reference_is_solved_implicitly() -> None:
    """The Van der Pol oscillator with mu = 1000: DOP853 alone takes minutes; LSODA, another method, agrees."""
    system, times = VanDerPol(mu=1000.0), np.linspace(0.0, 1000.0, 501)
    states = Truth(system, (2.0, 0.0)).states(times)
    found = solve_ivp(
        lambda _t, x: system.dynamics(x), (0.0, 1000.0), (2.0, 0.0), "LSODA", times, rtol=1e-11, atol=1e-11
    )
    calm = np.abs(found.y[1]) < 1.0  # off the jumps, where a shift in time counts a thousandfold
    assert calm.sum() > 490
    np.testing.assert_allclose(states[calm, 0], found.y[0][calm], atol=1e-4)
    long = Truth(Oscillator(), (1.0, 0.0)).states(np.array([0.0, 500.0]))  # long, and not stiff: the exact solution
    decay, wave = -0.025, np.sqrt(25.0 - 0.025**2)
    exact = np.exp(decay * 500.0) * (np.cos(wave * 500.0) - decay / wave * np.sin(wave * 500.0))
    assert long[-1, 0] == pytest.approx(exact, abs=1e-9)
