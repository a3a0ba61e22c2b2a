"""HTML pages that need nothing else, neither files nor a network."""

from base64 import b64encode
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from eigenode_cli.console import minus, number
from eigenode_cli.runs.atomic import write_text


def write_html(path: Path, template: str, content: Mapping[str, Any]) -> Path:
    """Write a page from a template of `templates/` and what stands on it, by the names that it uses; returns the path.

    Raises:
        WriteError: it cannot be written.
    """
    environment = Environment(
        loader=PackageLoader("eigenode_cli.reporting", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    write_text(path, environment.get_template(template).render(content))
    return path


def image_source(svg: bytes) -> str:
    """Return an SVG as the source of an image on the page."""
    return "data:image/svg+xml;base64," + b64encode(svg).decode("ascii")


def page_number(value: float | None) -> str:
    """Return a number of a page: as in a table, with a true minus sign."""
    return minus(number(value))
