"""A disk that can be full: a small file system in memory where it may be mounted, else a limit on the size of files."""

import contextlib
import os
import resource
import subprocess
from collections.abc import Iterator
from pathlib import Path

SIZE = 4 << 20


class Disk:
    """A folder whose disk can be filled.

    Attributes:
        folder: on that disk.
        mounted: whether it is a file system of its own, which can be made read-only as well.
    """

    def __init__(self, folder: Path, mounted: bool) -> None:
        self.folder = folder
        self.mounted = mounted
        self._ballast = folder / "ballast"
        self._limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill(self, free: int = 0) -> None:
        """Leave so many bytes."""
        if not self.mounted:
            resource.setrlimit(resource.RLIMIT_FSIZE, (free, self._limits[1]))
            return
        state = os.statvfs(self.folder)
        with self._ballast.open("ab") as file, contextlib.suppress(OSError):
            file.write(bytes(max(0, state.f_bavail * state.f_bsize - free)))

    def clear(self) -> None:
        """Give all of it back."""
        if self.mounted:
            self._ballast.unlink(missing_ok=True)
        else:
            resource.setrlimit(resource.RLIMIT_FSIZE, self._limits)

    def mode(self, mode: str) -> None:
        """Let it be read-only (`ro`) or not (`rw`)."""
        if self.mounted:
            subprocess.run(["mount", "-o", f"remount,{mode}", self.folder], check=True)
        else:
            self.folder.chmod(0o555 if mode == "ro" else 0o755)


@contextlib.contextmanager
def small_disk(folder: Path) -> Iterator[Disk]:
    """A disk of four megabytes at `folder`."""
    folder.mkdir()
    options = ["-t", "tmpfs", "-o", f"size={SIZE}", "tmpfs", str(folder)]
    mounted = subprocess.run(["mount", *options], capture_output=True, check=False).returncode == 0
    disk = Disk(folder, mounted)
    try:
        yield disk
    finally:
        disk.clear()
        if mounted:
            subprocess.run(["umount", "-l", folder], check=True)
