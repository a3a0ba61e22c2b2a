"""Systems: the ground truths that data is taken from."""

from typing import Any

from eigenode_cli.systems.base import Parameter, State, System
from eigenode_cli.systems.oscillator import Oscillator
from eigenode_cli.systems.vdp import VanDerPol

SYSTEMS: dict[str, type[Any]] = {"oscillator": Oscillator, "vdp": VanDerPol}
"""Dynamics by the name that `system.dynamics` holds; each is built from its own configuration class."""

__all__ = ["SYSTEMS", "Parameter", "State", "System"]
