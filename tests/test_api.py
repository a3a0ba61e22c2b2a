"""`import eigenode_cli as en`: light, quiet, and complete enough for a notebook."""

import subprocess
import sys

import numpy as np
import pytest

import eigenode_cli as en

PROBE = """
import sys
import eigenode_cli
heavy = [name for name in ("torch", "numba", "scipy", "pandas", "hydra", "matplotlib") if name in sys.modules]
print(heavy)
print(sys.modules["eigenode_cli"].__version__)
"""


def test_importing_loads_nothing_heavy_and_prints_nothing() -> None:
    done = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[0] == "[]"
    assert done.stderr == ""


@pytest.mark.parametrize("name", sorted(en.PUBLIC))
def test_every_public_name_is_there_and_documented(name: str) -> None:
    assert name in dir(en)
    assert (getattr(en, name).__doc__ or "").strip()


def test_a_name_that_there_is_not() -> None:
    with pytest.raises(AttributeError, match="no attribute Oscilator"):
        en.Oscilator  # noqa: B018


def test_a_fit_prints_nothing_and_leaves_the_random_state(capsys: pytest.CaptureFixture[str]) -> None:
    truth = en.Truth(en.VanDerPol(), (2.0, 0.0))
    data = en.simulate(truth, np.linspace(0.0, 6.0, 31), observed=["nu"])
    found = en.fit(en.VectorField(en.Mlp(2, [8], 1)), data, en.StatedTarget(), steps=40, stages=[en.Stage()])
    assert capsys.readouterr() == ("", "")
    assert list(found.metrics["step"]) == [0, 25, 40]
    assert found.metrics["sol"].iloc[-1] < 0.1 * found.metrics["sol"].iloc[0]
    assert found.simulate(np.array([0.0, 1.0])).shape == (2, 2)
    with pytest.raises(ValueError, match="foo: choose from sol, frq"):
        en.fit(found.field, data, en.StatedTarget(), terms=["foo"])
