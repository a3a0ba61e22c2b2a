"""Integration of the vector field: tableaus, step control, statuses and the torchdiffeq solvers."""
