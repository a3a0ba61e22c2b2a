"""The order of the packages, each of which imports from those above it alone, and the size of what is in them."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import eigenode_cli

ROOT = Path(eigenode_cli.__file__).parent
ORDER = (
    ("errors", "console", "arrays", "jit", "interruption", "cpus"),
    ("solve",),
    ("spectra",),
    ("systems",),
    ("tables",),
    ("data",),
    ("model",),
    ("terms",),
    ("engines",),
    ("training",),
    ("fitting",),
    ("runs",),
    ("reporting",),
    ("config",),
    ("batch",),
    ("export",),
    ("recorded",),
    ("basins",),
    ("bench",),
    ("reproduce",),
    ("commands",),
    ("cli", "__main__"),
)
"""In the order of the data flow; what stands in one line may import each other."""
LEVEL = {name: level for level, names in enumerate(ORDER) for name in names}
MODULES = sorted(ROOT.rglob("*.py"))
LINES, FUNCTION = 400, 60
"""Most lines of a file and of a function."""


def package(path: Path) -> str:
    return path.relative_to(ROOT).with_suffix("").parts[0]


def imports(tree: ast.AST) -> Iterator[str]:
    """The packages of ours that a module imports, wherever in it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("eigenode_cli."):
            yield (node.module or "").split(".")[1]
        elif isinstance(node, ast.ImportFrom) and node.module == "eigenode_cli":
            yield from (alias.name for alias in node.names if alias.name in LEVEL)


def test_every_package_has_its_place() -> None:
    names = {package(path) for path in MODULES} - {"__init__", "configs", "experiments"}
    assert names - set(LEVEL) == set()


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_module_imports_from_above_and_is_short(path: Path) -> None:
    text = path.read_text()
    tree = ast.parse(text)
    assert text.count("\n") <= LINES
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            assert (node.end_lineno or 0) - node.lineno < FUNCTION, node.name
    if package(path) in LEVEL:
        below = {name for name in imports(tree) if LEVEL[name] > LEVEL[package(path)]}
        assert below == set(), f"{package(path)} imports from {', '.join(sorted(below))}"
