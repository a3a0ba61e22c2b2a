"""Who takes part: ours, and peers in the form that their users would write."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from typing import Any

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.bench.case import Case, torch_field
from eigenode_cli.engines.compiled.buffers import Room, build_core, solver_method
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.engines.compiled.kernel import solve
from eigenode_cli.engines.compiled.mlp import MlpShape
from eigenode_cli.engines.compiled.owner import Owner
from eigenode_cli.engines.torch_engine import TorchEngine


@dataclass(frozen=True)
class Result:
    """One loss Jacobian: values `(L,)` and gradients `(L, P)` of the case's terms, and the solver's accepted steps."""

    values: Floats
    gradients: Floats
    steps: int


@dataclass(frozen=True)
class Runner:
    """A contestant ready for one case.

    Attributes:
        call: computes one loss Jacobian and returns when it is there; this is what is timed.
        read: what a call returned, as a `Result`.
        detail: what was chosen for this contestant, for people.
    """

    call: Callable[[], Any]
    read: Callable[[Any], Result]
    detail: str

    def result(self) -> Result:
        """One loss Jacobian."""
        return self.read(self.call())


@dataclass(frozen=True)
class Contestant:
    """One of the field: `build` makes it ready; `packages` are needed for it."""

    name: str
    title: str
    build: Callable[[Case], Runner]
    packages: tuple[str, ...] = ()

    def missing(self) -> list[str]:
        """Return the packages that are not installed."""
        absent: list[str] = []
        for package in self.packages:
            try:
                import_module(package)
            except ImportError:
                absent.append(package)
        return absent

    def versions(self) -> dict[str, str]:
        """Versions of the packages."""
        return {package: version(package) for package in self.packages}


def _as_result(jacobian: Any) -> Result:
    return Result(jacobian.values, jacobian.gradients, jacobian.n_accepted)


def compiled(case: Case) -> Runner:
    """Our engine: a fused kernel."""
    engine = CompiledEngine(case.shape, case.problem)
    return Runner(lambda: engine.loss_jacobian(case.theta), _as_result, "Tsit5, sensitivity=auto")


def reference(case: Case) -> Runner:
    """Our reference engine: torch, autograd, torchdiffeq with our Tsit5."""
    engine = TorchEngine(torch_field(case), case.problem, {})
    return Runner(lambda: engine.loss_jacobian(case.theta), _as_result, "Tsit5, autograd")


def torchdiffeq(case: Case) -> Runner:
    """Plain torchdiffeq, see `plain_torch`."""
    from eigenode_cli.bench.plain_torch import plain_runner, torchdiffeq_solver  # noqa: PLC0415

    return plain_runner(case, torchdiffeq_solver(case), "dopri5, autograd, torch.linalg.eigvals")


def torchode(case: Case) -> Runner:
    """Plain torchode, see `plain_torch`."""
    from eigenode_cli.bench.plain_torch import plain_runner, torchode_solver  # noqa: PLC0415

    return plain_runner(case, torchode_solver(case), "Tsit5, AutoDiffAdjoint, torch.linalg.eigvals")


def diffrax(case: Case) -> Runner:
    """Diffrax with its fastest adjoint, see `plain_jax`."""
    from eigenode_cli.bench.plain_jax import best_runner  # noqa: PLC0415

    return best_runner(case)


OURS = Contestant("compiled", "eigenode, compiled", compiled)
"""All ratios are times of others over this one's."""

PEERS: dict[str, Contestant] = {
    peer.name: peer
    for peer in (
        Contestant("torch", "eigenode, torch", reference),
        Contestant("torchdiffeq", "torchdiffeq", torchdiffeq, ("torchdiffeq",)),
        Contestant("torchode", "torchode", torchode, ("torchode",)),
        Contestant("diffrax", "diffrax", diffrax, ("jax", "diffrax")),
    )
}
"""Everybody else by name."""


class BareSolve:
    """Our own solver alone with the C library's scalar tanh, nothing recorded: the floor of any training step."""

    def __init__(self, case: Case) -> None:
        given, solver = case.shape, case.solver
        shape = MlpShape(given.sizes, "tanh_libm", given.structure, given.input_scale, given.output_scale)
        self._owner = Owner()  # of the arrays whose addresses the kernel holds
        method = solver_method(self._owner, solver)[0]
        self._core, shared = build_core(self._owner, shape, case.problem, method, 1, 0, False)
        shared.theta[:] = case.theta
        self._room = Room(self._core.net, method, solver.max_steps, case.times.size, recorded=False)
        self._times, self._free = case.times, np.empty(0)
        self.states = np.empty((case.times.size, shape.sizes[0]))

    def __call__(self) -> int:
        """Solve into `states (N, n)`; returns the status."""
        return solve(self._core, self._room.steps, self._free, self._times, self.states)
