"""A Python file with the learned vector field that needs torch only."""

from eigenode_cli.export.exported import ExportedModel
from eigenode_cli.export.text import render

ACTIVATIONS = {
    "tanh": "return torch.tanh(z)",
    "sigmoid": "return torch.sigmoid(z)",
    "relu": "return torch.relu(z)",
    "softplus": "return torch.nn.functional.softplus(z, threshold=700.0)",
    "silu": "return torch.nn.functional.silu(z)",
    "elu": "return torch.nn.functional.elu(z)",
    "sin": "return torch.sin(z)",
    "identity": "return z",
}
"""The activations, as they stand in the file."""


def torch_file(model: ExportedModel) -> str:
    """Return the file: a class `Field`, a function `simulate`, and what is known of the model as constants."""
    return render("field.py.j2", model, activations=ACTIVATIONS)
