"""`eigenode export` on the command line."""

import ctypes
import json
import subprocess
import sys
from pathlib import Path

import fmpy
import numpy as np
import onnx
import onnxruntime
import pytest
import torch

import eigenode_cli as en
from tests.batch.helpers import inside
from tests.export.helpers import disagreement

OWN_NETWORK = """
import torch


class Cubic(torch.nn.Module):
    def __init__(self, inputs, outputs, generator=None):
        super().__init__()
        self.weight = torch.nn.Parameter(-torch.ones(outputs, inputs, dtype=torch.float64))

    def forward(self, x):
        return x**3 @ self.weight.T
"""
OWN_SYSTEM = """
import numpy as np

import eigenode_cli as en


class MyPendulum(en.System):
    title = "Pendulum"
    states = (en.State("phi", "rad", "x"), en.State("omega", "rad/s", "y"))
    parameters = ()

    def dynamics(self, x):
        return np.stack([x[..., 1], -np.sin(x[..., 0])], axis=-1)

    def jacobian(self, x):
        matrix = np.zeros((*x.shape, 2))
        matrix[..., 0, 1] = 1.0
        matrix[..., 1, 0] = -np.cos(x[..., 0])
        return matrix
"""


@pytest.mark.parametrize(
    ("to", "ending", "said"),
    [
        ("onnx", "onnx", "an ONNX graph with input x and output dxdt, float64"),
        ("torch", "py", "a Python file with the class Field and simulate(), needs torch only"),
        ("c", "c", "C99 with oscillator_rates, oscillator_jacobian and oscillator_simulate, needs libm only"),
        ("fmu", "fmu", "an FMU, FMI 2.0 for model exchange, with its C sources and a binary for Linux"),
    ],
)
def test_it_writes_into_the_folder_of_the_run(
    one_run: en.RecordedRun, tmp_path: Path, to: str, ending: str, said: str
) -> None:
    status, out, err = inside(tmp_path, "export", str(one_run.folder), "--to", to)
    path = one_run.folder / "export" / f"oscillator.{ending}"
    assert (status, err) == (0, "")
    assert out == f"oscillator after 4 steps, 2 states, 0 inputs: {said}\n{path}\n"
    first = path.read_bytes()
    path.write_text("of another program")
    assert inside(tmp_path, "export", str(one_run.folder), "--to", to)[0] == 0
    assert path.read_bytes() == first
    assert sorted(entry.name for entry in path.parent.iterdir() if entry.stem != "oscillator") == []


def test_all_formats_give_the_rates_of_the_run(run: en.RecordedRun, tmp_path: Path) -> None:
    name = run.config.system.name
    for to in ("onnx", "torch", "c", "fmu"):
        assert inside(tmp_path, "export", str(run.folder), "--to", to, "--output", f"made.{to}")[0] == 0
    x = np.array([[0.3, -0.7]])
    with torch.no_grad():
        wanted = run.field()(torch.from_numpy(x)).numpy()
    session = onnxruntime.InferenceSession((tmp_path / "made.onnx").read_bytes(), providers=["CPUExecutionProvider"])
    assert disagreement(session.run(None, {"x": x})[0], wanted) < 1e-12
    scope: dict[str, object] = {"__name__": "made"}
    exec((tmp_path / "made.torch").read_text(), scope)
    assert disagreement(scope["Field"]()(torch.from_numpy(x)).numpy(), wanted) < 1e-12  # type: ignore[operator]
    subprocess.run(["gcc", "-std=c99", "-shared", "-fPIC", "made.c", "-o", "made.so", "-lm"], cwd=tmp_path, check=True)
    numbers = np.ctypeslib.ndpointer(dtype=np.float64)
    rates = ctypes.CDLL(str(tmp_path / "made.so"))[f"{name}_rates"]
    rates.argtypes, rates.restype = [numbers, ctypes.c_void_p, numbers], None
    found = np.empty(2)
    rates(x[0], None, found)
    assert disagreement(found, wanted[0]) < 1e-12
    start = fmpy.simulate_fmu(str(tmp_path / "made.fmu"), stop_time=0.01)[0]
    np.testing.assert_array_equal([start[state] for state in run.states], run.initial_state())


def test_float32_and_a_step(one_run: en.RecordedRun, tmp_path: Path) -> None:
    words = ("export", str(one_run.folder), "--to", "onnx", "--precision", "float32", "--step", "0")
    status, out, _ = inside(tmp_path, *words, "--output", "start.onnx")
    assert status == 0
    assert out.splitlines() == [
        "oscillator after 0 steps, 2 states, 0 inputs: an ONNX graph with input x and output dxdt, float32",
        "start.onnx",
    ]
    graph = onnx.load(tmp_path / "start.onnx")
    assert {tensor.data_type for tensor in graph.graph.initializer} <= {onnx.TensorProto.FLOAT, onnx.TensorProto.INT64}
    session = onnxruntime.InferenceSession(graph.SerializeToString(), providers=["CPUExecutionProvider"])
    x = np.array([[0.3, -0.7]])
    with torch.no_grad():
        wanted = one_run.field(0)(torch.from_numpy(x)).numpy()
    assert disagreement(session.run(None, {"x": x.astype(np.float32)})[0], wanted) < 1e-6


@pytest.mark.parametrize(
    ("words", "faults"),
    [
        ((), ["--to: missing; choose from onnx, torch, c, fmu"]),
        (("--to", "onx"), ["--to onx: unknown format 'onx', did you mean onnx? choose from onnx, "]),
        (
            ("--to", "c", "--precision", "float32"),
            ["--precision float32: --to c is float64; only --to onnx has a choice"],
        ),
        (
            ("--to", "onnx", "--precision", "float16", "--output", "nowhere/made.onnx"),
            [
                "--precision float16: unknown precision 'float16', did you mean float64? ",
                "--output nowhere/made.onnx: there is no folder nowhere; make it first",
            ],
        ),
        (("--to", "c", "--output", "."), ["--output .: is a folder; name a file in it"]),
        (("--to", "c", "--step", "7"), [": no checkpoint of step 7; there are 0, 4"]),
        (("--to", "c", "--step", "last"), ["argument --step: invalid int value: 'last'"]),
    ],
)
def test_mistakes_are_told(one_run: en.RecordedRun, tmp_path: Path, words: tuple[str, ...], faults: list[str]) -> None:
    status, out, err = inside(tmp_path, "export", str(one_run.folder), *words)
    assert (status, out) == (2, "")
    assert len(err.splitlines()) == len(faults)
    for fault, line in zip(faults, err.splitlines(), strict=True):
        assert line.startswith("eigenode: error: ")
        assert fault in line
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_is_not_there(tmp_path: Path) -> None:
    status, _, err = inside(tmp_path, "export", "nowhere", "--to", "c")
    assert (status, err) == (2, "eigenode: error: nowhere: no such folder\n")


def test_without_onnx(one_run: en.RecordedRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnx", None)
    status, _, err = inside(tmp_path, "export", str(one_run.folder), "--to", "onnx")
    assert (status, err) == (2, "eigenode: error: --to onnx needs the package onnx: pip install 'eigenode[onnx]'\n")


def test_without_gcc(one_run: en.RecordedRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    status, _, err = inside(tmp_path, "export", str(one_run.folder), "--to", "fmu")
    assert status == 2
    assert err == "eigenode: error: --to fmu needs gcc, which is not installed; install it, or write --to c\n"
    assert inside(tmp_path, "export", str(one_run.folder), "--to", "c")[0] == 0


def test_a_network_of_ones_own_is_refused_and_a_system_of_ones_own_is_not(tmp_path: Path) -> None:
    (tmp_path / "cubic_networks.py").write_text(OWN_NETWORK)
    (tmp_path / "swinging_systems.py").write_text(OWN_SYSTEM)
    short = ("trainer.steps=2", "trainer.figures=false", "engine=torch", "grads=sol")
    own = ("network=cubic_networks:Cubic", "system=oscillator", "hydra.run.dir=own")
    assert inside(tmp_path, "train", *short, *own)[::2] == (0, "")
    status, _, err = inside(tmp_path, "export", "own", "--to", "c")
    assert status == 2
    assert err == (
        "eigenode: error: own: the network cubic_networks:Cubic is a class of your own; only network=mlp and"
        " network=polynomial can be exported\n"
    )
    system = ("system=swinging_systems:MyPendulum", "system.initial_state=[1,0]", "system.horizon=2")
    more = ("system.points=21", "system.observed=[phi]", "hydra.run.dir=swing")
    assert inside(tmp_path, "train", *short, *system, *more)[::2] == (0, "")
    status, out, err = inside(tmp_path, "export", "swing", "--to", "onnx")
    assert (status, err) == (0, "")
    assert out.splitlines()[-1] == "swing/export/mypendulum.onnx"
    graph = onnx.load(tmp_path / "swing" / "export" / "mypendulum.onnx")
    found = {entry.key: entry.value for entry in graph.metadata_props}
    assert json.loads(found["states"])[1] == {"name": "omega", "unit": "rad/s"}


def test_weights_that_are_not_finite_are_refused(one_run: en.RecordedRun, tmp_path: Path) -> None:
    from safetensors.torch import load_file, save_file  # noqa: PLC0415  # here only

    folder = tmp_path / "broken"
    (folder / "checkpoints").mkdir(parents=True)
    for name in ("run.json", "data.csv", "solution.csv"):
        (folder / name).write_bytes((one_run.folder / name).read_bytes())
    checkpoint = "checkpoints/step-000004.safetensors"
    tensors = load_file(one_run.folder / checkpoint)
    tensors["layers.0.bias"][0] = torch.nan
    save_file(tensors, folder / checkpoint)
    status, _, err = inside(tmp_path, "export", "broken", "--to", "c")
    assert status == 2
    assert err == "eigenode: error: broken: cannot be exported: layers.0.bias is not finite\n"
