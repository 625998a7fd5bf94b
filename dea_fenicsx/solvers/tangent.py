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

from dea_fenicsx.model.forms import assembled
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import PETSc, dolfinx
from dea_fenicsx.support.petsc_objects import PetscObjects

SCALAR_MASS = 1e-8
"""Mass on p and phi in a matrix that is factorised, as a dimensionless compressibility mu/kappa.

The displacement of a membrane has such a mass, too, which is a stiffness.

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
        product = tangent.times(x.array_r)
        y.array[:] = product if tangent.weights is None else tangent.weights * product

    def multTranspose(self, _: Any, x: Any, y: Any) -> None:
        tangent = self.tangent()
        assert tangent
        assert tangent.weights is None
        y.array[:] = tangent.times_transposed(x.array_r)


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
    weights
        What the rows of the operator are multiplied by (owned, free rows), or None.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self._along = dolfinx.fem.Function(problem.W)
        self.weights: np.ndarray | None = None
        self._petsc = PetscObjects(problem.comm)
        forms = problem.forms
        self._matrix_form = forms.compiled_tangent()
        self._action = forms.compiled_tangent(self._along)
        self._product = self._petsc.keep("product", compat.create_vector(self._action))
        self._columns = self._petsc.keep("columns", PETSc.IS().createGeneral(
            problem.free + problem.space.rows.start, comm=problem.comm
        ))  # fmt: skip
        n = (len(problem.free), None)
        self.operator = self._petsc.keep("operator", PETSc.Mat().createPython(
            (n, n), context=_Product(weakref.ref(self)), comm=problem.comm
        ))  # fmt: skip
        self.operator.setUp()
        self._transposed: tuple[Any, Any] | None = None
        self._loads: dict[str, np.ndarray] = {}
        self._masses = scalar_masses(problem)
        self._kept: tuple[Any, Any] = None, None
        self._turned: tuple[int, np.ndarray | None] = -1, None

    def renew(self) -> None:
        """Take other constants of the problem.  Collective."""
        self.weights = None
        self._masses = scalar_masses(self.problem)
        self._loads = {}

    def times(self, direction: np.ndarray) -> np.ndarray:
        """Product with a vector of the free unknowns; both owned.  Collective."""
        self.problem.spread(self._unheld(direction), self._along)
        return self._with_springs(self._along_times(), direction)

    def _unheld(self, direction: np.ndarray) -> np.ndarray:
        """A direction without its part in potentials that ideal sources give."""
        if not self.problem.circuits:
            return direction
        held = self.problem.circuits.given_rows()
        direction = direction.copy()
        direction[held] = 0.0
        return direction

    def times_transposed(self, direction: np.ndarray) -> np.ndarray:
        """Product of the transpose with a vector of the free unknowns; both owned.  Collective."""
        if self.is_symmetric:
            return self.times(direction)
        if self._transposed is None:
            problem = self.problem
            trial = ufl.TrialFunction(problem.W)
            adjoint = ufl.adjoint(problem.forms.tangent(trial))
            form = compat.compile_form(ufl.action(adjoint, self._along))
            product = self._petsc.keep("transposed product", compat.create_vector(form))
            self._transposed = form, product
        self.problem.spread(self._unheld(direction), self._along)
        form, product = self._transposed
        moved = self._with_mass(assembled(product, form))
        return self._with_springs(moved, direction, transposed=True)

    @property
    def is_symmetric(self) -> bool:
        """Whether it is symmetric to rounding, free edges under a follower pressure included."""
        forms = self.problem.forms
        return forms.is_symmetric and not forms.loads.following

    def _with_springs(
        self, product: np.ndarray, direction: np.ndarray, transposed: bool = False
    ) -> np.ndarray:
        """A product at all owned unknowns in the free rows, with that of the springs."""
        problem = self.problem
        product = problem.restrict(product)
        springs = problem.springs
        if len(springs.rows):
            stiffness = problem.turning.stiffness(springs, problem.factors)
            product[springs.rows] += stiffness * direction[springs.rows]
        if (block := self._rigid()) is not None:
            problem.rigid.add_product(product, block.T if transposed else block, direction)
        if problem.circuits:
            for row, value in self._wires():
                product[row] += value * direction[row]
            held = problem.circuits.given_rows()
            product[held] = -direction[held]
        return product

    def _wires(self) -> list[tuple[int, float]]:
        """Rows of fed electrodes, and what the resistors of their wires add there."""
        problem = self.problem
        return problem.circuits.stiffness(problem.w.x.array, problem.factors)

    def _rigid(self) -> np.ndarray | None:
        """What second derivatives of the motion of rigid parts add, or None.  Collective."""
        problem = self.problem
        if not problem.rigid:
            return None
        if self._turned[0] != problem.shown:
            block = problem.rigid.stiffness(problem.residual(), problem.w.x.array)
            moment = problem.scales.force * problem.scales.length
            block = block + problem.rigid.by_moments(problem.factors, moment)
            self._turned = problem.shown, block
        return self._turned[1]

    def times_fixed(self, change: np.ndarray) -> np.ndarray:
        """Product with a change of the fixed values (owned), in the free rows.  Collective."""
        self._along.x.array[:] = 0.0
        self._along.x.array[self.problem.fixed] = change
        return self._times_given()

    def times_values(self, change: np.ndarray) -> np.ndarray:
        """Product with a change of all local values, in the free rows.  Collective.

        Nothing follows anything: nodes of rigid parts change as is said.
        """
        problem = self.problem
        self._along.x.array[:] = change
        self._along.x.scatter_forward()
        product = problem.restrict(self._along_times())
        product[problem.circuits.given_rows()] = 0.0
        return product

    def times_lift(self, lifted: np.ndarray) -> np.ndarray:
        """Product with the change of what is given to that of other local values.  Collective.

        Given are the fixed values, and the potentials of ideal sources.  In the free rows.
        """
        problem, along = self.problem, self._along
        now = problem.w.x.array
        along.x.array[:] = 0.0
        along.x.array[problem.fixed] = lifted[problem.fixed] - now[problem.fixed]
        problem.circuits.lift(along.x.array, lifted - now)
        return self._times_given()

    def _times_given(self) -> np.ndarray:
        """Product with what stands in `_along`, in the rows of what is not given.  Collective."""
        problem = self.problem
        self._along.x.scatter_forward()
        problem.rigid.follow(self._along.x.array, problem.w.x.array)
        problem.conditions.ties.follow(self._along.x.array)
        product = problem.restrict(self._along_times())
        product[problem.circuits.given_rows()] = 0.0
        return product

    def by_load(self, ramp: str) -> np.ndarray:
        """Derivative of the residual by a ramp's factor at fixed free unknowns (owned, free rows).

        The derivative is exact, because fixed values, loads and charges are linear in the factor.
        The fixed values enter the residual through the columns of the tangent.
        """
        problem, circuits = self.problem, self.problem.circuits
        changes = ramp in problem.loads.changing or bool(problem.rigid) or bool(problem.charges)
        if ramp not in self._loads or changes:
            vector = np.zeros(len(problem.free))
            if ramp in problem.loads.unit_work:
                vector = problem.restrict(problem.forms.load_vector(ramp))
            problem.add_sources(vector, ramp, 1.0)
            self._loads[ramp] = vector
        along = self._along.x.array
        along[:] = 0.0
        along[problem.fixed] = problem.conditions.fixed_values.base[ramp][problem.fixed]
        circuits.per_factor(ramp, along)
        given = along.copy()
        found = self._loads[ramp] + self._times_given()
        for row, value in circuits.by_source(ramp, problem.w.x.array, problem.factors):
            found[row] += value
        held = circuits.given_rows()
        # The row of a given potential is that of the source minus the electrode's.
        found[held] = given[problem.free[held]]
        return found

    def _along_times(self) -> np.ndarray:
        return self._with_mass(assembled(self._product, self._action))

    def _with_mass(self, product: np.ndarray) -> np.ndarray:
        """A product with what stands in `_along`, with that of the inertia.  Collective."""
        mass = self.problem.mass
        if mass is None or not mass.stiffness:
            return product
        along = self._along.x.array[: self.problem.owned]
        return product + mass.stiffness * mass.times(along)

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
            This multiple of `scalar_masses` is taken from the diagonal, as a rule that of p and
            phi.  Then each p and each phi gives one negative eigenvalue, whether the tangent
            determines it or not.
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
        if problem.mass is not None and problem.mass.stiffness:
            subset = PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN
            whole.axpy(problem.mass.stiffness, problem.mass.matrix, subset)
        if problem.expansion is not None:
            free = self._followed(whole, free)
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
        if (block := self._rigid()) is not None:
            # A factor takes the matrix as symmetric; that of a moment in space is so in part.
            problem.rigid.enter(free, (block + block.T) / 2)
        if problem.circuits:
            self._feed(free)
        if problem.unknowns <= MOST_UNKNOWNS_KEPT:
            self._kept = whole, free
            self._petsc.keep("whole", whole)
            self._petsc.keep("free", free)
        else:
            whole.destroy()
        return free

    def _followed(self, whole: Any, free: Any) -> Any:
        """P^T A P of a matrix A with the expansion P, into `free` if it is given.  Collective.

        A row of P^T A P that many cells share, such as that of the pressure in a cavity, is made
        fastest by a product with the transpose of P.  PETSc has this product on one rank only.
        """
        expansion = self.problem.expansion
        if not self.problem.cavities or self.problem.comm.size > 1:
            return whole.ptap(expansion, result=free)
        options = PETSc.Options()
        options.setValue("matptap_via", "rap")
        try:
            return whole.ptap(expansion, result=free)
        finally:
            options.delValue("matptap_via")

    def _feed(self, free: Any) -> None:
        """Enter the wires into an assembled matrix.  Collective."""
        first = free.getOwnershipRange()[0]
        for row, value in self._wires():
            free.setValue(first + row, first + row, value, addv=True)
        free.assemble()
        # The pattern stays, since the same matrix is filled again when the switch has opened.
        free.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        free.zeroRowsColumns(self.problem.circuits.given_rows() + first, diag=-1.0)


def scalar_masses(problem: Problem) -> np.ndarray:
    """The mass of each free unknown (owned) of the fields that have one, else 0.

    Each cell distributes its volume, times the mass of the field in its material (see
    `Field.mass`), equally over its nodes.  The masses of tied unknowns are added.  All values are
    dimensionless.  Collective.
    """
    device = problem.scene.device
    lumped = dolfinx.fem.Function(problem.W)
    for field in problem.space.fields:
        for name, material in problem.parameters.materials.items():
            if field.mass is None or not field.lives_in(name):
                continue
            weight = field.mass(material, problem.scales)
            cells = device.cells_of(name)
            cells = cells[cells < device.owned_cells()]
            for part in problem.space.parts[field.name].values():
                dofs = part.dofs[part.space.dofmap.list[cells]]
                share = weight * problem.forms.cell_volumes[cells] / dofs.shape[1]
                np.add.at(lumped.x.array, dofs, share[:, None])
    lumped.x.scatter_reverse(dolfinx.la.InsertMode.add)
    return problem.restrict(lumped.x.array[: problem.owned])
