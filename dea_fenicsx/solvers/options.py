"""Settings of the nonlinear solver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared, plain_numbers

FACTORS = ("auto", "whole", "single", "split")


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
        problems in space if it is possible, and ``"single"`` for other large problems.
    """

    tolerance: float = 1e-10
    max_iterations: int = 15
    krylov_limit: int = 30
    keep_factor: bool = True
    factor: str = "auto"

    def check(self) -> None:
        """Raise InputError for settings with which no step could converge."""
        check_declared(self)
        if not 1e-14 <= self.tolerance <= 1e-3:
            raise InputError(
                f"Newton's tolerance is {self.tolerance!r}, but must lie between 1e-14, what "
                "rounding allows, and 1e-3."
            )
        if self.factor not in FACTORS:
            raise InputError(
                f"Newton's factor is {self.factor!r}, but must be one of {', '.join(FACTORS)}."
            )
        for name, least in (("max_iterations", 4), ("krylov_limit", 5)):
            value = getattr(self, name)
            if not isinstance(value, int | np.integer) or value < least:
                raise InputError(
                    f"Newton's {name} is {value!r}, but must be a whole number of at least {least}."
                )
