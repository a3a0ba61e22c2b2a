"""Our optimizers against torch.optim on the same sequence of gradients."""

import math

import numpy as np
import pytest
import torch

from eigenode_cli.training.optimizers import Adam, AdamBfgs, AdamBfgsOptimizer, Optimizer, Sgd, build_optimizer

CONSTANT = {"lr_extra": 0.0, "lr_rate": 0.0, "lr_every": 1}
CASES = [
    (
        Adam(lr=3e-3, beta1=0.8, beta2=0.99, eps=1e-8, **CONSTANT),
        lambda p: torch.optim.Adam([p], lr=3e-3, betas=(0.8, 0.99), eps=1e-8),
    ),
    (
        Sgd(lr=1e-2, momentum=0.9, **CONSTANT),
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


def test_learning_rate_decays_in_stairs_to_its_end() -> None:
    config = Sgd(lr=1e-3, lr_extra=9e-3, lr_rate=2e-3, lr_every=10, momentum=0.0)
    rates = [config.learning_rate(k) for k in range(5001)]
    assert rates[:10] == pytest.approx([1e-2] * 10)
    assert rates[4990] == rates[4999] == 1e-3 + 9e-3 * math.exp(-9.98)
    assert np.all(np.diff(rates)[9::10] < 0.0)
    assert len(set(rates)) == 501


@pytest.mark.parametrize("config", [case[0] for case in CASES], ids=["adam", "sgd"])
def test_a_constant_rate_is_exactly_that(config) -> None:
    assert {config.learning_rate(k) for k in (0, 1, 5000)} == {config.lr}


@pytest.mark.parametrize("config", [case[0] for case in CASES], ids=["adam", "sgd"])
def test_an_update_has_the_size_of_its_rate(config) -> None:
    moves = []
    for lr in (1e-3, 2e-3):
        theta = np.ones(2)
        Optimizer(config, 2).update(theta, np.array([1.0, -3.0]), lr)
        moves.append(theta - 1.0)
    np.testing.assert_allclose(moves[1], 2.0 * moves[0], rtol=1e-12)


def test_the_rate_of_a_step_is_that_of_the_schedule() -> None:
    config = Sgd(lr=1e-3, lr_extra=1.0, lr_rate=0.5, lr_every=1, momentum=0.0)
    assert Optimizer(config, 2).lr(3) == 1e-3 + math.exp(-1.5)


def test_bfgs_takes_over_from_adam_at_its_step() -> None:
    adam = CASES[0][0]
    optimizer = build_optimizer(AdamBfgs(**vars(adam), adam_steps=4), 3)
    assert isinstance(optimizer, AdamBfgsOptimizer)
    plain = build_optimizer(adam, 3)
    assert optimizer.lr(3) == optimizer.adam_lr(4) == plain.lr(3)
    assert math.isnan(optimizer.lr(4))
    assert set(optimizer.state()) == {*plain.state(), "inverse_hessian", "phase"}
