"""Tables of numbers from files: what is without doubt is recognised, a doubt is an error with its place."""

from pathlib import Path

from eigenode_cli.tables.table import UNITS_OF_TIME, Column, Format, Selection, Table, time_unit


def read_table(path: Path, form: Format | None = None, selection: Selection | None = None) -> Table:
    """Read a table: CSV and its like, blanks, Parquet, MAT, any of the first two compressed by gzip.

    Args:
        path: of the file.
        form: what settles a doubt about the format; by default it is recognised.
        selection: columns and rows that are wanted; by default every column with numbers, and every row.

    Raises:
        UserError: it cannot be read, or something is in doubt; the line names file, row, column and option.
    """
    from eigenode_cli.tables.containers import read_mat, read_parquet  # noqa: PLC0415  # SciPy and pandas
    from eigenode_cli.tables.text import read_text_table  # noqa: PLC0415  # pandas

    form, selection = form or Format(), selection or Selection()
    kind = path.suffix.lower()
    if kind == ".mat" and path.is_file():
        return read_mat(path, form, selection)
    if kind in (".parquet", ".pq") and path.is_file():
        return read_parquet(path, selection)
    return read_text_table(path, form, selection)


__all__ = ["UNITS_OF_TIME", "Column", "Format", "Selection", "Table", "read_table", "time_unit"]
