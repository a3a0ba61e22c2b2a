"""Train NeuralODEs with knowledge about the eigenvalues of the learned system.

`import eigenode_cli as en` offers what a script or a notebook needs (`docs/python.md`), each name loaded at first use.
"""

import importlib
import os
import sys
from typing import Any

__version__ = "0.1.0"

PUBLIC = {
    **dict.fromkeys(("Oscillator", "VanDerPol", "System", "State", "Parameter"), "systems"),
    **dict.fromkeys(("Dataset", "Series"), "data.dataset"),
    **dict.fromkeys(("Truth", "simulate"), "data.simulate"),
    **dict.fromkeys(("reconstruct",), "data.reconstruct"),
    **dict.fromkeys(("StatedTarget", "TruthTarget"), "data.targets"),
    **dict.fromkeys(("VectorField", "Mlp", "Polynomial", "flat_parameters", "load_flat"), "model"),
    **dict.fromkeys(("Problem",), "engines.problem"),
    **dict.fromkeys(("build_engine",), "engines.factory"),
    **dict.fromkeys(("Adam", "AdamBfgs", "LevenbergMarquardt", "OwnMethod", "Sgd"), "training.methods"),
    **dict.fromkeys(("Schedule", "Exponential", "Cosine", "Plateau"), "training.schedules"),
    **dict.fromkeys(("Tableau", "explicit"), "solve.tableau"),
    **dict.fromkeys(("TERMS", "Term"), "terms"),
    **dict.fromkeys(("Stage",), "training.stages"),
    **dict.fromkeys(("AdaptiveSolver", "FixedStepSolver"), "solve.settings"),
    **dict.fromkeys(("eig", "eigvals"), "spectra.eig"),
    **dict.fromkeys(("track",), "spectra.tracking"),
    **dict.fromkeys(("train", "load_run", "RecordedRun", "Comparison"), "recorded"),
    **dict.fromkeys(("Fit", "fit", "modal_field"), "fitting"),
}
"""The public names, and where each is defined."""


def __getattr__(name: str) -> Any:
    """Load a public name at its first use, so that the command starts without torch and Numba."""
    if name not in PUBLIC:
        raise AttributeError(f"module {__name__} has no attribute {name}")
    return getattr(importlib.import_module(f"{__name__}.{PUBLIC[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *PUBLIC])


OWN_CODE = "EIGENODE_PATH"
"""Variable with the folders of the user's own code, for child processes."""


def own_code() -> list[str]:
    """Return the folders of the user's own code, those named first first."""
    return [folder for folder in os.environ.get(OWN_CODE, "").split(os.pathsep) if folder]


sys.path += [folder for folder in own_code() if folder not in sys.path]  # in a child process
