"""Small problems that several tests share."""

import logging
import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass, field

from eigenode_cli.cli import BLAS_THREADS

os.environ |= dict.fromkeys(BLAS_THREADS, "1")  # as the command does, before NumPy is loaded: workers share the cores

import numpy as np
import pytest

from eigenode_cli.config.build import build_field
from eigenode_cli.config.schema import MlpConfig
from eigenode_cli.data.simulate import Truth, simulate
from eigenode_cli.data.targets import TruthTarget
from eigenode_cli.engines.problem import Problem
from eigenode_cli.model import VectorField
from eigenode_cli.solve.settings import AdaptiveSolver, Solver
from eigenode_cli.systems import Oscillator, System, VanDerPol
from eigenode_cli.terms import NAMES, PAPER_TERMS

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in a shell's background job; some tests press Ctrl-C
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def forgotten_log_handlers() -> Iterator[None]:
    """Take away what Hydra's logging set up in a test: its handlers write to an output that ends with the test."""
    _forget_stream_handlers()
    yield
    _forget_stream_handlers()


def _forget_stream_handlers() -> None:
    root = logging.getLogger()
    for handler in [handler for handler in root.handlers if type(handler) is logging.StreamHandler]:
        root.removeHandler(handler)


PAPER_SYSTEMS = ("oscillator", "sparse_oscillator", "vdp")


@dataclass
class Case:
    """A system with the paper's data, and the problem that asks for all six terms."""

    name: str
    system: System
    initial_state: list[float]
    horizon: float
    points: int
    options: dict[str, object] = field(default_factory=dict)

    @property
    def truth(self) -> Truth:
        return Truth(self.system, tuple(self.initial_state))

    def problem(self, **changes: object) -> Problem:
        times = np.linspace(0.0, self.horizon, self.points)
        data = simulate(self.truth, times, [self.system.states[0].name]).series[0]
        options: dict[str, object] = {
            "data": data,
            "states": self.truth.states(times),
            "targets": TruthTarget(self.truth).rows(times),
            "every": 1,
            "terms": PAPER_TERMS,
            "errors": np.zeros(len(NAMES), dtype=np.int64),
            "huber_delta": 1.0,
            "margin": 0.0,
            "max_condition": 1e4,
            "jacobian": "autodiff",
            "solver": AdaptiveSolver(name="tsit5", rtol=1e-3, atol=1e-6, max_steps=10_000),
            "stabilise": True,
        }
        return Problem(**(options | changes))  # type: ignore[arg-type]

    def field(self, seed: int = 0, **changes: object) -> VectorField:
        options: dict[str, object] = {
            "name": "mlp",
            "target": "eigenode_cli.model:Mlp",
            "structure": "second_order",
            "hidden": [32],
            "activation": "tanh",
            "init": "glorot",
            "input_scaling": "none",
            "output_scaling": "none",
            "scaling_from": "truth",
            "linear": "none",
            "output_gain": 1.0,
        }
        states = self.truth.states(np.linspace(0.0, self.horizon, self.points))
        config = MlpConfig(**(options | changes))  # type: ignore[arg-type]
        return build_field(config, states, self.system.dynamics(states), seed)


def make_case(name: str) -> Case:
    if name == "vdp":
        return Case(name, VanDerPol(mu=2.0), [2.0, 0.0], 30.0, 91)
    if name == "sparse_oscillator":
        system = Oscillator(c=(2.0 * np.pi) ** 2, d=0.5)
        return Case(name, system, [1.0, 0.0], 9.75, 14)
    system = Oscillator()
    return Case(name, system, [1.0, 0.0], 10.0, 101)


@pytest.fixture(params=PAPER_SYSTEMS)
def case(request: pytest.FixtureRequest) -> Case:
    """Each of the paper's systems in turn."""
    return make_case(request.param)


def solver(name: str = "tsit5", rtol: float = 1e-3, atol: float = 1e-6, max_steps: int = 10_000) -> Solver:
    """An adaptive solver's configuration."""
    return AdaptiveSolver(name=name, rtol=rtol, atol=atol, max_steps=max_steps)
