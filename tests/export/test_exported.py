"""The exported model: its numbers are those of the run, and of eigenode's own modules."""

import keyword
import shlex
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import fsolve

import eigenode_cli as en
from eigenode_cli.errors import UserError
from eigenode_cli.export.exported import ExportedModel, Layer, Perceptron
from eigenode_cli.export.from_run import exported_model
from eigenode_cli.export.text import c_comment, c_text, identifier
from tests.export.helpers import VARIANTS, disagreement, expected, made, random_points


@pytest.mark.parametrize("model", VARIANTS.values(), ids=VARIANTS)
def test_rates_are_those_of_eigenodes_modules(model: ExportedModel) -> None:
    x, u = random_points(model)
    assert disagreement(model.rates(x, u), expected(model, x, u)) < 1e-13
    if not model.inputs:
        np.testing.assert_array_equal(model.rates(x), model.rates(x, u))
    else:
        np.testing.assert_array_equal(model.rates(x), model.rates(x, np.zeros_like(u)))


def test_units_are_those_of_the_user() -> None:
    model = made(scaled=True, n=4, k=2)
    x, u = random_points(model, 50)
    scaled = replace(model, state_units=np.ones(4), input_units=np.ones(2), time_unit=1.0)
    g = scaled.rates(x / model.state_units, u / model.input_units)
    np.testing.assert_allclose(model.rates(x, u), g * model.state_units / model.time_unit, rtol=1e-14)


def test_it_is_the_field_of_the_run(run: en.RecordedRun) -> None:
    model = exported_model(run.folder)
    x, _ = random_points(model)
    with torch.no_grad():
        wanted = run.field()(torch.from_numpy(x)).numpy()
    assert disagreement(model.rates(x), wanted) < 1e-13
    np.testing.assert_array_equal(model.initial_state, run.initial_state())
    assert tuple(state.name for state in model.states) == run.states
    assert (model.start, model.end) == (0.0, run.config.system.horizon)
    assert model.trained_steps == 4
    assert model.command == run.record["command"]
    assert shlex.split(model.command)[:2] == ["eigenode", "train"]
    assert (model.run, model.version) == (run.folder.name, en.__version__)


def test_the_range_is_that_of_the_data_or_of_the_trajectory(run: en.RecordedRun) -> None:
    model = exported_model(run.folder)
    path = run.simulate(np.linspace(model.start, model.end, 1001))
    for i, name in enumerate(run.states):
        seen = run.data[name].dropna() if run.data[name].notna().any() else path[:, i]
        assert (model.lowest[i], model.highest[i]) == pytest.approx((seen.min(), seen.max()), abs=1e-12)


def test_modes_are_those_of_the_equilibrium(run: en.RecordedRun) -> None:
    model = exported_model(run.folder)
    path = run.simulate(np.linspace(model.start, model.end, 1001))
    rest = fsolve(lambda x: model.rates(x[None])[0], path.mean(axis=0), xtol=1e-13)
    assert model.modes_at.startswith("at the equilibrium")
    values = np.linalg.eigvals(_slopes(model, rest))
    upper = sorted(values[values.imag > 1e-6], key=lambda value: value.imag)
    wanted = [(value.imag / (2.0 * np.pi), -value.real / abs(value)) for value in upper]
    np.testing.assert_allclose(np.reshape(model.modes, (-1, 2)), np.reshape(wanted, (-1, 2)), rtol=1e-5, atol=1e-7)
    fastest = max(np.abs(np.linalg.eigvals(_slopes(model, x))).max() for x in path[::25])
    assert 0.0 < model.step <= min(0.0501 / fastest, model.end / 200.0)


def test_without_an_equilibrium_modes_are_medians_along_the_trajectory(
    one_run: en.RecordedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eigenode_cli.export.from_run.equilibrium", lambda *_: None)
    model = exported_model(one_run.folder)
    assert len(model.modes) == 1
    path = one_run.simulate(np.linspace(model.start, model.end, 1001))
    values = np.array([np.linalg.eigvals(_slopes(model, x)) for x in path[::10]])
    upper = values[np.arange(len(values)), values.imag.argmax(axis=1)]
    assert model.modes_at == "median along the trajectory of the training"
    frequency, damping = np.median(upper.imag) / (2.0 * np.pi), np.median(-upper.real / np.abs(upper))
    np.testing.assert_allclose(model.modes, [(frequency, damping)], rtol=1e-3, atol=1e-4)


def test_weights_of_a_step(one_run: en.RecordedRun) -> None:
    start, end = exported_model(one_run.folder, 0), exported_model(one_run.folder)
    x, _ = random_points(end, 100)
    with torch.no_grad():
        wanted = one_run.field(0)(torch.from_numpy(x)).numpy()
    assert disagreement(start.rates(x), wanted) < 1e-13
    assert disagreement(end.rates(x), wanted) > 1e-6
    assert start.trained_steps == 0
    with pytest.raises(UserError, match="no checkpoint of step 7; there are 0, 4"):
        exported_model(one_run.folder, 7)


def test_what_does_not_fit_is_refused() -> None:
    model = made(n=4)
    with pytest.raises(ValueError, match="2 outputs of the network do not give the rates of 4 states, full"):
        replace(model, structure="full")
    with pytest.raises(ValueError, match=r"lowest has the shape \(3,\), not \(4,\)"):
        replace(model, lowest=np.zeros(3))
    assert isinstance(model.network, Perceptron)
    layers = (Layer(model.network.layers[0].weight * np.nan, model.network.layers[0].bias), *model.network.layers[1:])
    with pytest.raises(ValueError, match=r"layers\.0\.weight is not finite"):
        replace(model, network=replace(model.network, layers=layers))


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("vdp", "vdp"),
        ("My-System 2", "my_system_2"),
        ("2dof", "model_2dof"),
        ("\u00e4", "model"),
        ("lambda", "lambda_model"),
        ("torch", "torch_model"),
        ("random", "random_model"),
    ],
)
def test_names(text: str, name: str) -> None:
    assert identifier(text) == name
    assert name.isidentifier()
    assert not keyword.iskeyword(name)


def test_texts_of_c() -> None:
    assert c_text('a"b\\c?\n\u00e4') == r'"a\"b\\c\?\n\303\244"'
    assert c_comment("*/ /* ??/\n") == "* / / * ? ?/ "


def _slopes(model: ExportedModel, x: np.ndarray) -> np.ndarray:
    """Jacobian by central differences."""
    shift = 1e-5 * np.eye(x.size)
    return ((model.rates(x + shift) - model.rates(x - shift)) / 2e-5).T
