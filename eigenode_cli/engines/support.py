"""What keeps a configuration from the compiled engine. Light: the command line is checked with it."""

from eigenode_cli.config.schema import TrainConfig

SOLVERS = ("tsit5", "dopri5", "rk4")
"""The methods of `solve.tableau.TABLEAUS`."""


def obstacle(config: TrainConfig) -> str | None:
    """Why the compiled engine can't train this, in a few words that name the setting; None where it can."""
    if config.network.name != "mlp":
        return f"network={config.network.name} (it knows mlp)"
    if config.solver.name not in SOLVERS:
        return f"solver={config.solver.name} (it knows {', '.join(SOLVERS)})"
    if config.eigen.jacobian == "finite_difference":
        return "eigen.jacobian=finite_difference (its Jacobian is exact)"
    return None
