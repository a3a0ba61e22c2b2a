"""A term that has nothing to compare: zero where it trains, not a number where it is recorded."""

import numpy as np
import pytest

from eigenode_cli.data.targets import StatedTarget, Targets, targets_of_spectra
from eigenode_cli.engines.base import Engine
from eigenode_cli.engines.compiled.engine import CompiledEngine
from eigenode_cli.engines.factory import shape_of
from eigenode_cli.engines.torch_engine import TorchEngine
from eigenode_cli.model import flat_parameters
from eigenode_cli.terms import NAMES, PAPER_TERMS
from tests.conftest import make_case

REAL = targets_of_spectra(np.tile(np.array([-1.0, -2.0], dtype=np.complex128), (101, 1)))


def engine_of(name: str, targets: Targets) -> tuple[Engine, np.ndarray]:
    case = make_case("oscillator")
    field, problem = case.field(), case.problem(targets=targets)
    theta = flat_parameters(field)
    return (CompiledEngine(shape_of(field), problem) if name == "compiled" else TorchEngine(field, problem, {})), theta


@pytest.mark.parametrize("name", ["compiled", "torch"])
@pytest.mark.parametrize("targets", [REAL, StatedTarget().rows(np.zeros(101))], ids=["real targets", "no targets"])
def test_zero_trains_and_nothing_is_recorded(name: str, targets: Targets) -> None:
    engine, theta = engine_of(name, targets)
    names = np.array(PAPER_TERMS)
    idle = np.isin(names, ["frq", "dmp", "osc"]) | ((names == "stf") & np.isinf(targets.stiffness).all())
    trained = engine.loss_jacobian(theta)
    assert not trained.values[idle].any()
    assert not trained.gradients[idle].any()
    assert np.isfinite(trained.values).all()
    *recorded, no_step = engine.evaluate(theta, np.linspace(0.0, 10.0, 5)).values
    recorded = np.array(recorded)
    assert np.isnan(no_step)
    assert np.isnan(recorded[idle]).all()
    np.testing.assert_allclose(recorded[~idle], trained.values[~idle], rtol=1e-12)


@pytest.mark.parametrize("name", ["compiled", "torch"])
def test_frequency_is_recorded_once_the_model_has_a_pair(name: str) -> None:
    """A linear field `dv/dt = -c s - d v`, by an identity network: overdamped, critical, and with a pair."""
    case = make_case("oscillator")
    field, problem = case.field(hidden=[1], activation="identity"), case.problem()
    engine = CompiledEngine(shape_of(field), problem) if name == "compiled" else TorchEngine(field, problem, {})
    for damping, known in ((20.0, False), (6.0, False), (0.3, True)):
        theta = np.array([-9.0, -damping, 0.0, 1.0, 0.0])  # hidden weights and bias, output weight and bias
        values = dict(zip(NAMES, engine.evaluate(theta, np.linspace(0.0, 10.0, 5)).values, strict=True))
        assert np.isfinite([values["frq"], values["dmp"]]).tolist() == [known, known]
        gap = max(0.0, damping**2 / 4.0 - 9.0)
        assert values["osc"] == pytest.approx(np.sqrt(gap), abs=1e-6)  # half of the distance of the eigenvalues
