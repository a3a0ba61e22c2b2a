"""The loss Jacobian as a user of diffrax would write it, jitted as a whole, with the adjoint that is fastest for it."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from time import perf_counter
from typing import Any

import diffrax  # pyright: ignore[reportMissingImports]  # of the extra `bench`
import jax  # pyright: ignore[reportMissingImports]
import jax.numpy as jnp  # pyright: ignore[reportMissingImports]
import numpy as np

from eigenode_cli.bench.case import ATOL, RTOL, Case
from eigenode_cli.bench.contestants import Result, Runner

jax.config.update("jax_enable_x64", True)

FORWARD_LIMIT = 1000
"""Parameters up to which forward mode is tried: it carries a tangent for each."""
TRIALS = 5
"""Calls by which the fastest adjoint is found."""
CONTROLLERS = {"I": (0.0, 1.0), "PI": (0.4, 0.3)}
"""Proportional and integral coefficient: diffrax's default step-size control, and that of the paper's solvers."""


@dataclass(frozen=True)
class Choice:
    """How diffrax computes the loss Jacobian: its adjoint, and whether the terms are differentiated forward."""

    name: str
    adjoint: diffrax.AbstractAdjoint
    forward: bool
    max_steps: int


def field_function(case: Case) -> Callable[[Any, Any, Any], Any]:
    """`f(t, x, theta)` for a state `(n,)` and flat parameters."""
    sizes, second_order = case.shape.sizes, case.shape.structure == "second_order"

    def field(_t: Any, x: Any, theta: Any) -> Any:
        u, at = x, 0
        for layer, (inputs, outputs) in enumerate(pairwise(sizes)):
            weight = theta[at : at + inputs * outputs].reshape(outputs, inputs)
            u = weight @ u + theta[at + inputs * outputs : at + (inputs + 1) * outputs]
            u = jnp.tanh(u) if layer < len(sizes) - 2 else u
            at += (inputs + 1) * outputs
        return jnp.concatenate([x[x.size // 2 :], u]) if second_order else u

    return field


def _pair_spectrum(a: Any) -> tuple[Any, Any]:
    """Real and imaginary parts `(2,)` of the eigenvalues of `a (2, 2)`, upper member first, in closed form."""
    middle = 0.5 * (a[0, 0] + a[1, 1])
    discriminant = (0.5 * (a[0, 0] - a[1, 1])) ** 2 + a[0, 1] * a[1, 0]
    # the root of a constant where the branch is not taken, or its infinite slope would make NaN of zero
    gap = jnp.where(discriminant > 0.0, jnp.sqrt(jnp.where(discriminant > 0.0, discriminant, 1.0)), 0.0)
    imag = jnp.where(discriminant < 0.0, jnp.sqrt(jnp.where(discriminant < 0.0, -discriminant, 1.0)), 0.0)
    return jnp.stack([middle + gap, middle - gap]), jnp.stack([imag, -imag])


def _spectrum(a: Any) -> tuple[Any, Any]:
    """Return the same for `a (n, n)` by LAPACK, sorted by imaginary part, largest first."""
    spectrum = jnp.linalg.eigvals(a)
    spectrum = spectrum[jnp.argsort(-spectrum.imag)]
    return spectrum.real, spectrum.imag


def terms_function(case: Case) -> Callable[[Any, Any], Any]:
    """`(theta, trajectory (N, n)) -> values (L,)`: the equations of the terms (Sec. 2.3 of the paper), with MAE."""
    problem, field = case.problem, field_function(case)
    data, mask, n = problem.data.values, problem.data.mask, case.shape.sizes[0]
    frequency, damping = problem.targets.frequency[:, ::-1], problem.targets.damping[:, ::-1]
    known, count = ~np.isnan(frequency), frequency.shape[1]
    frequency, damping = np.where(known, frequency, 0.0), np.where(known, damping, 0.0)
    wanted = problem.targets.pairs > 0

    def spectral(theta: Any, states: Any) -> dict[str, Any]:
        matrices = jax.vmap(jax.jacrev(lambda x: field(0.0, x, theta)))(states[problem.spectral_index])
        real, imag = jax.vmap(_pair_spectrum if n == 2 else _spectrum)(matrices)
        upper, total = imag[:, :count], real.size
        both = (upper > 0.0) & known
        modulus = jnp.sqrt(jnp.where(both, real[:, :count] ** 2 + upper**2, 1.0))
        # both members of a pair count
        terms = {
            "frq": 2.0 * jnp.where(both, jnp.abs(upper / (2.0 * jnp.pi) - frequency), 0.0).sum() / total,
            "dmp": 2.0 * jnp.where(both, jnp.abs(-real[:, :count] / modulus - damping), 0.0).sum() / total,
            "stb": jnp.maximum(real, 0.0).mean(),
        }
        if n == 2:
            missing = wanted & (imag[:, 0] == 0.0)
            terms["osc"] = jnp.where(missing, jnp.abs(real[:, 0] - real[:, 1]), 0.0).sum() / total
        return terms

    def values(theta: Any, states: Any) -> Any:
        terms = {"sol": jnp.where(mask, jnp.abs(states - data), 0.0).sum() / mask.sum()}
        if problem.terms != ("sol",):
            terms |= spectral(theta, states)
        return jnp.stack([terms[name] for name in problem.terms])

    return values


def _control(case: Case, controller: str) -> diffrax.PIDController:
    pcoeff, icoeff = CONTROLLERS[controller]
    return diffrax.PIDController(rtol=case.solver.rtol, atol=case.solver.atol, pcoeff=pcoeff, icoeff=icoeff)


def loss_jacobian(case: Case, choice: Choice, controller: str) -> Callable[[Any], Any]:
    """Jitted `theta -> (values (L,), gradients (L, P), accepted steps, success)`."""
    times, terms_of = case.times, terms_function(case)
    term, count = diffrax.ODETerm(field_function(case)), len(case.problem.terms)
    control = _control(case, controller)

    def values(theta: Any) -> tuple[Any, Any]:
        solution = diffrax.diffeqsolve(
            term,
            diffrax.Tsit5(),
            times[0],
            times[-1],
            None,
            jnp.asarray(case.problem.data.initial_state),
            theta,
            saveat=diffrax.SaveAt(ts=jnp.asarray(times)),
            stepsize_controller=control,
            adjoint=choice.adjoint,
            max_steps=choice.max_steps,
            throw=False,
        )
        done = solution.result == diffrax.RESULTS.successful
        return terms_of(theta, solution.ys), (solution.stats["num_accepted_steps"], done)

    def reverse(theta: Any) -> Any:
        primal, pull, extra = jax.vjp(values, theta, has_aux=True)
        return primal, jax.vmap(pull)(jnp.eye(count))[0], *extra

    def forward(theta: Any) -> Any:
        def twice(at: Any) -> tuple[Any, Any]:
            primal, extra = values(at)
            return primal, (primal, *extra)

        rows, (primal, *extra) = jax.jacfwd(twice, has_aux=True)(theta)
        return primal, rows, *extra

    return jax.jit(forward if choice.forward else reverse)


def choices(case: Case, steps: int) -> list[Choice]:
    """Return the adjoints that are worth a try for a case whose solve takes this number of attempted steps.

    `BacksolveAdjoint` is not among them: its gradients are those of another problem, solved backwards.
    """
    room = 2 ** math.ceil(math.log2(2 * steps))
    bounded = 16 ** math.ceil(math.log(1.2 * steps, 16))
    found = [
        Choice("RecursiveCheckpointAdjoint", diffrax.RecursiveCheckpointAdjoint(checkpoints=room), False, 16 * room),
        Choice("DirectAdjoint", diffrax.DirectAdjoint(), False, bounded),
    ]
    if case.theta.size <= FORWARD_LIMIT:
        found.append(Choice("ForwardMode", diffrax.ForwardMode(), True, 16 * room))
    return found


def _runner(case: Case, choice: Choice, controller: str) -> Runner:
    function = loss_jacobian(case, choice, controller)
    theta = jnp.asarray(case.theta)

    def read(raw: Any) -> Result:
        values, gradients, steps, done = raw
        if not bool(done):
            raise RuntimeError(f"diffrax, {choice.name}: the solve failed")
        return Result(np.asarray(values), np.asarray(gradients), int(steps))

    detail = f"Tsit5, {controller} control, {choice.name}"
    return Runner(lambda: jax.block_until_ready(function(theta)), read, detail)


def _attempted(case: Case, controller: str) -> int:
    """Return steps of a solve, accepted or not."""
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(field_function(case)),
        diffrax.Tsit5(),
        case.times[0],
        case.times[-1],
        None,
        jnp.asarray(case.problem.data.initial_state),
        jnp.asarray(case.theta),
        stepsize_controller=_control(case, controller),
        max_steps=case.solver.max_steps,
    )
    return int(solution.stats["num_steps"])


def best_runner(case: Case) -> Runner:
    """Return the fastest of all adjoints, after the step-size control that takes fewer steps."""
    attempted = {name: _attempted(case, name) for name in CONTROLLERS}
    controller = min(attempted, key=lambda name: attempted[name])
    if case.solver.rtol < RTOL or case.solver.atol < ATOL:  # to be compared, not to be timed
        return _runner(case, choices(case, attempted[controller])[0], controller)
    runners = [_runner(case, choice, controller) for choice in choices(case, attempted[controller])]
    return min(runners, key=partial(_shortest, trials=TRIALS))


def _shortest(runner: Runner, trials: int) -> float:
    """Shortest of some calls in s, after one that compiles."""
    runner.result()
    spans: list[float] = []
    for _ in range(trials):
        start = perf_counter()
        runner.call()
        spans.append(perf_counter() - start)
    return min(spans)
