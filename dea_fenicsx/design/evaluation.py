"""Designs evaluated once, by all ranks together, and kept on disk.

    search.json          what the search is about; a resumed one must be about the same
    designs.RANK.jsonl   a line for each design, written by the rank that evaluated it

Each file has one writer, and a line is one write: a killed search loses the designs under work.
"""

from __future__ import annotations

import json
import os
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.design.evolution import Columns
from dea_fenicsx.design.front import Front
from dea_fenicsx.support.agreement import together
from dea_fenicsx.support.errors import InputError, Interrupted, MachineError
from dea_fenicsx.support.file_lock import FolderLock
from dea_fenicsx.support.files import free_name, replace_file

Key = tuple[float, ...]
Record = dict[str, Any]


class Evaluator:
    """Designs to quantities; see `dea_fenicsx.design.optimise` for the parameters.

    Attributes
    ----------
    needed
        Quantities that the function must return.
    cached
        Designs found on disk.
    """

    def __init__(
        self,
        function: Callable[..., Mapping[str, float]],
        names: list[str],
        fixed: Mapping[str, float],
        out: str | os.PathLike | None,
        facts: Mapping[str, Any],
        resume: bool,
        failures: tuple[type[Exception], ...],
        comm: Any,
    ) -> None:
        self.function, self.names, self.fixed = function, names, dict(fixed)
        self.failures, self.comm = failures, comm
        self.needed: list[str] = []
        self.known: dict[Key, Record] = {}
        self.seen: set[Key] = set()
        self.folder = Path(out) if out is not None else None
        self._lock: FolderLock | None = None
        if self.folder:
            self._open(json.loads(json.dumps(facts)), resume)
        self.cached = len(self.known)

    def close(self) -> None:
        """Give the folder free for other searches."""
        if self._lock:
            self._lock.release()

    # ------------------------------------------------------------------ evaluation

    def __call__(self, X: np.ndarray) -> Columns:
        """All quantities of the designs in the rows of X, NaN where one failed.  Collective."""
        keys: list[Key] = [tuple(float(x) for x in row) for row in X]
        self.seen.update(keys)
        new = [key for key in dict.fromkeys(keys) if key not in self.known]
        share = new[self.comm.rank :: self.comm.size]
        mine = together(
            self.comm, lambda: [(key, self._evaluate(key)) for key in share], "A design"
        )
        for part in self.comm.allgather(mine):
            self.known.update(part)
        records = [self.known[key] for key in keys]
        good = [r["quantities"] for r in records if "quantities" in r]
        if not good:
            if all("failed" in self.known[key] for key in self.seen):
                raise InputError(
                    f"None of the {len(keys)} designs of the first generation could be evaluated; "
                    f"the first failed with: {records[0]['failed']}"
                )
            good = [next(r["quantities"] for r in self.known.values() if "quantities" in r)]
        self._check(good)
        return {
            name: np.array([r.get("quantities", {}).get(name, np.nan) for r in records])
            for name in good[0]
        }

    def _evaluate(self, key: Key) -> Record:
        design = dict(zip(self.names, key, strict=True)) | self.fixed
        started = time.perf_counter()
        record: Record = {"design": design}
        try:
            found = self.function(**design)
            record["quantities"] = {name: float(value) for name, value in found.items()}
        except (Interrupted, MachineError):
            raise  # no fault of the design
        except self.failures as error:
            record["failed"] = f"{type(error).__name__}: {error}"
        record["wall_s"] = round(time.perf_counter() - started, 3)
        self._append(record)
        return record

    def _check(self, good: list[Mapping[str, float]]) -> None:
        for name in self.needed:
            if not all(name in q for q in good):
                raise InputError(
                    f"The function returns no quantity {name!r}, which the search needs; it "
                    f"returns: {', '.join(good[0])}."
                )

    def explained(self, front: Front) -> Front:
        """The front with the reasons for which designs failed."""
        reasons = Counter(
            r["failed"].split(":")[0] for key in self.seen if "failed" in (r := self.known[key])
        )
        return replace(front, reasons=dict(reasons))

    # ------------------------------------------------------------------ disk

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

    def _append(self, record: Record) -> None:
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
