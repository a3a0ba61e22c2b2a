"""One compiled training step against combination and optimizer by themselves."""

import numpy as np
import pytest
import torch

from eigenode_cli.arrays import Floats
from eigenode_cli.config.build import build_method, combination
from eigenode_cli.config.compose import compose, typed
from eigenode_cli.config.setup import build
from eigenode_cli.engines.combine import COMBINATIONS, SEQUENTIAL_REPEATING_LAST, combine
from eigenode_cli.engines.update import learn
from eigenode_cli.model import flat_parameters
from eigenode_cli.training.methods import Adam, Sgd
from eigenode_cli.training.optimizers import Optimizer, build_optimizer, build_update

CONFIG = Adam(lr=3e-3)


def test_a_step_takes_every_update_of_the_combination() -> None:
    generator, scales = np.random.default_rng(1), np.array([1.0, 0.5, 3.0])
    for code in COMBINATIONS.values():
        ours, theirs = Optimizer(CONFIG, 5), Optimizer(CONFIG, 5)
        update, theta = build_update(code, scales, ours), np.ones(5)
        expected, room = theta.copy(), np.empty((4, 5))
        for k in range(4):
            gradients = generator.normal(size=(3, 5))
            learn(update, theta, gradients, 1e-2 / (k + 1))
            for row in room[: combine(code, gradients, scales, room)]:
                theirs.update(expected, row, 1e-2 / (k + 1))
        assert theta.tobytes() == expected.tobytes()
        assert ours.state()["count"] == theirs.state()["count"]


SGD = Sgd(lr=1e-2, momentum=0.9)
PEERS = {
    "adam": (CONFIG, lambda p: torch.optim.Adam([p], lr=1e-3, betas=(0.9, 0.999), eps=1e-8)),
    "sgd": (SGD, lambda p: torch.optim.SGD([p], lr=1e-3, momentum=0.9)),
}


class TwiceTheLastStep:
    """The quirk around an optimizer of torch: after all gradients that act, the last change of p once more."""

    def __init__(self, theta: Floats, peer) -> None:
        self.parameter = torch.nn.Parameter(torch.from_numpy(theta.copy()))
        self.optimizer = peer(self.parameter)

    @property
    def theta(self) -> Floats:
        return self.parameter.detach().numpy()

    def take(self, gradients: Floats) -> None:
        step = torch.zeros(self.parameter.numel(), dtype=torch.float64)
        for gradient in gradients[np.isfinite(gradients).all(axis=1) & gradients.any(axis=1)]:
            before = self.parameter.detach().clone()
            self.parameter.grad = torch.from_numpy(gradient.copy())
            self.optimizer.step()
            step = self.parameter.detach() - before
        self.parameter.data += step


@pytest.mark.parametrize(
    ("gradients", "moved"),
    [
        ([[1.0]], 2.0),
        ([[1.0], [0.0]], 2.0),  # a gradient that does not act makes no step to be repeated
        ([[1.0], [1e-9]], 1.0 + 2.0 * (0.09 / 0.19) / np.sqrt(0.999e-3 / (1.0 - 0.999**2))),
    ],
    ids=["one", "one acts", "a negligible second"],
)
def test_the_authors_last_step_is_made_twice(gradients: list[list[float]], moved: float) -> None:
    """In units of the learning rate; 2.340 for the negligible second gradient, through Adam once more it were 2.188."""
    optimizer, theta = Optimizer(CONFIG, 1), np.zeros(1)
    learn(build_update(SEQUENTIAL_REPEATING_LAST, [1.0] * len(gradients), optimizer), theta, np.array(gradients), 1e-3)
    assert -theta[0] / 1e-3 == pytest.approx(moved, rel=1e-7)
    assert optimizer.state()["count"] == np.any(gradients, axis=1).sum()


def test_nothing_is_repeated_where_no_gradient_acts() -> None:
    theta = np.arange(3.0)
    update = build_update(SEQUENTIAL_REPEATING_LAST, [1.0], Optimizer(CONFIG, 3))
    learn(update, theta, np.ones((1, 3)), 1e-3)
    after = theta.copy()
    learn(update, theta, np.full((1, 3), np.nan), 1e-3)
    learn(update, theta, np.zeros((1, 3)), 1e-3)
    assert theta.tobytes() == after.tobytes()


@pytest.mark.parametrize("name", PEERS)
def test_repeated_steps_follow_torch(name: str) -> None:
    """Over many training steps the moments are those without the repetition, at the parameters with it."""
    config, peer = PEERS[name]
    generator, theta = np.random.default_rng(2), np.ones(5)
    theirs, scales = TwiceTheLastStep(theta, peer), np.array([1.0, 0.5, 3.0])
    update = build_update(SEQUENTIAL_REPEATING_LAST, scales, Optimizer(config, 5))
    for k in range(20):
        gradients = generator.normal(size=(3, 5)) + theta
        gradients[2] *= k % 3 > 0
        learn(update, theta, gradients, 1e-3)
        theirs.take(scales[:, None] * gradients)
    np.testing.assert_allclose(theta, theirs.theta, rtol=1e-12)


@pytest.mark.parametrize("engine", ["compiled", "torch"])
@pytest.mark.parametrize("name", PEERS)
@pytest.mark.parametrize("grads", ["sol", "sol+frq+stb"])
def test_the_authors_protocol_repeats_the_last_step(engine: str, name: str, grads: str) -> None:
    words = ["protocol=authors", "system=sparse_oscillator", f"engine={engine}", f"optimizer={name}", f"grads={grads}"]
    momentum = [f"optimizer.momentum={SGD.momentum}"] if name == "sgd" else []
    config = typed(compose([*words, *momentum, "optimizer.lr=1e-3"]))
    setup = build(config, lambda message: None)
    stage, theta = setup.phases[0], flat_parameters(setup.field)
    theirs = TwiceTheLastStep(theta, PEERS[name][1])
    update = build_update(combination(config.combine), stage.scales, build_optimizer(build_method(config), theta.size))
    for _ in range(3):
        theirs.take(stage.scales[:, None] * stage.engine.loss_jacobian(theirs.theta.copy()).gradients)
        stage.engine.advance(theta, update, np.array([1e-3]), False)
    np.testing.assert_allclose(theta, theirs.theta, rtol=1e-9, atol=1e-12)
