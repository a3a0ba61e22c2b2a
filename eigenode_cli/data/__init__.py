"""Data: what was measured, what is known of the initial state and of the spectrum, and how both are simulated."""

from eigenode_cli.data.dataset import Dataset, Series
from eigenode_cli.data.reconstruct import Estimate, reconstruct
from eigenode_cli.data.simulate import Truth, simulate
from eigenode_cli.data.targets import StatedTarget, Target, Targets, TruthTarget, targets_of_spectra

__all__ = [
    "Dataset",
    "Estimate",
    "Series",
    "StatedTarget",
    "Target",
    "Targets",
    "Truth",
    "TruthTarget",
    "reconstruct",
    "simulate",
    "targets_of_spectra",
]
