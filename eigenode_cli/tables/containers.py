"""Tables in Parquet and MAT files."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from eigenode_cli.arrays import Floats
from eigenode_cli.errors import UserError, unknown
from eigenode_cli.tables.table import Format, Selection, Table, find_column, split_unit


def read_parquet(path: Path, selection: Selection) -> Table:
    """Read a Parquet file; see `tables.read_table`."""
    try:
        import pyarrow as pa  # noqa: PLC0415  # an extra
        import pyarrow.parquet as pq  # noqa: PLC0415
    except ImportError as error:
        raise UserError(f"{path.name}: Parquet needs pyarrow: pip install 'eigenode[parquet]'") from error
    try:
        names = pq.read_schema(path).names
        wanted = None if selection.columns is None else [_named(names, key, path) for key in selection.columns]
        if wanted is not None and selection.time is not None:
            wanted.append(_named(names, selection.time, path))
        frame = pq.read_table(path, columns=None if wanted is None else list(dict.fromkeys(wanted))).to_pandas()
    except (OSError, pa.ArrowException) as error:
        raise UserError(f"{path.name}: cannot be read as Parquet ({str(error).splitlines()[0]})") from error
    columns = {}
    for name in frame.columns:
        values = frame[name]
        if values.dtype.kind == "M":
            values = (values - values.iloc[0]).dt.total_seconds()
        if values.dtype.kind in "iufb":
            columns[str(name)] = values.to_numpy(dtype=np.float64, na_value=np.nan)
        elif wanted is not None:
            raise UserError(f"{path.name}, column {name}: holds {values.dtype}, not numbers")
    return _table(path, names, columns, selection, ("Parquet",))


def _named(names: list[str], key: str | int, path: Path) -> str:
    return names[find_column(names, key, "column", path.name)]


def read_mat(path: Path, form: Format, selection: Selection) -> Table:
    """Read a MAT file, flat or nested; see `tables.read_table`."""
    from scipy.io import loadmat  # noqa: PLC0415
    from scipy.io.matlab import MatReadError  # noqa: PLC0415

    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError as error:
        raise UserError(f"{path.name}: is a MAT file of version 7.3; save it with -v7") from error
    except (MatReadError, ValueError, OSError, TypeError) as error:
        raise UserError(f"{path.name}: cannot be read as a MAT file ({error})") from error
    arrays = dict(_arrays({name: value for name, value in content.items() if not name.startswith("__")}))
    if form.variable is not None:
        inside = {
            n.removeprefix(f"{form.variable}."): a for n, a in arrays.items() if n.startswith(f"{form.variable}.")
        }
        if form.variable in arrays:
            inside = {form.variable.rpartition(".")[2]: arrays[form.variable]}
        if not inside:
            known = dict.fromkeys([*arrays, *(name.rpartition(".")[0] for name in arrays if "." in name)])
            raise UserError(
                f"system.variable={form.variable}: {path.name}: {unknown('variable', form.variable, known)}"
            )
        arrays = inside
    columns = _columns(arrays)
    lengths = {name: len(values) for name, values in columns.items()}
    if not columns:
        raise UserError(f"{path.name}: holds no arrays of numbers")
    if selection.columns is not None:  # others may have another length
        keys = [*selection.columns, *([] if selection.time is None else [selection.time])]
        named = {list(columns)[find_column(list(columns), key, "column", path.name)] for key in keys}
        lengths = {name: length for name, length in lengths.items() if name in named}
    if len(set(lengths.values())) > 1:
        shown = ", ".join(f"{name} ({length})" for name, length in lengths.items())
        raise UserError(f"{path.name}: variables of different length: {shown}; name one with system.variable")
    length = next(iter(lengths.values()))
    kept = {name: values for name, values in columns.items() if len(values) == length}
    return _table(path, list(columns), kept, selection, ("MAT",))


def _arrays(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Yield the arrays of numbers by their paths."""
    for name, value in content.items():
        if hasattr(value, "_fieldnames"):
            yield from _arrays({key: getattr(value, key) for key in value._fieldnames}, f"{prefix}{name}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iufb" and 1 <= value.ndim <= 2 and value.size > 1:
            yield f"{prefix}{name}", value.astype(np.float64)


def _columns(arrays: Mapping[str, np.ndarray]) -> dict[str, Floats]:
    """Return columns by name: an array of two dimensions has one for each of its columns."""
    columns: dict[str, Floats] = {}
    for name, array in arrays.items():
        if array.ndim == 1:
            columns[name] = array
        else:
            columns |= {f"{name}_{k}": column for k, column in enumerate(array.T)}
    return columns


def _table(
    path: Path, names: list[str], columns: Mapping[str, Floats], selection: Selection, notes: tuple[str, ...]
) -> Table:
    """Return the table of columns, its rows counted from 1."""
    names = [str(name) for name in names]
    present = [name for name in names if name in columns]
    if not present:
        raise UserError(f"{path.name}: holds no columns of numbers")
    values = np.column_stack([columns[name] for name in present])
    rows = np.arange(1, len(values) + 1)
    infinite = np.argwhere(np.isinf(values))
    if infinite.size:
        raise UserError(f"{path.name}, row {rows[infinite[0][0]]}, column {present[infinite[0][1]]}: is infinite")
    if selection.window is not None and selection.time is not None:
        time = names[find_column(names, selection.time, "system.time", path.name)]
        inside = ~((columns[time] < selection.window[0]) | (columns[time] > selection.window[1]))
        values, rows = values[inside], rows[inside]
    values, rows = values[:: selection.stride], rows[:: selection.stride]
    parts = [split_unit(name) for name in names]
    numbers = tuple(names.index(name) for name in present)
    plain, units = tuple(name for name, _ in parts), tuple(unit for _, unit in parts)
    return Table(path, plain, units, numbers, values, rows, notes)
