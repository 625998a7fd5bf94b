"""Points of a study given out to groups of ranks, each to the group that is free first.

A group takes a point by making a file that no other has made, so that no rank has to wait for
requests of the others.  The files belong to one call of a study and are removed at its end.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

CLAIMS_PREFIX = "claims-"


class Claims:
    """The numbers 0 to count - 1, each given to one group.

    Parameters
    ----------
    folder
        A folder that all ranks see.
    count
        How many numbers there are.
    comm, group
        All ranks, and those of this rank's group.
    """

    def __init__(self, folder: Path, count: int, comm: Any, group: Any) -> None:
        self._count, self._comm, self._group = count, comm, group
        place = None
        if comm.rank == 0:
            for old in folder.glob(f"{CLAIMS_PREFIX}*"):  # a killed study has left them
                shutil.rmtree(old, ignore_errors=True)
            place = tempfile.mkdtemp(prefix=CLAIMS_PREFIX, dir=folder)
        self._place = Path(comm.bcast(place, root=0))

    def __iter__(self) -> Iterator[int]:
        """The numbers of this rank's group.  Collective over the group."""
        for number in range(self._count):
            mine = self._group.rank == 0 and self._take(number)
            if self._group.bcast(mine, root=0):
                yield number

    def _take(self, number: int) -> bool:
        try:
            os.close(os.open(self._place / str(number), os.O_CREAT | os.O_EXCL | os.O_WRONLY))
        except FileExistsError:
            return False
        return True

    def close(self) -> None:
        """Remove the files.  Collective over all ranks."""
        self._comm.Barrier()
        if self._comm.rank == 0:
            shutil.rmtree(self._place, ignore_errors=True)
