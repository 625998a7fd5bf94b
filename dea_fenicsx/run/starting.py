"""Where a path begins: in a state of another run, brought to equilibrium in this one's scene."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.state import Factors, State
from dea_fenicsx.results.columns import load_column
from dea_fenicsx.results.fields import FieldWriter
from dea_fenicsx.results.finished import Run
from dea_fenicsx.results.identity import mesh_facts, same_mesh
from dea_fenicsx.results.stored_state import StoredState, StoredStep, about, of_folder, of_run
from dea_fenicsx.scene.amounts import carried
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import Outcome, fault_of
from dea_fenicsx.support.errors import InputError, SolverError

Start = str | PathLike | StoredStep | Run | State
"""What `solve` takes as its start.

A run's folder, any step of it, a run in memory, or a state of this scene.
"""

AT_PLACE = 1e-9
"""How far a fixed value may be from that of its load and count as the same, dimensionless."""


@dataclass(frozen=True)
class Beginning:
    """The state in which a path begins, not yet in equilibrium.

    Attributes
    ----------
    state
        Values and load of the stored state, in the units of this scene.
    told
        What the summary says of it: ``folder``, ``step``, and the columns of the loads.
    place
        Where it is from, for a message.
    """

    state: State
    told: dict[str, Any]
    place: str


def beginning(problem: Problem, writer: FieldWriter, start: Start) -> Beginning:
    """The state of another run in the units of a problem.  Collective; nothing is written.

    Parameters
    ----------
    problem, writer
        The problem, and the writer of its fields.
    start
        Where the state is from.

    Raises
    ------
    InputError
        If there is no such state; if mesh or fields are others; if a ramp that the scene lacks is
        not at 0 there, or drives other quantities.
    """
    if isinstance(start, State):
        state, folder, step, place = _own(problem, start), None, None, "the given state"
    else:
        stored = _stored(problem, start)
        place = stored.place
        state = _converted(problem, writer, stored)
        folder, step = stored.folder, stored.step
    loads = {}
    for ramp in problem.scene.ramps:
        column, unit = load_column(problem.scene, ramp)
        loads[column] = state.factors[ramp] * unit
    return Beginning(state, {"folder": folder, "step": step, **loads}, place)


def _stored(problem: Problem, start: str | PathLike | StoredStep | Run) -> StoredState:
    if isinstance(start, StoredStep):
        return of_folder(start.folder, problem.comm, start.step)
    if not isinstance(start, Run):
        return of_folder(start, problem.comm)
    if not start.history:
        raise InputError("The run to start from has no accepted step.")
    alone = start.problem.comm.size == 1 or start.problem.comm.size == problem.comm.size
    if not problem.comm.allreduce(alone, op=MPI.LAND):
        raise InputError(
            f"The run to start from is on {start.problem.comm.size} ranks, but this one on "
            f"{problem.comm.size}; give its folder, start={str(start.out or 'out')!r}."
        )
    step = int(start.history[-1]["step"])
    return of_run(start.problem, str(start.out) if start.out else None, step)


def _own(problem: Problem, state: State) -> State:
    """A state of a problem of the same scene, on the same ranks.  Collective."""
    size = len(state.values) == problem.size and bool(np.isfinite(state.values).all())
    if not problem.comm.allreduce(size, op=MPI.LAND):
        raise InputError(
            "The state to start from is none of this scene on these ranks; give its run, or the "
            "folder of its run."
        )
    factors = {}
    for ramp, factor in state.factors.items():
        volts, unit = state.factors.volts(ramp), problem.scene.reference_voltage(ramp)
        factors[ramp] = volts / unit if volts is not None and unit else factor
    return State(state.values, _load(problem, factors), state.time, history=state.history)


def _load(problem: Problem, given: dict[str, float]) -> Factors:
    """The load of a start: ramps that are new begin at 0, one that is missing must be at 0."""
    ramps = problem.scene.ramps
    for name, factor in given.items():
        if name not in ramps and factor != 0:
            raise InputError(
                f"The ramp {name!r} is at factor {factor:.6g} in the state to start from, but the "
                "scene has no such ramp; add it to the scene, or start from a state in which it "
                "is at 0."
            )
    known = {name: factor for name, factor in given.items() if name in ramps}
    return problem.factors | dict.fromkeys(ramps, 0.0) | known


def _converted(problem: Problem, writer: FieldWriter, stored: StoredState) -> State:
    """A stored state in the units of a problem.  Collective."""
    mine = about(problem)
    _check_same(problem, writer, stored, mine)
    factors = {
        name: carried(name, factor, stored.about["amounts"][name], mine["amounts"][name])
        if name in mine["amounts"] else factor
        for name, factor in stored.factors.items()
    }  # fmt: skip
    raw = writer.scattered(stored.values, _load(problem, factors), stored.moment)
    values = raw.values.copy()
    for field in problem.space.fields:
        ratio = stored.about["units"][field.name] / mine["units"][field.name]
        if ratio != 1.0:
            for part in problem.space.parts[field.name].values():
                values[part.dofs] *= ratio
    return raw.with_values(values)


def _check_same(
    problem: Problem, writer: FieldWriter, stored: StoredState, mine: dict[str, Any]
) -> None:
    """Raise InputError unless a stored state has the mesh and the fields of a problem."""
    if not same_mesh(mesh_facts(problem, writer.grid), stored.mesh):
        raise InputError(
            f"{_begun(stored)} is on another mesh, or one with other names; start from a run on "
            "the same mesh."
        )
    there, here = stored.about["fields"], mine["fields"]
    if there != here:
        other = [name for name in {**here, **there} if here.get(name) != there.get(name)]
        raise InputError(
            f"{_begun(stored)} has the fields {_listed(there)}, but this scene has "
            f"{_listed(here)}, which differ in {_listed(other)}; start from a run with the same "
            "kinematics and elements, with electrodes if this scene has some."
        )
    if bool(stored.moment.times) != bool(problem.forms.memory):
        has, lacks = ("has", "has none") if stored.moment.times else ("has no", "has some")
        raise InputError(
            f"{_begun(stored)} {has} viscous branches, but this scene {lacks}; start from a run "
            "with the same number of branches."
        )
    if not writer.fits(stored.values, stored.moment):
        raise InputError(f"{_begun(stored)} holds no state of its own mesh; it is damaged.")


def _begun(stored: StoredState) -> str:
    return stored.place[0].upper() + stored.place[1:]


def _listed(names: Any) -> str:
    return ", ".join(str(name)[:40] for name in list(names)[:12])


def balanced(solver: NewtonSolver, begin: Beginning) -> State:
    """The equilibrium of a problem at the load of a beginning.  Collective.

    A stored state that is in equilibrium and has the fixed values of its load is taken as it is.
    Else Newton's method leads from it to equilibrium, with the fixed values reached in its first
    step.

    Raises
    ------
    SolverError
        If no equilibrium is found.
    """
    problem = solver.problem
    state = problem.anchored(begin.state)
    imposed = problem.imposed(state)
    moved = np.max(np.abs(imposed.values - state.values), initial=0.0)
    if problem.comm.allreduce(float(moved), op=MPI.MAX) <= AT_PLACE:
        with problem.at(imposed):
            rests = solver.residual_of(problem.residual()) <= solver.options.tolerance
            good = fault_of(problem.probe()) is Outcome.CONVERGED
        if rests and good:
            return imposed
    attempt = solver.solve(state, state.factors)
    if not attempt.converged:
        raise SolverError(
            f"No equilibrium of this scene was found from {begin.place} at its load "
            f"({attempt.outcome.value}, {attempt.iterations} Newton iterations); change constants, "
            "supports or loads by less at a time, or start from the undeformed state."
        )
    return problem.anchored(attempt.found)
