"""Activations: their values against many digits, their derivatives against autograd."""

import mpmath
import numpy as np
import pytest
import torch

from eigenode_cli.engines.compiled import activations
from eigenode_cli.engines.compiled.memory import start_of
from eigenode_cli.jit import njit
from tests.engines.compiled import oracle


@njit
def tanh_of(x, y):
    for i in range(x.size):
        y[i] = activations.tanh(x[i])


@njit
def expm1_of(x, y):
    for i in range(x.size):
        y[i] = activations.expm1(x[i])


@njit
def activate_of(code, z, slope, curve):
    activations.activate_twice(code, z.size, start_of(z), start_of(slope), start_of(curve))


@njit
def activate_once_of(code, z, slope):
    activations.activate(code, z.size, start_of(z), start_of(slope))


def ulps(function, exact, points):
    found = np.empty_like(points)
    function(points, found)
    with mpmath.workdps(40):
        wanted = [exact(mpmath.mpf(float(x))) for x in points]
        return max(
            abs(float((mpmath.mpf(float(f)) - w) / mpmath.mpf(float(np.spacing(abs(float(w)))))))
            for f, w in zip(found, wanted, strict=True)
        )


def points() -> np.ndarray:
    random = np.random.default_rng(0)
    near = np.concatenate([random.uniform(-1.0, 1.0, 2000), random.uniform(-25.0, 25.0, 2000)])
    size = np.geomspace(1e-308, 1e3, 1000)
    borders = 0.5 * np.log(2.0) * np.arange(-60, 61)  # where the reduced argument jumps
    return np.concatenate([near, size, -size, borders, np.nextafter(borders, 100.0), np.nextafter(borders, -100.0)])


def test_tanh_to_a_few_units_in_the_last_place():
    assert ulps(tanh_of, mpmath.tanh, points()) < 4.0


def test_expm1_to_a_few_units_in_the_last_place():
    x = points()
    assert ulps(expm1_of, mpmath.expm1, x[np.abs(x) < 708.0]) < 4.0


def test_tanh_at_the_ends():
    x = np.array([0.0, -0.0, 5e-324, -5e-324, 20.0, -20.0, 1e300, -1e300, np.inf, -np.inf, np.nan])
    found = np.empty_like(x)
    tanh_of(x, found)
    np.testing.assert_array_equal(found, np.tanh(x))
    np.testing.assert_array_equal(np.signbit(found[:-1]), np.signbit(x[:-1]))


def test_tanh_is_odd_and_monotonic():
    x = np.sort(np.random.default_rng(1).uniform(0.0, 21.0, 20_000))
    up, down = np.empty_like(x), np.empty_like(x)
    tanh_of(x, up)
    tanh_of(-x, down)
    np.testing.assert_array_equal(up, -down)
    assert np.all(np.diff(up) > -3e-16)
    assert np.all(up <= 1.0)


@pytest.mark.parametrize("name", [*oracle.ACTIVATIONS, "tanh_libm"])
@pytest.mark.parametrize("size", [1, 7, 8, 33])
def test_derivatives_are_those_of_autograd(name, size):
    z = np.random.default_rng(size).normal(size=size) * 4.0
    leaf = torch.from_numpy(z.copy()).requires_grad_()
    value = oracle.ACTIVATIONS[name.removesuffix("_libm")](leaf)
    (first,) = torch.autograd.grad(value.sum(), leaf, create_graph=True)
    second = torch.zeros_like(leaf)
    if first.requires_grad:
        (second,) = torch.autograd.grad(first.sum(), leaf, materialize_grads=True)
    found, slope, curve = z.copy(), np.empty(size), np.empty(size)
    activate_of(activations.ACTIVATIONS[name], found, slope, curve)
    np.testing.assert_allclose(found, value.detach().numpy(), rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(slope, first.detach().numpy(), rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(curve, second.detach().numpy(), rtol=1e-12, atol=1e-15)
    again, slope_again = z.copy(), np.empty(size)
    activate_once_of(activations.ACTIVATIONS[name], again, slope_again)
    np.testing.assert_allclose(again, found, rtol=1e-15)
    np.testing.assert_allclose(slope_again, slope, rtol=1e-15)


@pytest.mark.parametrize("name", oracle.ACTIVATIONS)
def test_nan_is_seen_and_large_numbers_do_not_overflow(name):
    z = np.array([np.nan, 700.0, -700.0, 1e5, -1e5])
    wanted = oracle.ACTIVATIONS[name](torch.from_numpy(z)).numpy()
    slope, curve = np.empty(5), np.empty(5)
    activate_of(activations.ACTIVATIONS[name], z, slope, curve)
    np.testing.assert_allclose(z, wanted, rtol=1e-12, atol=1e-290)
    assert np.isnan(z[0])
    assert np.isfinite(slope[1:]).all()
    assert np.isfinite(curve[1:]).all()


@pytest.mark.parametrize("name", ["sigmoid", "silu", "softplus", "elu"])
def test_saturated_units_keep_their_digits(name):
    """Eigenvalues of dead units are tiny, and ratios of them count: no floor, and no sum with 1 in between."""
    z = np.array([-30.0, -36.0, -40.0, -100.0, -600.0, -800.0, -1e6, -1e300])
    leaf = torch.from_numpy(z.copy()).requires_grad_()
    value = torch.nn.functional.softplus(leaf) if name == "softplus" else oracle.ACTIVATIONS[name](leaf)
    (first,) = torch.autograd.grad(value.sum(), leaf, create_graph=True)
    (second,) = torch.autograd.grad(first.sum(), leaf)
    slope, curve = np.empty(z.size), np.empty(z.size)
    activate_of(activations.ACTIVATIONS[name], z, slope, curve)
    np.testing.assert_allclose(slope, first.detach().numpy(), rtol=1e-12, atol=0.0)
    np.testing.assert_allclose(curve, second.numpy(), rtol=1e-12, atol=0.0)
