"""MAT and Parquet files, and the memory that a large file takes."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from eigenode_cli.errors import UserError
from eigenode_cli.tables import Format, Selection, read_table

TIMES = np.linspace(0.0, 1.0, 11)


def test_flat_variables_of_a_mat_file_are_columns(tmp_path: Path) -> None:
    savemat(tmp_path / "x.mat", {"t": TIMES, "x": TIMES**2, "name": "rig"})
    found = read_table(tmp_path / "x.mat")
    assert found.names == ("t", "x")
    assert np.array_equal(found.values, np.column_stack([TIMES, TIMES**2]))


def test_nested_variables_are_named_by_their_paths(tmp_path: Path) -> None:
    savemat(tmp_path / "x.mat", {"run": {"data": {"t": TIMES, "x": TIMES**2}, "other": np.arange(3.0)}})
    found = read_table(tmp_path / "x.mat", Format(variable="run.data"))
    assert found.names == ("t", "x")
    whole = read_table(tmp_path / "x.mat", None, Selection(columns=("run.data.t", "run.data.x")))
    assert whole.column("run.data.x", "system.positions") == whole.numbers.index(whole.names.index("run.data.x"))
    with pytest.raises(
        UserError, match=r"variables of different length: .*run.other \(3\); name one with system.variable"
    ):
        read_table(tmp_path / "x.mat")
    with pytest.raises(UserError, match=r"system.variable=run.dat: x.mat: unknown variable 'run.dat', did you mean"):
        read_table(tmp_path / "x.mat", Format(variable="run.dat"))


def test_a_matrix_has_a_column_for_each_of_its_own(tmp_path: Path) -> None:
    savemat(tmp_path / "x.mat", {"data": np.column_stack([TIMES, TIMES**2])})
    assert read_table(tmp_path / "x.mat", Format(variable="data")).names == ("data_0", "data_1")


def test_what_is_no_mat_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.mat").write_bytes(b"MATLAB 7.3 MAT-file" + bytes(105) + b"\x00\x02IM" + bytes(500))
    with pytest.raises(UserError, match=r"x.mat: .*(save it with -v7|cannot be read)"):
        read_table(tmp_path / "x.mat")
    (tmp_path / "y.mat").write_text("t,x\n0,1\n")
    with pytest.raises(UserError, match=r"y.mat: cannot be read as a MAT file"):
        read_table(tmp_path / "y.mat")


def test_parquet_is_read_by_columns_with_dates_as_seconds(tmp_path: Path) -> None:
    frame = pd.DataFrame({"when": pd.to_datetime("2024-01-31") + pd.to_timedelta(TIMES, unit="s"), "x [mm]": TIMES**2})
    frame["note"] = "text"
    frame.to_parquet(tmp_path / "x.parquet")
    found = read_table(tmp_path / "x.parquet")
    assert found.names == ("when", "x", "note")
    assert found.units[1] == "mm"
    assert np.allclose(found.values, np.column_stack([TIMES, TIMES**2]), atol=1e-9)
    with pytest.raises(UserError, match=r"x.parquet, column note: holds .*, not numbers"):
        read_table(tmp_path / "x.parquet", None, Selection(columns=("note",)))
    (tmp_path / "y.parquet").write_text("no")
    with pytest.raises(UserError, match=r"y.parquet: cannot be read as Parquet"):
        read_table(tmp_path / "y.parquet")


MEASURE = """
import resource, sys
from pathlib import Path
import pandas
from eigenode_cli.tables import Selection, read_table
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
found = read_table(Path(sys.argv[1]), None, Selection(stride=1000))
print(len(found.rows), (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
"""


def test_a_large_file_takes_the_memory_of_what_is_kept(tmp_path: Path) -> None:
    """100 MB here; a file of 1 GB takes the same, since blocks of lines are read one after another."""
    rows = 2_000_000
    block = "".join(f"{k:09d}.5,{k % 977}.25,1e-3,-{k % 31}.125,{k % 7}.0625,12345.678\n" for k in range(rows // 20))
    with (tmp_path / "x.csv").open("w") as file:
        file.write("t,a,b,c,d,e\n")
        for _ in range(20):
            file.write(block)
    assert (tmp_path / "x.csv").stat().st_size > 80e6
    told = subprocess.run(
        [sys.executable, "-c", MEASURE, str(tmp_path / "x.csv")], capture_output=True, text=True, check=True
    ).stdout.split()
    assert int(told[0]) == rows // 1000
    assert float(told[1]) < 150.0
