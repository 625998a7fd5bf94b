"""Designs that are kept on disk, so that a search that was killed goes on.

    search.json          what the search is about; a resumed one must be about the same
    designs.RANK.jsonl   a line for each design, written by the rank that evaluated it

Each file has one writer, and a line is one write: a killed search loses the designs under work.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dea_fenicsx.support.errors import InputError, MachineError
from dea_fenicsx.support.file_lock import FolderLock
from dea_fenicsx.support.files import free_name, replace_file

Key = tuple[float, ...]
Record = dict[str, Any]


class KeptDesigns:
    """The designs of a search that are known, and their folder.  Collective.

    Parameters
    ----------
    out
        The folder; None keeps them in memory only.
    names
        The variables, in the order of a design's key.
    facts
        What the search is about.
    resume
        Take what is there; else it moves to ``previous/``.
    comm
        The ranks of the search.

    Attributes
    ----------
    known
        What is known of each design, by its values in the order of the names.

    Raises
    ------
    InputError
        If the folder cannot be used, or holds another search.
    """

    def __init__(
        self,
        out: str | os.PathLike | None,
        names: list[str],
        facts: Mapping[str, Any],
        resume: bool,
        comm: Any,
    ) -> None:
        self.names, self.comm = names, comm
        self.known: dict[Key, Record] = {}
        self.folder = Path(out) if out is not None else None
        self._lock: FolderLock | None = None
        if self.folder:
            self._open(json.loads(json.dumps(facts)), resume)

    def close(self) -> None:
        """Give the folder free for other searches."""
        if self._lock:
            self._lock.release()

    def _open(self, facts: dict[str, Any], resume: bool) -> None:
        """Read what is there, or put it aside.  Rank 0 does it; errors are raised on all."""
        told: tuple[str, Any] = ("", None)
        if self.comm.rank == 0:
            try:
                told = "", self._prepare(facts, resume)
            except InputError as error:
                told = str(error), None
                self.close()
            except OSError as error:
                told = f"The folder {self.folder} cannot be used ({error.strerror}).", None
        problem, known = self.comm.bcast(told, root=0)
        if problem:
            raise InputError(problem)
        self.known = known

    def _prepare(self, facts: dict[str, Any], resume: bool) -> dict[Key, Record]:
        assert self.folder
        self.folder.mkdir(parents=True, exist_ok=True)
        self._lock = FolderLock(self.folder)
        self._lock.take()
        about = self.folder / "search.json"
        parts = sorted(self.folder.glob("designs.*.jsonl"))
        known: dict[Key, Record] = {}
        if resume and about.exists():
            earlier = json.loads(about.read_text("utf-8"))
            for name, value in facts.items():
                if earlier.get(name) != value:
                    raise InputError(
                        f"The search in {self.folder} cannot be resumed: its {name} are not these; "
                        "start anew without resume, or in another folder."
                    )
            for part in parts:
                for line in part.read_text("utf-8").splitlines():
                    try:
                        record = json.loads(line)
                        known[tuple(record["design"][n] for n in self.names)] = record
                    except (ValueError, KeyError):
                        continue  # cut short by a kill
            return known
        if parts or about.exists():
            old = free_name(self.folder / "previous")
            old.mkdir()
            for part in [*parts, about]:
                if part.exists():
                    os.replace(part, old / part.name)

        def write(target: Path) -> None:
            target.write_text(json.dumps(facts, indent=2) + "\n", "utf-8")

        replace_file(about, write)
        return known

    def append(self, record: Record) -> None:
        """Write a design to the file of this rank."""
        if not self.folder:
            return
        path = self.folder / f"designs.{self.comm.rank}.jsonl"
        line = json.dumps(record) + "\n"
        try:
            with path.open("ab+") as f:
                if f.tell():  # a line cut short by a kill must not swallow this one
                    f.seek(-1, os.SEEK_END)
                    line = line if f.read(1) == b"\n" else "\n" + line
                f.write(line.encode())
        except OSError as error:
            raise MachineError(
                f"{path} cannot be written any more ({error.strerror}); all designs before are "
                "kept there, and the search can be resumed from them."
            ) from error
