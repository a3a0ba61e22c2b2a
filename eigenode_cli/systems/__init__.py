"""Systems: the ground truths that data is taken from."""

from eigenode_cli.systems.base import Parameter, State, System
from eigenode_cli.systems.oscillator import Oscillator
from eigenode_cli.systems.vdp import VanDerPol

__all__ = ["Oscillator", "Parameter", "State", "System", "VanDerPol"]
