"""The end of a run: its summary, and the final form of its files."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from dea_fenicsx.measure.failures import pull_in
from dea_fenicsx.path.falling import MOTION_EVENT
from dea_fenicsx.results.finished import Run
from dea_fenicsx.results.summary import count_changes, settings, versions, work
from dea_fenicsx.run.journal import Journal
from dea_fenicsx.support.errors import EquilibriumLost, MachineError, PathError

NOT_IN_SUMMARY = frozenset({
    "step", "time", "ramp", "event", "newton_iterations", "krylov_iterations", "factorisations",
    "retries", "wall_s", "inertia_is_of_this_step",
})  # fmt: skip
"""Columns of a history whose last value belongs to one step and not to the whole run."""


@dataclass
class Closing:
    """Writes the summary of a run while it lasts and at its end.

    Attributes
    ----------
    journal
        The accepted steps.
    result
        What the user gets; its summary is filled here.
    settings
        The script's own settings.
    """

    journal: Journal
    result: Run
    settings: Mapping[str, Any]

    def summarise(self, status: str, message: str = "", lost: PathError | None = None) -> None:
        """Fill the run's summary and write it.  Collective."""
        journal, result = self.journal, self.result
        solver, history = journal.solver, journal.history
        last = history[-1] if history else {}
        stable: bool | None = None
        if last.get("inertia_is_of_this_step"):
            stable = last["inertia"] == 0
        summary: dict[str, Any] = {
            "status": status,
            "message": message,
            **{k: v for k, v in last.items() if k not in NOT_IN_SUMMARY},
            "stable": stable,
            "events": [
                {**journal.notes.get(str(row["step"]), {}), "event": row["event"],
                 "step": row["step"], **journal.loads(row)}
                for row in history if row["event"] not in ("", MOTION_EVENT)
            ],
            "failures": journal.found + self._lost_by_pull_in(lost),
            "count_changes": count_changes(history),
            "start": journal.start,
            "steps": len(history) - 1 if history else 0,
            **work(solver, history),
            "wall_s": journal.seconds,
            "discretisation_error": result.summary.get("discretisation_error", {}),
            "accuracy": result.summary.get("accuracy"),
            "settings": self._inputs | {"script": dict(self.settings)},
            "versions": versions(),
            "origin": journal.folder.origin if journal.folder else {},
            "command": " ".join(sys.argv),
        }  # fmt: skip
        result.summary.clear()
        result.summary.update(summary)
        if folder := journal.folder:
            folder.write(lambda: folder.write_summary(summary))

    @cached_property
    def _inputs(self) -> dict[str, Any]:
        """All inputs of the run, which stay the same."""
        return settings(self.journal.solver, self.journal.path, self.settings)

    def _lost_by_pull_in(self, lost: PathError | None) -> list[dict[str, Any]]:
        journal = self.journal
        known = any(entry["mode"] == "pull-in" for entry in journal.found)
        if known or not isinstance(lost, EquilibriumLost):
            return []
        return pull_in(journal.scene, lost, journal.history[-1])

    def finish(self, status: str, message: str = "", lost: PathError | None = None) -> None:
        """Bring the files into their final form, as far as the machine allows.  Collective."""
        journal = self.journal
        if folder := journal.folder:
            try:
                folder.write(lambda: folder.consolidate(journal.history))
            except MachineError:
                where = folder.path / "parts"
                journal.progress.say(
                    f"There is no room for one fields.h5: the steps stay in {where}."
                )
        try:
            self.summarise(status, message, lost)
        except MachineError as error:
            if lost is None:
                error.run = self.result
                raise
        steps = len(journal.history) - 1
        told = f"; {message}" if message and lost is None else ""
        wall_s = self.result.summary["wall_s"]
        journal.progress.end(f"{status}: {max(steps, 0)} steps, {wall_s:.1f} s{told}")

    def note_crash(self, error: BaseException) -> None:
        """Note in the summary that an error of the script has ended the run, on rank 0 alone.

        Nothing here is collective: this rank may be the only one that fails.
        """
        folder, result = self.journal.folder, self.result
        if folder is None or not result.summary:
            return
        told = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        result.summary |= {"status": "script failed", "message": told}
        with suppress(MachineError):
            folder.write(lambda: folder.write_summary(result.summary), together=False)
