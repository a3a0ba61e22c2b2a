"""Our optimizers against torch.optim on the same sequence of gradients."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from eigenode_cli.arrays import Floats
from eigenode_cli.engines.combine import SEQUENTIAL
from eigenode_cli.engines.update import learn
from eigenode_cli.training.methods import Adam, AdamBfgs, OwnMethod, Sgd
from eigenode_cli.training.optimizers import AdamBfgsOptimizer, Optimizer, OwnOptimizer, build_optimizer, build_update
from eigenode_cli.training.schedules import Exponential

CASES = [
    (
        Adam(lr=3e-3, beta1=0.8, beta2=0.99, eps=1e-8),
        lambda p: torch.optim.Adam([p], lr=3e-3, betas=(0.8, 0.99), eps=1e-8),
    ),
    (
        Sgd(lr=1e-2, momentum=0.9),
        lambda p: torch.optim.SGD([p], lr=1e-2, momentum=0.9),
    ),
]


@pytest.mark.parametrize(("config", "peer"), CASES, ids=["adam", "sgd"])
def test_same_path_as_torch(config, peer) -> None:
    generator = np.random.default_rng(5)
    theta = generator.normal(size=7)
    parameter = torch.nn.Parameter(torch.from_numpy(theta.copy()))
    ours, theirs = Optimizer(config, 7), peer(parameter)
    for _ in range(50):
        gradient = generator.normal(size=7)
        ours.update(theta, gradient, ours.lr(0))
        parameter.grad = torch.from_numpy(gradient)
        theirs.step()
    np.testing.assert_allclose(theta, parameter.detach().numpy(), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("config", [case[0] for case in CASES], ids=["adam", "sgd"])
def test_state_is_all_that_the_next_update_depends_on(config) -> None:
    first, theta = Optimizer(config, 3), np.ones(3)
    for k in range(4):
        first.update(theta, np.array([1.0, -2.0, 0.5]) * k, 1e-2)
    second, copy = Optimizer(config, 3), theta.copy()
    for name, array in second.state().items():
        array[:] = first.state()[name]
    first.update(theta, np.ones(3), 1e-2)
    second.update(copy, np.ones(3), 1e-2)
    assert theta.tobytes() == copy.tobytes()


@pytest.mark.parametrize("config", [case[0] for case in CASES], ids=["adam", "sgd"])
def test_an_update_has_the_size_of_its_rate(config) -> None:
    moves = []
    for lr in (1e-3, 2e-3):
        theta = np.ones(2)
        Optimizer(config, 2).update(theta, np.array([1.0, -3.0]), lr)
        moves.append(theta - 1.0)
    np.testing.assert_allclose(moves[1], 2.0 * moves[0], rtol=1e-12)


@pytest.mark.parametrize("config", [case[0] for case in CASES], ids=["adam", "sgd"])
def test_the_rate_of_a_step_is_that_of_the_schedule(config) -> None:
    assert {Optimizer(config, 2).lr(k) for k in (0, 1, 5000)} == {config.lr}
    assert Optimizer(config, 2, Exponential(1.0, 0.5)).lr(3) == config.lr + math.exp(-1.5)


class OwnAdam(OwnMethod):
    """Adam as a user would write it."""

    def __init__(self, lr: float = 3e-3) -> None:
        self.lr = lr

    def memory(self, parameters: int) -> dict[str, Floats]:
        return {"first": np.zeros(parameters), "second": np.zeros(parameters), "count": np.zeros(1)}

    def update(self, theta: Floats, gradient: Floats, lr: float, memory: dict[str, Floats]) -> None:
        memory["count"] += 1.0
        memory["first"] *= 0.8
        memory["first"] += 0.2 * gradient
        memory["second"] *= 0.99
        memory["second"] += 0.01 * gradient**2
        first = memory["first"] / (1.0 - 0.8 ** memory["count"])
        second = memory["second"] / (1.0 - 0.99 ** memory["count"])
        theta -= lr * first / (np.sqrt(second) + 1e-8)


def test_a_method_of_ones_own_takes_the_updates_of_the_combination() -> None:
    own, shipped = build_optimizer(OwnAdam(), 3), build_optimizer(CASES[0][0], 3)
    assert isinstance(own, OwnOptimizer)
    theta, copy = np.ones(3), np.ones(3)
    held = np.array([True, True, False])
    updates = [build_update(SEQUENTIAL, [1.0, 2.0], optimizer, held) for optimizer in (own, shipped)]
    gradients = np.array([[1.0, -2.0, 0.5], [0.3, 0.1, -1.0]])

    class Still:
        def at(self, theta: Floats) -> SimpleNamespace:
            return SimpleNamespace(jacobian=SimpleNamespace(gradients=gradients))

    for step in range(5):
        own.search(theta, Still(), updates[0], step)  # type: ignore[arg-type]
        learn(updates[1], copy, gradients, shipped.lr(step))
    np.testing.assert_allclose(theta, copy, rtol=1e-14)
    assert theta[2] == 1.0
    assert {"own.first", "own.second", "own.count"} < set(own.state())


def test_bfgs_takes_over_from_adam_at_its_step() -> None:
    adam = CASES[0][0]
    optimizer = build_optimizer(AdamBfgs(**vars(adam), adam_steps=4), 3)
    assert isinstance(optimizer, AdamBfgsOptimizer)
    plain = build_optimizer(adam, 3)
    assert optimizer.lr(3) == optimizer.adam_lr(4) == plain.lr(3)
    assert math.isnan(optimizer.lr(4))
    assert set(optimizer.state()) == {*plain.state(), "inverse_hessian", "phase"}
    limited = build_optimizer(AdamBfgs(**vars(adam), adam_steps=4, pairs=7), 3)
    assert limited.state()["steps"].shape == (7, 3)
