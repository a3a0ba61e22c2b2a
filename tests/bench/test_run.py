import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eigenode_cli.bench import GROWTH, NAMES, RECIPES, measure
from eigenode_cli.bench import run as bench_run
from eigenode_cli.bench.case import Case, oscillating, recipe_config
from eigenode_cli.bench.contestants import PEERS, Contestant, Result, Runner
from eigenode_cli.bench.figure import draw_bench
from eigenode_cli.bench.run import disagreements, goals, measure_peers
from eigenode_cli.bench.table import number, show
from eigenode_cli.cli import main
from tests.bench.content import made


def wrong(case: Case) -> Runner:
    runner = PEERS["torch"].build(case)
    return replace(runner, read=lambda raw: Result(1.01 * raw.values, raw.gradients, raw.n_accepted))


def test_a_peer_that_computes_something_else_gets_no_ratio(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure, "SAMPLE_SECONDS", 0.0)
    monkeypatch.setattr(measure, "PAIRS", measure.FEWEST)
    peers = [PEERS["torch"], Contestant("wrong", "wrong", wrong)]
    found = measure_peers("tiny", oscillating(4, [4], 0.5, 3, ("sol", "frq")), peers, lambda _line: None)
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert {name: row["holds"] for name, row in found["agreement"].items()} == {"torch": True, "wrong": False}
    assert list(found["ratios"]) == ["torch"]
    assert found["ratios"]["torch"]["pairs"] == measure.FEWEST
    assert disagreements({"cases": {"tiny": found}, "growth": {}}) == ["tiny: wrong disagrees"]


def test_goals_say_whether_bounds_hold() -> None:
    rows = {row["what"]: row for row in goals(made(diffrax=5.0))}
    assert rows["vdp: diffrax over ours"]["holds"]
    mean = rows["geometric mean: diffrax over ours"]
    assert mean["value"] == pytest.approx(5.0)
    assert not mean["holds"]
    floor = rows["vdp: whole training step over bare solve"]
    assert (floor["bound"], floor["holds"], floor["aim_holds"]) == ("at most", True, True)
    assert not rows["vdp: six terms over sol alone, adjoint"]["holds"]
    assert not rows["growth, states, sol, 21 spectra: smallest ratio of diffrax"]["holds"]


def test_the_geometric_mean_needs_all_cases() -> None:
    content = made()
    del content["cases"]["vdp"]
    assert not [row for row in goals(content) if "geometric" in row["what"]]


def test_every_recipe_is_a_valid_configuration() -> None:
    for name, (system, grads, steps) in RECIPES.items():
        config = recipe_config(name)
        assert (config.system.name, config.grads, config.trainer.steps) == (system, grads, steps)
    assert (*RECIPES, GROWTH) == NAMES


def test_tables_name_what_is_missing_and_who_disagrees(capsys: pytest.CaptureFixture[str]) -> None:
    content = made(agrees=False)
    content["goals"] = goals(content)
    show(content)
    out = capsys.readouterr().out
    assert "torchode is not measured: no torchode; pip install 'eigenode[bench]'" in out
    assert "vdp: diffrax disagrees" in out
    assert "900 (810 to 990)" in out
    assert "1.50" in out
    assert "fails" in out


@pytest.mark.parametrize(("value", "text"), [(1234.5, "1234"), (99.94, "99.9"), (1.0, "1"), (0.12345, "0.123")])
def test_numbers_have_three_digits(value: float, text: str) -> None:
    assert number(value) == text


def test_figures_are_drawn_for_what_was_measured(tmp_path: Path) -> None:
    paths = draw_bench(made(), tmp_path)
    assert [path.name for path in paths] == ["ratios.png", "ratios.pdf", "growth.png", "growth.pdf"]
    assert all(path.stat().st_size > 1000 for path in paths)
    assert [path.name for path in draw_bench(made() | {"growth": {}}, tmp_path)] == ["ratios.png", "ratios.pdf"]


def test_an_unknown_case_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "ocsillator-all"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("eigenode: error: unknown case 'ocsillator-all', did you mean oscillator-all?")
    assert captured.err.count("\n") == 1


def test_an_output_that_is_a_file_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "taken").write_text("")
    assert main(["bench", "vdp", "--output", str(tmp_path / "taken")]) == 2
    assert "--output" in capsys.readouterr().err


@pytest.mark.parametrize(("agrees", "status"), [(True, 0), (False, 1)])
def test_json_alone_is_on_standard_output(
    agrees: bool, status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[tuple[str, ...]] = []

    def measured(names: tuple[str, ...], say) -> dict:
        asked.append(tuple(names))
        say("measuring")
        return made(agrees=agrees)

    monkeypatch.setattr(bench_run, "run_bench", measured)
    monkeypatch.setattr("eigenode_cli.commands.bench.ONE_THREAD", {})
    assert main(["bench", "--json", "--output", str(tmp_path / "a" / "b")]) == status
    captured = capsys.readouterr()
    assert json.loads(captured.out) == json.loads((tmp_path / "a" / "b" / "bench.json").read_text())
    assert "measuring" in captured.err
    assert asked == [NAMES]
    assert np.isfinite(json.loads(captured.out)["cases"]["vdp"]["train_seconds"])
