"""Memory that was freed, given back to the system."""

from __future__ import annotations

import ctypes
from contextlib import suppress


def give_memory_back() -> None:
    """Ask the C library to return free memory to the system, where it can.

    MUMPS allocates the blocks of a compressed factor one by one.  The GNU library keeps such blocks
    when they are freed, and what is made next by another allocator cannot have them.
    """
    with suppress(AttributeError, OSError):  # no GNU library
        ctypes.CDLL(None).malloc_trim(0)
