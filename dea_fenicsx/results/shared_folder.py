"""A folder that rank 0 handles, and whose faults are raised on all ranks."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

from dea_fenicsx.results import hdf5
from dea_fenicsx.results.spread import serving
from dea_fenicsx.support.errors import InputError, MachineError
from dea_fenicsx.support.file_lock import FolderLock


class SharedFolder:
    """A folder that can be written, and can be taken for one run at a time.  Collective.

    Parameters
    ----------
    path
        The folder; it is made if it is not there.
    comm
        Communicator of the run.

    Raises
    ------
    InputError
        If the folder cannot be made or written.
    """

    def __init__(self, path: str | os.PathLike, comm: MPI.Comm) -> None:
        self.path = Path(path)
        self.comm = comm
        self.together(self._check_writable)
        self.lock = FolderLock(self.path)

    def take(self) -> bool:
        """Take the folder for one run; False if its file system keeps no locks.  Collective.

        Raises
        ------
        InputError
            If another run is writing into it, or what a run writes into is a link.
        """

        def action() -> bool:
            self.lock.take()
            for name in ("parts", "modes"):
                if (self.path / name).is_symlink():
                    self.lock.release()
                    raise InputError(
                        f"{self.path / name} is a link, but a run writes into its own folder only; "
                        "remove it, or choose another folder with --out or out=."
                    )
            return self.lock.kept

        return bool(self.together(action))

    def release(self) -> None:
        """Give the folder free for other runs; reading and `Run.add` need no lock."""
        self.lock.release()

    def together(self, action: Callable[[], Any]) -> Any:
        """Run an action on rank 0 and let all ranks share its result or its error."""
        result, fault = None, ""
        if self.comm.rank == 0:
            try:
                result = action()
            except (OSError, InputError) as error:
                fault = str(error) or type(error).__name__
        result, fault = self.comm.bcast((result, fault), root=0)
        if fault:
            raise InputError(fault if fault.endswith(".") else f"{fault} ({self.path}).")
        return result

    def write(self, action: Callable[[], None], together: bool = True) -> None:
        """Write on rank 0, from tables that may be spread; a fault is `MachineError` on all ranks.

        Collective, unless `together` is False: then it is raised on rank 0 alone.
        """


        def attempt() -> str:
            try:
                action()
            except (OSError, RuntimeError, KeyError) as error:  # h5py raises any of them
                return hdf5.reason(error)
            return ""

        if together:
            fault = serving(self.comm, attempt)
        else:
            fault = attempt() if self.comm.rank == 0 else ""
        if together:
            fault = self.comm.bcast(fault, root=0)
        if fault:
            raise MachineError(
                f"The results folder {self.path} cannot be written any more ({fault}); all steps "
                "before are kept there, and the run can be resumed from them."
            )

    def _check_writable(self) -> None:
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self.path):
                pass
        except OSError as error:
            raise InputError(
                f"The results folder {self.path} cannot be written ({error.strerror}); choose "
                "another with --out or out=."
            ) from error
