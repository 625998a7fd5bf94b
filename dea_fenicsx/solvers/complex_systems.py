"""Linear systems with a complex matrix, for a PETSc of real numbers.

(R + i S) x = f is solved as the real system of twice the size

    | R  -S |  | Re x |     | Re f |
    | S   R |  | Im x |  =  | Im f |

by a factor L U of MUMPS and iterative refinement.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.solvers.unsymmetric import by_lu
from dea_fenicsx.support.compat import PETSc
from dea_fenicsx.support.errors import SolverError

COMPLEX_TOLERANCE = 1e-10
"""Largest residual of a solution, relative to the right-hand side."""

MOST_REFINEMENTS = 5
"""Largest number of steps of iterative refinement."""


class ComplexSystem:
    """A factorised system (R + i S) x = f.  Collective.

    Parameters
    ----------
    real, imaginary
        PETSc matrices R and S; S is None for 0.  They are used up.
    """

    def __init__(self, real: Any, imaginary: Any | None) -> None:
        self.comm: MPI.Comm = real.comm.tompi4py()
        self.size, self.is_complex = real.getLocalSize()[0], imaginary is not None
        self.matrix = real
        if imaginary is not None:
            minus = imaginary.copy()
            minus.scale(-1.0)
            nest = PETSc.Mat().createNest([[real, minus], [imaginary, real]], comm=self.comm)
            self.matrix = nest.convert("aij", PETSc.Mat())
            for thing in (nest, minus, imaginary, real):
                thing.destroy()
        self._ksp = by_lu(self.matrix)
        self._x, self._f = self.matrix.createVecs()

    def solve(self, force: np.ndarray) -> np.ndarray:
        """The solution for a complex right-hand side (owned).  Collective.

        Raises
        ------
        SolverError
            If the matrix is singular to working precision.
        """
        found = np.zeros(self.size, dtype=complex)
        rest, size = force, self._norm(force)
        if size == 0:
            return found
        for _ in range(1 + MOST_REFINEMENTS):
            found = found + self._apply(rest)
            rest = force - self._times(found)
            left = self._norm(rest)
            if left <= COMPLEX_TOLERANCE * size:
                return found
            if not np.isfinite(left):
                break
        raise SolverError(
            "The linear system of a frequency response cannot be solved to the tolerance, since it "
            "is nearly singular; choose a frequency that is no resonance of an undamped device."
        )

    def destroy(self) -> None:
        """Let the factor go.  Collective."""
        for thing in (self._ksp, self._x, self._f, self.matrix):
            thing.destroy()

    def _apply(self, force: np.ndarray) -> np.ndarray:
        self._f.array[:] = self._real(force)
        self._ksp.solve(self._f, self._x)
        return self._complex(self._x.array_r)

    def _times(self, x: np.ndarray) -> np.ndarray:
        self._x.array[:] = self._real(x)
        self.matrix.mult(self._x, self._f)
        return self._complex(self._f.array_r)

    def _real(self, values: np.ndarray) -> np.ndarray:
        if not self.is_complex:
            return values.real
        return np.concatenate([values.real, values.imag])

    def _complex(self, values: np.ndarray) -> np.ndarray:
        if not self.is_complex:
            return values.astype(complex)
        return values[: self.size] + 1j * values[self.size :]

    def _norm(self, values: np.ndarray) -> float:
        square = float(np.sum(np.abs(values) ** 2))
        return float(np.sqrt(self.comm.allreduce(square, op=MPI.SUM)))
