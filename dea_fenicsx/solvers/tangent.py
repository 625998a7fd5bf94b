"""The tangent: the residual's derivative by the unknowns, as an action and as a matrix.

GMRES only needs products of the tangent with vectors.  Such a product takes as long as two
residuals, the matrix as long as a hundred.  So the matrix is assembled only for a factorisation.

Some modes of the pressure or the potential may be undetermined: a constant pressure in a block that
is held along every normal, the pressures of a cell whose faces are all clamped, or a constant
potential in a dielectric that no electrode touches.  Such a mode has the eigenvalue 0 instead of a
negative one, so the count of negative eigenvalues would be too small by one.  Therefore a matrix
that is to be factorised gets a tiny negative mass on p and phi, see `Tangent.matrix`.
"""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl

from dea_fenicsx.model.problem import Problem, assembled
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import PETSc, dolfinx

SCALAR_MASS = 1e-8
"""Mass on p and phi in a matrix that is factorised, as a dimensionless compressibility mu/kappa.

It must be small, because the count may be wrong if the lowest eigenvalue is smaller than the mass.
It must be large compared with the rounding errors of a factorisation, which are about 1e-13.  The
counts are the same with 1e-10.
"""

MOST_UNKNOWNS_KEPT = 60_000
"""Largest number of unknowns for which matrix and factor stay in memory (a few hundred MB)."""


@dataclass
class _Product:
    """The product with the operator, which PETSc calls.

    It only holds a weak reference to the tangent.  Python cannot free a cycle of references that
    goes through PETSc.
    """

    tangent: weakref.ref[Tangent]

    def mult(self, _: Any, x: Any, y: Any) -> None:
        tangent = self.tangent()
        assert tangent
        y.array[:] = tangent.times(x.array_r)


class Tangent:
    """The tangent of a problem at its present state.

    Parameters
    ----------
    problem
        The problem.

    Attributes
    ----------
    operator
        PETSc matrix in the free unknowns that has no entries, but multiplies vectors.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self._along = dolfinx.fem.Function(problem.W)
        residual, w = problem.forms.residual, problem.w
        self._matrix_form = compat.compile_form(
            ufl.derivative(residual, w, ufl.TrialFunction(problem.W))
        )
        self._action = compat.compile_form(ufl.derivative(residual, w, self._along))
        self._product = compat.create_vector(self._action)
        self._columns = PETSc.IS().createGeneral(
            problem.free + problem.space.rows.start, comm=problem.comm
        )
        n = (len(problem.free), None)
        self.operator = PETSc.Mat().createPython(
            (n, n), context=_Product(weakref.ref(self)), comm=problem.comm
        )
        self.operator.setUp()
        self._loads: dict[str, np.ndarray] = {}
        self._masses = scalar_masses(problem)
        self._kept: tuple[Any, Any] = None, None

    def times(self, direction: np.ndarray) -> np.ndarray:
        """Product with a vector of the free unknowns; both owned.  Collective."""
        self.problem.spread(direction, self._along)
        product = self.problem.restrict(self._along_times())
        springs = self.problem.springs
        stiffness = self.problem.turning.stiffness(springs, self.problem.factors)
        product[springs.rows] += stiffness * direction[springs.rows]
        return product

    def times_fixed(self, change: np.ndarray) -> np.ndarray:
        """Product with a change of the fixed values (owned), in the free rows.  Collective."""
        self._along.x.array[:] = 0.0
        self._along.x.array[self.problem.fixed] = change
        self._along.x.scatter_forward()
        return self.problem.restrict(self._along_times())

    def by_load(self, ramp: str) -> np.ndarray:
        """Derivative of the residual by a ramp's factor at fixed free unknowns (owned, free rows).

        The derivative is exact, because fixed values, loads and charges are linear in the factor.
        The fixed values enter the residual through the columns of the tangent.
        """
        problem = self.problem
        if ramp not in self._loads or ramp in problem.loads.changing:
            vector = np.zeros(len(problem.free))
            if ramp in problem.loads.unit_work:
                vector = problem.restrict(problem.forms.load_vector(ramp))
            problem.add_sources(vector, ramp, 1.0)
            self._loads[ramp] = vector
        return self._loads[ramp] + self.times_fixed(
            problem.conditions.fixed_values.base[ramp][problem.fixed]
        )

    def _along_times(self) -> np.ndarray:
        return assembled(self._product, self._action)

    def matrix(self, mass: float = 0.0, counting: bool = False) -> Any:
        """Assemble the block in the free unknowns.  Collective.

        For a preconditioner it includes springs on the orientation of a free body even while dead
        loads turn the body.  Without them it would be singular before the loads cause stresses.

        The caller destroys the matrix.  If the problem has at most `MOST_UNKNOWNS_KEPT` unknowns,
        the caller may also keep it.  Then the next call fills the same matrix with new values, and
        a factor need not analyse its pattern again.

        Parameters
        ----------
        mass
            This multiple of `scalar_masses` is taken from the diagonal of p and phi.  Then each p
            and each phi gives one negative eigenvalue, whether the tangent determines it or not.
            With 0 the matrix is the tangent itself.
        counting
            Whether the negative eigenvalues of an equilibrium are to be counted.  Then springs act
            on the orientation only where no dead load determines it.
        """
        problem, form = self.problem, self._matrix_form
        whole, free = self._kept
        if not free:  # there is none, or it was destroyed
            if whole:
                whole.destroy()
            whole, free = dolfinx.fem.petsc.create_matrix(form), None
        whole.zeroEntries()
        dolfinx.fem.petsc.assemble_matrix(whole, form)
        whole.assemble()
        if problem.expansion is not None:
            free = whole.ptap(problem.expansion, result=free)
        else:
            free = whole.createSubMatrix(self._columns, self._columns, submat=free)
        if mass:
            diagonal = free.createVecLeft()
            diagonal.array[:] = -mass * self._masses
            free.setDiagonal(diagonal, PETSc.InsertMode.ADD)
            diagonal.destroy()
        if problem.turning.ramps:
            first = free.getOwnershipRange()[0]
            springs = problem.springs
            stiffness = problem.turning.stiffness(springs, problem.factors)
            if not counting:
                stiffness = np.full(len(stiffness), problem.turning.STIFFNESS)
            for row, value in zip(springs.rows, stiffness, strict=True):
                free.setValue(first + row, first + row, value, addv=True)
            free.assemble()
        if problem.unknowns <= MOST_UNKNOWNS_KEPT:
            self._kept = whole, free
        else:
            whole.destroy()
        return free


def scalar_masses(problem: Problem) -> np.ndarray:
    """A positive mass of each free unknown (owned) of the fields that have one, else 0.

    Each cell distributes its volume, times the mass of the field in its material (see
    `Field.mass`), equally over its nodes.  The masses of tied unknowns are added.  All values are
    dimensionless.  Collective.
    """
    device = problem.scene.device
    lumped = dolfinx.fem.Function(problem.W)
    for field in problem.space.fields:
        for name, material in problem.parameters.materials.items():
            weight = field.mass(material, problem.scales) if field.mass else None
            if weight is None:
                continue
            cells = device.cells_of(name)
            cells = cells[cells < device.owned_cells()]
            for part in problem.space.parts[field.name].values():
                dofs = part.dofs[part.space.dofmap.list[cells]]
                share = weight * problem.forms.cell_volumes[cells] / dofs.shape[1]
                np.add.at(lumped.x.array, dofs, share[:, None])
    lumped.x.scatter_reverse(dolfinx.la.InsertMode.add)
    return problem.restrict(lumped.x.array[: problem.owned])
