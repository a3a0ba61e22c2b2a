"""`eigenode evaluate RUN --map FILE`: where trajectories go from a grid of initial states."""

from pathlib import Path
from typing import TYPE_CHECKING

from eigenode_cli.errors import UserError

if TYPE_CHECKING:
    from eigenode_cli.recorded import RecordedRun

PICTURES = (".png", ".pdf", ".svg")


def draw_map(run: "RecordedRun", name: str, count: int) -> None:
    """Write the picture and, beside it, the table; print how many trajectories end in which way.

    Raises:
        UserError: the name is not that of a picture, or there is nothing to map.
    """
    from eigenode_cli.basins import LEAVES, MOVES, RESTS, basins  # noqa: PLC0415  # torch, once it is needed
    from eigenode_cli.reporting.figures.basins import draw_basins  # noqa: PLC0415  # matplotlib
    from eigenode_cli.runs.atomic import write_text  # noqa: PLC0415

    path = Path(name)
    if path.suffix.lower() not in PICTURES:
        raise UserError(f"--map {name}: name a picture, {', '.join(PICTURES)}")
    try:
        found = basins(run, count)
    except ValueError as error:
        raise UserError(f"--map {name}: {error}") from error
    states = {state.name: state for state in run.described_states}
    write_text(path.with_suffix(".csv"), found.table.to_csv(index=False))
    draw_basins(found.table, found.trajectory, (states[found.axes[0]], states[found.axes[1]]), path)
    counts = found.counts
    print(
        f"{sum(counts.values())} initial states: {counts[RESTS]} come to rest, {counts[MOVES]} go on moving,"
        f" {counts[LEAVES]} leave\n{path}\n{path.with_suffix('.csv')}"
    )
