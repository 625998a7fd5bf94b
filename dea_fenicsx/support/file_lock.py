"""One run at a time in a results folder: a lock that ends with the process that holds it."""

from __future__ import annotations

import errno
import fcntl
import os
from contextlib import suppress
from pathlib import Path

from dea_fenicsx.support.errors import InputError

NAME = ".lock"
"""The file that is locked where a file system cannot lock a folder."""

_TAKEN = (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES)
_held: set[int] = set()


class FolderLock:
    """The lock of a folder, taken by one process for one run.

    The kernel holds it (``flock``) and gives it up when the process ends, however it ends; so a run
    that was killed can be resumed at once.  The folder itself is locked: nothing is written, and
    the folder is the same by whatever path it is reached.  NFS locks no folders; there a file
    ``.lock`` in it is locked, which stays.  Reading needs no lock.

    Parameters
    ----------
    folder
        The folder, which must be there.

    Attributes
    ----------
    kept
        Whether the file system keeps locks at all; some network file systems do not.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.kept = False
        self._descriptor: int | None = None

    def take(self) -> None:
        """Take the lock.

        Raises
        ------
        InputError
            If another run has it, in this process or in another one.
        """
        for name, flags in (
            ("", os.O_RDONLY | os.O_DIRECTORY),
            (NAME, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW),
        ):
            if self._lock(self.folder / name, flags):
                self.kept = True
                return

    def _lock(self, path: Path, flags: int) -> bool:
        """Whether a folder or file could be locked; InputError if another run has locked it."""
        try:
            descriptor = os.open(path, flags | os.O_CLOEXEC, 0o666)
        except OSError:
            return False
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(descriptor)
            if error.errno in _TAKEN:
                raise InputError(
                    f"Another run is writing into the results folder {self.folder}; wait for its "
                    "end, or choose another folder with --out or out=."
                ) from error
            return False
        self._descriptor = descriptor
        _held.add(descriptor)
        return True

    def release(self) -> None:
        """Give the lock up, if it is held."""
        if self._descriptor is not None:
            _held.discard(self._descriptor)
            with suppress(OSError):
                os.close(self._descriptor)
            self._descriptor = None


def _forget() -> None:
    """A forked process shares its parent's locks, and must not keep them longer than the parent."""
    for descriptor in list(_held):
        with suppress(OSError):
            os.close(descriptor)
    _held.clear()


os.register_at_fork(after_in_child=_forget)
