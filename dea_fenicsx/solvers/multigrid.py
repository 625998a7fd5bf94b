"""A preconditioner whose memory grows in proportion to the unknowns.

`Multigrid` is for very large problems in space.  The tangent's blocks are

        | A   B^T  G^T |          u, displacement
    T = | B   -C    0  |          p, pressure
        | G    0   -K  |          phi, potential

The preconditioner takes the lower triangle of the blocks, with B A^-1 B^T + C replaced by the mass
of the pressure over the shear modulus, plus C (Elman, Silvester and Wathen, Finite Elements and
Fast Iterative Solvers, 2014, chapter 4).  One cycle of multigrid stands for A^-1, and one for K^-1.
The products with B and G come from the true tangent, so that neither is assembled.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
import ufl

from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.kernels import measure
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.solvers.field_multigrid import FieldMultigrid
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import PETSc, dolfinx
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.petsc_objects import PetscObjects

ROLES = frozenset({Role.MOTION, Role.MULTIPLIER, Role.POTENTIAL})
"""Roles of the fields that it can take."""

SCHUR_SHARE = 0.7
"""Inverse of the pressure's block, as a multiple of that of its mass over the shear modulus.

Between 0.5 and 1 the number of iterations hardly changes.
"""

LARGEST_SIDE_RATIO = 10.0
"""Longest over shortest edge of a cell from which a run says that multigrid may fail.

Cells of 7.5 take three times the iterations of those of 2.5, and with 25 nothing converges.
"""

MASS_ITERATIONS = 5
"""Chebyshev iterations on the mass of a continuous pressure.  A discontinuous one is inverted."""


class Multigrid:
    """Block triangular preconditioner with one cycle of multigrid in each block.

    Parameters
    ----------
    problem
        The problem.
    times
        Product of the true tangent with a vector of the free unknowns.

    Raises
    ------
    InputError
        If the problem is of a kind that it cannot take.
    """

    needs_matrix: ClassVar[bool] = False
    """Whether `make` takes the tangent as an assembled matrix."""

    worth: ClassVar[float] = 0.0
    """Krylov iterations that take as long as setting up does, beyond those of an assembly."""

    def __init__(self, problem: Problem, times: Callable[[np.ndarray], np.ndarray]) -> None:
        check(problem)
        self.problem, self._times = problem, times
        fields = {field.role: field for field in problem.space.fields}
        self._motion = FieldMultigrid(problem, fields[Role.MOTION])
        self._potential = None
        if problem.roles.count(Role.POTENTIAL):
            self._potential = FieldMultigrid(problem, fields[Role.POTENTIAL])
        self._pressure = _PressureMass(problem) if problem.roles.count(Role.MULTIPLIER) else None

    def make(self, _: Any = None) -> bool:
        """Set all levels up at the problem's present state.  Collective."""
        mass = self.problem.mass
        if mass is not None and mass.stiffness:
            raise InputError(
                'NewtonOptions(factor="multigrid") cannot solve for a motion with inertia; take '
                'factor="auto".'
            )
        self._motion.make()
        if self._potential:
            self._potential.make()
        return True

    def apply(self, _: Any, x: Any, y: Any) -> None:
        """What PETSc calls to precondition: displacement, then pressure and potential."""
        b = x.array_r
        found = np.zeros_like(b)
        self._motion.apply(b, found)
        rest = b - self._times(found)
        if self._pressure:
            self._pressure.apply(rest, found)
        if self._potential:
            self._potential.apply(rest, found)
        y.array[:] = found

    def apply_transposed(self, context: Any, x: Any, y: Any) -> None:
        """The same, for the tangent is symmetric but for edges of follower pressures."""
        self.apply(context, x, y)

    def make_room(self) -> None:
        """Delete the algebraic levels before they are made anew."""
        self._motion.release()
        if self._potential:
            self._potential.release()

    release = make_room


class _PressureMass:
    """Minus the inverse of the pressure's mass over the shear modulus, compressibility included."""

    def __init__(self, problem: Problem) -> None:
        self._petsc = PetscObjects(problem.comm)
        part = problem.pressure
        space, dofs = part.space, part.dofs
        scene, device = problem.scene, problem.scene.device
        soft = dolfinx.fem.Function(dolfinx.fem.functionspace(problem.mesh, ("DG", 0)))
        for name, material in problem.parameters.materials.items():
            shear = material.elastic.shear_modulus() / problem.scales.stress
            bulk = material.bulk_modulus
            softness = 0.0 if bulk is None else problem.scales.stress / bulk
            soft.x.array[device.cells_of(name)] = 1 / (SCHUR_SHARE * shear) + softness
        soft.x.scatter_forward()
        count = device.owned_cells()
        dx = measure(device, [np.arange(count)], scene.elements.quadrature_degree)
        p, q = ufl.TrialFunction(space), ufl.TestFunction(space)
        form = compat.compile_form(soft * p * q * dx(0))
        whole = dolfinx.fem.petsc.create_matrix(form)
        dolfinx.fem.petsc.assemble_matrix(whole, form)
        whole.assemble()
        index_map = space.dofmap.index_map
        own = dofs[: index_map.size_local]
        row = np.full(problem.size, -1)
        row[problem.free] = np.arange(len(problem.free))
        held = np.flatnonzero(row[own] >= 0)
        self.rows = row[own][held]
        free = PETSc.IS().createGeneral(
            (held + index_map.local_range[0]).astype(np.int32), comm=problem.comm
        )
        matrix = self._petsc.keep("mass", whole.createSubMatrix(free, free))
        whole.destroy()
        free.destroy()
        self._ksp = ksp = self._petsc.keep("ksp", PETSc.KSP().create(problem.comm))
        ksp.setOptionsPrefix("dea_multigrid_p_")
        ksp.setOperators(matrix)
        if problem.pressure_kind == "discontinuous":
            ksp.setType("preonly")
            ksp.getPC().setType("bjacobi")  # with ILU(0), which is exact where cells are apart
        else:
            ksp.setType("chebyshev")
            ksp.setNormType(PETSc.KSP.NormType.NONE)
            ksp.setTolerances(max_it=MASS_ITERATIONS)
            ksp.getPC().setType("jacobi")
        ksp.setUp()
        vectors = matrix.createVecs()
        self._b, self._x = (self._petsc.keep(f"v{k}", v) for k, v in enumerate(vectors))

    def apply(self, rest: np.ndarray, into: np.ndarray) -> None:
        """Write the pressure that a residual asks for into a vector; both of free unknowns."""
        self._b.array[:] = rest[self.rows]
        self._ksp.solve(self._b, self._x)
        into[self.rows] = -self._x.array_r


def caution(problem: Problem) -> str:
    """A sentence about cells that are too slender for multigrid, or nothing."""
    ratio = problem.scene.device.quality.get("largest_aspect", 1.0)
    if ratio <= LARGEST_SIDE_RATIO:
        return ""
    return (
        f"The longest edge of a cell is {ratio:.3g} times as long as its shortest one, and "
        f"multigrid may not converge beyond {LARGEST_SIDE_RATIO:g}; take more cells along the long "
        'edges, or factor="auto".'
    )


def check(problem: Problem) -> None:
    """Raise InputError unless multigrid can precondition a problem."""
    if why := missing(problem):
        raise InputError(f'NewtonOptions(factor="multigrid") needs {why}; take factor="auto".')


def missing(problem: Problem) -> str:
    """What multigrid needs and a problem lacks, in words; empty if it can precondition it."""
    conditions, why = problem.conditions, ""
    if problem.mesh.topology.dim != 3 or len(problem.displacement) != 3:
        why = "a device in space"
    elif any(k.air is not None or k.is_membrane for k in problem.kernels):
        why = "a device without air or membranes"
    elif not problem.forms.is_symmetric:
        why = "a symmetric tangent, but it is not symmetric here"
    elif conditions.expansion is not None or problem.circuits:
        why = ("that nothing is tied: no floating or charged electrodes, rigid or periodic parts, "
               "cavities and overall unknowns")  # fmt: skip
    elif not problem.roles.has <= ROLES:
        why = "displacement, pressure and potential, but there are other fields"
    elif problem.turning.ramps or conditions.body is not None:
        why = "a device that is held, but it is a free body"
    return why
