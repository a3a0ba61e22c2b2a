"""Odd and wrong text files: each is read rightly, and says how, or refused in one line that names the place."""

import gzip
import re
from pathlib import Path

import numpy as np
import pytest

from eigenode_cli.errors import UserError
from eigenode_cli.tables import Format, Selection, Table, read_table

NAN = float("nan")
ROWS = [[0.0, 1.5], [0.1, -2.0], [0.2, 3.25]]
"""What most files hold."""


def read(
    folder: Path, content: str | bytes, name: str = "x.csv", form: Format | None = None, **wanted: object
) -> Table:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return read_table(path, form, Selection(**wanted) if wanted else None)  # type: ignore[arg-type]


DATES = "t,x\n2024-01-31 10:00:00,1.5\n2024-01-31T10:00:00.1,-2\n2024-01-31 10:00:00.2Z,3.25\n"

RIGHT: dict[str, tuple[str | bytes, list[list[float]], tuple[str, ...], str]] = {
    "plain": ("t,x\n0,1.5\n0.1,-2\n0.2,3.25\n", ROWS, ("t", "x"), "delimiter ,, header in line 1"),
    "no header": ("0,1.5\n0.1,-2\n0.2,3.25\n", ROWS, ("", ""), "no header"),
    "no last newline": ("t,x\n0,1.5\n0.1,-2\n0.2,3.25", ROWS, ("t", "x"), ""),
    "semicolon": ("t;x\n0;1.5\n0.1;-2\n0.2;3.25\n", ROWS, ("t", "x"), "delimiter ;"),
    "decimal comma": ("t;x\n0;1,5\n0,1;-2\n0,2;3,25\n", ROWS, ("t", "x"), "decimal comma"),
    "decimal comma, tab": ("t\tx\n0\t1,5\n0,1\t-2\n0,2\t3,25\n", ROWS, ("t", "x"), "decimal comma"),
    "decimal comma, quoted": ('t,x\n"0,0","1,5"\n"0,1","-2,0"\n"0,2","3,25"\n', ROWS, ("t", "x"), "decimal comma"),
    "tab": ("t\tx\n0\t1.5\n0.1\t-2\n0.2\t3.25\n", ROWS, ("t", "x"), "delimiter tab"),
    "blanks": ("t x\n0    1.5\n0.1 -2\n0.2   3.25\n", ROWS, ("t", "x"), "delimiter blanks"),
    "leading blanks": ("  t x\n  0    1.5\n  0.1 -2\n  0.2   3.25  \n", ROWS, ("t", "x"), "delimiter blanks"),
    "bar": ("t|x\n0|1.5\n0.1|-2\n0.2|3.25\n", ROWS, ("t", "x"), "delimiter |"),
    "comma and blank": ("t, x\n0, 1.5\n0.1, -2\n0.2, 3.25\n", ROWS, ("t", "x"), "delimiter ,"),
    "trailing delimiter": ("t,x,\n0,1.5,\n0.1,-2,\n0.2,3.25,\n", ROWS, ("t", "x"), "trailing delimiter"),
    "trailing delimiter, not in the header": ("t;x\n0;1.5;\n0.1;-2;\n0.2;3.25;\n", ROWS, ("t", "x"), "trailing"),
    "BOM": (b"\xef\xbb\xbft,x\n0,1.5\n0.1,-2\n0.2,3.25\n", ROWS, ("t", "x"), ""),
    "UTF-16": ("t,x\n0,1.5\n0.1,-2\n0.2,3.25\n".encode("utf-16"), ROWS, ("t", "x"), "UTF-16"),
    "Latin-1": ("t,\xb0C\n0,1.5\n0.1,-2\n0.2,3.25\n".encode("latin-1"), ROWS, ("t", "\xb0C"), "Latin-1"),
    "CRLF": ("t,x\r\n0,1.5\r\n0.1,-2\r\n0.2,3.25\r\n", ROWS, ("t", "x"), ""),
    "CR CR LF": ("t,x\r\r\n0,1.5\r\r\n0.1,-2\r\r\n0.2,3.25\r\r\n", ROWS, ("t", "x"), ""),
    "CR": ("t,x\r0,1.5\r0.1,-2\r0.2,3.25\r", ROWS, ("t", "x"), ""),
    "blank lines": ("\nt,x\n\n0,1.5\n\n0.1,-2\n0.2,3.25\n\n\n", ROWS, ("t", "x"), ""),
    "NUL bytes": (b"t,x\n0,1.5\n0.1,-2\0\n0.2,3.25\n" + b"\0", ROWS, ("t", "x"), "NUL bytes left out"),
    "quoted names": ('"t","x"\n0,1.5\n0.1,-2\n0.2,3.25\n', ROWS, ("t", "x"), ""),
    "quoted numbers": ('t,x\n"0","1.5"\n"0.1","-2"\n"0.2","3.25"\n', ROWS, ("t", "x"), ""),
    "delimiter in quotes": ('t,"x, left"\n0,1.5\n0.1,-2\n0.2,3.25\n', ROWS, ("t", "x, left"), ""),
    "glued to a sign": ("%t x\n0 1.5\n0.1 -2\n0.2 3.25\n", ROWS, ("t", "x"), "header in line 1"),
    "behind a sign": ("# t,x\n0,1.5\n0.1,-2\n0.2,3.25\n", ROWS, ("t", "x"), "1 comment line"),
    "comments above": ("# one\n# two\nt,x\n0,1.5\n0.1,-2\n0.2,3.25\n", ROWS, ("t", "x"), "2 comment lines"),
    "22 comments": ("% c;\n" * 22 + "t,x\n0,1.5\n0.1,-2\n0.2,3.25\n", ROWS, ("t", "x"), "header in line 23"),
    "text above": ("Rig 7, second try\nby hand\nt,x\n0,1.5\n0.1,-2\n0.2,3.25\n", ROWS, ("t", "x"), "2 lines of text"),
    "slashes": ("// a file\nt,x\n0,1.5\n0.1,-2\n0.2,3.25\n", ROWS, ("t", "x"), "1 comment line"),
    "comments between": ("t,x\n0,1.5\n# stop\n0.1,-2\n0.2,3.25\n", ROWS, ("t", "x"), "1 comments between rows"),
    "unit row": ("t;x\ns;mm\n0;1.5\n0.1;-2\n0.2;3.25\n", ROWS, ("t", "x"), "unit row"),
    "unit row in brackets": ("t,x\n[s],[mm]\n0,1.5\n0.1,-2\n0.2,3.25\n", ROWS, ("t", "x"), "unit row"),
    "units in names": ("t [s],x (mm)\n0,1.5\n0.1,-2\n0.2,3.25\n", ROWS, ("t", "x"), ""),
    "blanks in names": ("t,bar velocity\n0,1.5\n0.1,-2\n0.2,3.25\n", ROWS, ("t", "bar velocity"), ""),
    "fewer names": ("% x v\n0 0 1\n0 1 2\n0 2 3\n", [[0, 0, 1], [0, 1, 2], [0, 2, 3]], ("", "", ""), "names 2 of 3"),
    "more names": ("a,b,c\n0,1.5\n0.1,-2\n0.2,3.25\n", ROWS, ("", ""), "names 3 of 2"),
    "names that are numbers": ("2019,2020\n0,1\n1,2\n", [[2019, 2020], [0, 1], [1, 2]], ("", ""), "no header"),
    "sep=": ("sep=;\nt;x\n0;1.5\n0.1;-2\n0.2;3.25\n", ROWS, ("t", "x"), "delimiter ;"),
    "empty cells": ("t,x\n0,1.5\n0.1,\n0.2,3.25\n", [[0, 1.5], [0.1, NAN], [0.2, 3.25]], ("t", "x"), ""),
    "words for holes": ("t,x\n0,NA\n1,nan\n2,-\n3,7\n", [[0, NAN], [1, NAN], [2, NAN], [3, 7]], ("t", "x"), ""),
    "exponents": ("t,x\n0,15E-1\n1e-1,-2\n0.2,3.25e+0\n", ROWS, ("t", "x"), ""),
    "exponents with D": ("t,x\n0,1.5d0\n0.1,-2D0\n0.2,3.25D+00\n", ROWS, ("t", "x"), "exponents with D"),
    "one column": ("x\n1.5\n-2\n3.25\n", [[1.5], [-2.0], [3.25]], ("x",), "one column"),
    "equal values": ("t,x\n0,1\n1,1\n2,1\n", [[0, 1], [1, 1], [2, 1]], ("t", "x"), ""),
    "whole numbers": ("t,x\n0,1\n1,2\n2,3\n", [[0, 1], [1, 2], [2, 3]], ("t", "x"), ""),
    "signs": ("t,x\n+0,+1.5\n.1,-2.\n0.2,3.25\n", ROWS, ("t", "x"), ""),
    "semicolons in comments": ("# a;b;c;d\nt,x\n0,1.5\n0.1,-2\n0.2,3.25\n", ROWS, ("t", "x"), "delimiter ,"),
    "dates": (DATES, ROWS, ("t", "x"), "time as date"),
    "time of day": ("t,x\n10:00:00,1.5\n10:00:00.1,-2\n10:00:00.2,3.25\n", ROWS, ("t", "x"), "time as time of day"),
}  # fmt: skip


@pytest.mark.parametrize("case", RIGHT, ids=str)
def test_a_file_is_read_and_says_how(case: str, tmp_path: Path) -> None:
    content, values, names, note = RIGHT[case]
    found = read(tmp_path, content, time=0) if case in ("dates", "time of day") else read(tmp_path, content)
    assert found.names == names
    assert np.allclose(found.values, values, rtol=0, atol=1e-9, equal_nan=True)
    assert note in found.summary
    assert found.summary.count("\n") == 0


WRONG: dict[str, tuple[str | bytes, str]] = {
    "empty": ("", "x.csv: is empty"),
    "blanks only": ("\n \n\n", "x.csv: is empty"),
    "header only": ("t,x\n", "no rows of numbers"),
    "comments only": ("# t\n# x\n", "no rows of numbers below its comments"),
    "words": ("one two\nthree four\n", "no rows of numbers"),
    "picture": (b"\x89PNG\r\n\x1a\n" + bytes(100), "is a picture, not a table; save the table as CSV"),
    "workbook": (b"PK\x03\x04" + bytes(100), "is a workbook or an archive"),
    "binary": (bytes(range(1, 9)) * 200, "is no text"),
    "text in a column": ("t,x\n0,1\n0.1,oops\n0.2,3\n", r"row 3, column 1 \(x\): 'oops' is not a number"),
    "infinite": ("t,x\n0,1\n0.1,inf\n0.2,3\n", r"row 3, column 1 \(x\).*infinite"),
    "hexadecimal": ("t,x\n0,1\n0.1,0x10\n0.2,3\n", r"row 3, column 1 \(x\): '0x10' is not a number"),
    "thousands": ('t,x\n0,1\n0.1,"1,234.5"\n0.2,3\n', r"row 3, column 1 \(x\): '1,234.5' is not a number"),
    "commas in doubt": ("t;x\n0;1,234\n1;5,678\n2;9,012\n", r"row 2: '1,234' may be 1234 or 1.234"),
    "comma as both": ("t,x\n0,0,1,5\n0,1,2,5\n0,2,3,5\n", "2 names and 4 cells; the comma may be"),
    "fewer cells": ("t,x\n0,1\n0.1\n0.2,3\n", "row 3: 1 cells where the others have 2: '0.1'"),
    "more cells": ("t,x\n0,1\n0.1,2,9\n0.2,3\n", "row 3: 3 cells where the others have 2"),
    "stray last row": ("t,x\n0,1\n0.1,2\n0.2,3\nEND\n", "row 5: 1 cells where the others have 2: 'END'"),
    "cut off": ("t,x\n0,1\n0.1,2\n0.2,3\n0.3", "row 5: 1 cells where the others have 2"),
    "second header": ("t,x\n0,1\n0.1,2\nt,x\n0,1\n0.1,2\n0.2,4\n", r"row 4, column 0 \(t\): 't' is not a number"),
    "two tables": ("t,x\n0,1\n0.1,2\n0.2,3\na,b,c\n1,2,3\n", "row 5: 3 cells where the others have 2"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG, ids=str)
def test_a_file_is_refused_in_one_line(case: str, tmp_path: Path) -> None:
    content, said = WRONG[case]
    with pytest.raises(UserError) as error:
        read(tmp_path, content)
    assert len(error.value.faults) == 1
    assert re.search(said, error.value.faults[0])
    assert "x.csv" in error.value.faults[0]


def test_dates_that_may_be_two_are_refused(tmp_path: Path) -> None:
    content = "t,x\n03/04/2024,1\n04/04/2024,2\n05/04/2024,3\n"
    with pytest.raises(UserError, match=r"row 2, column 0 \(t\): '03/04/2024' may be one of two dates"):
        read(tmp_path, content, columns=("t", "x"), time="t")


def test_what_is_not_asked_for_does_not_matter(tmp_path: Path) -> None:
    content = "t,note,x\n0,start,1.5\n0.1,,-2\n0.2,end of it,3.25\n"
    assert read(tmp_path, content).values.tolist() == ROWS
    assert read(tmp_path, content, columns=("x", 0)).values.tolist() == [row[::-1] for row in ROWS]
    with pytest.raises(UserError, match=r"row 2, column 1 \(note\): 'start' is not a number"):
        read(tmp_path, content, columns=("note",))


def test_a_format_settles_doubts(tmp_path: Path) -> None:
    doubtful = "t;x\n0;1,234\n1;5,678\n2;9,012\n"
    assert read(tmp_path, doubtful, form=Format(decimal=",")).values[0].tolist() == [0.0, 1.234]
    commas = "t,x\n0,0,1,5\n0,1,2,5\n0,2,3,5\n"
    assert read(tmp_path, commas, form=Format(delimiter=",")).values.shape == (3, 4)
    years = "2019,2020\n0,1.5\n0.1,-2\n0.2,3.25\n"
    found = read(tmp_path, years, form=Format(header="1"))
    assert found.names == ("2019", "2020")
    assert found.values.tolist() == ROWS
    assert read(tmp_path, "t,x\n0,1.5\n0.1,-2\n0.2,3.25\n", form=Format(header="none")).names == ("", "")
    with pytest.raises(UserError, match=r"system.header=9: x.csv has no header in this line"):
        read(tmp_path, "t,x\n0,1\n1,2\n", form=Format(header="9"))


def test_units_are_those_stated(tmp_path: Path) -> None:
    found = read(tmp_path, "t [ms],x (mm),Year\n0,1,2\n1,2,3\n2,3,4\n")
    assert found.units == ("ms", "mm", "")
    assert [found.unit_of_time(name) for name in ("t", "x", "Year")] == ["ms", None, "year"]
    below = read(tmp_path, "t;x\n\xb5s;mm\n0;1\n1;2\n2;3\n")
    assert below.unit_of_time("t") == "us"
    assert read(tmp_path, "time_ms,x\n0,1\n1,2\n").unit_of_time("time_ms") == "ms"
    assert read(tmp_path, "Zeit in s;x\n0;1\n1;2\n").unit_of_time("Zeit in s") == "s"
    assert read(tmp_path, "t,x\n0,1\n1,2\n").unit_of_time("t") is None


def test_a_column_is_found_or_the_nearest_named(tmp_path: Path) -> None:
    found = read(tmp_path, "time,angle,angle\n0,1,2\n1,2,3\n")
    assert found.column("time", "system.time") == 0
    assert found.column(2, "system.positions") == 2
    with pytest.raises(UserError, match=r"system.time=tme: x.csv: unknown column 'tme', did you mean time\?"):
        found.column("tme", "system.time")
    with pytest.raises(
        UserError, match=r"system.positions=angle: x.csv has this name in columns 1, 2; give the number"
    ):
        found.column("angle", "system.positions")
    with pytest.raises(UserError, match=r"system.positions=7: x.csv has the columns 0 to 2"):
        found.column(7, "system.positions")
    bare = read(tmp_path, "0,1\n1,2\n2,3\n")
    with pytest.raises(UserError, match=r"the columns of x.csv have no names; give a number from 0 to 1"):
        bare.column("t", "system.time")


def test_rows_keep_their_lines_through_window_and_stride(tmp_path: Path) -> None:
    content = "# a\nt,x\n" + "".join(f"{k},{k * k}\n" for k in range(20))
    found = read(tmp_path, content, time="t", window=(5.0, 14.0), stride=3)
    assert found.values[:, 0].tolist() == [5, 8, 11, 14]
    assert found.rows.tolist() == [8, 11, 14, 17]
    with pytest.raises(UserError, match=r"system.window=\[30,40\]: x.csv has no rows there"):
        read(tmp_path, content, time="t", window=(30.0, 40.0))


def test_compressed_files_are_read_and_damaged_ones_refused(tmp_path: Path) -> None:
    content = gzip.compress(b"t,x\n" + b"".join(b"%d,%d\n" % (k, k) for k in range(9000)))
    assert read(tmp_path, content, "x.csv.gz").values.shape == (9000, 2)
    with pytest.raises(UserError, match=r"x.csv.gz: the compressed file is damaged"):
        read(tmp_path, content[:-200], "x.csv.gz")


def test_folders_missing_and_locked_files_are_named(tmp_path: Path) -> None:
    (tmp_path / "shaker.csv").write_text("t,x\n0,1\n")
    with pytest.raises(UserError, match=r"shaker.cvs: no such file in .*, did you mean shaker.csv\?"):
        read_table(tmp_path / "shaker.cvs")
    with pytest.raises(UserError, match=r"is a folder; name a file, or a pattern"):
        read_table(tmp_path)


def test_many_blocks_are_one_table(tmp_path: Path) -> None:
    times = np.arange(120_000) * 1e-3
    content = "t,x\n" + "\n".join(f"{t!r},{float(np.sin(t))!r}" for t in times.tolist()) + "\n"
    found = read(tmp_path, content, stride=7)
    assert np.array_equal(found.values[:, 0], times[::7])
    assert np.array_equal(found.values[:, 1], np.sin(times[::7]))
    assert found.rows[-1] == 2 + 7 * (found.rows.size - 1)
    broken = content.replace("\n100.0,", "\n100.0;", 1)
    with pytest.raises(UserError, match="row 100002: 1 cells where the others have 2"):
        read(tmp_path, broken)
