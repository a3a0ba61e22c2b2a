"""The fixed lists of names that settings choose from, as plain data: no torch, no Numba.

The modules that implement them hold a registry under the same names; a test keeps the two equal.
"""

ACTIVATIONS = ("tanh", "sigmoid", "relu", "softplus", "silu", "elu", "sin", "identity")
INITS = ("glorot", "uniform01", "kaiming")
STRUCTURES = ("second_order", "full")
SCALINGS = ("none", "max_abs")
ERRORS = ("mae", "mse", "huber")
ON_UNSOLVABLE = ("stabilise", "skip", "stop")
JACOBIANS = ("autodiff", "finite_difference", "symbolic")
SPECTRA_AT = ("trajectory", "data")
EIGENVALUE_COUNTS = ("spectrum", "times")
SENSITIVITIES = ("auto", "forward", "adjoint")
