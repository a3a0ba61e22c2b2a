"""Models made by hand, what eigenode's own modules say of them, and how far a file's rates are from that."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from eigenode_cli.arrays import Floats
from eigenode_cli.export.exported import ExportedModel, Layer, Monomials, Perceptron
from eigenode_cli.model import Mlp, Polynomial
from eigenode_cli.systems.base import State

STATES, SEED = 10_000, 20_230
"""Number of random states, and the seed of everything that is drawn."""


def made(
    activation: str = "tanh",
    structure: str = "second_order",
    n: int = 2,
    k: int = 0,
    scaled: bool = False,
    linear: bool = False,
    hidden: tuple[int, ...] = (12, 7),
    degree: int = 0,
    **more: Any,
) -> ExportedModel:
    """A model with random numbers; `scaled` gives every scale and unit a value of its own, `degree` a polynomial."""
    draw = np.random.default_rng(SEED)
    generator = torch.Generator().manual_seed(SEED)
    m = n // 2 if structure == "second_order" else n
    if degree:
        polynomial = Polynomial(n + k, m, degree, 0.5, generator)
        network: Any = Monomials(polynomial.exponents.numpy(), polynomial.coefficients.detach().numpy())
    else:
        scales = [torch.from_numpy(draw.uniform(0.5, 3.0, size)) for size in (n + k, m)] if scaled else [None, None]
        mlp = Mlp(n + k, hidden, m, activation, "glorot", *scales, generator=generator)
        layers = [(layer.weight.detach().numpy(), draw.normal(0.0, 0.5, layer.out_features)) for layer in mlp._linear]
        arrays = [None if scale is None else scale.numpy() for scale in scales]
        network = Perceptron(tuple(Layer(*layer) for layer in layers), activation, *arrays)
    own: dict[str, Any] = {
        "name": "made",
        "states": tuple(State(f"x{i}", "m" if i < n // 2 else "m/s", f"x_{i}") for i in range(n)),
        "inputs": tuple(State(f"u{i}", "N", f"u_{i}") for i in range(k)),
        "network": network,
        "linear": draw.normal(size=(m, n + k)) if linear else None,
        "structure": structure,
        "state_units": draw.uniform(0.1, 9.0, n) if scaled else np.ones(n),
        "input_units": draw.uniform(0.1, 9.0, k) if scaled else np.ones(k),
        "time_unit": 2.5 if scaled else 1.0,
        "initial_state": draw.normal(size=n),
        "lowest": -np.ones(n),
        "highest": np.ones(n),
        "modes": ((0.8, 0.05),),
        "modes_at": "at the equilibrium x0 = 0",
        "command": "eigenode train system=made",
        "run": "2026-01-01_made",
        "version": "0.1.0",
    }
    return ExportedModel(**(own | more))


def variants() -> dict[str, ExportedModel]:
    """Every activation, structure, scale, input, linear part and kind of network."""
    activations = ("tanh", "sigmoid", "relu", "softplus", "silu", "elu", "sin", "identity")
    found = {f"{name}": made(name, scaled=True, k=1, linear=True) for name in activations}
    found["plain"] = made()
    found["full"] = made(structure="full", n=3)
    found["full scaled"] = made("silu", "full", n=3, k=2, scaled=True, linear=True)
    found["four states"] = made("sin", n=4, k=1, scaled=True)
    found["no hidden layer"] = made(hidden=(), k=1)
    found["one hidden layer"] = made("elu", hidden=(40,), linear=True)
    found["polynomial"] = made(degree=3, n=4, linear=True)
    found["polynomial with inputs"] = made(degree=2, structure="full", n=3, k=2, scaled=True)
    return found


VARIANTS = variants()


def random_points(model: ExportedModel, count: int = STATES) -> tuple[Floats, Floats]:
    """States `(count, n)` in and beyond the training range, and inputs `(count, k)`."""
    draw = np.random.default_rng(SEED + 1)
    middle, half = (model.highest + model.lowest) / 2.0, (model.highest - model.lowest) / 2.0 + 1e-3
    x = middle + half * draw.uniform(-3.0, 3.0, (count, len(model.states)))
    return x, model.input_units * draw.uniform(-3.0, 3.0, (count, len(model.inputs)))


def own_field(model: ExportedModel) -> Callable[[Tensor, Tensor], Tensor]:
    """The rates `(..., n)` at states and inputs by eigenode's own network modules."""
    n, size, network = len(model.states), len(model.states) + len(model.inputs), model.network
    if isinstance(network, Monomials):
        module: torch.nn.Module = Polynomial(size, network.outputs, int(network.exponents.sum(axis=1).max()))
        module.load_state_dict({"coefficients": _tensor(network.coefficients)})
    else:
        hidden = [layer.bias.size for layer in network.layers[:-1]]
        scales = [None if s is None else _tensor(s) for s in (network.input_scale, network.output_scale)]
        module = Mlp(size, hidden, network.outputs, network.activation, "glorot", *scales)
        for number, layer in enumerate(network.layers):
            module.layers[number].load_state_dict({"weight": _tensor(layer.weight), "bias": _tensor(layer.bias)})

    def rates(x: Tensor, u: Tensor) -> Tensor:
        z = torch.cat([x / _tensor(model.state_units), u / _tensor(model.input_units)], dim=-1)
        g = module(z)
        if model.linear is not None:
            g = g + z @ _tensor(model.linear).T
        if model.structure == "second_order":
            g = torch.cat([z[..., n // 2 : n], g], dim=-1)
        return g * _tensor(model.state_units) / model.time_unit

    return rates


def expected(model: ExportedModel, x: Floats, u: Floats) -> Floats:
    """The same as arrays."""
    with torch.no_grad():
        return own_field(model)(torch.from_numpy(x), torch.from_numpy(u)).numpy()


def disagreement(found: Floats, wanted: Floats) -> float:
    """Largest difference relative to the largest rate; infinite where a number is missing."""
    difference = float(np.abs(found - wanted).max() / np.abs(wanted).max())
    return difference if math.isfinite(difference) and found.shape == wanted.shape else math.inf


def _tensor(values: Floats) -> Tensor:
    return torch.from_numpy(np.array(values))


def awkward() -> ExportedModel:
    """A model whose names and command hold all that languages take for their own."""
    text = 'a"b*/ /*c??/ \\ <&> \u00b5 """ %s {{ x }} {% raw %}\'\n'
    return made(
        n=2,
        k=1,
        name="9 odd-names",
        states=(State(f"x{text}", "\u00b0C", "x"), State("y", "1/s", "y")),
        inputs=(State(f"u{text}", "N m/s^2", "u"),),
        command=f"eigenode train {text}",
        run="a*/b",
    )
