"""The learned vector field as an FMU: FMI 2.0 for model exchange, with its sources and a binary for Linux."""

import hashlib
import io
import shutil
import subprocess
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from eigenode_cli.errors import UserError
from eigenode_cli.export.c_file import c_file
from eigenode_cli.export.exported import ExportedModel
from eigenode_cli.export.text import identifier, render
from eigenode_cli.export.units import rate_unit, unit_of

DATE = (1980, 1, 1, 0, 0, 0)
"""Of every file in the archive, so that the same model gives the same bytes."""
BINARY = "binaries/linux64"
FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-Wl,-Bsymbolic")
"""Of the compiler; each FMU calls its own functions, however many a program loads."""


def fmu(model: ExportedModel) -> bytes:
    """Return the FMU, a zip archive.

    Raises:
        UserError: there is no gcc, two variables have one name, or a name is none that an FMU can have.
    """
    _check_names(model)
    name = identifier(model.name)
    files = _texts(model, name)
    sources = {path: text for path, text in files.items() if path.startswith("sources/")}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, text in files.items():
            archive.writestr(zipfile.ZipInfo(path, DATE), text, zipfile.ZIP_DEFLATED)
        binary = zipfile.ZipInfo(f"{BINARY}/{name}.so", DATE)
        binary.external_attr = 0o755 << 16
        archive.writestr(binary, compiled(sources), zipfile.ZIP_DEFLATED)
    return buffer.getvalue()


def compiled(sources: dict[str, str]) -> bytes:
    """Return the shared object that gcc makes of C files.

    Args:
        sources: their texts by path.

    Raises:
        UserError: there is no gcc, or it does not take them.
    """
    gcc = shutil.which("gcc")
    if gcc is None:
        raise UserError("--to fmu needs gcc, which is not installed; install it, or write --to c")
    with TemporaryDirectory() as folder:
        names = [Path(path).name for path in sources]
        for name, text in zip(names, sources.values(), strict=True):
            (Path(folder) / name).write_text(text, encoding="utf-8")
        done = subprocess.run(
            [gcc, *FLAGS, *names, "-o", "made.so", "-lm"], cwd=folder, capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            first = next((line for line in done.stderr.splitlines() if "error" in line), "no message")
            raise UserError(f"--to fmu: gcc ends with {done.returncode}: {first}")
        return (Path(folder) / "made.so").read_bytes()


def _texts(model: ExportedModel, name: str) -> dict[str, str]:
    """Return the text files of the archive by path; the guid is that of all that is in them."""
    rate_units = [rate_unit(state.unit) for state in model.states]
    names = [*(variable.unit for variable in (*model.states, *model.inputs)), *rate_units]
    size = np.maximum(np.abs(model.lowest), np.abs(model.highest))
    content = {
        "rate_units": rate_units,
        "units": [unit_of(unit) for unit in dict.fromkeys(names) if unit],
        "nominals": np.where(size > 0.0, size, 1.0),
    }
    sources = f"sources/{name}.c"

    def texts(guid: str) -> dict[str, str]:
        described = render("modelDescription.xml.j2", model, escape=True, guid=guid, **content)
        return {
            "modelDescription.xml": described,
            sources: c_file(model),
            f"sources/{name}_fmi2.c": render("fmi2.c.j2", model, guid=guid, **content),
            "documentation/index.html": render("index.html.j2", model, escape=True),
        }

    digest = hashlib.sha256("".join(texts("").values()).encode()).hexdigest()
    return texts("{" + "-".join((digest[:8], digest[8:12], digest[12:16], digest[16:20], digest[20:32])) + "}")


def _check_names(model: ExportedModel) -> None:
    names = [variable.name for variable in (*model.states, *model.inputs)]
    names += [f"der({state.name})" for state in model.states]
    if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
        raise UserError(f"--to fmu: two variables are named {twice[0]}; an FMU needs a name for each")
