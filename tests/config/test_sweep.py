"""Sweeps are checked as a whole, with one composition for runs that differ in the seed alone."""

from pathlib import Path

import pytest

from eigenode_cli.config import sweep
from eigenode_cli.config.composer import Composer
from eigenode_cli.config.sweep import examine_sweep


def test_seeds_share_one_check(monkeypatch: pytest.MonkeyPatch) -> None:
    checked: list[int] = []
    examine = sweep.examine_overrides

    def counting(composer, overrides):
        checked.append(len(overrides))
        return examine(composer, overrides)

    monkeypatch.setattr(sweep, "examine_overrides", counting)
    composer = Composer()
    found = examine_sweep(composer, composer.composed(()), ["grads=sol,sol+frq", "seed=range(500)"])
    assert found.checked().grads == "sol"
    assert len(checked) == 2


def test_an_option_that_one_run_reads_is_not_useless() -> None:
    composer = Composer()
    found = examine_sweep(composer, composer.composed(()), ["grads=sol,sol+stf", "scale.stf=3"])
    assert (found.faults, found.useless) == ([], {})


def test_the_sweep_of_a_config(tmp_path: Path) -> None:
    text = (
        "defaults: [train, _self_]\nhydra:\n  mode: MULTIRUN\n  sweeper:\n    params:\n      system: oscillator,vpd\n"
    )
    (tmp_path / "study.yaml").write_text(text)
    composer = Composer(str(tmp_path), "study")
    found = examine_sweep(composer, composer.composed(()), ["seed=range(2)"])
    assert [fault.partition(",")[0] for fault in found.faults] == ["system=vpd: unknown system 'vpd'"]
