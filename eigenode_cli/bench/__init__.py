"""`eigenode bench`: the same loss Jacobian at the same weights and tolerances, ours and by peers, as ratios.

Importing this package costs nothing; what measures and the peers are imported where they are needed.
"""

RECIPES: dict[str, tuple[str, str, int]] = {
    "oscillator-sol": ("oscillator", "sol", 5000),
    "oscillator-all": ("oscillator", "sol+frq+dmp+stb+osc", 5000),
    "vdp": ("vdp", "sol+frq+dmp+osc", 20_000),
}
"""System, terms and training steps that give each case its weights: `eigenode train system=... grads=... seed=0`. The
Van der Pol oscillator takes more steps until the learned system moves as fast as the true one."""

GROWTH = "growth"
"""The case that asks how time grows with states, width, depth and horizon."""

NAMES: tuple[str, ...] = (*RECIPES, GROWTH)
"""All cases, in the order they are measured."""
