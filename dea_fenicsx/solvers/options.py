"""Settings of the nonlinear solver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared, plain_numbers
from dea_fenicsx.support.validation import one_of, whole

Factorisation = Literal["auto", "whole", "single", "split", "precise", "multigrid"]
FACTORS: tuple[Factorisation, ...] = get_args(Factorisation)


@dataclass(frozen=True)
@plain_numbers
class NewtonOptions:
    """Settings of the nonlinear solver.

    Attributes
    ----------
    tolerance
        Each field's residual, relative to its own reference (see `References`).
    max_iterations
        Newton iterations before a step counts as failed.
    krylov_limit
        Krylov iterations in one linear solve after which the factor is renewed.
    keep_factor
        False factorises at every Newton iteration (plain Newton).
    factor
        The matrix that is factorised: ``"whole"`` for the whole tangent, ``"single"`` for the same
        in single precision, ``"split"`` for a factor of the displacement block and one of the
        potential block, with the pressure condensed.  ``"auto"`` chooses ``"split"`` for large
        problems in space if it is possible, and ``"single"`` for other large problems.  In a run
        it chooses ``"multigrid"`` instead where the factor is estimated to need more than 0.8 of
        the memory that is free, unless the run counts negative eigenvalues on its path or the
        scene does not suit multigrid.  The log says so.
        ``"precise"`` takes two or three Krylov iterations for any number of digits, as is best for
        very many solves at one state: ``"split"`` in double precision with a pressure that is
        nearly exact for large problems in space, or ``"whole"``.
        ``"multigrid"`` makes no factor: its memory grows in proportion to the unknowns, for very
        large problems in space in which nothing is tied.  It takes more Krylov iterations, and
        negative eigenvalues are not counted.  What is named here is always taken.
    """

    tolerance: float = 1e-10
    max_iterations: int = 15
    krylov_limit: int = 30
    keep_factor: bool = True
    factor: Factorisation = "auto"

    def check(self) -> None:
        """Raise InputError for settings with which no step could converge."""
        check_declared(self)
        if not 1e-14 <= self.tolerance <= 1e-3:
            raise InputError(
                f"Newton's tolerance is {self.tolerance!r}, but must lie between 1e-14, what "
                "rounding allows, and 1e-3."
            )
        one_of(self.factor, FACTORS, "Newton's factor")
        whole(self.max_iterations, "Newton's max_iterations", least=4)
        whole(self.krylov_limit, "Newton's krylov_limit", least=5)
