"""How many processor cores this process may use: one answer for every command, on every system."""

import os


def usable_cores() -> int:
    """Return number of cores that this process may use, at least 1.

    Python 3.13 tells it on every system. Before, only Linux tells which cores a process is bound to; elsewhere all of
    the machine count.
    """
    if hasattr(os, "process_cpu_count"):
        return os.process_cpu_count() or 1  # pyright: ignore[reportAttributeAccessIssue]  # not in Python 3.11
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
