"""The mass of a body: what its inertia adds to the residual and to the tangent.

The displacement has the consistent mass matrix M of int rho u . v dX; pressure and potential have
no mass.  With lengths in L and stresses in mu, a density is in units of mu/L^2, so that M is in s^2
and an acceleration in 1/s^2.  A scheme of time integration makes the acceleration at the end of a
step a linear function of the displacement there,

    a = c (u - s),

with a number c in 1/s^2 and values s that are known.  So the residual has M a in addition, and the
tangent c M.  A body at rest has c = 0 and a = 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import ufl

from dea_fenicsx.materials import Material
from dea_fenicsx.model.attached_mass import add_attached
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.motion import Motion
from dea_fenicsx.model.rigid_parts import RigidParts
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.model.unknowns import Unknowns
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import PETSc, dolfinx
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.petsc_objects import PetscObjects


class Mass:
    """The mass matrix of a problem, and the inertial forces of its present state.

    Parameters
    ----------
    scene, scales, space
        The scene, its units, and its unknowns.
    materials
        Material of each region, with its present constants.
    rigid
        The rigid parts, to which bodies may be attached.

    Attributes
    ----------
    matrix
        PETSc matrix M in all owned degrees of freedom of the mixed function, in s^2.
    density
        The density in each cell, in units of the matrix.
    stiffness
        c in 1/s^2.
    constant
        The part -c s of the acceleration in 1/s^2 at all owned degrees of freedom, or None for 0.
        With c = 0 it is the acceleration itself.  Drag counts as an acceleration.

    Raises
    ------
    InputError
        If a region has no density, or the device has global unknowns that are free.
    """

    def __init__(
        self, scene: Scene, scales: Scales, space: Unknowns, materials: Mapping[str, Material],
        rigid: RigidParts,
    ) -> None:  # fmt: skip
        check_mass(materials, scene)
        self._petsc = PetscObjects(scene.device.comm)
        self.density = _density(scene, scales, materials)
        matrix = products_of_motions(scene, space, self.density)
        add_attached(matrix, scene.declared.rigid_surfaces, rigid.parts, scales)
        self.matrix = self._petsc.keep("mass", _without_zeros(matrix))
        self._x, self._y = self.matrix.createVecs()
        self._petsc.keep("x", self._x)
        self._petsc.keep("y", self._y)
        self.stiffness = 0.0
        self.constant: np.ndarray | None = None

    def times(self, values: np.ndarray) -> np.ndarray:
        """M times owned values of the mixed function.  Collective."""
        self._x.array[:] = values
        self.matrix.mult(self._x, self._y)
        return np.asarray(self._y.array_r.copy())

    def moving(self, free: np.ndarray, expansion: Any | None) -> np.ndarray:
        """Places among the free unknowns (owned) of those that have a mass.  Collective."""
        matrix = self.reduced(free, expansion)
        diagonal = matrix.getDiagonal()
        found = np.flatnonzero(diagonal.array_r > 0)
        diagonal.destroy()
        matrix.destroy()
        return found

    def rest(self) -> None:
        """Let the body be without inertia."""
        self.stiffness, self.constant = 0.0, None

    def show(self, motion: Motion | None) -> None:
        """Take the inertia of a state's motion; none if it has none."""
        self.rest()
        if motion is not None:
            self.stiffness = motion.stiffness
            if motion.constant is not None:
                self.constant = motion.constant[: self.matrix.getLocalSize()[0]]

    @property
    def acts(self) -> bool:
        """Whether the present state has inertial forces."""
        return self.stiffness != 0 or self.constant is not None

    def acceleration(self, values: np.ndarray) -> np.ndarray:
        """The acceleration in 1/s^2 that belongs to owned values of the mixed function."""
        found = self.stiffness * values
        return found if self.constant is None else found + self.constant

    def forces(self, values: np.ndarray) -> np.ndarray:
        """M a at owned values of the mixed function.  Collective."""
        return self.times(self.acceleration(values))

    def reduced(self, free: np.ndarray, expansion: Any | None) -> Any:
        """M in the free unknowns as a PETSc matrix, which the caller destroys.  Collective.

        `free` and `expansion` are those of the problem.
        """
        return in_free_unknowns(self.matrix, free, expansion)


def check_mass(materials: Mapping[str, Material], scene: Scene) -> None:
    """Raise InputError unless a scene has all that vibration and motion need."""
    without = sorted(name for name, m in materials.items() if m.density is None)
    if without:
        names = ", ".join(repr(name) for name in without)
        many = len(without) > 1
        raise InputError(
            f"The region{'s' * many} {names} {'have' if many else 'has'} no density, without which "
            "there is no inertia; give Material(..., density=1000) in kg/m^3."
        )
    held = {told.unknown.name for _, told in scene.declared.fixed_globals}
    if any(unknown.name not in held for unknown in scene.kinematics.global_unknowns):
        raise InputError(
            "Vibration and motion are not available where the stretch or the twist of "
            f"{scene.kinematics.title} is free; hold it by AxialStretch and Twist, or take a "
            "device in three dimensions."
        )


def _density(scene: Scene, scales: Scales, materials: Mapping[str, Material]) -> Any:
    """The density in each cell, in units of which the mass matrix is in s^2."""
    density = dolfinx.fem.Function(dolfinx.fem.functionspace(scene.device.mesh, ("DG", 0)))
    for name, material in materials.items():
        assert material.density is not None
        unit = scales.stress / scales.length**2
        density.x.array[scene.device.cells_of(name)] = material.density / unit
    return density


def products_of_motions(scene: Scene, space: Unknowns, density: Any = 1.0) -> Any:
    """The matrix of int density u . v dX in the owned degrees of freedom.  Collective.

    The caller destroys it.
    """
    mesh = scene.device.mesh
    u = space.symbolic(Role.MOTION, ufl.TrialFunction(space.W))
    v = space.symbolic(Role.MOTION, ufl.TestFunction(space.W))
    weight = scene.kinematics.weight(ufl.SpatialCoordinate(mesh))
    degree = scene.elements.quadrature_of_mass  # exact in straight cells
    dx = ufl.Measure("dx", domain=mesh, metadata={"quadrature_degree": degree})
    form = compat.compile_form(density * ufl.inner(u, v) * weight * dx)
    matrix = dolfinx.fem.petsc.assemble_matrix(form)
    matrix.assemble()
    return matrix


def _without_zeros(matrix: Any) -> Any:
    """A matrix without its entries that are 0; the one with them is destroyed.  Collective.

    The pattern of the assembled mass couples all fields and all axes: it has some ten times the
    entries that are needed.
    """
    offsets, columns, values = matrix.getValuesCSR()
    kept = values != 0
    rows = np.concatenate([[0], np.cumsum(kept)])[offsets].astype(PETSc.IntType)
    found = PETSc.Mat().createAIJ(
        matrix.getSizes(), csr=(rows, columns[kept], values[kept]), comm=matrix.comm
    )
    matrix.destroy()
    return found


def in_free_unknowns(matrix: Any, free: np.ndarray, expansion: Any | None) -> Any:
    """A matrix of the owned degrees of freedom in the free unknowns, which the caller destroys.

    `free` and `expansion` are those of the problem.  Collective.
    """
    if expansion is not None:
        return matrix.ptap(expansion)
    start = matrix.getOwnershipRange()[0]
    rows = PETSc.IS().createGeneral((free + start).astype(PETSc.IntType), comm=matrix.comm)
    found = matrix.createSubMatrix(rows, rows)
    rows.destroy()
    return found
