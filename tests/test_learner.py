"""One compiled training step against combination and optimizer by themselves."""

import numpy as np

from eigenode_cli.combine import COMBINATIONS, combine
from eigenode_cli.config.schema import AdamConfig
from eigenode_cli.learner import build_rule, learn
from eigenode_cli.optimizer import Optimizer

CONFIG = AdamConfig(name="adam", lr=3e-3, lr_extra=0.0, lr_rate=0.0, lr_every=1, beta1=0.9, beta2=0.999, eps=1e-8)


def test_a_step_takes_every_update_of_the_combination() -> None:
    generator, scales = np.random.default_rng(1), np.array([1.0, 0.5, 3.0])
    for code in COMBINATIONS.values():
        ours, theirs = Optimizer(CONFIG, 5), Optimizer(CONFIG, 5)
        rule, theta = build_rule(code, scales, ours), np.ones(5)
        expected, room = theta.copy(), np.empty((4, 5))
        for k in range(4):
            gradients = generator.normal(size=(3, 5))
            learn(rule, theta, gradients, 1e-2 / (k + 1))
            for update in room[: combine(code, gradients, scales, room)]:
                theirs.update(expected, update, 1e-2 / (k + 1))
        assert theta.tobytes() == expected.tobytes()
        assert ours.state()["count"] == theirs.state()["count"]
