"""What trains at which step: a list of stages."""

import pytest

from eigenode_cli.config.compose import compose, typed
from eigenode_cli.config.setup import build
from eigenode_cli.training.stages import Stage, stage_lengths


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
    stages = f"[{{terms:frq,steps:{lead}}},{{horizons:{horizons}}}]" if lead else f"[{{horizons:{horizons}}}]"
    setup = build(typed(compose([f"trainer.steps={steps}", f"stages={stages}"])))
    assert [phase.first for phase in setup.phases] == first
    assert setup.phases[-1].engine is setup.engine
    assert len(setup.phases) == len(horizons) + bool(lead)


def test_stages_without_steps_share_what_the_others_leave() -> None:
    assert stage_lengths([Stage(), Stage(steps=3), Stage()], 10) == [4, 3, 3]
    for stages in ([Stage(steps=3)], [Stage(steps=10), Stage()], [Stage(steps=11)]):
        with pytest.raises(ValueError, match="the stages take"):
            stage_lengths(stages, 10)


@pytest.mark.parametrize("wrong", [{"horizons": ()}, {"horizons": (0.0, 1.0)}, {"spectra": "nowhere"}])
def test_a_stage_that_makes_no_sense_is_refused(wrong: dict) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Stage(**wrong)


def test_held_blocks_stay_as_they_are() -> None:
    words = ["network.linear=zero", "grads=sol", "stages=[{trained:[linear],steps:3},{}]", "trainer.steps=6"]
    for optimizer in ("adam", "sgd", "adam_bfgs"):
        config = typed(compose([*words, f"optimizer={optimizer}"]))
        setup = build(config)
        held, free = setup.phases[0].trained, setup.phases[1].trained
        assert held is not None
        assert free is None
        assert held.sum() == 2
        assert held[setup.blocks["linear"]].all()
