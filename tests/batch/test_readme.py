"""The README's sweep example, run as written."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import eigenode_cli
from tests.batch.helpers import rows

README = Path(eigenode_cli.__file__).parents[1] / "README.md"


@pytest.mark.slow
def test_the_example_as_written(tmp_path: Path) -> None:
    section = README.read_text().split("<!-- sweep -->")[1].split("<!-- /sweep -->")[0]
    lines = [line for block in re.findall(r"```bash\n(.*?)```", section, re.DOTALL) for line in block.splitlines()]
    assert lines[0].startswith("eigenode train -m ")
    (tmp_path / "eigenode").write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m eigenode_cli "$@"\n')
    (tmp_path / "eigenode").chmod(0o755)
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    for line in lines:  # by a shell, quotes and all
        done = subprocess.run(
            ["sh", "-c", line],
            cwd=tmp_path,
            env={**os.environ, "PATH": path},
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.returncode, done.stderr) == (0, ""), line
    (sweep,) = (tmp_path / "outputs").iterdir()
    summary = rows(sweep)
    assert len(summary) == 12
    assert {row["status"] for row in summary} == {"finished"}
