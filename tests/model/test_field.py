"""Networks, initial weights, scalings and structures."""

import numpy as np
import pytest
import torch

from eigenode_cli.config.build import build_field
from eigenode_cli.config.schema import MlpConfig, PolynomialConfig
from eigenode_cli.model import flat_parameters, load_flat
from eigenode_cli.model.activations import ACTIVATIONS
from eigenode_cli.model.init import INITS
from eigenode_cli.model.mlp import Mlp
from eigenode_cli.model.polynomial import Polynomial

STATES = np.array([[1.0, 0.0], [-4.0, 2.0]])
RATES = np.array([[0.0, -3.0], [2.0, 5.0]])

CUBIC = PolynomialConfig(
    name="polynomial",
    target="eigenode_cli.model:Polynomial",
    structure="full",
    linear="none",
    output_gain=1.0,
    degree=3,
    spread=1.0,
)


def mlp(**changes: object) -> MlpConfig:
    options = {
        "name": "mlp",
        "target": "eigenode_cli.model:Mlp",
        "structure": "second_order",
        "hidden": [32],
        "activation": "tanh",
        "init": "glorot",
        "input_scaling": "none",
        "output_scaling": "none",
        "scaling_from": "data",
        "linear": "none",
        "output_gain": 1.0,
    }
    return MlpConfig(**(options | changes))  # type: ignore[arg-type]


def test_the_papers_network_has_129_parameters() -> None:
    field = build_field(mlp(), STATES, RATES, seed=0)
    assert flat_parameters(field).size == 129
    assert list(field.network.state_dict()) == ["layers.0.weight", "layers.0.bias", "layers.1.weight", "layers.1.bias"]
    assert all(tensor.dtype == torch.float64 for tensor in field.network.state_dict().values())


@pytest.mark.parametrize("hidden", [[], [5], [4, 3], [6, 5, 4]])
@pytest.mark.parametrize("structure", ["second_order", "full"])
@pytest.mark.parametrize("scaling", ["none", "max_abs"])
@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_symbolic_jacobian_is_the_derivative(hidden: list[int], structure: str, scaling: str, activation: str) -> None:
    config = mlp(
        hidden=hidden, structure=structure, activation=activation, input_scaling=scaling, output_scaling=scaling
    )
    field = build_field(config, STATES, RATES, seed=1)
    x = torch.randn(3, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    assert field(x).shape == (3, 2)
    expected = torch.stack([torch.autograd.functional.jacobian(field, row) for row in x])  # type: ignore[misc]
    torch.testing.assert_close(field.jacobian(x), expected, rtol=1e-12, atol=1e-14)


def test_second_order_passes_the_velocity_through() -> None:
    x = torch.tensor([[0.3, -0.7]], dtype=torch.float64)
    assert build_field(mlp(), STATES, RATES, seed=0)(x)[0, 0] == x[0, 1]


def test_scaling_divides_inputs_and_multiplies_outputs_by_the_largest_modulus() -> None:
    scaled = build_field(mlp(input_scaling="max_abs", output_scaling="max_abs"), STATES, RATES, seed=0)
    plain = build_field(mlp(), STATES, RATES, seed=0)
    x = torch.tensor([[0.3, -0.7]], dtype=torch.float64)
    inside = x / torch.tensor([4.0, 2.0], dtype=torch.float64)
    torch.testing.assert_close(scaled(x)[0, 1], 5.0 * plain.network(inside)[0, 0])  # type: ignore[operator]
    assert flat_parameters(scaled).size == 129
    assert set(scaled.network.state_dict()) - set(plain.network.state_dict()) == {"input_scale", "output_scale"}


def test_initial_weights_depend_on_the_seed_alone() -> None:
    first, second, other = (flat_parameters(build_field(mlp(), STATES, RATES, seed=s)) for s in (0, 0, 1))
    assert first.tobytes() == second.tobytes()
    assert not np.array_equal(first, other)


@pytest.mark.parametrize("init", INITS)
def test_initial_weights_lie_in_their_bounds(init: str) -> None:
    network = build_field(mlp(hidden=[400], init=init), STATES, RATES, seed=0).network
    assert isinstance(network, Mlp)
    weight, bias = network.layers[0].weight.detach(), network.layers[0].bias.detach()
    low, high = {
        "glorot": (-np.sqrt(6 / 402), np.sqrt(6 / 402)),
        "uniform01": (0.0, 1.0),
        "kaiming": (-5 / 3 * np.sqrt(1.5), 5 / 3 * np.sqrt(1.5)),
    }[init]
    assert low <= float(weight.min()) < low + 0.02 * (high - low)
    assert high - 0.02 * (high - low) < float(weight.max()) <= high
    assert bool((bias == 0).all()) == (init != "kaiming")


def test_polynomial_has_every_monomial_once() -> None:
    field = build_field(CUBIC, STATES, RATES, 0)
    assert flat_parameters(field).size == 2 * 10
    x, y = 0.5, -2.0
    theta = np.zeros(20)
    theta[:10] = np.arange(10.0)
    load_flat(field, theta)
    value = field(torch.tensor([x, y], dtype=torch.float64)).detach()
    monomials = [1, x, y, x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3]
    assert float(value[0]) == pytest.approx(sum(k * m for k, m in enumerate(monomials)))
    assert float(value[1]) == 0.0


def test_polynomial_is_smooth_at_the_origin() -> None:
    field = build_field(CUBIC, STATES, RATES, 0)
    origin = torch.zeros(2, dtype=torch.float64)
    hessian = torch.autograd.functional.hessian(lambda x: field(x)[0], origin)
    assert isinstance(field.network, Polynomial)
    c = field.network.coefficients[0].detach()
    torch.testing.assert_close(hessian, torch.stack([torch.stack([2 * c[3], c[4]]), torch.stack([c[4], 2 * c[5]])]))


def test_flat_parameters_round_trip() -> None:
    field = build_field(mlp(), STATES, RATES, seed=0)
    theta = np.arange(129.0)
    load_flat(field, theta)
    np.testing.assert_array_equal(flat_parameters(field), theta)
    assert isinstance(field.network, Mlp)
    np.testing.assert_array_equal(field.network.layers[0].weight.detach().numpy(), np.arange(64.0).reshape(32, 2))
