"""The ONNX graph, in the real runtime."""

import json
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest

import eigenode_cli as en
from eigenode_cli.arrays import Floats
from eigenode_cli.export.exported import ExportedModel
from eigenode_cli.export.from_run import exported_model
from eigenode_cli.export.onnx_file import onnx_file
from tests.export.helpers import VARIANTS, awkward, disagreement, expected, random_points

AGREEMENT = {"float64": 1e-9, "float32": 1e-6}


def rates(graph: onnx.ModelProto, x: Floats, u: Floats, precision: str) -> np.ndarray:
    """What onnxruntime makes of it."""
    session = onnxruntime.InferenceSession(graph.SerializeToString(), providers=["CPUExecutionProvider"])
    feed = {"x": x.astype(precision), **({"u": u.astype(precision)} if u.shape[1] else {})}
    assert [value.name for value in session.get_inputs()] == list(feed)
    (found,) = session.run(["dxdt"], feed)
    assert found.dtype == precision
    return found


@pytest.mark.parametrize("precision", AGREEMENT)
@pytest.mark.parametrize("model", VARIANTS.values(), ids=VARIANTS)
def test_its_rates(model: ExportedModel, precision: str) -> None:
    graph = onnx_file(model, precision)
    onnx.checker.check_model(graph, full_check=True)
    x, u = random_points(model)
    assert disagreement(rates(graph, x, u, precision), expected(model, x, u)) < AGREEMENT[precision]


@pytest.mark.parametrize("name", ["softplus", "elu", "silu", "sigmoid"])
def test_activations_far_out_are_finite(name: str) -> None:
    model = VARIANTS[name]
    x, u = random_points(model, 200)
    assert disagreement(rates(onnx_file(model), 1e4 * x, u, "float64"), expected(model, 1e4 * x, u)) < 1e-9


def test_that_of_a_run(run: en.RecordedRun, tmp_path: Path) -> None:
    model = exported_model(run.folder)
    path = tmp_path / "field.onnx"
    path.write_bytes(onnx_file(model).SerializeToString())
    graph = onnx.load(path)
    x, u = random_points(model)
    assert disagreement(rates(graph, x, u, "float64"), expected(model, x, u)) < 1e-9
    found = {entry.key: entry.value for entry in graph.metadata_props}
    assert found["command"] == model.command
    assert [state["name"] for state in json.loads(found["states"])] == list(run.states)
    assert json.loads(found["highest"]) == model.highest.tolist()
    assert [(mode["frequency"], mode["damping"]) for mode in json.loads(found["modes"])] == list(model.modes)


def test_awkward_names() -> None:
    model = awkward()
    graph = onnx_file(model)
    found = {entry.key: entry.value for entry in graph.metadata_props}
    assert found["command"] == model.command
    assert json.loads(found["inputs"])[0]["unit"] == "N m/s^2"
    x, u = random_points(model, 10)
    assert disagreement(rates(graph, x, u, "float64"), expected(model, x, u)) < 1e-9
