"""Eigenvalues of the Jacobian along a trajectory, their sensitivities, pairs and tracking."""
