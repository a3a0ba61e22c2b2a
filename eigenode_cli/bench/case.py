"""What is measured: one vector field at given weights with its problem; how those come about without a peer's help."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.bench import RECIPES
from eigenode_cli.config.compose import compose, typed
from eigenode_cli.config.schema import TrainConfig
from eigenode_cli.data.dataset import Series
from eigenode_cli.data.targets import targets_of_spectra
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.engines.compiled.mlp import MlpShape
from eigenode_cli.engines.problem import Problem
from eigenode_cli.model import VectorField, load_flat
from eigenode_cli.model.mlp import Mlp
from eigenode_cli.solve.settings import AdaptiveSolver

RTOL, ATOL = 1e-3, 1e-6
"""Tolerances of every solve that is timed: the paper's."""
TIGHT = 1e-9
"""Relative and absolute tolerance at which contestants must agree."""
UNGUARDED = 1e12
"""Condition guard of the comparison at tight tolerance: the peers have none."""
MAX_STEPS = 10_000


@dataclass(frozen=True)
class Case:
    """One loss Jacobian to be computed by every contestant.

    Attributes:
        shape: the vector field.
        problem: data, targets, terms, solver.
        theta: parameters at which it is computed `(P,)`.
    """

    shape: MlpShape
    problem: Problem
    theta: Floats

    @property
    def solver(self) -> AdaptiveSolver:
        """Method and tolerances."""
        solver = self.problem.solver
        if not isinstance(solver, AdaptiveSolver):
            raise ValueError(f"solver={solver.name}: peers are compared with adaptive steps")
        return solver

    @property
    def times(self) -> Floats:
        """Data times in s `(N,)`."""
        return self.problem.data.times

    def with_terms(self, terms: tuple[str, ...]) -> "Case":
        """Return the same with other terms."""
        return replace(self, problem=replace(self.problem, terms=terms))

    def tight(self) -> "Case":
        """Return the same at the tolerance at which contestants must agree, without a guard on the condition."""
        solver = replace(self.solver, rtol=TIGHT, atol=TIGHT, max_steps=100 * MAX_STEPS)
        return replace(self, problem=replace(self.problem, solver=solver, max_condition=UNGUARDED))


def recipe_config(name: str) -> TrainConfig:
    """Return the configuration whose training gives a case its weights: a system's, all else as shipped.

    Args:
        name: one of `RECIPES`.
    """
    system, grads, steps = RECIPES[name]
    return typed(compose([f"system={system}", f"grads={grads}", f"trainer.steps={steps}", "seed=0"]))


def torch_field(case: Case) -> VectorField:
    """Return the vector field of a case as a torch module, at its weights."""
    sizes = case.shape.sizes
    network = Mlp(sizes[0], sizes[1:-1], sizes[-1], case.shape.activation)
    field = VectorField(network, case.shape.structure)
    load_flat(field, case.theta)
    return field


def oscillating(n: int, hidden: Sequence[int], horizon: float, points: int, terms: tuple[str, ...]) -> Case:
    """Return a black-box network `n -> hidden -> n` (structure `full`) with as many pairs as it can hold.

    The weights are made, not trained, so that any size has a well-posed problem: near the origin A is a block diagonal
    of damped rotations between 0.15 and 0.6 Hz in a random orthogonal basis. A hidden layer of h neurons limits its
    rank to h, so that there are `min(n, h) / 2` pairs; further eigenvalues are zero and no term looks at them. Targets
    and data are the network's own, shifted, so that which pair belongs to which target is beyond doubt.

    Args:
        n: number of states, even.
        hidden: widths, each at least 2.
        horizon: in s.
        points: data times; there is a spectrum at each.
        terms: of sol and frq.
    """
    generator = np.random.default_rng(0)
    shape = MlpShape((n, *hidden, n), "tanh", "full", np.ones(n), np.ones(n))
    pairs = min(n, *hidden) // 2
    times = np.linspace(0.0, horizon, points)
    start = _start(n, generator)
    blank = Series(times, np.tile(start, (points, 1)), start)
    solver = AdaptiveSolver(name="tsit5", rtol=RTOL, atol=ATOL, max_steps=MAX_STEPS)
    spectra = np.tile(_spectrum(pairs, n), (points, 1))
    problem = Problem(
        data=blank,
        targets=targets_of_spectra(spectra),
        terms=terms,
        solver=solver,
    )
    case = Case(shape, problem, _oscillating_weights(n, hidden, pairs, generator))
    return _with_own_targets(case, pairs)


def _start(n: int, generator: np.random.Generator) -> Floats:
    start = generator.standard_normal(n)
    return start / np.linalg.norm(start)


def _spectrum(pairs: int, n: int) -> np.ndarray:
    """Eigenvalues `(n,)` in 1/s near the origin: damped pairs, then zeros."""
    upper = 2.0 * np.pi * np.linspace(0.15, 0.6, pairs) * (1j - 0.03)
    return np.concatenate([upper, upper.conj(), np.zeros(n - 2 * pairs)])


def _oscillating_weights(n: int, hidden: Sequence[int], pairs: int, generator: np.random.Generator) -> Floats:
    """Parameters `(P,)`: into the basis, through the hidden layers, rotated and back."""
    rank = 2 * pairs
    basis = np.linalg.qr(generator.standard_normal((n, n)))[0][:, :rank]
    rotation = np.zeros((rank, rank))
    for i, value in enumerate(_spectrum(pairs, rank)[:pairs]):
        rotation[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[value.real, -value.imag], [value.imag, value.real]]
    sizes = (n, *hidden, n)
    layers: list[Floats] = []
    for inputs, outputs in pairwise(sizes):
        layers.append(0.02 * generator.standard_normal((outputs, inputs)) / np.sqrt(inputs))
    layers[0][:rank] += 0.5 * basis.T
    for middle in layers[1:-1]:
        middle[:rank, :rank] += np.eye(rank)
    layers[-1][:, :rank] += 2.0 * basis @ rotation
    biases = [0.01 * generator.standard_normal(size) for size in sizes[1:-1]] + [np.zeros(n)]
    return np.concatenate([np.concatenate([w.ravel(), b]) for w, b in zip(layers, biases, strict=True)])


def _with_own_targets(case: Case, pairs: int) -> Case:
    """Return data and targets from the network's own trajectory and spectra at tight tolerance, shifted."""
    own = CompiledEngine(case.shape, case.tight().problem).loss_jacobian(case.theta)
    shift = 0.05 * (1.0 + np.sin(np.arange(own.trajectory.size).reshape(own.trajectory.shape)))
    states = own.trajectory + shift
    states[0] = case.problem.data.initial_state
    leading = np.sort(own.spectra.imag, axis=1)[:, : -pairs - 1 : -1] / (2.0 * np.pi)
    upper = 2j * np.pi * 1.02 * leading
    rest = np.zeros((len(states), states.shape[1] - 2 * pairs))
    data = replace(case.problem.data, values=states)
    targets = targets_of_spectra(np.concatenate([upper, upper.conj(), rest], axis=1).astype(np.complex128))
    targets = replace(targets, frequency=targets.frequency[:, :pairs], damping=targets.damping[:, :pairs])
    return replace(case, problem=replace(case.problem, data=data, targets=targets, states=None))
