"""Text files of an exported model: their templates, and numbers and texts as the languages write them."""

import keyword
import re
import sys
import textwrap
from collections.abc import Iterable
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from numpy.typing import ArrayLike, NDArray

from eigenode_cli.export.exported import ExportedModel, Perceptron

WIDTH = 120
"""Longest line of numbers."""
HEAD = 36
"""Room on it for what stands before an array that fits into one."""


def identifier(text: str) -> str:
    """Return a name of a model as an identifier of C and Python, whose file hides no module of Python's."""
    name = re.sub(r"[^A-Za-z0-9_]+", "_", text).strip("_").lower() or "model"
    if name[0].isdigit():
        name = f"model_{name}"
    taken = keyword.iskeyword(name) or name in sys.stdlib_module_names or name == "torch"
    return f"{name}_model" if taken else name


def render(template: str, model: ExportedModel, escape: bool = False, **content: Any) -> str:
    """Return a template of `templates/` filled with a model.

    Args:
        template: name of the file.
        model: stands there as `model`; `name` is its identifier, `kind` that of its network.
        escape: whether texts are escaped for XML.
        content: more of what the template uses, by name.
    """
    environment = Environment(
        loader=PackageLoader("eigenode_cli.export", "templates"),
        autoescape=escape,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "python": python_list,
        "python_text": repr,
        "c": c_list,
        "c_text": c_text,
        "c_texts": c_texts,
        "c_comment": c_comment,
        "plain": plain,
        "number": lambda value: repr(float(value)),
    }
    kind = "perceptron" if isinstance(model.network, Perceptron) else "monomials"
    return environment.get_template(template).render(model=model, name=identifier(model.name), kind=kind, **content)


def _nested(values: NDArray[Any], brackets: str, indent: int, head: int = HEAD) -> str:
    """Return an array of one or two dimensions with all digits of its numbers, so that they are read back exactly."""
    opening, closing = brackets
    space = " " * indent
    if values.ndim == 1:
        line = ", ".join(map(repr, values.tolist()))
        if len(line) + indent <= WIDTH - head:
            return f"{opening}{line}{closing}"
        inner = f"{space}    "
        wrapped = textwrap.fill(line, WIDTH - 1, initial_indent=inner, subsequent_indent=inner)
        return f"{opening}\n{wrapped},\n{space}{closing}"
    rows = "".join(f"{space}    {_nested(row, brackets, indent + 4, len('{},'))},\n" for row in values)
    return f"{opening}\n{rows}{space}{closing}"


def python_list(values: ArrayLike, indent: int = 0) -> str:
    """Return an array as a list of Python."""
    return _nested(np.asarray(values), "[]", indent)


def c_list(values: ArrayLike) -> str:
    """Return an array as an initialiser of C."""
    return _nested(np.asarray(values), "{}", 0)


def c_texts(texts: Iterable[str]) -> str:
    """Return texts as an initialiser of C."""
    return "{" + ", ".join(map(c_text, texts)) + "}"


def c_text(text: str) -> str:
    """Return a text as a string literal of C: ASCII, with every other byte as an octal escape."""
    known = {ord('"'): '\\"', ord("\\"): "\\\\", ord("\n"): "\\n", ord("?"): "\\?"}  # ?? may begin a trigraph
    return '"' + "".join(known.get(byte) or _c_byte(byte) for byte in text.encode()) + '"'


def _c_byte(byte: int) -> str:
    return chr(byte) if 32 <= byte < 127 else f"\\{byte:03o}"


def c_comment(text: str) -> str:
    """Return a text as it may stand within a comment of C."""
    return plain(text).replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?")


def plain(text: str) -> str:
    """Return a text in one line without control characters."""
    return re.sub(r"[\x00-\x1f\x7f]+", " ", text)
