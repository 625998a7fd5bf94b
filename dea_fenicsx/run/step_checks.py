"""Checks of every accepted state: of a ramp, of a trace, and of a resumed run.

All values are computed again from the state itself, so a wrong report of a solver is noticed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.probe import Probe
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.terms.viscous import SMALLEST_SHARE_OF_TIME
from dea_fenicsx.run.short_circuit import short_circuit
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.support.errors import SolverError

DETERMINANT_ROUNDING = 1e-12
"""Rounding error of det F - 1, whose terms are products of up to three stretches."""

RESIDUAL_SUM_MARGIN = 1.001
"""Largest residual, in units of Newton's tolerance: a sum in another order has rounding errors."""

VISCOUS_MARGIN = 10 * SMALLEST_SHARE_OF_TIME
"""Residual that an accepted viscous state may have on top of that.

Newton's method ends with the history of the step.  An accepted state has the viscous strains of its
own time, and no time passes in it.  Its branches then count as flowing for
`SMALLEST_SHARE_OF_TIME` of their relaxation times, which changes their stress by this share times
C, here up to 10.
"""


@dataclass(frozen=True)
class CheckedStep:
    """What was measured on an accepted state.

    Attributes
    ----------
    residual : largest scaled residual of a field
    probe : extremes over the quadrature points
    volume_error : largest relative change of volume of any incompressible cell
    """

    residual: float
    probe: Probe
    volume_error: float


def check_step(
    solver: NewtonSolver, step: int, measured: Mapping[str, float], held: float = 0.0
) -> CheckedStep:
    """Check the problem's present state.  Collective.

    Parameters
    ----------
    solver
        The solver with its problem.
    step
        Number of the step, for the message.
    measured
        Observables that must be finite, by name.
    held
        The residual of a state with guiding forces, which may be above the tolerance.

    Raises
    ------
    SolverError
        If the residual is above the tolerance, det F or a chain's margin is not positive, the
        volume is off by more than the residual's tolerance allows, electrodes of different
        potentials touch, or an observable is not finite.
    """
    problem = solver.problem
    residual = problem.residual()
    norm = solver.residual_of(residual, anew=True)
    probe = problem.probe()
    worst, bounded, bound = volume(problem, solver.options.tolerance * solver.references.volume)
    faults = []
    allowed = RESIDUAL_SUM_MARGIN * max(solver.options.tolerance, held)
    if problem.forms.memory:
        allowed += VISCOUS_MARGIN
    if not norm <= allowed:
        faults.append(f"its residual {norm:.3g} is above {solver.options.tolerance:g}")
    if not probe.min_J > 0:
        faults.append(f"det F falls to {probe.min_J:.3g}")
    elif not probe.min_margin > 0:
        faults.append("a chain is past its lock-up")
    elif not probe.admissible:
        faults.append("its wrinkles have no natural width, so that no relaxed energy exists")
    if not math.isfinite(probe.max_field):
        faults.append("the electric field is not finite")
    if not bounded <= bound:
        faults.append(f"its volume error {bounded:.3g} is above {bound:.3g}")
    faults += _open_gaps(problem)
    if (short := short_circuit(problem)) is not None:
        faults.append(short)
    faults += [f"{name} is {value}" for name, value in measured.items() if not np.isfinite(value)]
    if faults:
        raise SolverError(
            f"Step {step} is not accepted: {faults[0]}; all steps before it are kept."
        )
    solver.references.remember(residual)
    return CheckedStep(norm, probe, worst)


def _open_gaps(problem: Problem) -> list[str]:
    """The contacts whose gap is not closed to its tolerance, in words.  Collective."""
    found, length = [], problem.scales.length
    for contact in problem.forms.contacts:
        gap, allowed = contact.excess()
        if gap > 0:
            found.append(
                f"a pressed point of {contact.told.surface!r} is {gap * length:.3g} m away from "
                f"the surface of its obstacle, more than the tolerance of {allowed * length:.3g} m "
                "(the mesh is too coarse for this contact, or the tolerance too small)"
            )
    return found


def volume(problem: Problem, tolerance: float) -> tuple[float, float, float]:
    """Volume error of the worst incompressible cell; the error that is bounded; its bound.

    The p rows of the residual are r_i = int q_i (J - 1) dX, and an accepted state has |r| (2-norm)
    below `tolerance`, a volume.

    A discontinuous pressure has the constants in each cell: the sum of a cell's n rows is
    int (J - 1) dX over it, at most sqrt(n) |r|.  So each cell is bounded, by sqrt(n) |r| over its
    volume.  A continuous one holds the volume of neighbourhoods, not of cells; with all of the
    device incompressible its N rows add up to the change of the whole volume, at most sqrt(N) |r|.
    """
    errors = problem.forms.swelling()
    comm = problem.comm
    cells = problem.forms.incompressible_cells
    share = np.abs(errors[cells]) / problem.forms.cell_volumes[cells]
    worst = comm.allreduce(float(np.max(share, initial=0.0)), op=MPI.MAX)
    worst = worst if comm.allreduce(bool(np.isfinite(share).all()), op=MPI.LAND) else math.inf
    if problem.pressure_kind == "discontinuous":
        smallest = comm.allreduce(
            float(np.min(problem.forms.cell_volumes[cells], initial=np.inf)), op=MPI.MIN
        )
        rows = problem.pressure.space.dofmap.list.shape[1]
        return worst, worst, math.sqrt(rows) * tolerance / smallest + DETERMINANT_ROUNDING
    some_compressible = len(cells) < len(problem.forms.cell_volumes)
    if comm.allreduce(some_compressible, op=MPI.LOR):
        return worst, 0.0, math.inf
    total = abs(comm.allreduce(float(errors.sum()), op=MPI.SUM)) / problem.forms.volume
    bound = math.sqrt(problem.roles.count(Role.MULTIPLIER)) * tolerance / problem.forms.volume
    return worst, total, bound + DETERMINANT_ROUNDING
