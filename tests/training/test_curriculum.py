"""What trains at which step, as the configuration says it."""

import pytest

from eigenode_cli.config.compose import compose, typed
from eigenode_cli.runs.run import build


@pytest.mark.parametrize(
    ("steps", "lead", "horizons", "first"),
    [
        (10, 0, [1.0], [0]),
        (10, 0, [0.5, 1.0], [0, 5]),
        (10, 0, [0.2, 0.5, 1.0], [0, 4, 7]),
        (10, 4, [0.5, 1.0], [0, 4, 7]),
        (11, 4, [0.5, 1.0], [0, 4, 8]),
    ],
)
def test_pretraining_comes_first_and_horizons_share_the_rest(
    steps: int, lead: int, horizons: list[float], first: list[int]
) -> None:
    words = [f"trainer.steps={steps}", f"trainer.horizons={horizons}", f"trainer.pretrain_steps={lead}"]
    setup = build(typed(compose([*words, *(["trainer.pretrain=frq"] if lead else [])])))
    assert [stage.first for stage in setup.stages] == first
    assert setup.stages[-1].engine is setup.engine
    assert len(setup.stages) == len(horizons) + bool(lead)
