"""`eigenode bench`: the same loss Jacobian at the same weights and tolerances, ours and by peers, as ratios.

Importing this package costs nothing; what measures and the peers are imported where they are needed.
"""

RECIPES: dict[str, tuple[str, str]] = {
    "oscillator-sol": ("oscillator", "sol"),
    "oscillator-all": ("oscillator", "sol+frq+dmp+stb+osc"),
    "vdp": ("vdp", "sol+frq+dmp+osc"),
}
"""System and terms of each case at trained weights: `eigenode train system=... grads=... seed=0`."""

GROWTH = "growth"
"""The case that asks how time grows with states, width, depth and horizon."""

NAMES: tuple[str, ...] = (*RECIPES, GROWTH)
"""All cases, in the order they are measured."""
