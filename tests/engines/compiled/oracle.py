"""A plain torch transcription of what the compiled engine computes, and small problems to compare it on."""

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from eigenode_cli.arrays import Floats
from eigenode_cli.data.targets import targets_of_spectra
from eigenode_cli.engines.compiled.mlp import MlpShape
from eigenode_cli.engines.problem import Problem
from eigenode_cli.solve.settings import AdaptiveSolver, FixedStepSolver, Solver
from eigenode_cli.solve.stability import region_of
from eigenode_cli.solve.tableau import Tableau
from eigenode_cli.terms import NAMES
from eigenode_cli.terms.torch_terms import solution_term, spectral_values
from tests.measured import series

ACTIVATIONS = {
    "tanh": torch.tanh,
    "sigmoid": torch.sigmoid,
    "relu": torch.relu,
    # torch's own softplus leaves its definition by 2e-9 beyond 20
    "softplus": lambda z: torch.logaddexp(z, torch.zeros_like(z)),
    "silu": functional.silu,
    "elu": functional.elu,
    "sin": torch.sin,
    "identity": lambda z: z,
}


def make_shape(
    n: int, hidden: tuple[int, ...] = (5,), activation: str = "tanh", structure: str = "second_order", seed: int = 0
) -> MlpShape:
    """A shape with scales that are not 1."""
    random = np.random.default_rng(seed)
    m = n // 2 if structure == "second_order" else n
    return MlpShape(
        (n, *hidden, m), activation, structure, random.uniform(0.5, 1.5, size=n), random.uniform(0.5, 1.5, size=m)
    )


def make_theta(shape: MlpShape, seed: int = 0, size: float = 0.6) -> Floats:
    return np.random.default_rng(seed).normal(size=shape.parameters) * size


def make_problem(
    n: int, count: int = 9, horizon: float = 1.0, every: int = 1, solver: Solver | None = None, **changes
) -> Problem:
    """Data and targets without any meaning, but with every kind of target in them."""
    random = np.random.default_rng(7)
    times = np.sort(np.concatenate([[0.0, horizon], random.uniform(0.0, horizon, size=count - 2)]))
    states = random.normal(size=(count, n))
    mask = random.uniform(size=(count, n)) < 0.7
    mask[0] = True
    matrices = random.normal(size=(len(range(0, count, every)), n, n)) * 2.0
    targets = targets_of_spectra(np.linalg.eigvals(matrices).astype(np.complex128))
    problem = Problem(
        data=series(times, states, mask),
        states=states,
        targets=replace(targets, pairs=np.full_like(targets.pairs, max(1, n // 2)), region=region_of("rk4", 0.7)),
        every=every,
        terms=NAMES,
        errors=np.ones(len(NAMES), dtype=np.int64),
        huber_delta=0.3,
        margin=5.0,
        max_condition=1e8,
        jacobian="autodiff",
        solver=solver or adaptive(),
        stabilise=True,
    )
    return replace(problem, **changes)


def adaptive(name: str = "tsit5", rtol: float = 1e-3, atol: float = 1e-6, max_steps: int = 10_000) -> AdaptiveSolver:
    return AdaptiveSolver(name=name, rtol=rtol, atol=atol, max_steps=max_steps)


def fixed(step: float) -> FixedStepSolver:
    return FixedStepSolver(name="rk4", step=step)


def field(shape: MlpShape, theta: Tensor, x: Tensor) -> Tensor:
    """`f(x; theta)` for states `(..., n)`."""
    u = x * torch.from_numpy(shape.input_scale)
    at, last = 0, len(shape.sizes) - 2
    for level, (inputs, outputs) in enumerate(zip(shape.sizes[:-1], shape.sizes[1:], strict=True)):
        weight = theta[at : at + inputs * outputs].reshape(outputs, inputs)
        bias = theta[at + inputs * outputs : at + (inputs + 1) * outputs]
        at += (inputs + 1) * outputs
        z = u @ weight.T + bias
        u = z if level == last else ACTIVATIONS[shape.activation](z)
    y = u * torch.from_numpy(shape.output_scale)
    if shape.linear:
        y = y + x @ theta[at : at + shape.sizes[0] * shape.sizes[-1]].reshape(shape.sizes[-1], shape.sizes[0]).T
    return torch.cat([x[..., x.shape[-1] // 2 :], y], -1) if shape.structure == "second_order" else y


def jacobians(shape: MlpShape, theta: Tensor, states: Tensor) -> Tensor:
    """`A (N, n, n)` at `states (N, n)`."""
    return torch.func.vmap(torch.func.jacrev(lambda x: field(shape, theta, x)))(states)


def rollout(shape: MlpShape, theta: Tensor, tableau: Tableau, steps: Floats, start: Floats, times: Floats) -> Tensor:
    """States `(N, n)` at `times` from a Runge-Kutta solve with given steps, by the textbook's formulas."""
    a, dense = torch.from_numpy(tableau.a), torch.from_numpy(tableau.dense)
    x, t, states = torch.from_numpy(start), times[0], [torch.from_numpy(start)]
    for i, h in enumerate(steps):
        k = [field(shape, theta, x)]
        for j in range(1, len(a)):
            k.append(field(shape, theta, x + h * (a[j, :j] @ torch.stack(k))))
        end = times[-1] if i == len(steps) - 1 else t + h
        while len(states) < len(times) and times[len(states)] <= end:
            fraction = (times[len(states)] - t) / h
            weights = dense @ torch.tensor([fraction**p for p in range(1, 5)])
            states.append(x + h * (weights @ torch.stack(k)))
        x, t = x + h * (a[-1] @ torch.stack(k)), end
    return torch.stack(states)


def terms(problem: Problem, trajectory: Tensor, spectra: Tensor) -> Tensor:
    """All terms of a trajectory `(N, n)` with spectra `(T, n)`."""
    sol = solution_term(trajectory, problem.data, int(problem.errors[0]), problem.huber_delta)
    spectral = spectral_values(spectra, NAMES[1:], problem.targets, problem.margin, problem.errors, problem.huber_delta)
    return torch.cat([sol[None], spectral])


def loss_jacobian(
    shape: MlpShape, problem: Problem, theta: Floats, tableau: Tableau, steps: Floats
) -> tuple[Floats, Floats]:
    """Values `(L,)` and gradients `(L, P)` of all terms by autograd through everything."""
    leaf = torch.from_numpy(theta.copy()).requires_grad_()
    trajectory = rollout(shape, leaf, tableau, steps, problem.data.initial_state, problem.data.times)
    spectra = torch.linalg.eigvals(jacobians(shape, leaf, trajectory[problem.spectral_index]))
    values = terms(problem, trajectory, spectra)
    rows = [torch.autograd.grad(value, leaf, retain_graph=True)[0] for value in values]
    return values.detach().numpy(), torch.stack(rows).numpy()


def relative(found: Floats, wanted: Floats) -> float:
    """Largest deviation, in units of the largest wanted entry of the row."""
    scale = np.maximum(np.abs(wanted).max(axis=-1, keepdims=True), 1e-300)
    return float((np.abs(found - wanted) / scale).max())
