"""The command line as a whole: exit codes, folders, and what is handed to a run."""

import gc
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
import yaml

import eigenode_cli.batch
from eigenode_cli import __version__
from eigenode_cli.cli import BLAS_THREADS, COMMANDS, main
from eigenode_cli.commands import configs
from eigenode_cli.config.catalogue import Validation
from eigenode_cli.config.schema import MlpConfig, TrainConfig
from eigenode_cli.runs.paths import claim_folder, slug

ROOT = Path(eigenode_cli.__file__).parents[1]
BASIC = "hydra/launcher=basic"
"""Runs a sweep in this process, where stand-ins are seen."""


class Runs(list[tuple[TrainConfig, Path]]):
    """What was handed to `run.train`, and the status that it answers with."""

    status = 0


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Runs:
    """A stand-in for `eigenode_cli.batch.run` that records and writes run.json, in an empty current folder."""
    recorded = Runs()
    module = ModuleType("eigenode_cli.batch.run")

    def train(config: TrainConfig, folder: Path, overrides: list[str], **_: object) -> int:
        assert all(isinstance(word, str) for word in overrides)
        status = {0: "finished", 1: "failed", 130: "interrupted"}[recorded.status]
        (folder / "run.json").write_text(
            json.dumps({"status": status, "error": "no glue" if recorded.status else None})
        )
        recorded.append((config, folder))
        return recorded.status

    module.train = train  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "eigenode_cli.batch.run", module)
    monkeypatch.setattr(eigenode_cli.batch, "run", module, raising=False)
    monkeypatch.chdir(tmp_path)
    return recorded


def process(command: list[str], folder: Path) -> "subprocess.CompletedProcess[str]":
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_a_run_gets_its_configuration_and_a_folder_named_for_people(runs: Runs) -> None:
    assert main(["train", "system=oscillator", "grads=STB+sol", "seed=3"]) == 0
    [(config, folder)] = runs
    assert isinstance(config, TrainConfig)
    assert isinstance(config.network, MlpConfig)
    assert (config.system.name, config.grads, config.seed, config.protocol) == ("oscillator", "sol+stb", 3, "paper")
    assert re.fullmatch(r"\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d_oscillator_sol\+stb_seed3", folder.name)
    assert folder.parent == Path("outputs").resolve()
    assert yaml.safe_load((folder / ".hydra" / "overrides.yaml").read_text()) == [
        "system=oscillator",
        "grads=sol+stb",
        "seed=3",
    ]
    assert not list(folder.glob("*.log"))


def test_runs_of_one_second_have_folders_of_their_own(runs: Runs) -> None:
    for _ in range(3):
        assert main(["train"]) == 0
    assert len({folder for _, folder in runs}) == 3


def test_a_claimed_folder_is_new(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    folders = [claim_folder("vdp_sol_seed0") for _ in range(5)]
    assert len(set(folders)) == 5
    assert all(folder.is_dir() for folder in folders)
    assert any(folder.name.endswith("seed0-2") for folder in folders)


def test_own_folder_wins_and_is_not_overwritten(runs: Runs, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "hydra.run.dir=here"]) == 0
    assert runs[0][1] == Path("here").resolve()
    assert main(["train", "hydra.run.dir=here"]) == 2
    assert "hydra.run.dir=here: holds a run already" in capsys.readouterr().err
    assert len(runs) == 1
    assert not Path("outputs").exists()


def test_a_sweep(runs: Runs) -> None:
    assert main(["train", "-m", "system=vdp,oscillator", "grads=frq+sol,sol", "seed=range(2)", BASIC]) == 0
    assert len(runs) == 8
    assert len({folder.parent for _, folder in runs}) == 1
    shown = r"sweep_grads=sol\+frq,sol,seed=range-2-,system=vdp,oscillator-[0-9a-f]{8}"
    assert re.fullmatch(shown, runs[0][1].parent.name)
    assert runs[0][1].name == "grads=sol+frq,seed=0,system=vdp"


def test_flags_may_stand_anywhere(runs: Runs) -> None:
    assert main(["train", "seed=0,1", "-m", "system=vdp", BASIC]) == 0
    assert [config.seed for config, _ in runs] == [0, 1]


@pytest.mark.parametrize(("status", "started"), [(1, 2), (130, 1)])
def test_the_status_of_a_sweep(runs: Runs, status: int, started: int) -> None:
    runs.status = status
    assert main(["train", "-m", "seed=0,1", BASIC]) == status
    assert len(runs) == started


@pytest.mark.parametrize("status", [0, 1, 130])
def test_the_status_of_a_run(runs: Runs, status: int) -> None:
    runs.status = status
    assert main(["train"]) == status


def test_calls_leave_the_process_as_it_was(runs: Runs) -> None:
    def state() -> tuple[object, ...]:
        environment = {name: value for name, value in os.environ.items() if name not in BLAS_THREADS}  # these stay
        return list(sys.argv), list(sys.path), environment, signal.getsignal(signal.SIGTERM), gc.get_threshold()

    before = state()
    assert main(["train"]) == 0
    assert main(["train", "sede=1"]) == 2
    assert main(["train", "-m", "seed=0,1", BASIC]) == 0
    assert state() == before
    assert len(runs) == 3


def test_own_configs_and_own_code(runs: Runs, tmp_path: Path) -> None:
    (tmp_path / "mine" / "system").mkdir(parents=True)
    (tmp_path / "mine" / "system" / "mild.yaml").write_text("# Mild\ndefaults: [vdp, _self_]\nmu: 0.1\n")
    (tmp_path / "mine" / "cli_test_terms.py").write_text("import torch\n\n\ndef far(*_):\n    return torch.zeros(())\n")
    words = ["train", "--config-dir", "mine", "system=mild", "+terms.far=cli_test_terms:far", "grads=far+sol"]
    assert main(words) == 0
    [(config, folder)] = runs
    assert (config.system.name, config.grads, config.scale["far"]) == ("mild", "sol+far", 1.0)
    assert "_mild_sol+far_" in folder.name


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        (["--cfg", "job"], "  name: vdp\n  target: eigenode_cli.systems:VanDerPol"),
        (["--cfg", "job", "--resolve", "system=sparse_oscillator", "-p", "system"], "name: sparse_oscillator"),
        (["system=oscillator", "--cfg", "job", "seed=5"], "seed: 5"),
        (["--info", "searchpath"], str(ROOT / "configs")),
        (["--help"], "eigenode train system=vdp grads=sol+frq+dmp+osc"),
        (["--hydra-help"], "--multirun"),
    ],
)
def test_hydras_flags_print_and_make_no_folder(
    words: list[str], shown: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["train", *words]) == 0
    assert shown in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []


def test_version_and_help(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as done:
        main(["--version"])
    assert done.value.code == 0
    assert capsys.readouterr().out == f"eigenode {__version__}\n"
    assert main([]) == 0
    out = capsys.readouterr().out
    assert all(re.search(rf"\n    {command.name}\s", out) for command in COMMANDS)


def test_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    groups = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert groups[0] == "system"
    assert {"solver", "protocol", "terms"} <= set(groups)
    for group in groups:
        assert main(["list", group]) == 0
        assert all(len(line.split(maxsplit=1)) == 2 for line in capsys.readouterr().out.splitlines())
    assert main(["list", "protocol"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "authors  the code behind the figures of the paper's first version",
        "journal  the authors' code for the later journal version, its quirks included",
        "paper    the text of the paper, gaps filled from the authors' first code",
        "robust   ours, reliable on all three systems of the paper",
    ]


@pytest.mark.parametrize(
    ("faults", "status", "said"),
    [
        ([], 0, "7 configurations from 2 files are valid\n5 runs of 3 experiments are valid\n"),
        (["a", "b"], 2, "eigenode: error: a\neigenode: error: b\n"),
    ],
)
def test_validate(
    faults: list[str], status: int, said: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(configs, "validate", lambda composer: Validation(7, {"x.yaml", "y.yaml"}, faults))
    experiments = SimpleNamespace(compositions=5, experiments=3, faults=[])
    monkeypatch.setattr(configs, "check_all", lambda composer: experiments)
    assert main(["validate"]) == status
    captured = capsys.readouterr()
    assert captured.out + captured.err == said


@pytest.mark.parametrize("command", ["plot", "report", "resume"])
def test_what_is_not_a_run(
    command: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "outputs" / "2026-11-24_vdp").mkdir(parents=True)
    (tmp_path / "outputs" / "empty").mkdir()
    (tmp_path / "outputs" / "sweep" / "seed=0").mkdir(parents=True)
    (tmp_path / "outputs" / "sweep" / "seed=0" / "run.json").write_text("{")
    (tmp_path / "outputs" / "2026-11-24_vdp" / "run.json").write_text("{")
    expected = {
        "outputs/2026-11-25_vdp": "no such folder, did you mean outputs/2026-11-24_vdp?",
        "outputs/empty": "not the folder of a run, it has no run.json",
        "sweep": "a sweep, name one of its 1 runs, for example outputs/sweep/seed=0",
    }
    for folder, answer in expected.items():
        assert main([command, folder]) == 2
        assert f"eigenode: error: {folder}: {answer}" in capsys.readouterr().err
    assert main([command, "2026-11-24_vdp"]) == 2
    assert capsys.readouterr().err.startswith("eigenode: error: run.json: not valid JSON: ")


def test_a_finished_run_is_not_resumed(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run.json").write_text('{"status": "finished"}')
    assert main(["resume", str(tmp_path)]) == 2
    assert "the run is finished" in capsys.readouterr().err


def test_plot_and_report_print_what_they_wrote(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("run.json", "metrics.csv"):
        (tmp_path / name).touch()
    figures = SimpleNamespace(draw_run=lambda folder: ([folder / "plots" / "phase.png"], ["data.csv is missing"]))
    report = SimpleNamespace(write_report=lambda folder: SimpleNamespace(path=folder / "report.html", faults=[]))
    monkeypatch.setitem(sys.modules, "eigenode_cli.reporting.figures", figures)
    monkeypatch.setitem(sys.modules, "eigenode_cli.reporting.report", report)
    assert main(["plot", str(tmp_path)]) == 0
    assert main(["report", str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert out.split() == [str(tmp_path / "plots" / "phase.png"), str(tmp_path / "report.html")]
    assert err == "eigenode: data.csv is missing\n"


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("eigenode tr", "train reproduce evaluate export data resume plot report bench list validate"),
        ("eigenode train system=", "system=custom system=oscillator system=sparse_oscillator system=table system=vdp"),
        ("eigenode train scale.s", "scale.sol= scale.stb= scale.stf= scale.stp="),
        ("eigenode plot ", ""),
    ],
)
def test_completion(
    line: str, offered: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COMP_LINE", line)
    assert main(["-sc", "query=bash"]) == 0
    assert capsys.readouterr().out.strip() == offered


def test_completion_is_installed_for_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["-sc", "install=bash"]) == 0
    assert capsys.readouterr().out.endswith("complete -o nospace -o default -F hydra_bash_completion eigenode\n")


def test_slug_keeps_texts_apart() -> None:
    assert slug("grads=sol+frq,seed=0") == "grads=sol+frq,seed=0"
    assert slug("a/b") != slug("a-b")
    assert "/" not in slug("a/b")
    assert len(slug("x" * 300)) <= 110
    assert slug("x" * 300) != slug("x" * 301)
    assert slug("..").startswith("run-")


def test_a_real_process_answers_a_wrong_line(tmp_path: Path) -> None:
    done = process([sys.executable, "-m", "eigenode_cli", "train", "grads=sol+frg", "sede=1"], tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert [line.split(":")[2].strip() for line in done.stderr.splitlines()] == ["sede=1", "grads=sol+frg"]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("words", [["train", "eigen.every=999"], ["train", "-m", "seed=-1,0"], ["list"]])
def test_no_heavy_import_before_everything_is_checked(words: list[str], tmp_path: Path) -> None:
    script = (
        "import sys; from eigenode_cli.cli import main; main(sys.argv[1:]);"
        "print({'torch', 'numba', 'pandas', 'scipy', 'matplotlib'} & set(sys.modules))"
    )
    assert process([sys.executable, "-c", script, *words], tmp_path).stdout.splitlines()[-1] == "set()"


def test_sigterm_interrupts(tmp_path: Path) -> None:
    script = (
        "import os, signal, sys, types, eigenode_cli.batch\n"
        "run = types.ModuleType('eigenode_cli.batch.run')\n"
        "run.train = lambda config, folder, overrides: os.kill(os.getpid(), signal.SIGTERM) or 0\n"
        "sys.modules['eigenode_cli.batch.run'] = eigenode_cli.batch.run = run\n"
        "from eigenode_cli.cli import main\n"
        "sys.exit(main(['train']))\n"
    )
    done = process([sys.executable, "-c", script], tmp_path)
    assert (done.returncode, done.stderr) == (130, "eigenode: interrupted\n")


ONE_AFTER_ANOTHER = "defaults:\n  - train\n  - override hydra/launcher: basic\n"
FEW_PROCESSES = "# @package _global_\nhydra:\n  launcher:\n    n_jobs: 1\n"


def write_config(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def test_a_launcher_that_a_config_of_the_users_chooses_runs_the_sweep(runs: Runs, tmp_path: Path) -> None:
    write_config(tmp_path / "mine" / "slow.yaml", ONE_AFTER_ANOTHER)
    assert main(["train", "-m", "--config-dir", "mine", "--config-name", "slow", "seed=0,1"]) == 0
    assert [config.seed for config, _ in runs] == [0, 1]  # joblib's processes would not see the stand-in


def test_settings_of_the_launcher_in_a_config_of_the_users_are_taken(runs: Runs, tmp_path: Path) -> None:
    write_config(tmp_path / "mine" / "machine" / "few.yaml", FEW_PROCESSES)
    assert main(["train", "-m", "--config-dir", "mine", "+machine=few", "seed=0,1"]) == 0
    assert [config.seed for config, _ in runs] == [0, 1]  # joblib starts no process for n_jobs=1


def test_the_dry_run_counts_the_cores_of_the_checked_launcher(
    runs: Runs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_config(tmp_path / "mine" / "machine" / "few.yaml", FEW_PROCESSES)
    cost = ModuleType("eigenode_cli.batch.cost")
    counted: list[int] = []
    cost.show_cost = lambda composer, kinds, workers, drawn: counted.append(workers)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "eigenode_cli.batch.cost", cost)
    assert main(["train", "-m", "--config-dir", "mine", "+machine=few", "seed=0,1", "--dry-run"]) == 0
    assert counted == [1]


OPTUNA = "_target_: hydra_plugins.hydra_optuna_sweeper.optuna_sweeper.OptunaSweeper\nn_trials: 20\nsearch_space: null\n"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["hydra/sweeper=optuna", "seed=0,1"], "hydra/sweeper=optuna: a sweep here runs every combination"),
        (["hydra/sweeper=optuna", "optimizer.lr=interval(0,1)"], "hydra/sweeper=optuna: a sweep here runs every"),
        (["+machine=one,other", "seed=0,1"], "hydra/launcher: the runs of this sweep name different launchers"),
        (["seed=0,1", "hydra.launcher.n_jobs=0"], "hydra.launcher.n_jobs=0: no run would start"),
        (["seed=0,1", "hydra.sweeper.max_batch_size=0"], "hydra.sweeper.max_batch_size=0: no run would start"),
    ],
)
def test_a_sweep_that_cannot_be_started_leaves_nothing(
    words: list[str], said: str, runs: Runs, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_config(tmp_path / "mine" / "hydra" / "sweeper" / "optuna.yaml", OPTUNA)  # as the plugin registers it
    write_config(tmp_path / "mine" / "machine" / "one.yaml", FEW_PROCESSES)
    write_config(tmp_path / "mine" / "machine" / "other.yaml", FEW_PROCESSES.replace("1", "2"))
    assert main(["train", "-m", "--config-dir", "mine", *words]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"eigenode: error: {said}")
    assert err.count("\n") == 1
    assert not (tmp_path / "outputs").exists()


def test_a_foreign_sweeper_does_not_matter_to_a_single_run(runs: Runs, tmp_path: Path) -> None:
    write_config(tmp_path / "mine" / "hydra" / "sweeper" / "optuna.yaml", OPTUNA)
    assert main(["train", "--config-dir", "mine", "hydra/sweeper=optuna"]) == 0
    assert len(runs) == 1
