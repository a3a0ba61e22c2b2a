"""Runs on measured data: the real command on files that the tests write."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

import eigenode_cli as en
from eigenode_cli.arrays import Floats
from tests.batch.helpers import inside

YEAR = 31557600.0
RECIPE = ("protocol=robust", "trainer.figures=false")


def pendulum(times: Floats, angle: float = 1.0, torque: Any = None) -> Floats:
    """Angle and rate `(N, 2)` of a damped pendulum of 1 Hz."""

    def rate(t: float, x: Floats) -> list[float]:
        return [x[1], -((2.0 * np.pi) ** 2) * np.sin(x[0]) - 0.2 * x[1] + (0.0 if torque is None else float(torque(t)))]

    return solve_ivp(rate, (0.0, times[-1]), [angle, 0.0], t_eval=times, rtol=1e-10, atol=1e-10, max_step=0.05).y.T


TIMES = np.linspace(0.0, 8.0, 161)
NOISE = 0.005 * np.random.default_rng(0).standard_normal(TIMES.size)
X = ("system.time=t", "system.positions=[x]")
TARGET = ("target.frequency=[1.0]", "target.damping=[0.016]")


class Done(NamedTuple):
    """What a command left."""

    returncode: int
    stdout: str
    stderr: str


def command(folder: Path, *words: str) -> Done:
    return Done(*inside(folder, *words))


def write(path: Path, times: Floats, *columns: Floats, names: str) -> Path:
    rows = np.column_stack([times, *columns]).tolist()
    path.write_text("\n".join([names, *(",".join(repr(value) for value in row) for row in rows)]) + "\n")
    return path


def train(folder: Path, *words: str) -> tuple[dict[str, Any], Path]:
    """Train in `folder/run`; returns its record and folder."""
    run = folder / "run"
    done = command(folder, "train", "system=table", *RECIPE, *words, f"hydra.run.dir={run}")
    assert done.returncode == 0, done.stderr
    return json.loads((run / "run.json").read_text()), run


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    folder = tmp_path_factory.mktemp("plain")
    write(folder / "p.csv", TIMES, pendulum(TIMES)[:, 0] + NOISE, names="t,angle [rad]")
    return train(folder, "system.file=p.csv", "system.time=t", "system.positions=[angle]", "system.test=0.5", *TARGET)


def test_a_record_becomes_a_model_that_predicts(plain: tuple[dict[str, Any], Path]) -> None:
    record, run = plain
    assert record["status"] == "finished"
    assert record["final"]["test_error"] < 0.02
    assert record["baselines"]["linear"] > 5.0 * record["final"]["test_error"]
    assert record["baselines"]["repetition"] > record["final"]["test_error"]
    assert record["system"]["notes"] == [
        "p.csv: 161 rows, 2 columns (t, angle), delimiter ,, header in line 1, time in s (not stated)"
    ]
    assert [state["unit"] for state in record["system"]["states"]] == ["rad", "rad/s"]
    data = pd.read_csv(run / "data.csv")
    assert data["part"].value_counts().to_dict() == {"train": 81, "test": 80}
    wrong = (data["model_angle"] - data["angle"])[data["part"] == "test"] / data["angle"].abs().max()
    assert np.sqrt((wrong**2).mean()) == pytest.approx(record["final"]["test_error"], rel=1e-6)


def test_nothing_is_called_truth_where_there_is_none(plain: tuple[dict[str, Any], Path]) -> None:
    _, run = plain
    solution, metrics = pd.read_csv(run / "solution.csv"), pd.read_csv(run / "metrics.csv")
    assert solution[["truth_angle", "truth_angle_dot"]].isna().all().all()
    assert metrics["dense_error"].isna().all()
    assert metrics["test_error"].notna().all()
    assert solution["t"].iloc[-1] == pytest.approx(8.0)
    rest = pd.read_csv(run / "equilibrium.csv")
    assert rest["frequency"].iloc[0] == pytest.approx(1.0, rel=0.05)
    assert rest["target_im"].abs().iloc[0] == pytest.approx(2.0 * np.pi, rel=1e-3)


def test_units_and_shifts_change_nothing(plain: tuple[dict[str, Any], Path], tmp_path: Path) -> None:
    angle = pendulum(TIMES)[:, 0] + NOISE
    cases = {
        "us": (TIMES * 1e6, angle, ("system.time_unit=us", *TARGET)),
        "year": (TIMES, angle, ("system.time_unit=year", f"target.frequency=[{1.0 / YEAR!r}]", TARGET[1])),
        "shift": (TIMES + 1e6, angle, TARGET),
        "small": (TIMES, 1e-4 * angle, TARGET),
        "large": (TIMES, 1e4 * angle, TARGET),
    }
    for name, (times, values, words) in cases.items():
        folder = tmp_path / name
        folder.mkdir()
        write(folder / "p.csv", times, values, names="t,x")
        record, _ = train(
            folder, "system.file=p.csv", "system.time=t", "system.positions=[x]", "system.test=0.5", *words
        )
        assert record["final"]["test_error"] == pytest.approx(plain[0]["final"]["test_error"], rel=0.01), name


def test_a_rate_with_a_bias_alone_is_enough(tmp_path: Path) -> None:
    write(tmp_path / "g.csv", TIMES, pendulum(TIMES, 0.5)[:, 1] + 0.3, names="t,gyro")
    words = ("system.file=g.csv", "system.time=t", "system.velocities=[gyro]", "system.offset=free", "system.test=0.5")
    record, run = train(tmp_path, *words, *TARGET)
    assert record["final"]["test_error"] < 0.02
    assert (run / "checkpoints" / "last.safetensors").is_file()


def test_accelerations_are_compared_with_the_derivative_of_the_velocity(tmp_path: Path) -> None:
    states = pendulum(TIMES, 0.5)
    measured = -((2.0 * np.pi) ** 2) * np.sin(states[:, 0]) - 0.2 * states[:, 1]
    write(tmp_path / "a.csv", TIMES, measured, names="t,acc")
    words = ("system.file=a.csv", "system.time=t", "system.accelerations=[acc]", "system.test=0.5")
    record, run = train(tmp_path, *words, *TARGET)
    assert record["final"]["test_error"] < 0.05
    assert {"rate_x1_dot", "model_rate_x1_dot"} <= set(pd.read_csv(run / "data.csv").columns)


def test_trials_share_a_field_and_have_initial_states_of_their_own(tmp_path: Path) -> None:
    times = TIMES[:81]
    rows = [np.column_stack([np.full(81, trial), times, pendulum(times, a)[:, 0]]) for trial, a in ((1, 0.9), (2, 0.4))]
    every = np.concatenate(rows)
    write(tmp_path / "t.csv", every[:, 0], every[:, 1], every[:, 2], names="trial,t,x")
    words = ("system.file=t.csv", "system.trial=trial", "system.time=t", "system.positions=[x]", "system.test=0.25")
    record, run = train(tmp_path, *words, *TARGET)
    assert record["final"]["test_error"] < 0.02
    assert [one["label"] for one in record["system"]["trajectories"]] == ["t.csv trial 1", "t.csv trial 2"]
    assert pd.read_csv(run / "data.csv")["trajectory"].value_counts().to_dict() == {0: 81, 1: 81}


def test_a_driven_system_predicts_another_file_and_is_exported(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for name, seed in (("a.csv", 1.3), ("b.csv", 2.1)):
        samples = 4.0 * np.sin(seed * TIMES) + rng.standard_normal(TIMES.size)
        angle = pendulum(TIMES, 0.0, lambda t, s=samples: np.interp(t, TIMES, s))[:, 0]
        write(tmp_path / name, TIMES, angle, samples, names="t,x,torque")
    words = ("system.file=a.csv", "system.test_files=[b.csv]", "system.time=t", "system.positions=[x]")
    record, run = train(tmp_path, *words, "system.inputs=[torque]", *TARGET)
    assert record["final"]["test_error"] < 0.1
    assert record["final"]["test_error"] < record["baselines"]["linear"]
    shown = command(tmp_path, "evaluate", str(run))
    assert shown.returncode == 0, shown.stderr
    assert "b.csv" in shown.stdout
    assert "modes at the equilibrium" in shown.stdout
    other = command(tmp_path, "evaluate", str(run), "system.file=b.csv", "system.test_files=[]")
    assert other.returncode == 0, other.stderr
    assert "train" not in other.stdout.partition("rms error")[2].partition("modes")[0]
    exported = command(tmp_path, "export", str(run), "--to", "torch")
    assert exported.returncode == 0, exported.stderr
    assert "1 input" in exported.stdout


def test_a_run_is_resumed_and_evaluated_from_another_folder(tmp_path: Path) -> None:
    (tmp_path / "here").mkdir()
    (tmp_path / "there").mkdir()
    write(tmp_path / "here" / "p.csv", TIMES, pendulum(TIMES)[:, 0], names="t,x")
    write(tmp_path / "there" / "q.csv", TIMES, pendulum(TIMES, 0.6)[:, 0], names="t,x")
    words = ("system.file=p.csv", *X, "system.test=0.5", "trainer.steps=40", "stages=[{}]")
    record, run = train(tmp_path / "here", *words, *TARGET)
    more = command(tmp_path / "there", "resume", str(run), "trainer.steps=60")
    assert more.returncode == 0, more.stderr
    assert json.loads((run / "run.json").read_text())["steps"] == 60
    assert record["steps"] == 40
    other = command(tmp_path / "there", "evaluate", str(run), "system.file=q.csv", "--output", "errors.csv")
    assert other.returncode == 0, other.stderr
    assert pd.read_csv(tmp_path / "there" / "errors.csv")["trajectory"].tolist() == ["q.csv"]


WRONG = {
    "no file": (("system.file=no.csv", *X), "system.file=no.csv: no such file"),
    "near file": (("system.file=p.cvs", *X), "did you mean p.csv?"),
    "no column": (("system.file=p.csv", "system.time=t", "system.positions=[y]"), "unknown column 'y'"),
    "no time": (("system.file=p.csv", "system.positions=[x]"), "system.time: name the column of the times"),
    "nothing": (("system.file=p.csv", "system.time=t"), "nothing is measured"),
    "twice": (("system.file=p.csv", "system.time=t", "system.positions=[t]"), "=t: is system.time already"),
    "states": (("system.file=p.csv", "system.time=t", "system.states=[x]"), "network.structure=full"),
    "back in time": (("system.file=back.csv", *X), "back.csv, row 4: the time 0.5 follows 1"),
    "same time": (("system.file=same.csv", *X), "same.csv, row 4: the time is that of"),
    "no time in a row": (("system.file=hole.csv", *X), "hole.csv, row 3: no time"),
    "input with a hole": (
        ("system.file=drive.csv", *X, "system.inputs=[u]"),
        "drive.csv, row 4: no number; an input must be known in every row",
    ),
    "window": (("system.file=p.csv", *X, "system.window=[50,60]"), "has no rows there"),
    "truth": (("system.file=p.csv", *X, "target=truth"), "measured data have no truth"),
    "trials": (("system.file=p.csv", *X, "system.trials=[1]"), "no effect without system.trial"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG, ids=str)
def test_a_mistake_is_one_line(case: str, tmp_path: Path) -> None:
    write(tmp_path / "p.csv", TIMES[:9], TIMES[:9], names="t,x")
    (tmp_path / "back.csv").write_text("t,x\n0,1\n1,2\n0.5,3\n2,4\n3,5\n")
    (tmp_path / "same.csv").write_text("t,x\n0,1\n1,2\n1,3\n2,4\n3,5\n")
    (tmp_path / "hole.csv").write_text("t,x\n0,1\n,2\n1,3\n2,4\n3,5\n")
    (tmp_path / "drive.csv").write_text("t,x,u\n0,1,1\n1,2,1\n2,3,\n3,4,1\n4,5,1\n")
    words, said = WRONG[case]
    done = command(tmp_path, "train", "system=table", "grads=sol", *words)
    assert done.returncode == 2, done.stderr
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("eigenode: error: ")
    assert said in lines[0]
    assert not (tmp_path / "outputs").exists()


@pytest.mark.parametrize(("rule", "value"), [("first", 2.0), ("last", 3.0), ("mean", 2.5)])
def test_rows_of_one_time_become_one_by_the_stated_rule(rule: str, value: float, tmp_path: Path) -> None:
    (tmp_path / "same.csv").write_text("t,x\n0,1\n1,2\n1,3\n2,4\n3,5\n4,6\n")
    words = ("system.file=same.csv", "system.time=t", "system.positions=[x]", f"system.duplicates={rule}", "grads=sol")
    _, run = train(tmp_path, *words, "trainer.steps=20", "stages=[{}]")
    assert pd.read_csv(run / "data.csv")["x"].tolist() == [1.0, value, 4.0, 5.0, 6.0]


def test_data_shows_what_would_be_read_and_suggests_targets(tmp_path: Path) -> None:
    decaying = np.exp(-0.2 * TIMES) * np.cos(2.0 * np.pi * 1.5 * TIMES)
    write(tmp_path / "d.csv", TIMES * 1e3, decaying, names="t [ms],x [mm]")
    columns = command(tmp_path, "data", "d.csv")
    assert columns.returncode == 0, columns.stderr
    assert "name the roles" in columns.stdout
    shown = command(tmp_path, "data", "d.csv", "time=t", "positions=[x]")
    assert shown.returncode == 0, shown.stderr
    assert "time in ms" in shown.stdout
    frequency = float(shown.stdout.split("target.frequency=[")[1].split("]")[0])
    damping = float(shown.stdout.split("target.damping=[")[1].split("]")[0])
    assert frequency == pytest.approx(1.5, rel=0.01)
    assert damping == pytest.approx(0.2 / (2.0 * np.pi * 1.5), rel=0.05)
    assert (tmp_path / "d.png").stat().st_size > 5000
    wrong = command(tmp_path, "data", "d.csv", "time=t", "positions=[y]")
    assert (wrong.returncode, wrong.stderr.count("\n")) == (2, 1)


def test_two_modes_are_told_apart(tmp_path: Path) -> None:
    slow, fast = np.cos(2.0 * np.pi * 0.7 * TIMES), np.cos(2.0 * np.pi * 2.9 * TIMES)
    write(tmp_path / "m.csv", TIMES, slow + 0.2 * fast, slow - 0.3 * fast, names="t,a,b")
    shown = command(tmp_path, "data", "m.csv", "time=t", "positions=[a,b]").stdout
    found = [float(text) for text in shown.split("target.frequency=[")[1].split("]")[0].split(",")]
    assert found == pytest.approx([0.7, 2.9], rel=0.005)


def test_the_shipped_record_trains(tmp_path: Path) -> None:
    run = tmp_path / "run"
    done = command(tmp_path, "train", "measured=lynx_hare", "trainer.figures=false", f"hydra.run.dir={run}")
    assert done.returncode == 0, done.stderr
    assert json.loads((run / "run.json").read_text())["final"]["test_error"] < 0.3


def test_the_shipped_driven_pendulum_beats_its_linear_model(tmp_path: Path) -> None:
    run = tmp_path / "run"
    done = command(tmp_path, "train", "measured=driven_simulated", "trainer.figures=false", f"hydra.run.dir={run}")
    assert done.returncode == 0, done.stderr
    record = json.loads((run / "run.json").read_text())
    assert record["final"]["test_error"] < 0.08
    assert record["baselines"]["linear"] > 0.3
    done = command(tmp_path, "evaluate", str(run), "--map", "map.png", "--grid", "3")
    assert done.stdout.startswith("9 initial states: "), done.stderr  # without the torque


def test_a_model_is_simulated_from_another_state(plain: tuple[dict[str, Any], Path], tmp_path: Path) -> None:
    _, run = plain
    done = command(
        tmp_path, "evaluate", str(run), "system.initial_state=[0.9,0]", "system.horizon=2", "--output", "s.csv"
    )
    assert done.returncode == 0, done.stderr
    table = pd.read_csv(tmp_path / "s.csv")
    expected = pendulum(np.linspace(0.0, 2.0, 1001), 0.9)[:, 0]
    assert table["t"].iloc[-1] == pytest.approx(2.0)
    np.testing.assert_allclose(table["model_angle"], expected, atol=0.02)
    for words, fault in (
        (["system.initial_state=[0.2]"], "system.initial_state=[0.2]: give one value for each of angle, angle_dot"),
        (["system.horizon=-1"], "system.horizon=-1: must be above 0"),
        (["system.horizon=2", "solver.rtol=1e-3"], "solver.rtol=1e-3: no effect beside system.horizon=..."),
        (["--map", "m.txt"], "--map m.txt: name a picture"),
        (["--grid", "1"], "--grid 1: must be at least 2"),
    ):
        done = command(tmp_path, "evaluate", str(run), *words)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.startswith(f"eigenode: error: {fault}")


def test_a_map_tells_where_trajectories_go(plain: tuple[dict[str, Any], Path], tmp_path: Path) -> None:
    _, run = plain
    done = command(tmp_path, "evaluate", str(run), "--map", "map.png", "--grid", "7")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("49 initial states: ")
    table, loaded = pd.read_csv(tmp_path / "map.csv"), en.load_run(run)
    assert (tmp_path / "map.png").stat().st_size > 10_000
    assert len(table) == 49
    own = loaded.solution[["model_angle", "model_angle_dot"]].to_numpy()
    span = 1.5 * np.ptp(own, axis=0)  # in the units of the file, one and a half times as wide as the model's own range
    np.testing.assert_allclose(np.ptp(table[["angle", "angle_dot"]].to_numpy(), axis=0), span, rtol=1e-6)
    nearest = table.iloc[(table["angle"].abs() + table["angle_dot"].abs()).argmin()]
    assert nearest["size"] < 0.5 * table["size"].replace(np.inf, np.nan).max()
    row = table.loc[table["end"] != "leaves"].iloc[len(table) // 3]
    times = np.linspace(0.0, loaded.solution["t"].iloc[-1], 201)
    again = loaded.simulate(times, [row["angle"], row["angle_dot"]])
    np.testing.assert_allclose(again[-1], [row["end_angle"], row["end_angle_dot"]], atol=1e-3 * span.max())
