"""What a run says of its linear systems before its first step."""

from __future__ import annotations

from dea_fenicsx.solvers.multigrid import caution
from dea_fenicsx.solvers.newton import NewtonSolver


def notes_on(solver: NewtonSolver) -> list[str]:
    """Sentences about the tangent and its preconditioner that a user should know."""
    found = []
    if names := solver.problem.forms.unsymmetric:
        found.append(
            f"The tangent of {', '.join(names)} is not symmetric, so that it is factorised as "
            "L U and its negative eigenvalues are not counted."
        )
    if solver.factor_kind == "multigrid":
        found += [told for told in (caution(solver.problem),) if told]
    return found
