"""What keeps a training from the compiled engine. Light: the command line is checked with it."""

SOLVERS = ("tsit5", "dopri5", "bosh3", "adaptive_heun", "rk4", "rodas5p", "rosenbrock23", "auto")
"""The methods of `solve.tableau.TABLEAUS` and `solve.way.STIFF`."""


def obstacle(network: str, solver: str | None, jacobian: str) -> str | None:
    """Return why the compiled engine can't train this, in a few words that name the setting; None where it can.

    Args:
        network: `mlp`, or the name of another network.
        solver: name of the method; None for one of the user's own tableau.
        jacobian: how A is computed.
    """
    if network != "mlp":
        return f"network={network} (it knows mlp)"
    if solver is not None and solver not in SOLVERS:
        return f"solver={solver} (it knows {', '.join(SOLVERS)})"
    if jacobian == "finite_difference":
        return "eigen.jacobian=finite_difference (its Jacobian is exact)"
    return None
