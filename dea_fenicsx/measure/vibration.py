"""Small vibrations about an equilibrium: K v = omega^2 M v.

K is the tangent of the equilibrium at given voltages (or at given charge, where an electrode
floats), M the mass, which pressure and potential have none of.  So each v keeps the volume and the
electric equations, without inertia, and a negative omega^2 is a motion that grows.

A rigid motion that only `FreeBody` holds takes part without force.  With such motions R the body
moves by v - R (R.M R)^-1 R.M v, which has no momentum, and M is lessened by what R carries.  So
rigid motions, of frequency zero, never appear among the vibrations.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.measure.observables import Measurement
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.rigid_shapes import rigid_shapes
from dea_fenicsx.path.items import RESPONSES, Response
from dea_fenicsx.solvers.eigenpairs import Eigenpair, eigenpairs
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.options import NewtonOptions
from dea_fenicsx.support.errors import InputError, SolverError
from dea_fenicsx.support.validation import one_of, whole

SHIFT_SHARE = 1e-4
"""Shift below zero for a tangent that is singular, in units of mu/(rho L^2)."""


def vibration_solver(problem: Problem) -> NewtonSolver:
    """A solver for a search for vibrations, which solves very often and very precisely.

    It keeps a precise factor: each solve takes two or three iterations.  The cheaper factors of
    large problems take many more.
    """
    return NewtonSolver(problem, NewtonOptions(factor="precise"))


@dataclass(frozen=True)
class Vibration:
    """One vibration about an equilibrium.

    Attributes
    ----------
    square
        omega^2 in 1/s^2; negative where the motion grows.
    shape
        Local values of the mixed function, ghosts included; its kinetic energy is omega^2/2.
    residual
        Size of K v - omega^2 M v over that of M v in 1/s^2, an error of omega^2.
    """

    square: float
    shape: np.ndarray
    residual: float


def signed_hertz(square: float) -> float:
    """omega/(2 pi) in Hz; minus the growth rate over 2 pi where omega^2 is negative."""
    return math.copysign(math.sqrt(abs(square)) / (2 * math.pi), square)


def vibrations(
    solver: NewtonSolver, count: int, response: Response = "instantaneous"
) -> list[Vibration]:
    """The vibrations of lowest omega^2 about the present state, those that grow first.  Collective.

    Parameters
    ----------
    solver
        The solver, whose problem is in equilibrium.
    count
        How many are wanted.
    response
        How viscous branches take part: with ``"instantaneous"`` their viscous strains stay as they
        are, with ``"relaxed"`` they carry no stress, as in vibrations that are infinitely slow.
        Charges that depend on the past stay as they are.

    Raises
    ------
    InputError
        If `count` is more than there are, a region has no density, or the tangent is not symmetric.
    SolverError
        If the tangent cannot be solved with, or the state is no equilibrium.
    """
    problem = solver.problem
    whole(count, "The number of modes", 1)
    _check_response(problem, response)
    _check_number(problem, count)
    mass = problem.massive()
    with _responding(problem, response):
        check_rest(solver)
        rigid = rigid_shapes(problem)
        reduced = mass.reduced(problem.free, problem.expansion)
        try:
            pairs = _lowest(solver, count, reduced, carried_by_rigid(problem, rigid))
            found = [
                Vibration(p.value, _shape(problem, p.vector, rigid), p.residual) for p in pairs
            ]
        finally:
            reduced.destroy()
            mass.rest()
            solver.forget_factor()
    if len(found) < count:
        raise InputError(
            f"{count} modes are wanted, but the device has {len(found)} only, since the volume of "
            "its cells is kept; ask for fewer, or take a finer mesh."
        )
    return found


def _check_number(problem: Problem, count: int) -> None:
    """Raise InputError if a device has fewer modes than are wanted."""
    most = problem.roles.count(Role.MOTION) + problem.roles.count(Role.GLOBAL)
    # In cells of a rigid part the volume is kept anyway, so that we cannot count with it there.
    materials = problem.parameters.materials.values()
    if not problem.rigid and all(m.bulk_modulus is None for m in materials):
        most -= problem.roles.count(Role.MULTIPLIER)
    if count > most:
        raise InputError(
            f"{count} modes are wanted, but with the volume kept the displacement has "
            f"{max(most, 0)} free unknowns only; ask for fewer, or take a finer mesh."
        )


@contextmanager
def _responding(problem: Problem, response: Response) -> Iterator[None]:
    """The present state, in which viscous branches respond to a small change in some way."""
    state, viscous = problem.state, problem.forms.memory.NAME
    kept = dict(state.history)
    for memory in problem.memories:
        history = problem.histories[memory.NAME]
        if response == "relaxed" and viscous == memory.NAME:
            kept[memory.NAME] = history.ahead(math.inf)
        else:
            kept[memory.NAME] = memory.settled(history, state.time)
    with problem.at(replace(state, history=kept)):
        yield


def kept_charges(problem: Problem) -> str:
    """What must be known of vibrations where charge depends on the past, or an empty string."""
    kept = []
    if problem.forms.leaks:
        kept.append("charge that has leaked, and polarisation that is delayed,")
    if problem.circuits:
        kept.append("the charge behind a resistance or an open switch")
    if not kept:
        return ""
    words = " and ".join(kept)
    return (
        f"{words[0].upper()}{words[1:]} stays as it is in these vibrations, which is right where "
        "they are much faster than it changes."
    )


def _check_response(problem: Problem, response: Response) -> None:
    """Raise InputError if charges would have to relax."""
    one_of(response, RESPONSES, "The response of viscous branches in modes")
    if response == "relaxed" and kept_charges(problem):
        raise InputError(
            'Modes with response="relaxed" are not available where charge leaks, is delayed or '
            'passes a resistance; take response="instantaneous", in which it stays as it is.'
        )


def check_rest(solver: NewtonSolver) -> None:
    """Raise SolverError unless the present state is an equilibrium.  Collective."""
    problem = solver.problem
    problem.massive().rest()
    residual = problem.residual()
    solver.references.remember(residual)
    size = solver.residual_of(residual, anew=True)
    if not size <= 100 * solver.options.tolerance:
        raise SolverError(
            f"Small vibrations are about an equilibrium, but the present state has a residual of "
            f"{size:.2g}; let the path end in equilibrium, or name the response in which the "
            "viscous branches are."
        )


def _lowest(
    solver: NewtonSolver, count: int, reduced: Any, carried: np.ndarray | None
) -> list[Eigenpair]:
    """The eigenpairs of lowest value.  Collective."""
    problem = solver.problem
    most = problem.roles.count(Role.MOTION)
    growing = 0
    if solver.counts_cheaply:
        solver.refresh_inertia()
        growing = max(solver.inertia.excess or 0, 0)
    wanted = min(count + growing, most)
    pairs: list[Eigenpair] = []
    with suppress(SolverError):
        pairs = eigenpairs(solver, wanted, reduced, carried)
        # A large device is counted by the factor that the search has made.  Motions that grow fast
        # are far from zero, so that a search for the nearest ones alone may not have met them.
        if solver.inertia.excess is None:  # this factor has not proved that there are none
            solver.refresh_inertia()
        counted = max(solver.inertia.excess or 0, 0)
        if counted > sum(pair.value < 0 for pair in pairs) and counted > growing:
            wanted = min(count + counted, most)
            pairs = eigenpairs(solver, wanted, reduced, carried)
    if len(pairs) < wanted:
        # A tangent that is nearly singular, as at a bifurcation, has an eigenvalue that is lost in
        # rounding; then the search is made about a shift below 0.
        mass = problem.massive()
        densities = [m.density for m in problem.parameters.materials.values()]
        unit = problem.scales.stress / problem.scales.length**2
        mass.stiffness = SHIFT_SHARE * unit / max(d for d in densities if d is not None)
        shifted = eigenpairs(solver, wanted, reduced, carried)
        if len(shifted) >= len(pairs):
            pairs = [replace(pair, value=pair.value - mass.stiffness) for pair in shifted]
    pairs.sort(key=lambda pair: pair.value)
    return pairs[:count]


def carried_by_rigid(problem: Problem, rigid: np.ndarray) -> np.ndarray | None:
    """Rows U in the free unknowns, with U U^T what rigid motions take of the mass.  Collective."""
    if not rigid.shape[1]:
        return None
    heavy, gram = _weighed(problem, rigid)
    rows = np.stack([problem.restrict(column) for column in heavy.T], axis=1)
    return np.asarray(np.linalg.solve(np.linalg.cholesky(gram), rows.T).T)


def _weighed(problem: Problem, rigid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """M R at the owned degrees of freedom, and R.M R.  Collective."""
    mine, mass = rigid[: problem.owned], problem.massive()
    heavy = np.stack([mass.times(column) for column in mine.T], axis=1)
    return heavy, np.asarray(problem.comm.allreduce(mine.T @ heavy, op=MPI.SUM))


def _shape(problem: Problem, vector: np.ndarray, rigid: np.ndarray) -> np.ndarray:
    """A vector in the free unknowns as values of the mixed function.  Collective."""
    shape = change_of_values(problem, vector)
    if rigid.shape[1]:
        heavy, gram = _weighed(problem, rigid)
        carried = problem.comm.allreduce(heavy.T @ shape[: problem.owned], op=MPI.SUM)
        shape = shape - rigid @ np.linalg.solve(gram, carried)
    return shape


def change_of_values(problem: Problem, vector: np.ndarray) -> np.ndarray:
    """A small change of the free unknowns (owned) as one of all local values.  Collective."""
    function = problem.w.copy()
    problem.spread(vector, function)
    return np.asarray(function.x.array.copy())


@dataclass(frozen=True)
class Frequency:
    """Frequency of a vibration about each equilibrium of a path, in Hz.

    A motion that grows, about an equilibrium that is not stable, has minus its growth rate over
    2 pi.  Viscous branches respond instantaneously.

    Parameters
    ----------
    number
        Which one, counted from 0, the lowest first.
    """

    number: int = 0
    unit = "Hz"

    def bind(self, problem: Problem) -> Measurement:
        whole(self.number, "The number of the mode", 0)
        problem.massive()
        solver = vibration_solver(problem)

        def value() -> float:
            return signed_hertz(vibrations(solver, self.number + 1)[self.number].square)

        return value
