"""What a run says of its linear systems before its first step."""

from __future__ import annotations

from dea_fenicsx.solvers.multigrid import caution
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.outcome import Outcome

UNCOUNTED = (
    "Negative eigenvalues are not counted with multigrid, so nothing is told about stability."
)


def uncounted(solver: NewtonSolver, stability: str) -> str:
    """A sentence where a count is wanted that the solver cannot make, or nothing."""
    return UNCOUNTED if stability != "never" and solver.factor_kind == "multigrid" else ""


def advice(solver: NewtonSolver) -> str:
    """What to do where linear solves with multigrid, which the run has chosen, have failed."""
    chosen = solver.options.factor == "auto" and solver.factor_kind == "multigrid"
    if not chosen or solver.trouble is not Outcome.STAGNATION:
        return ""
    return (
        "Multigrid had been chosen for want of memory; where there is more, "
        'NewtonOptions(factor="whole") makes a factor.'
    )


def notes_on(solver: NewtonSolver, choice: str, stability: str) -> list[str]:
    """Sentences about the tangent and its preconditioner that a user should know.

    Parameters
    ----------
    solver
        The solver.
    choice
        Why its preconditioner was chosen, or nothing.
    stability
        When negative eigenvalues are to be counted, see `solve`.
    """
    found = []
    if names := solver.problem.forms.unsymmetric:
        found.append(
            f"The tangent of {', '.join(names)} is not symmetric, so that it is factorised as "
            "L U and its negative eigenvalues are not counted."
        )
    found.append(choice)
    if solver.factor_kind == "multigrid":
        found.append(caution(solver.problem))
    found.append(uncounted(solver, stability))
    return [told for told in found if told]
