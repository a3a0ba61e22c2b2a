"""Train NeuralODEs with knowledge about the eigenvalues of the learned system."""

import os
import sys

__version__ = "0.1.0"

OWN_CODE = "EIGENODE_PATH"
"""Variable with the folders of the user's own code, for child processes."""


def own_code() -> list[str]:
    """The folders of the user's own code, those named first first."""
    return [folder for folder in os.environ.get(OWN_CODE, "").split(os.pathsep) if folder]


sys.path += [folder for folder in own_code() if folder not in sys.path]  # in a child process
