"""docs/first-steps.ipynb runs from an empty folder, cell by cell, and shows what its text says."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

PAGE = Path(__file__).parents[1] / "docs" / "first-steps.ipynb"


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")  # of the Jupyter packages
def test_the_notebook_runs(tmp_path: Path) -> None:
    notebook = nbformat.read(PAGE, as_version=4)
    assert any(cell.get("outputs") for cell in notebook.cells)  # it can be read without being run
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert not [output for output in outputs if output.output_type in ("error", "stream")]
    images = [output for output in outputs if "image/png" in output.get("data", {})]
    assert len(images) == 5
    assert "'finished'" in outputs[0].data["text/plain"]
    assert len(list(tmp_path.glob("outputs/*/run.json"))) == 2
