"""Several trajectories in one loss Jacobian: means over the residuals of all of them."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.cpus import usable_cores
from eigenode_cli.engines.base import Advance, Engine, Evaluation, LossJacobian, ResidualJacobian, single_step
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.engines.problem import Problem
from eigenode_cli.engines.update import Update
from eigenode_cli.model import own_parameters
from eigenode_cli.solve.status import Status
from eigenode_cli.terms import NAMES, SPECTRAL

Found = TypeVar("Found")


class SeveralEngine:
    """One engine for each trajectory; they share the field's parameters and have initial states of their own.

    A term is the mean over the residuals of all trajectories: SOL over all measured values, the others over all
    spectra. Where the solve of one of them fails, SOL is not defined. Parameters are those of the field, then
    trained entries of the initial states and then offsets, each one trajectory after another.

    Args:
        engines: one a trajectory.
        problems: what they solve, the same but for data and targets.
    """

    def __init__(self, engines: Sequence[Engine], problems: Sequence[Problem]) -> None:
        self.name = engines[0].name
        self._engines, self._problems = tuple(engines), tuple(problems)
        self._terms = problems[0].terms
        self._series = [problem.data for problem in problems]
        parallel = all(isinstance(engine, CompiledEngine) and engine.in_threads for engine in engines)
        self.threads = min(len(engines), usable_cores()) if parallel else 1
        self._pool = ThreadPoolExecutor(max(1, self.threads - 1))

    @property
    def compile_seconds(self) -> float:
        """See `Engine.compile_seconds`."""
        return sum(engine.compile_seconds for engine in self._engines)

    def _columns(self, size: int) -> list[np.ndarray]:
        """Which of all `size` parameters each trajectory has."""
        field = np.arange(size - sum(series.trained for series in self._series))
        return [np.concatenate([field, *own]) for own in own_parameters(size, self._series)]

    def _each(self, call: Callable[[Engine, Floats], Found], theta: Floats) -> list[Found]:
        """Call each engine with its own parameters, each thread a share of them; results in their order."""
        parts = [theta[own] for own in self._columns(theta.size)]

        def share(number: int) -> list[Found]:
            part = slice(len(parts) * number // self.threads, len(parts) * (number + 1) // self.threads)
            return [call(engine, own) for engine, own in zip(self._engines[part], parts[part], strict=True)]

        waiting = [self._pool.submit(share, number) for number in range(1, self.threads)]
        found = share(0)
        return [*found, *(one for part in waiting for one in part.result())]

    def _shares(self, names: Sequence[str]) -> Floats:
        """Share of each trajectory in the mean of each term `(N, L)`."""
        counts = [
            [problem.spectral_index.size if name in SPECTRAL else problem.measured for name in names]
            for problem in self._problems
        ]
        numbers = np.array(counts, dtype=np.float64)
        return numbers / numbers.sum(axis=0)

    def loss_jacobian(self, theta: Floats) -> LossJacobian:
        """See `Engine.loss_jacobian`; the trajectory is that of the first one, the spectra are those of all."""
        columns, shares = self._columns(theta.size), self._shares(self._terms)
        found = self._each(lambda engine, own: engine.loss_jacobian(own), theta)
        gradients = np.zeros((len(self._terms), theta.size))
        for one, own, share in zip(found, columns, shares, strict=True):
            gradients[:, own] += share[:, None] * one.gradients
        return LossJacobian(
            values=(shares * np.array([one.values for one in found])).sum(axis=0),
            gradients=gradients,
            trajectory=found[0].trajectory,
            spectra=np.concatenate([one.spectra for one in found]),
            status=_worst([one.status for one in found]),
            n_accepted=sum(one.n_accepted for one in found),
            n_rejected=sum(one.n_rejected for one in found),
            guard_count=sum(one.guard_count for one in found),
        )

    def residual_jacobian(self, theta: Floats, differentiated: bool = True) -> ResidualJacobian:
        """See `Engine.residual_jacobian`: those of a term, trajectory after trajectory."""
        columns = self._columns(theta.size)
        found = self._each(lambda engine, own: engine.residual_jacobian(own, differentiated), theta)
        rows, residuals, parts, start = {}, [], [], 0
        for term in self._terms:
            for one, own in zip(found, columns, strict=True):
                residuals.append(one.residuals[one.rows[term]])
                part = np.zeros((residuals[-1].size if differentiated else 0, theta.size))
                part[:, own] = one.jacobian[one.rows[term]] if differentiated else 0.0
                parts.append(part)
            stop = sum(part.size for part in residuals)
            rows[term], start = slice(start, stop), stop
        values = (self._shares(self._terms) * np.array([one.values for one in found])).sum(axis=0)
        status = _worst([one.status for one in found])
        accepted = sum(one.n_accepted for one in found)
        return ResidualJacobian(np.concatenate(residuals), np.concatenate(parts), rows, values, status, accepted)

    def advance(self, theta: Floats, update: Update, rates: Floats, halt: bool) -> Advance:
        """See `Engine.advance`: one step."""
        return single_step(self, theta, update, rates, halt)

    def evaluate(self, theta: Floats, times: Floats) -> Evaluation:
        """See `Engine.evaluate`; trajectory and states at `times` are those of the first one."""
        found = self._each(lambda engine, own: engine.evaluate(own, times), theta)
        own_terms = found[0].values.size - len(NAMES)
        shares = self._shares([*NAMES, *[SPECTRAL[0]] * own_terms])
        return Evaluation(
            values=(shares * np.array([one.values for one in found])).sum(axis=0),
            trajectory=found[0].trajectory,
            spectra=np.concatenate([one.spectra for one in found]),
            status=_worst([one.status for one in found]),
            n_accepted=sum(one.n_accepted for one in found),
            n_rejected=sum(one.n_rejected for one in found),
            dense=found[0].dense,
        )


def _worst(statuses: Sequence[Status]) -> Status:
    """Return the first status that is not OK, if there is one."""
    return next((status for status in statuses if status is not Status.OK), Status.OK)
