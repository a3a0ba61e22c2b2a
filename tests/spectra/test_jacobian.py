"""The Jacobian's three methods agree, and so do their derivatives in states and parameters."""

import pytest
import torch
from torch import Tensor, nn
from torch.autograd import forward_ad, gradcheck
from torch.func import jvp, vmap

from eigenode_cli.spectra.jacobian import METHODS, jacobian

TOLERANCE = {"autodiff": 1e-13, "finite_difference": 1e-8, "symbolic": 1e-13}


class Pendulum(nn.Module):
    """`(x, v) -> (v, -a sin x - b v^3)`, with everything about it known."""

    def __init__(self) -> None:
        super().__init__()
        self.a = nn.Parameter(torch.tensor(2.0, dtype=torch.float64))
        self.b = nn.Parameter(torch.tensor(0.3, dtype=torch.float64))

    def forward(self, x: Tensor) -> Tensor:
        return torch.stack([x[..., 1], -self.a * torch.sin(x[..., 0]) - self.b * x[..., 1] ** 3], dim=-1)

    def jacobian(self, x: Tensor) -> Tensor:
        zero, one = torch.zeros_like(x[..., 0]), torch.ones_like(x[..., 0])
        lower = torch.stack([-self.a * torch.cos(x[..., 0]), -3.0 * self.b * x[..., 1] ** 2], dim=-1)
        return torch.stack([torch.stack([zero, one], dim=-1), lower], dim=-2)


def states(*shape: int) -> Tensor:
    return torch.randn(*shape, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(3))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("shape", [(), (1,), (101,), (3, 4), (0,)])
def test_value_for_any_batch(method, shape):
    field, x = Pendulum(), states(*shape)
    found = jacobian(field, x, method)
    assert found.shape == (*shape, 2, 2)
    torch.testing.assert_close(found, field.jacobian(x), rtol=0, atol=TOLERANCE[method])


@pytest.mark.parametrize("method", METHODS)
def test_derivatives_in_states_and_parameters(method):
    field, x = Pendulum(), states(7).requires_grad_()
    weight = torch.randn(7, 2, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(4))
    leaves = (x, field.a, field.b)
    found = torch.autograd.grad((jacobian(field, x, method) * weight).sum(), leaves)
    # by hand: A10 = -a cos x, A11 = -3 b v^2
    position, speed = x.detach().unbind(-1)
    lower = weight[:, 1]
    expected = (
        torch.stack([2.0 * torch.sin(position) * lower[:, 0], -1.8 * speed * lower[:, 1]], dim=-1),
        -(torch.cos(position) * lower[:, 0]).sum(),
        -(3.0 * speed**2 * lower[:, 1]).sum(),
    )
    for slope, known in zip(found, expected, strict=True):
        torch.testing.assert_close(slope, known, rtol=0, atol=10.0 * TOLERANCE[method])


@pytest.mark.parametrize("method", ["autodiff", "symbolic"])
def test_gradcheck_in_both_modes(method):
    field = Pendulum()
    assert gradcheck(lambda x: jacobian(field, x, method), (states(3).requires_grad_(),), check_forward_ad=True)


@pytest.mark.parametrize("method", METHODS)
def test_forward_mode_and_transforms(method):
    field, x, direction = Pendulum(), states(5), states(5).flip(0)
    tangent = jvp(lambda y: jacobian(field, y, method), (x,), (direction,))[1]
    exact = jvp(field.jacobian, (x,), (direction,))[1]
    torch.testing.assert_close(tangent, exact, rtol=0, atol=10.0 * TOLERANCE[method])
    with forward_ad.dual_level():
        dual = jacobian(field, forward_ad.make_dual(x, direction), method)
        torch.testing.assert_close(forward_ad.unpack_dual(dual).tangent, tangent, rtol=0, atol=1e-13)
    torch.testing.assert_close(vmap(lambda y: jacobian(field, y, method))(x), jacobian(field, x, method))


@pytest.mark.parametrize("method", METHODS)
def test_works_without_recording_gradients(method):
    field, x = Pendulum(), states(4)
    with torch.no_grad():
        found = jacobian(field, x, method)
    assert not found.requires_grad
    torch.testing.assert_close(found, field.jacobian(x).detach(), rtol=0, atol=TOLERANCE[method])


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_finite_difference_step_follows_the_size_of_the_state(size):
    """x^2 has no truncation error, and the difference quotient's rounding stays relative to the slope."""
    x = torch.full((1, 1), size, dtype=torch.float64)
    found = jacobian(lambda y: y**2, x, "finite_difference")
    torch.testing.assert_close(found.squeeze(), torch.tensor(2.0 * size, dtype=torch.float64), rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("size", [1e-6, 1e-3, 1.0, 1e6])
@pytest.mark.parametrize("scaled", [True, False], ids=["field of that size", "field of size 1"])
def test_finite_difference_at_states_of_any_size(size, scaled):
    """A field that varies over the states' own size, and one that hardly varies over it (or much faster)."""
    generator = torch.Generator().manual_seed(5)
    first, last = (torch.randn(*shape, dtype=torch.float64, generator=generator) for shape in ((8, 2), (2, 8)))
    width = size if scaled else max(1.0, size)
    field = lambda x: torch.tanh(x @ first.T / width + 0.3) @ last.T  # noqa: E731
    x, sizes = size * states(20), torch.full((2,), 2.0 * size, dtype=torch.float64)
    exact = jacobian(field, x, "autodiff")
    found = jacobian(field, x, "finite_difference", sizes)
    assert float((found - exact).norm() / exact.norm()) < 1e-6


def test_finite_difference_where_a_state_is_always_zero():
    sizes = torch.tensor([0.0, 2.0], dtype=torch.float64)
    found = jacobian(Pendulum(), states(3), "finite_difference", sizes)
    torch.testing.assert_close(found, Pendulum().jacobian(states(3)), rtol=0, atol=1e-8)


@pytest.mark.parametrize("method", ["autodiff", "finite_difference"])
def test_a_constant_field_has_a_zero_jacobian(method):
    found = jacobian(torch.zeros_like, states(3), method)
    assert (found == 0.0).all()
    assert found.shape == (3, 2, 2)


def test_an_unknown_method_is_refused_with_those_that_work():
    with pytest.raises(ValueError, match=r"eigen.jacobian=numeric: .* autodiff, finite_difference, symbolic"):
        jacobian(Pendulum(), states(1), "numeric")


def test_symbolic_needs_a_closed_form():
    with pytest.raises(ValueError, match=r"Linear offers no jacobian\(states\); use autodiff or finite_difference"):
        jacobian(nn.Linear(2, 2, dtype=torch.float64), states(1), "symbolic")
    without = Pendulum()
    without.has_symbolic_jacobian = False
    with pytest.raises(ValueError, match="Pendulum offers no jacobian"):
        jacobian(without, states(1), "symbolic")
