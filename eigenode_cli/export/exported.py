"""What is exported: a learned vector field as plain numbers, with all that a user of it should know."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.special import expit

from eigenode_cli.arrays import Floats, Integers
from eigenode_cli.systems.base import State


def _elu(z: Floats) -> Floats:
    return np.where(z > 0.0, z, np.expm1(np.minimum(z, 0.0)))


ACTIVATIONS: dict[str, Callable[[Floats], Floats]] = {
    "tanh": np.tanh,
    "sigmoid": expit,
    "relu": lambda z: np.maximum(z, 0.0),
    "softplus": lambda z: np.maximum(z, 0.0) + np.log1p(np.exp(-np.abs(z))),
    "silu": lambda z: z * expit(z),
    "elu": _elu,
    "sin": np.sin,
    "identity": lambda z: z,
}
"""Activations by name. Every format has all of them."""


@dataclass(frozen=True, eq=False)
class Layer:
    """An affine map: `weight (m, n)` and `bias (m,)`."""

    weight: Floats
    bias: Floats


@dataclass(frozen=True, eq=False)
class Perceptron:
    """`y = output_scale * (W_L act(... act(W_0 (input_scale * z) + b_0) ...) + b_L)`.

    Attributes:
        layers: from the first to the last one, which has no activation.
        activation: of the hidden layers, one of `ACTIVATIONS`.
        input_scale: factors `(n + k,)`, None for none.
        output_scale: factors `(m,)`, None for none.
    """

    layers: tuple[Layer, ...]
    activation: str = "tanh"
    input_scale: Floats | None = None
    output_scale: Floats | None = None

    @property
    def outputs(self) -> int:
        """Number of outputs m."""
        return self.layers[-1].bias.size

    @property
    def width(self) -> int:
        """Width of the widest layer, the input included."""
        return max(self.layers[0].weight.shape[1], *(layer.bias.size for layer in self.layers))

    def __call__(self, z: Floats) -> Floats:
        """Return the outputs `(N, m)` at `z (N, n + k)`."""
        h = z if self.input_scale is None else z * self.input_scale
        for layer in self.layers[:-1]:
            h = ACTIVATIONS[self.activation](h @ layer.weight.T + layer.bias)
        y = h @ self.layers[-1].weight.T + self.layers[-1].bias
        return y if self.output_scale is None else y * self.output_scale


@dataclass(frozen=True, eq=False)
class Monomials:
    """`y_j = sum_a c_ja z^a`, a polynomial.

    Attributes:
        exponents: of each monomial `(M, n + k)`.
        coefficients: `(m, M)`.
    """

    exponents: Integers
    coefficients: Floats

    @property
    def outputs(self) -> int:
        """Number of outputs m."""
        return self.coefficients.shape[0]

    @property
    def degree(self) -> int:
        """Largest power of one variable."""
        return int(self.exponents.max(initial=0))

    def __call__(self, z: Floats) -> Floats:
        """Return the outputs `(N, m)` at `z (N, n + k)`."""
        return np.prod(z[:, None, :] ** self.exponents, axis=-1) @ self.coefficients.T


@dataclass(frozen=True, eq=False)
class ExportedModel:
    """`dx/dt = X/T * g(x/X, u/U)`, where `g` is the network's output y, and a linear part of `z = (x/X, u/U)` with it.

    All values are in the user's units. Structure `second_order`: `g = (velocities, y)`, where the velocities are the
    second half of `x/X`; `full`: `g = y`.

    Attributes:
        name: of the system, as it was chosen.
        states: name, unit and symbol of each state `(n,)`.
        inputs: the same of each input `(k,)`; none of an autonomous system.
        network: what was learned.
        linear: matrix `(m, n + k)` whose product with z is added to the network's output; None for none.
        structure: `second_order` or `full`.
        state_units: X `(n,)`, what 1 of a scaled state is in the state's own unit.
        input_units: U `(k,)`, the same of the inputs.
        time_unit: T in s.
        initial_state: state `(n,)` that the training starts from.
        start, end: of the training horizon in s.
        lowest, highest: of each state in training `(n,)`.
        modes: damped frequency in Hz and damping ratio of each pair of eigenvalues.
        modes_at: where in the space of the states these are, in words.
        step: size in s of a fixed step of RK4 that resolves the fastest eigenvalue in training.
        trained_steps: training steps done.
        command: what was typed to make the run.
        run: name of its folder.
        version: of eigenode.
    """

    name: str
    states: tuple[State, ...]
    network: Perceptron | Monomials
    state_units: Floats
    initial_state: Floats
    lowest: Floats
    highest: Floats
    inputs: tuple[State, ...] = ()
    linear: Floats | None = None
    structure: str = "full"
    input_units: Floats = field(default_factory=lambda: np.empty(0))
    time_unit: float = 1.0
    start: float = 0.0
    end: float = 1.0
    modes: tuple[tuple[float, float], ...] = ()
    modes_at: str = ""
    step: float = 0.01
    trained_steps: int = 0
    command: str = ""
    run: str = ""
    version: str = ""

    def __post_init__(self) -> None:
        """Check the shapes, and that every number is finite.

        Raises:
            ValueError: something does not fit; the message names it.
        """
        n, k, m = len(self.states), len(self.inputs), self.network.outputs
        if m != (n // 2 if self.structure == "second_order" else n):
            raise ValueError(f"{m} outputs of the network do not give the rates of {n} states, {self.structure}")
        shapes = {
            "state_units": (n,),
            "input_units": (k,),
            "initial_state": (n,),
            "lowest": (n,),
            "highest": (n,),
            "linear": (m, n + k),
        }
        for name, shape in shapes.items():
            found = getattr(self, name)
            if found is not None and found.shape != shape:
                raise ValueError(f"{name} has the shape {found.shape}, not {shape}")
        for name, array in self.arrays().items():
            if not np.isfinite(array).all():
                raise ValueError(f"{name} is not finite")

    def arrays(self) -> dict[str, Floats]:
        """Return every array of numbers of it by name, those that it has not left out."""
        found: dict[str, Floats | None] = {
            name: getattr(self, name)
            for name in ("linear", "state_units", "input_units", "initial_state", "lowest", "highest")
        }
        if isinstance(self.network, Perceptron):
            for number, layer in enumerate(self.network.layers):
                found |= {f"layers.{number}.weight": layer.weight, f"layers.{number}.bias": layer.bias}
            found |= {"input_scale": self.network.input_scale, "output_scale": self.network.output_scale}
        else:
            found["coefficients"] = self.network.coefficients
        return {name: array for name, array in found.items() if array is not None}

    def rates(self, x: Floats, u: Floats | None = None) -> Floats:
        """Return `dx/dt (N, n)` at the states `x (N, n)` and inputs `u (N, k)`, zero by default.

        This is what the exported files compute, in the same order, and what they are tested against.
        """
        scaled = x / self.state_units
        inputs = np.zeros((len(x), len(self.inputs))) if u is None else u / self.input_units
        z = np.concatenate([scaled, inputs], axis=1)
        y = self.network(z)
        if self.linear is not None:
            y = y + z @ self.linear.T
        g = y if self.structure == "full" else np.concatenate([scaled[:, len(self.states) // 2 :], y], axis=1)
        return g * (self.state_units / self.time_unit)
