"""A C99 file with the learned vector field, its Jacobian and a solver, that needs libm only."""

from eigenode_cli.export.exported import ExportedModel
from eigenode_cli.export.text import render

_SIGMOID = "(z >= 0.0 ? 1.0 / (1.0 + exp(-z)) : exp(z) / (1.0 + exp(z)))"

ACTIVATIONS = {
    "tanh": ("return tanh(z);", "return 1.0 - tanh(z) * tanh(z);"),
    "sigmoid": (f"return {_SIGMOID};", f"return {_SIGMOID} * (1.0 - {_SIGMOID});"),
    "relu": ("return z < 0.0 ? 0.0 : z;", "return z > 0.0 ? 1.0 : 0.0;"),
    "softplus": ("return (z < 0.0 ? 0.0 : z) + log1p(exp(-fabs(z)));", f"return {_SIGMOID};"),
    "silu": (f"return z * {_SIGMOID};", f"return {_SIGMOID} * (1.0 + z * (1.0 - {_SIGMOID}));"),
    "elu": ("return z > 0.0 ? z : expm1(z);", "return z > 0.0 ? 1.0 : exp(z);"),
    "sin": ("return sin(z);", "return cos(z);"),
    "identity": ("return z;", "(void)z;\n    return 1.0;"),
}
"""The activations and their derivatives, as they stand in the file."""


def c_file(model: ExportedModel) -> str:
    """Return the file: `NAME_rates`, `NAME_jacobian`, `NAME_input_jacobian`, `NAME_simulate`, and constants."""
    return render("field.c.j2", model, activations=ACTIVATIONS)
