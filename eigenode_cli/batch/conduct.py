"""A sweep from beginning to end: what is finished is skipped, the rest run, all of it summarised, whatever failed."""

import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

from eigenode_cli.batch.plan import Sweep, check_folder, write_plan
from eigenode_cli.batch.progress import watched
from eigenode_cli.batch.state import State, forget_failure, read_state
from eigenode_cli.batch.summary import failure_lines, group, read_rows, show_groups, write_summary
from eigenode_cli.config.sweep import Job
from eigenode_cli.console import counted
from eigenode_cli.training.ending import ENDED, FAILED, FINAL, FINISHED, INTERRUPTED, UNSUCCESSFUL

EXIT_INTERRUPTED = 130
Start = Callable[[Sequence[Job]], None]
"""Runs the jobs it is given and returns when all have ended."""


def conduct(sweep: Sweep, start: Start) -> int:
    """Bring a sweep to its end; returns the exit status (0 done, 1 a run failed, 130 interrupted).

    Args:
        sweep: the checked sweep.
        start: runs what is left of it.

    Raises:
        UserError: its folder holds something else, or the launcher refuses its settings.
    """
    check_folder(sweep)
    write_plan(sweep)
    states = {job: read_state(sweep.place(job)) for job in sweep.jobs}
    pending = [job for job in sweep.jobs if states[job].status not in FINAL]
    _announce(sweep, states)
    for job in pending:
        if states[job].status == FAILED:
            forget_failure(sweep.place(job))
    broken: Exception | None = None
    interrupted = False
    try:
        if pending:
            with watched(sweep):
                start(pending)
    except KeyboardInterrupt:
        interrupted = True
    except (RuntimeError, OSError) as error:  # the launcher itself: a worker that was killed, a full disk
        broken = error
    return _finish(sweep, interrupted, broken)


def _announce(sweep: Sweep, states: Mapping[Job, State]) -> None:
    count = Counter(state.status for state in states.values())
    parts = [counted(len(sweep.jobs), "run")]
    parts += [f"{count[status]} {status} already, skipped" for status in FINAL if count[status]]
    if count[INTERRUPTED]:
        parts.append(f"{count[INTERRUPTED]} resumed")
    print(f"sweep  {', '.join(parts)}\nfolder {sweep.folder}", flush=True)


def _finish(sweep: Sweep, interrupted: bool, broken: Exception | None) -> int:
    """Write the summary and say what happened; returns the exit status."""
    from eigenode_cli.batch.figure import draw_summary  # noqa: PLC0415  # matplotlib, once the runs have ended

    rows = read_rows(sweep)
    groups = group(rows)
    paths = [write_summary(sweep.folder, rows)]
    if any(row.state.status == FINISHED for row in rows):
        paths += draw_summary(sweep.folder, groups)
        show_groups(groups)
    for path in paths:
        print(path)
    for line in failure_lines(rows):
        print(line, file=sys.stderr)
    left = sum(row.state.status not in ENDED for row in rows)
    if broken is not None:
        print(f"eigenode: the launcher failed: {type(broken).__name__}: {broken}", file=sys.stderr)
    if left:
        print(f"{left} of {len(rows)} runs are left; go on with: eigenode resume {sweep.folder}", file=sys.stderr)
    if interrupted:
        return EXIT_INTERRUPTED
    return 1 if broken is not None or left or any(row.state.status in UNSUCCESSFUL for row in rows) else 0
