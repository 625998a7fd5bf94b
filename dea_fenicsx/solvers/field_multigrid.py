"""Multigrid for one field's block of the tangent: first by degree, then algebraic.

The block is assembled in the field's own space, for displacements in small blocks of one node each.
A Chebyshev iteration with the inverse of these small blocks smooths it.  The coarse level holds the
same form on linear elements of the same mesh, which is P^T A P with the interpolation P between
the two.  PETSc's GAMG solves there (smoothed aggregation, Vanek et al., Computing 56 (1996) 179):
it builds its own coarser levels from the rigid motions of the deformed body, which elasticity
hardly resists.  All of this takes memory in proportion to the unknowns.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from ufl.algorithms import expand_derivatives

from dea_fenicsx.model.components import Component
from dea_fenicsx.model.fields import Field
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import PETSc, dolfinx
from dea_fenicsx.support.petsc_objects import PetscObjects

SMOOTHING = 2
"""Chebyshev iterations before and after each correction on the coarse level."""

COARSENING = {"pc_gamg_threshold": "0.02", "pc_gamg_aggressive_coarsening": "0"}
"""Options of GAMG: small groups of strongly coupled nodes, which slender bodies need.

The iterations with and without are in docs/developers/solver.md, "Measured constants".
"""

OPTIONS_PREFIX = "dea_multigrid_"
"""What the names of options begin with."""


class _Level:
    """One field's block of the tangent on one space.

    Parameters
    ----------
    space, form
        The space, and the compiled form.
    fixed
        Whether each local degree of freedom is fixed.

    Attributes
    ----------
    matrix
        The block.  That of a vector has the rows of all owned degrees of freedom, with 1 on the
        diagonal for fixed ones; that of a scalar only those of free ones.
    free
        PETSc's index set of the free degrees of freedom.
    """

    matrix: Any = None

    def __init__(self, space: Any, form: Any, fixed: np.ndarray) -> None:
        self.space, self._form, self.fixed = space, form, fixed
        self._components = n = space.dofmap.index_map_bs
        index_map = space.dofmap.index_map
        self.owned = n * index_map.size_local
        first = n * index_map.local_range[0]
        free = np.flatnonzero(~fixed[: self.owned]) + first
        self.free = PETSc.IS().createGeneral(free.astype(np.int32), comm=space.mesh.comm)
        self._supports = []
        for a in range(n):
            held = n * np.flatnonzero(fixed[a::n]).astype(np.int32) + a
            part = space.sub(a) if n > 1 else space
            self._supports.append(dolfinx.fem.dirichletbc(0.0, held.astype(np.int32), part))

    def assemble(self) -> None:
        """Assemble the block at the problem's present state.  Collective."""
        whole = self.matrix if self._components > 1 else None
        if whole is None:
            kind = "baij" if self._is_fine and self._components > 1 else None
            whole = dolfinx.fem.petsc.create_matrix(self._form, kind)
        whole.zeroEntries()
        dolfinx.fem.petsc.assemble_matrix(whole, self._form, bcs=self._supports)
        whole.assemble()
        if self._components > 1:
            self.matrix = whole
        else:
            self.matrix = whole.createSubMatrix(self.free, self.free, submat=self.matrix)
            whole.destroy()
        compat.mark_positive(self.matrix)

    @property
    def _is_fine(self) -> bool:
        return int(self.space.element.basix_element.degree) > 1


class FieldMultigrid:
    """An approximate inverse of one field's block, by multigrid.

    Parameters
    ----------
    problem
        A problem in space in which nothing is tied.
    field
        A continuous Lagrange field of any degree.

    Attributes
    ----------
    rows
        Places of the field's unknowns among the free ones of this rank.
    """

    def __init__(self, problem: Problem, field: Field) -> None:
        self.problem, self._field = problem, field
        self._petsc = PetscObjects(problem.comm)
        fine = dolfinx.fem.functionspace(problem.mesh, field.element)
        dofs = _places_in_whole(list(problem.space.parts[field.name].values()), fine)
        self._components = n = fine.dofmap.index_map_bs
        linear = dolfinx.fem.functionspace(problem.mesh, ("Lagrange", 1, (n,) if n > 1 else ()))
        fixed = problem.conditions.fixed_values.fixed[dofs]
        above = _interpolated(fixed.astype(float), fine, linear) > 0.5
        self._levels = [_Level(linear, self._form(linear), above)]
        if fine.element.basix_element.degree > 1:
            self._levels.append(_Level(fine, self._form(fine), fixed))
        self._dofs = dofs
        row = np.full(problem.size, -1)
        row[problem.free] = np.arange(len(problem.free))
        own = row[dofs[: n * fine.dofmap.index_map.size_local]]
        held = np.flatnonzero(own >= 0)
        self.rows = own[held]
        self._places = held if n > 1 else np.arange(len(held))
        self._pc: Any = None
        self._between: Any = None
        self._vectors: tuple[Any, Any] = (None, None)

    def _form(self, space: Any) -> Any:
        """The field's block on a space, compiled; positive in a stable body."""
        unknowns = self.problem.space

        def on_all(argument: Any) -> Any:
            found: list[Any] = []
            for field in unknowns.fields:
                n = max(1, len(field.parts))
                if field is not self._field:
                    found += n * [0]
                else:
                    found += [argument] if n == 1 else [argument[a] for a in range(n)]
            return ufl.as_vector(found)

        trial = ufl.TrialFunction(unknowns.W)
        tangent = expand_derivatives(self.problem.forms.tangent(trial))
        u, v = on_all(ufl.TrialFunction(space)), on_all(ufl.TestFunction(space))
        block = ufl.replace(tangent, {trial: u, unknowns.test: v})
        return compat.compile_form(-block if self._field.negative else block)

    def make(self) -> None:
        """Assemble all levels at the problem's present state, and set them up.  Collective."""
        first = self._vectors[0] is None
        if self._pc is not None:
            self._pc.destroy()
        for level in self._levels:
            level.assemble()
        if self._components > 1:
            self._tell_rigid_motions(self._levels[0])
        if first:
            self._between = self._interpolation() if len(self._levels) > 1 else None
            self._vectors = self._levels[-1].matrix.createVecs()
            levels = [thing for level in self._levels for thing in (level.matrix, level.free)]
            kept = [*self._vectors, *levels, self._between]
            for number, thing in enumerate(kept):
                if thing is not None:
                    self._petsc.keep(f"part {number}", thing)
        self._pc = self._petsc.keep("pc", self._cycle())

    def _interpolation(self) -> Any:
        """The interpolation from the linear elements, without fixed degrees of freedom."""
        coarse, fine = self._levels
        made = compat.interpolation_matrix(coarse.space, fine.space)
        if self._components == 1:
            free = made.createSubMatrix(fine.free, coarse.free)
            made.destroy()
            return free
        left, right = made.createVecLeft(), made.createVecRight()
        left.array[:] = ~fine.fixed[: fine.owned]
        right.array[:] = ~coarse.fixed[: coarse.owned]
        made.diagonalScale(left, right)
        left.destroy()
        right.destroy()
        return made

    def _tell_rigid_motions(self, level: _Level) -> None:
        """Tell GAMG what the deformed body does not resist: translations and rotations."""
        space, n = level.space, self._components
        moved = _interpolated(self.problem.w.x.array[self._dofs], self._levels[-1].space, space)
        x = space.tabulate_dof_coordinates()[:, :n] + moved.reshape(-1, n)
        modes = []
        for a in range(n):
            modes.append(np.zeros_like(x))
            modes[-1][:, a] = 1.0
        for a in range(n):
            for b in range(a):
                modes.append(np.zeros_like(x))
                modes[-1][:, a], modes[-1][:, b] = -x[:, b], x[:, a]
        vectors: list[Any] = []
        for mode in modes:
            vector = level.matrix.createVecRight()
            vector.array[:] = mode.ravel()[: level.owned]
            for _ in range(2):  # twice, since a body may lie far from the origin
                for other in vectors:
                    vector.axpy(-vector.dot(other), other)
            vector.normalize()
            vectors.append(vector)
        null = PETSc.NullSpace().create(vectors=vectors, comm=self.problem.comm)
        level.matrix.setNearNullSpace(null)
        null.destroy()
        for vector in vectors:
            vector.destroy()

    def _cycle(self) -> Any:
        """One V-cycle over the levels, as a preconditioner of PETSc that is ready."""
        prefix = f"{OPTIONS_PREFIX}{self._field.name}_"
        options = PETSc.Options()
        for name, value in COARSENING.items():
            options.setValue(prefix + name, value)
        pc = PETSc.PC().create(self.problem.comm)
        coarse = pc
        if len(self._levels) > 1:
            pc.setOperators(self._levels[-1].matrix)
            pc.setType("mg")
            pc.setMGLevels(2)
            pc.setMGInterpolation(1, self._between)
            smoother = pc.getMGSmoother(1)
            smoother.setOperators(self._levels[-1].matrix)
            smoother.setType("chebyshev")
            smoother.setNormType(PETSc.KSP.NormType.NONE)
            smoother.setTolerances(max_it=SMOOTHING)
            smoother.getPC().setType("pbjacobi" if self._components > 1 else "jacobi")
            below = pc.getMGCoarseSolve()
            below.setType("preonly")
            below.setOperators(self._levels[0].matrix)
            coarse = below.getPC()
        coarse.setOperators(self._levels[0].matrix)
        coarse.setType("gamg")
        coarse.setOptionsPrefix(prefix)
        coarse.setFromOptions()
        pc.setUp()
        for name in COARSENING:
            options.delValue(prefix + name)
        return pc

    def apply(self, forces: np.ndarray, into: np.ndarray) -> None:
        """Write what one cycle makes of a right-hand side into a vector; both of free unknowns."""
        b, x = self._vectors
        b.array[:] = 0.0
        b.array[self._places] = forces[self.rows]
        self._pc.apply(b, x)
        found = x.array_r[self._places]
        into[self.rows] = -found if self._field.negative else found

    def release(self) -> None:
        """Delete the coarser levels of GAMG and the factor of the coarsest one."""
        if self._pc is not None:
            self._pc.destroy()
            self._pc = None


def _places_in_whole(parts: list[Component], space: Any) -> np.ndarray:
    """Where each local degree of freedom of a field's own space lies in the mixed space.

    DOLFINx's `collapse` finds them, too, but for a vector in a time that grows with their square.
    """
    dofmap = space.dofmap
    size = dofmap.index_map.size_local + dofmap.index_map.num_ghosts
    found = np.empty((size, len(parts)), dtype=np.int64)
    for a, part in enumerate(parts):
        found[dofmap.list, a] = part.dofs[part.space.dofmap.list]
    return found.ravel()


def _interpolated(values: np.ndarray, space: Any, onto: Any) -> np.ndarray:
    """Local values of a function of one space, interpolated onto another one.  Collective."""
    function, found = dolfinx.fem.Function(space), dolfinx.fem.Function(onto)
    function.x.array[:] = values
    found.interpolate(function)
    found.x.scatter_forward()
    return np.asarray(found.x.array)
