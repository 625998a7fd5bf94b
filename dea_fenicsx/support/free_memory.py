"""Memory that is free, and memory that was freed, given back to the system."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

NO_LIMIT = 2.0**60
"""Bytes from which a limit of a control group stands for none."""

# of the two versions of control groups: limit, use, and the line that tells what files hold of it
_FILES_OF_GROUP = (
    ("memory.max", "memory.current", "inactive_file"),
    ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
)


def give_memory_back() -> None:
    """Ask the C library to return free memory to the system, where it can.

    MUMPS allocates the blocks of a compressed factor one by one.  The GNU library keeps such blocks
    when they are freed, and what is made next by another allocator cannot have them.
    """
    with suppress(AttributeError, OSError):  # no GNU library
        ctypes.CDLL(None).malloc_trim(0)


def free_bytes(root: Path = Path("/")) -> float | None:
    """Bytes that this process may still take: those of the machine, or of its control groups.

    Parameters
    ----------
    root
        Where the kernel shows its files.

    Returns
    -------
    float or None
        None where the kernel does not tell, as on other systems than Linux.
    """
    found = _entry(root / "proc" / "meminfo", "MemAvailable:")
    if found is None:
        return None
    return min([1024 * found, *_left_in_groups(root)])


def _left_in_groups(root: Path) -> Iterator[float]:
    """What the limits of the control groups leave; a group inside others has all their limits."""
    try:
        lines = (root / "proc/self/cgroup").read_text().splitlines()
    except OSError:
        return
    for line in lines:
        number, kinds, place = [*line.split(":", 2), "", ""][:3]
        if number != "0" and "memory" not in kinds.split(","):
            continue
        first = root / "sys/fs/cgroup" / ("" if number == "0" else "memory")
        names = _FILES_OF_GROUP[0 if number == "0" else 1]
        group = first / place.strip("/")
        for folder in (group, *group.parents):
            limit, used = (_entry(folder / name) for name in names[:2])
            if limit is not None and used is not None and limit < NO_LIMIT:
                # The kernel drops what it holds of files as soon as a process needs the room.
                cached = _entry(folder / "memory.stat", names[2]) or 0.0
                yield max(limit - used + cached, 0.0)
            if folder == first:
                break


def _entry(file: Path, name: str = "") -> float | None:
    """The number in a file of the kernel, in the line of this name; None if there is none."""
    try:
        rows = [line.split() for line in file.read_text().splitlines()]
        return next(float(row[1] if name else row[0]) for row in rows if not name or row[0] == name)
    except (OSError, ValueError, IndexError, StopIteration):
        return None
