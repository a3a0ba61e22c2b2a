"""The user's own code and configs: found, never taken for an installed module, and named in every command to repeat."""

import json
import os
import shlex
import sys
from pathlib import Path

import pytest

from eigenode_cli import OWN_CODE
from eigenode_cli.batch import run as run_module
from eigenode_cli.config.compose import compose, typed
from eigenode_cli.runs.paths import hidden, importable
from tests.batch.helpers import BASIC, eigenode, inside
from tests.test_damage import InterruptedAt

NAMES = ("random", "queue", "torch", "yaml", "numpy", "logging", "hydra")
SHORT = ("system=oscillator", "trainer.steps=6", "trainer.record_every=2", "trainer.figures=false")
CALM = "def calm(trajectory):\n    return (trajectory[:, 1] ** 2).mean()\n"


def record(run: Path) -> dict[str, object]:
    return json.loads((run / "run.json").read_text())


@pytest.fixture
def hiding(tmp_path: Path) -> Path:
    """A folder with files that have the names of installed modules, and a term of the user's."""
    for name in NAMES:
        (tmp_path / f"{name}.py").write_text(f"raise SystemExit('{name}.py of the current folder was run')\n")
    (tmp_path / "my_terms.py").write_text(CALM)
    return tmp_path


def test_files_of_the_current_folder_hide_no_installed_module(hiding: Path) -> None:
    words = (*SHORT, "+terms.calm=my_terms:calm", "grads=sol+calm")
    status, _, err = eigenode(hiding, "train", *words, "hydra.run.dir=run")
    assert (status, err) == (0, "")
    assert record(hiding / "run")["status"] == "finished"


def test_nor_in_the_workers_of_a_sweep(hiding: Path) -> None:
    words = (*SHORT, "+terms.calm=my_terms:calm", "grads=sol+calm", "seed=0,1", "hydra.sweep.dir=sweep")
    status, _, err = eigenode(hiding, "train", "-m", *words, "hydra.launcher.n_jobs=2")
    assert (status, err) == (0, "")
    assert [record(path.parent)["status"] for path in (hiding / "sweep").glob("*/run.json")] == ["finished"] * 2


def test_a_term_in_a_module_of_an_installed_ones_name(hiding: Path) -> None:
    (hiding / "queue.py").write_text(CALM)
    status, _, err = inside(hiding, "train", *SHORT, "+terms.calm=queue:calm", "grads=sol+calm")
    assert status == 2
    line = f"terms.calm=queue:calm: an installed module queue is taken, not {hiding / 'queue.py'}; rename yours"
    assert err == f"eigenode: error: {line}\n"


def test_own_folders_come_last_and_the_first_named_of_them_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    before = list(sys.path), dict(os.environ)
    with importable("."), importable("mine"):
        assert sys.path[-2:] == [str(tmp_path / "mine"), str(tmp_path)]
        assert os.environ[OWN_CODE] == os.pathsep.join(sys.path[-2:])
        assert os.environ.get("PYTHONPATH") == before[1].get("PYTHONPATH")
        assert hidden("my_terms") is None
        (tmp_path / "my_terms.py").touch()
        (tmp_path / "queue.py").touch()
        assert hidden("my_terms") is None
        assert hidden("queue.inner") == tmp_path / "queue.py"
    assert (list(sys.path), dict(os.environ)) == before


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A folder with a system and a term of the user's in `my configs`."""
    configs = tmp_path / "my configs"
    (configs / "system").mkdir(parents=True)
    (configs / "system" / "soft.yaml").write_text("# Soft\ndefaults: [oscillator, _self_]\nc: 4.0\n")
    (configs / "own_terms_of_the_configs.py").write_text(CALM)
    return tmp_path


FLAG = "--config-dir=my configs"
OWN = ("system=soft", *SHORT[1:], "+terms.calm=own_terms_of_the_configs:calm", "grads=sol+calm")


def test_the_command_in_the_record_is_complete(own: Path) -> None:
    assert inside(own, "train", FLAG, *OWN, "hydra.run.dir=run")[0] == 0
    command = shlex.split(str(record(own / "run")["command"]))
    assert command[:3] == ["eigenode", "train", f"--config-dir={own / 'my configs'}"]
    (own / "elsewhere").mkdir()
    status, _, err = inside(own / "elsewhere", *command[1:], "hydra.run.dir=again")
    assert (status, err) == (0, "")
    assert record(own / "elsewhere" / "again")["config"] == record(own / "run")["config"]
    assert inside(own, "train", "-m", FLAG, *OWN, "seed=0,1", BASIC, "hydra.sweep.dir=sweep")[0] == 0
    for path in (own / "sweep").glob("*/run.json"):
        assert shlex.split(str(record(path.parent)["command"]))[2] == f"--config-dir={own / 'my configs'}"


def test_the_hint_to_go_on_works(
    own: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(own)
    words = [f"--config-dir={own / 'my configs'}", *OWN]
    folder = own / "cut run"
    folder.mkdir()
    with importable("my configs"):
        config = typed(compose(OWN, "my configs"))
        monkeypatch.setattr(run_module, "display", lambda *_: InterruptedAt(2))
        assert run_module.train(config, folder, words) == 130
    monkeypatch.undo()
    hint = capsys.readouterr().err.splitlines()[-1]
    assert hint.startswith("go on with: eigenode resume ")
    sys.modules.pop("own_terms_of_the_configs", None)
    status, _, err = inside(own.parent, *shlex.split(hint.removeprefix("go on with: "))[1:])
    assert (status, err) == (0, "")
    assert record(folder)["status"] == "finished"


def test_resume_knows_the_configs_and_refuses_without_harm(own: Path) -> None:
    folder = own / "cut"
    folder.mkdir()
    words = [f"--config-dir={own / 'my configs'}", *OWN]
    with importable(str(own / "my configs")):
        config = typed(compose(OWN, str(own / "my configs")))
        assert run_module.train(config, folder, words, quiet=True, watch=InterruptedAt(2)) == 130
    sys.modules.pop("own_terms_of_the_configs", None)
    source = own / "my configs" / "own_terms_of_the_configs.py"
    source.rename(own / "gone")
    before = (folder / "run.json").read_bytes()
    status, _, err = inside(own, "resume", "cut")
    assert (status, err.count("\n")) == (2, 1)
    assert "run.json: config.terms.calm=own_terms_of_the_configs:calm: cannot import own_terms_of_the_configs" in err
    assert (folder / "run.json").read_bytes() == before
    (own / "gone").rename(source)
    status, _, err = inside(own, "resume", "cut")
    assert (status, err) == (0, "")


@pytest.mark.parametrize("resolve", [(), ("--resolve",)])
def test_printed_settings_train_as_a_config(tmp_path: Path, resolve: tuple[str, ...]) -> None:
    status, out, _ = inside(tmp_path, "train", *SHORT, "grads=sol+stb", "optimizer=sgd", "--cfg", "job", *resolve)
    assert status == 0
    (tmp_path / "mine.yaml").write_text(out)
    flags = ("--config-dir=.", "--config-name=mine")
    status, _, err = inside(tmp_path, "train", *flags, "optimizer.lr=0.01", "hydra.run.dir=run")
    assert (status, err) == (0, "")
    again = inside(tmp_path, "train", *SHORT, "grads=sol+stb", "optimizer=sgd", "optimizer.lr=0.01", "hydra.run.dir=b")
    assert again[0] == 0
    assert record(tmp_path / "run")["config"] == record(tmp_path / "b")["config"]
    assert not list((tmp_path / "run").glob("*.log"))
    status, _, err = inside(tmp_path, "train", *flags, "solver.rtol=-1", "sede=1")
    assert status == 2
    assert "solver.rtol=-1: must be above 0" in err
    assert "sede=1: unknown setting 'sede', did you mean seed?" in err
    status, _, err = inside(tmp_path, "train", *flags, "-m", "seed=0,1", BASIC)
    assert (status, err) == (0, "")
    (sweep,) = (tmp_path / "outputs").iterdir()
    assert sweep.name.startswith("sweep_seed=0,1")


def test_a_config_without_a_schema_is_checked(tmp_path: Path) -> None:
    out = inside(tmp_path, "train", *SHORT, "--cfg", "job")[1]
    (tmp_path / "mine.yaml").write_text(out.replace("  rtol: 0.001\n", "  rtol: -1\n"))
    status, _, err = inside(tmp_path, "train", "--config-dir=.", "--config-name=mine")
    assert (status, err) == (2, "eigenode: error: solver.rtol=-1: must be above 0\n")
    (tmp_path / "mine.yaml").write_text(out.replace("  rtol: 0.001\n", ""))
    status, _, err = inside(tmp_path, "train", "--config-dir=.", "--config-name=mine")
    assert (status, err) == (2, "eigenode: error: solver.rtol: missing, write solver.rtol=...\n")
