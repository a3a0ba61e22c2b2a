"""`eigenode export RUN --to FORMAT`: the learned vector field as a file for use elsewhere."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from eigenode_cli.console import counted
from eigenode_cli.errors import UserError, unknown

if TYPE_CHECKING:
    from eigenode_cli.export.exported import ExportedModel

ENDINGS = {"onnx": ".onnx", "torch": ".py", "c": ".c", "fmu": ".fmu"}
"""Formats, and how their files end."""
USES = {
    "onnx": "an ONNX graph with input {inputs} and output dxdt, {precision}",
    "torch": "a Python file with the class Field and simulate(), needs torch only",
    "c": "C99 with {name}_rates, {name}_jacobian and {name}_simulate, needs libm only",
    "fmu": "an FMU, FMI 2.0 for model exchange, with its C sources and a binary for Linux",
}
"""What is written, in words."""
DOUBLE, SINGLE = "float64", "float32"


def export(args: argparse.Namespace) -> int:
    """Write the learned vector field of a run into one file."""
    _check(args)
    from eigenode_cli.export.from_run import exported_model  # noqa: PLC0415  # torch, once it is needed
    from eigenode_cli.export.text import identifier  # noqa: PLC0415  # Jinja2, as above
    from eigenode_cli.runs.atomic import make_folder, write_bytes  # noqa: PLC0415
    from eigenode_cli.runs.paths import run_folder  # noqa: PLC0415

    model = exported_model(args.run, args.step)
    content = _content(args.to, model, args.precision)
    name = identifier(model.name)
    if args.output is None:
        path = run_folder(args.run) / "export" / f"{name}{ENDINGS[args.to]}"
        make_folder(path.parent)
    else:
        path = Path(args.output)
    write_bytes(path, content)
    inputs = "x and u" if model.inputs else "x"
    use = USES[args.to].format(name=name, inputs=inputs, precision=args.precision)
    size = f"{counted(len(model.states), 'state')}, {counted(len(model.inputs), 'input')}"
    print(f"{model.name} after {counted(model.trained_steps, 'step')}, {size}: {use}")
    print(path)
    return 0


def _check(args: argparse.Namespace) -> None:
    """Check the arguments.

    Raises:
        UserError: with all faults.
    """
    faults = []
    if args.to is None:
        faults.append(f"--to: missing; choose from {', '.join(ENDINGS)}")
    elif args.to not in ENDINGS:
        faults.append(f"--to {args.to}: {unknown('format', args.to, ENDINGS)}")
    if args.precision not in (DOUBLE, SINGLE):
        faults.append(f"--precision {args.precision}: {unknown('precision', args.precision, (DOUBLE, SINGLE))}")
    elif args.precision != DOUBLE and args.to in ENDINGS and args.to != "onnx":
        faults.append(f"--precision {args.precision}: --to {args.to} is float64; only --to onnx has a choice")
    if args.output is not None:
        path = Path(args.output)
        if path.is_dir():
            faults.append(f"--output {args.output}: is a folder; name a file in it")
        elif not path.parent.is_dir():
            faults.append(f"--output {args.output}: there is no folder {path.parent}; make it first")
    if faults:
        raise UserError(faults)


def _content(kind: str, model: "ExportedModel", precision: str) -> bytes:
    """Return the file of a format."""
    if kind == "onnx":
        from eigenode_cli.export.onnx_file import onnx_file  # noqa: PLC0415  # each format loads what it needs

        return onnx_file(model, precision).SerializeToString()
    if kind == "torch":
        from eigenode_cli.export.torch_file import torch_file  # noqa: PLC0415

        return torch_file(model).encode()
    if kind == "c":
        from eigenode_cli.export.c_file import c_file  # noqa: PLC0415

        return c_file(model).encode()
    from eigenode_cli.export.fmu import fmu  # noqa: PLC0415

    return fmu(model)
