"""Objects that a configuration describes."""

import numpy as np
import pytest

from eigenode_cli.config.build import build_source, build_target
from eigenode_cli.config.compose import compose, typed


def test_an_undamped_frequency_is_the_modulus_of_the_eigenvalue() -> None:
    words = ["system=oscillator", "target=stated", "target.frequency=[1.5]", "target.damping=[0.6]"]
    config = typed(compose([*words, "target.undamped=true"]))
    target = build_target(config.target, build_source(config))
    eigenvalue = target.spectra(np.zeros(1))[0][0]
    assert abs(eigenvalue) == pytest.approx(2.0 * np.pi * 1.5)
    assert -eigenvalue.real / abs(eigenvalue) == pytest.approx(0.6)
    plain = typed(compose(words))
    assert build_target(plain.target, build_source(plain)).rows(np.zeros(1)).frequency[0, 0] == pytest.approx(1.5)
