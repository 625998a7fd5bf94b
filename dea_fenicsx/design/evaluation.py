"""Designs evaluated once, by all ranks together, and kept on disk."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from dea_fenicsx.design.evolution import Columns
from dea_fenicsx.design.front import Front
from dea_fenicsx.design.kept_designs import KeptDesigns, Key, Record
from dea_fenicsx.support.agreement import together
from dea_fenicsx.support.errors import InputError, Interrupted, MachineError


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
        self.seen: set[Key] = set()
        self.kept = KeptDesigns(out, names, facts, resume, comm)
        self.known = self.kept.known
        self.cached = len(self.known)

    def close(self) -> None:
        """Give the folder free for other searches."""
        self.kept.close()

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
        self.kept.append(record)
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
