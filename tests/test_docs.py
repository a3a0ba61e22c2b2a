"""The Python blocks of README and docs run as they stand, one behind the other on a page."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
BLOCKS = {
    f"{page.relative_to(ROOT)}:{number}": "\n".join(BLOCK.findall(page.read_text())[:number])
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
    for number in range(1, 1 + len(BLOCK.findall(page.read_text())))
}


def test_blocks_are_found():
    assert "docs/eigenvalue-sensitivities.md:1" in BLOCKS


@pytest.mark.parametrize("block", BLOCKS.values(), ids=BLOCKS)
def test_a_block_runs(block, tmp_path):
    run = subprocess.run([sys.executable, "-c", block], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
