"""The fields of a problem: the unknowns and their roles.

Those that follow from materials and kinematics are declared in this file; a condition of a scene
may declare others, see `AddedPhysics`.  Residual norms, factors, the count of negative eigenvalues
and predictors use the role and the declared properties of a field, never its name.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

import basix.ufl

from dea_fenicsx.materials import Material
from dea_fenicsx.materials.base import is_compressible
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.scene.elements import Discretisation
from dea_fenicsx.scene.kinematics_base import Kinematics
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import InputError

SHAPE_OF_AIR = "shape of air"
"""Name of the multiplier that lets the cells of the air follow the body."""

SHAPE_RESIDUAL = 1e-2
"""Residual of the air's shape that counts as 1: that of strains of about 1e-2."""


class Role(Enum):
    """The role of a field in a problem."""

    MOTION = "motion"
    """Displacement.  The residual of global unknowns is included in its norm."""

    MULTIPLIER = "multiplier"
    """The pressure, which keeps the volume."""

    POTENTIAL = "potential"
    """The electric potential."""

    GLOBAL = "global"
    """Numbers for the whole device.  Each is stored as one value per cell, all of them tied."""

    INTERNAL = "internal"
    """Any other field."""


@dataclass(frozen=True)
class Field:
    """A field of a problem.

    Attributes
    ----------
    name
        Its name, as in the summary of a run.
    element
        Its element, of basix.
    role
        What it is for.
    parts
        Names of its scalar parts; empty for a scalar field.
    negative
        Whether each of its unknowns gives the tangent one negative eigenvalue on a stable path.
    odd
        Whether it changes its sign with the voltage; displacements and pressures do not.
    residual_scale
        For an internal field the residual that counts as 1, dimensionless.
    mass
        Mass per volume that keeps an undetermined mode of the field from making a factor singular,
        for a material; None for a field without such modes.  It is negative where the modes are
        those of a positive stiffness.  See `Tangent.matrix`.
    regions
        Names of the regions in which the field lives; None for all.  Elsewhere its degrees of
        freedom are fixed at 0.
    at_rest
        Its value in the undeformed body without loads, dimensionless.
    unit
        SI value of 1, for a field that is neither a displacement, a pressure nor a potential.
    surface
        Name of the facet group on which the field lives, or None.  Elsewhere its degrees of freedom
        are fixed at 0.
    by_reactions
        Whether the residual of an internal field is compared with those of its fixed degrees of
        freedom, too, where they are larger than `residual_scale`.
    """

    name: str
    element: Any
    role: Role
    parts: tuple[str, ...] = ()
    negative: bool = False
    odd: bool = False
    residual_scale: float = 1.0
    mass: Callable[[Material, Scales], float] | None = None
    regions: tuple[str, ...] | None = None
    at_rest: float = 0.0
    unit: float = 1.0
    surface: str | None = None
    by_reactions: bool = False

    def lives_in(self, region: str) -> bool:
        """Whether the field lives in a region."""
        return self.regions is None or region in self.regions

    @property
    def is_continuous(self) -> bool:
        """Whether neighbouring cells share degrees of freedom, on a vertex, an edge or a face."""
        return any(n for on_entities in self.element.num_entity_dofs[:-1] for n in on_entities)


def declared_fields(scene: Scene) -> list[Field]:
    """The fields of a scene's problem, in the order in which they lie in the mixed function.

    Raises
    ------
    InputError
        If two fields have the same name.
    """
    cell = scene.device.mesh.topology.cell_name()
    kinematics = scene.kinematics
    axes = tuple(kinematics.axes)
    vector = basix.ufl.element("Lagrange", cell, scene.elements.degree, shape=(len(axes),))
    solids = tuple(scene.solids)
    has_air = len(solids) < len(scene.materials)
    pressed = tuple(name for name in solids if not is_compressible(scene.solids[name].elastic))
    found = [
        # Where all is air, nothing moves.
        Field(
            "u", vector, Role.MOTION, axes, regions=None if solids else (),
            mass=_without_tension if kinematics.is_membrane else None,
        ),
        _pressure(scene, cell, None if len(pressed) == len(scene.materials) else pressed),
    ]  # fmt: skip
    if scene.has_potential:
        element = basix.ufl.element("Lagrange", cell, scene.elements.potential_degree)
        dielectric = tuple(name for name, m in scene.materials.items() if m.is_dielectric)
        if kinematics.is_membrane:
            element = basix.ufl.element("DG", cell, 0)
            dielectric = tuple(name for e in scene.electrodes for name in e.names)
        found.append(
            Field(
                "phi", element, Role.POTENTIAL, negative=True, odd=True, mass=_permittivity,
                regions=dielectric,
            )
        )  # fmt: skip
    names = kinematics.overall
    if names:
        shape = (len(names),) if len(names) > 1 else None
        found.append(
            Field("global", basix.ufl.element("DG", cell, 0, shape=shape), Role.GLOBAL, names)
        )
    for part in scene.declared.rigid_surfaces:
        names = unknowns_of_part(kinematics)
        shape = (len(names),) if len(names) > 1 else None
        element = basix.ufl.element("DG", cell, 0, shape=shape)
        found.append(Field(part.field, element, Role.GLOBAL, names))
        if part.attached:
            names = carriers_of_part(kinematics)
            element = basix.ufl.element("DG", cell, 0, shape=(len(names),))
            found.append(Field(part.attached_field, element, Role.GLOBAL, names))
    for pair in scene.declared.periodic_faces:
        element = basix.ufl.element("DG", cell, 0, shape=(len(axes),))
        found.append(Field(pair.field, element, Role.GLOBAL, axes))
    found += _cavity_fields(scene, cell)
    if has_air and solids:
        air = tuple(name for name in scene.materials if name not in solids)
        found.append(
            Field(
                SHAPE_OF_AIR, vector, Role.INTERNAL, axes, negative=True, regions=air,
                residual_scale=SHAPE_RESIDUAL, by_reactions=True,
            )
        )  # fmt: skip
    found += [field for added in scene.declared.added for field in added.fields]
    _check_names(found)
    return found


def _pressure(scene: Scene, cell: str, regions: tuple[str, ...] | None) -> Field:
    """The pressure in some regions; that of a membrane is eliminated, so that p is 0 there."""
    element = _pressure_element(scene.elements, cell)
    if scene.kinematics.is_membrane:  # see `ReferenceTension`
        regions, element = (), basix.ufl.element("DG", cell, 0)
    return Field("p", element, Role.MULTIPLIER, negative=True, mass=softness, regions=regions)


def unknowns_of_part(kinematics: Kinematics) -> tuple[str, ...]:
    """Names of the unknowns of a rigid part: displacements of its centre, then rotations."""
    axes = tuple(kinematics.axes)
    return {
        0: axes[-1:], 1: (*axes, "angle"), 3: (*axes, *(f"rotation {axis}" for axis in axes))
    }[kinematics.rotations]  # fmt: skip


def carriers_of_part(kinematics: Kinematics) -> tuple[str, ...]:
    """Names of the components of the points that carry an attached mass, point after point."""
    axes = tuple(kinematics.axes)
    points = 1 + (len(axes) if kinematics.rotations == 3 else kinematics.rotations)
    return tuple(f"point {k} {axis}" for k in range(points) for axis in axes)


GAS_ROUNDING = 1e-3
"""Residual of a gas pressure that counts as 1, as a share of the pressure outside, or more.

The pressure in a cavity is a difference to that outside.  So it is known to about 1e-16 of the
latter, and this share keeps the test reachable at 1e6 moduli.
"""


def _cavity_fields(scene: Scene, cell: str) -> list[Field]:
    """The pressure of each cavity, and the change of its volume."""
    fillings = scene.declared.fillings
    if not fillings:
        return []
    scales, found = Scales.of(scene), []
    for told in fillings:
        size = told.space.unit
        element = basix.ufl.element("DG", cell, 0)
        found.append(Field(
            told.pressure_field, element, Role.INTERNAL, negative=True, residual_scale=size,
            mass=softness, unit=scales.stress,
        ))  # fmt: skip
        if told.knows_volume:
            found.append(Field(
                told.volume_field, element, Role.INTERNAL,
                residual_scale=size * max(1.0, GAS_ROUNDING * told.outside / scales.stress),
                unit=scales.volume * size,
            ))  # fmt: skip
    return found


def _check_names(fields: Sequence[Field]) -> None:
    names = [field.name for field in fields]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"The scene has two fields of the name {name!r}; rename one of them.")


def _pressure_element(elements: Discretisation, cell: str) -> Any:
    if elements.pressure_on(cell) == "discontinuous":
        return basix.ufl.element("DPC", cell, elements.degree - 1, discontinuous=True)
    return basix.ufl.element("Lagrange", cell, elements.degree - 1)


def softness(material: Material, scales: Scales) -> float:
    """One over the shear modulus, dimensionless: the mass of a pressure."""
    return scales.stress / material.elastic.shear_modulus()


def _without_tension(material: Material, scales: Scales) -> float:
    """Minus the shear modulus, dimensionless: it holds a membrane that bears no tension yet."""
    return -material.elastic.shear_modulus() / scales.stress


def _permittivity(material: Material, scales: Scales) -> float:
    return material.dielectric.permittivity() / scales.permittivity
