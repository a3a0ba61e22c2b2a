"""The command from end to end, its choices and its mistakes; tables and files that it leaves."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest

from eigenode_cli.cli import main
from eigenode_cli.console import minus
from eigenode_cli.errors import UserError
from eigenode_cli.reproduce import study as way
from eigenode_cli.reproduce.journal import HEADER, hit_step, journal_table
from eigenode_cli.reproduce.library import names
from eigenode_cli.reproduce.study import Study, choose, prepare, train
from eigenode_cli.reproduce.tables import counts, found, reached
from tests.reproduce.conftest import write_experiment


def test_what_is_chosen() -> None:
    protocol, experiments = choose((), None)
    assert protocol == "paper"
    assert set(experiments) == {"cost", "local_minimum", "network", "oscillator", "sparse_oscillator", "vdp"}
    assert choose(["ablation_targets"], None)[0] == "paper"  # only by its name
    assert set(choose((), "journal")[1]) == {name for name in names() if name.startswith("journal_")}
    assert choose(["journal_vdp"], None)[0] == "journal"
    assert choose(["journal_vdp"], "paper")[0] == "paper"
    with pytest.raises(UserError) as caught:
        choose(["vpd", "oscilator"], None)
    assert len(caught.value.faults) == 2


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--repetitions 0", "0: must be a whole number from 1"),
        ("--jobs two", "two: must be a whole number from 1"),
        ("--protocol papr", "--protocol papr: unknown protocol 'papr', did you mean paper?"),
        ("vpd", "reproduce vpd: unknown experiment 'vpd', did you mean vdp?"),
        ("--check gone.json", "--check gone.json: no such file"),
        ("--check small.yaml", "--check small.yaml: not a verdicts.json"),
    ],
)
def test_mistakes(words: str, said: str, elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_experiment(elsewhere)
    assert main(["reproduce", *words.split()]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.startswith("eigenode: error: ")
    assert err.count("\n") == 1
    assert not (elsewhere / "outputs").exists()


def test_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(names())
    assert any(line.startswith("vdp ") and "7 runs, 12 claims (paper, authors)" in line for line in lines)


def test_the_command_leaves_everything(study: Study, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    words = ["reproduce", "small.yaml", "--repetitions", "2", "--jobs", "1", "--output", str(out)]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "4 runs, 4 of them finished before" in said
    assert "protocol paper, 2 seeds, 3 claims: 2 holds, 1 fails" in said
    assert {path.name for path in out.iterdir()} == {
        "verdicts.md",
        "verdicts.csv",
        "verdicts.json",
        "runs.csv",
        "tables.md",
        "table_small.csv",
        "figures",
        "index.html",
    }
    assert len(list((out / "figures").iterdir())) == 9
    content = json.loads((out / "verdicts.json").read_text())
    assert content["command"] == "eigenode reproduce small.yaml --protocol paper --repetitions 2"
    with (out / "verdicts.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["claim"], row["kept"], row["seeds"], row["verdict"]) for row in rows] == [
        ("size", "2", "2", "holds"),
        ("same", "2", "2", "holds"),
        ("perfect", "0", "2", "fails"),
    ]
    assert (out / "verdicts.md").read_text().count("**holds**") == 2
    assert "\n| sol+stb | " in (out / "verdicts.md").read_text()
    assert len((out / "runs.csv").read_text().splitlines()) == 4
    assert "sol+stb" in said.partition("holds")[0]
    words += ["--no-figures", "--check", str(out / "verdicts.json")]
    assert main(words) == 0
    content["claims"][2] |= {"verdict": "holds", "kept": 99, "seeds": 99}
    (out / "verdicts.json").write_text(json.dumps(content))
    assert main(words) == 1
    assert (
        "eigenode: differs: small/perfect: fails (0 of 2 seeds), committed is holds (99 of 99)"
        in capsys.readouterr().err
    )


def run_small(*words: str) -> int:
    return main(["reproduce", "small.yaml", "--jobs", "1", "--no-figures", *words])


def test_each_study_has_a_folder_of_its_own(study: Study) -> None:
    results = Path("outputs", "reproduce", "paper")

    def written() -> dict[str, bytes]:
        return {path.parent.name: path.read_bytes() for path in results.glob("*/verdicts.json")}

    assert run_small("--repetitions", "1") == 0
    (first,) = written()
    assert first.startswith("small_1-seed-")
    before = written()[first]
    assert run_small("--repetitions", "2") == 0
    assert written()[first] == before
    (second,) = written().keys() - {first}
    assert second.startswith("small_2-seeds-")
    assert run_small("--repetitions", "1") == 0
    assert written().keys() == {first, second}
    assert way.default_output(study).name == second
    changed = replace(study.experiments["small"], title="Another study")
    assert way.default_output(replace(study, experiments={"small": changed})).name not in (first, second)
    assert not list(results.glob("*.lock"))


def test_two_at_once_do_not_write_into_one_folder(
    study: Study, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    with way.alone(out):
        assert run_small("--output", str(out)) == 2
    assert "another eigenode reproduce writes into it; wait until it ends" in capsys.readouterr().err
    assert list(out.iterdir()) == []
    (tmp_path / "file").touch()
    assert run_small("--output", str(tmp_path / "file")) == 2
    assert capsys.readouterr().err.startswith(f"eigenode: error: --output {tmp_path / 'file'}: no folder can be made")


@pytest.mark.parametrize(
    ("verdicts", "said"), [(0, "no claims"), (1, "1 claim: 1 holds"), (2, "2 claims: 1 holds, 1 fails")]
)
def test_counts_of_claims(verdicts: int, said: str, study: Study) -> None:
    size, _, perfect = study.verdicts()
    assert counts([size, perfect][:verdicts]) == said


def test_one_seed_is_one_seed(study: Study, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_small("--repetitions", "1") == 0
    said = capsys.readouterr().out
    assert "1 of 1 " in said
    assert "protocol paper, 1 seed, 3 claims: 2 holds, 1 fails" in said
    assert "1 seeds" not in said


def test_one_kind_of_minus_on_a_page() -> None:
    text = "{0}0.0123 [{0}2e{0}05, 1e+3] from {0}1 to .5"
    assert minus(text.format("-")) == text.format("\N{MINUS SIGN}")
    assert minus("run-2 sol+frq-3 2026-11-24") == "run-2 sol+frq-3 2026-11-24"


def test_journal_table(study: Study) -> None:
    table = journal_table(study, "small")
    assert table.names == ("sol", "sol+stb", "again")
    assert table.numbers.shape == (3, len(HEADER) - 1)
    sol, stb, again = table.numbers
    assert (sol[:7] == again[:7]).all()
    assert sol[0] <= sol[1] <= sol[2]
    assert (table.numbers[:, 7:9] > 0.0).all()
    assert not table.numbers[:, -1].any()
    finals = [result.metrics.terms["sol"][-1] for result in study.results["small"]["sol"]]
    assert sol[1] == pytest.approx(sum(finals) / 2.0)
    assert stb[9] >= 1.0


def test_hit_step_is_the_first_below(study: Study) -> None:
    results = study.results["small"]["sol"]
    assert hit_step(results, 1e9) == 0.0
    assert hit_step(results, 0.0) == float("inf")


def test_numbers_in_the_table() -> None:
    assert reached(None) == "\N{EN DASH}"
    assert reached(float("inf")) == "never"
    assert (reached(0.012345), reached(2587.5)) == ("0.0123", "2588")


def test_found_shows_quartiles_only_where_they_differ(study: Study) -> None:
    size, _, perfect = study.verdicts()
    assert found(size) == "129"
    assert found(perfect).count(",") == 1


def test_an_interrupted_run_ends_the_study(elsewhere: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started = []
    monkeypatch.setattr(way, "train_unit", lambda unit: started.append(unit) or 130)
    with pytest.raises(KeyboardInterrupt):
        train(prepare([write_experiment(elsewhere)], None, 2), jobs=1)
    assert len(started) == 1
