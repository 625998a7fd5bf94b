"""A state of another run, from its folder or from memory, with all that tells whether it fits.

Values of unknowns are dimensionless, and a ramp's factor says nothing without what it drives.  So a
checkpoint keeps beside the state

    about    the fields with their elements, the SI unit of each field's values, and for each ramp
             the amounts that it drives at factor 1

and the mesh is known from the run's fingerprint.  All that is read from a file is data: it is
checked for its form before anything else uses it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.results import checkpoint
from dea_fenicsx.results.fields import FieldWriter
from dea_fenicsx.results.identity import mesh_facts
from dea_fenicsx.results.moment import NO_MOMENT, MomentInTime, moment_of, moment_told
from dea_fenicsx.results.spread import Table
from dea_fenicsx.results.untrusted import Foreign, inside
from dea_fenicsx.scene.amounts import amounts_of
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import clean, replace_file
from dea_fenicsx.support.type_checks import is_number, shown
from dea_fenicsx.support.validation import whole

MOST_NAMES = 10_000
"""Most fields, ramps or amounts that a checkpoint may speak of."""

LARGEST_STEP_NUMBER = 1_000_000_000
"""Largest number of a step."""


@dataclass(frozen=True)
class StoredStep:
    """Any step of a run that has kept its states, to start another run from.

    Parameters
    ----------
    folder
        Results folder of the run, which was solved with ``keep_states=True``, as the branches of a
        diagram are.
    step
        Number of the step, as in its history; events have states as well.
    """

    folder: str | PathLike
    step: int

    def __post_init__(self) -> None:
        if not isinstance(self.folder, str | PathLike):
            raise InputError(
                f"StoredStep is given the folder {shown(self.folder)}, but needs the results "
                "folder of a run, as a text or a path."
            )
        whole(self.step, "The step of StoredStep", 0)
        if self.step > LARGEST_STEP_NUMBER:
            raise InputError(
                f"The step of StoredStep is {shown(self.step)}, but a run has at most "
                f"{LARGEST_STEP_NUMBER}."
            )


@dataclass(frozen=True)
class StoredState:
    """A state of a run.

    Attributes
    ----------
    values
        What `FieldWriter.gather_state` gave, or an array on rank 0 alone: shape (cells, unknowns
        of a cell).
    factors
        Factor of each of the run's ramps.
    about
        Fields, units and amounts of the run, see `about`.
    mesh
        What `mesh_facts` says of its mesh.
    folder, step
        Its results folder, if it has one, and the number of the step.
    moment
        Its time, and the times of its viscous strains.
    """

    values: np.ndarray | None
    factors: Mapping[str, float]
    about: Mapping[str, Any]
    mesh: Mapping[str, Any]
    folder: str | None
    step: int
    moment: MomentInTime = NO_MOMENT

    @property
    def place(self) -> str:
        """Where the state is from, for a message."""
        return f"step {self.step} of {self.folder or 'a run without a folder'}"


def about(problem: Problem) -> dict[str, Any]:
    """What must be known of a problem beside the values of a state, as JSON can hold it."""
    units = {Role.MULTIPLIER: problem.scales.stress, Role.POTENTIAL: problem.scales.potential}
    return {
        "fields": {
            field.name: [
                str(field.element.family_name), int(field.element.degree),
                bool(field.element.discontinuous), list(field.parts),
            ]
            for field in problem.space.fields
        },
        "units": {f.name: float(units.get(f.role, f.unit)) for f in problem.space.fields},
        "amounts": amounts_of(problem.scene),
    }  # fmt: skip


def of_run(problem: Problem, folder: str | None, step: int) -> StoredState:
    """The present state of a problem.  Collective over the problem's ranks."""
    writer = FieldWriter(problem)
    return StoredState(
        writer.gather_state(), dict(problem.factors), about(problem),
        mesh_facts(problem, writer.grid), folder, step,
        moment_of(problem),
    )  # fmt: skip


def state_file(step: int) -> str:
    """Name of the file with the state of a step, in the folder ``states``."""
    return f"step_{step:05d}.npz"


def keep_state(folder: Path, values: Table, told: Mapping[str, Any]) -> None:
    """Write the state of a step beside those of other steps (rank 0).

    Parameters
    ----------
    folder
        The results folder.
    values, told
        The state in each cell, and what is told, as of `checkpoint.write`.
    """
    place = folder / "states"
    place.mkdir(exist_ok=True)
    name = state_file(int(told["cursor"]["step"]))
    replace_file(place / name, lambda target: checkpoint.write(target, [values], told))


def of_folder(
    folder: str | PathLike, comm: MPI.Comm, step: int | None = None
) -> StoredState:
    """The last accepted state of the run in a folder, which is left as it is, or that of a step.

    Collective.

    Raises
    ------
    InputError
        If there is none, or the checkpoint is damaged, made up, or of another version.
    """
    found, values, fault = None, None, ""
    if comm.rank == 0:
        try:
            found = _read(Path(folder), step)
            values = found.values
            found = replace(found, values=None)
        except InputError as error:
            fault = str(error)
    found, fault = comm.bcast((found, fault), root=0)
    if fault:
        raise InputError(fault)
    assert found is not None
    return replace(found, values=values)


def _read(folder: Path, step: int | None) -> StoredState:
    name = clean(folder, 200)
    try:
        if step is None:
            file = inside(folder, "checkpoint.npz")
        else:
            file = inside(folder / "states", state_file(step))
    except Foreign as error:
        if step is None:
            raise InputError(
                f"start={name} is no folder of a run that could be started from: its "
                f"checkpoint.npz is not usable ({error})."
            ) from error
        raise InputError(
            f"The run in {name} has no usable state of step {step} ({error}); a run with "
            "keep_states=True keeps the states of all steps."
        ) from error
    told, (values, *_) = checkpoint.read(file)
    why = _fault(told)
    if why:
        raise InputError(f"The run in {name} cannot be started from: its checkpoint {why}.")
    return StoredState(
        values, told["factors"], told["about"], told["fingerprint"]["mesh"], str(folder),
        int(told["cursor"]["step"]), moment_told(told.get("moment")) or NO_MOMENT,
    )  # fmt: skip


def _fault(told: Mapping[str, Any]) -> str | None:
    """What is wrong with what a checkpoint tells, as a clause, or None."""
    if not told["digest_agrees"]:
        return "is damaged, or was changed after it was written"
    if "about" not in told:
        return "is of an earlier version, which kept no units of its fields; run it again"
    described, cursor, fingerprint = (told.get(k) for k in ("about", "cursor", "fingerprint"))
    if not _is_named(told.get("factors"), _is_finite):
        return "holds load factors that are no finite numbers"
    if not isinstance(described, dict) or set(described) != {"fields", "units", "amounts"}:
        return "does not say what its fields are"
    good = (
        _is_named(described["fields"], lambda v: isinstance(v, list))
        and _is_named(described["units"], lambda v: _is_finite(v) and v > 0)
        and set(described["units"]) == set(described["fields"])
        and _is_named(described["amounts"], lambda v: _is_named(v, _is_numbers))
        and set(described["amounts"]) == set(told["factors"])
    )
    if not good:
        return "does not hold together in what it says of its fields and ramps"
    if moment_told(told.get("moment")) is None:
        return "does not say at which time its state is"
    step = cursor.get("step") if isinstance(cursor, dict) else None
    if not isinstance(step, int) or isinstance(step, bool) or step < 0:
        return "does not say which step it is of"
    if not isinstance(fingerprint, dict) or not isinstance(fingerprint.get("mesh"), dict):
        return "does not say which mesh it is of"
    return None


def _is_named(value: Any, good: Any) -> bool:
    """Whether a value is a dictionary by names, of which each entry is good."""
    return (
        isinstance(value, dict)
        and len(value) <= MOST_NAMES
        and all(isinstance(k, str) and good(v) for k, v in value.items())
    )


def _is_finite(value: Any) -> bool:
    return is_number(value) and math.isfinite(value)


def _is_numbers(value: Any) -> bool:
    return isinstance(value, list) and 0 < len(value) <= MOST_NAMES and all(map(_is_finite, value))
