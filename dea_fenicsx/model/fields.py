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
from dea_fenicsx.model.scales import Scales
from dea_fenicsx.scene.elements import Discretisation
from dea_fenicsx.scene.kinematics_base import Kinematics
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.support.errors import InputError


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
        for a material; None for a field without such modes.  See `Tangent.matrix`.
    regions
        Names of the regions in which the field lives; None for all.  Elsewhere its degrees of
        freedom are fixed at 0.
    at_rest
        Its value in the undeformed body without loads, dimensionless.
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
    vector = basix.ufl.element("Lagrange", cell, 2, shape=(len(axes),))
    found = [
        Field("u", vector, Role.MOTION, axes),
        Field(
            "p", _pressure_element(scene.elements, cell), Role.MULTIPLIER, negative=True,
            mass=_softness,
        ),
    ]  # fmt: skip
    if scene.has_potential:
        element = basix.ufl.element("Lagrange", cell, scene.elements.potential_degree)
        dielectric = tuple(name for name, m in scene.materials.items() if m.is_dielectric)
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
    found += [field for added in scene.declared.added for field in added.fields]
    _check_names(found)
    return found


def unknowns_of_part(kinematics: Kinematics) -> tuple[str, ...]:
    """Names of the unknowns of a rigid part: displacements of its centre, then rotations."""
    axes = tuple(kinematics.axes)
    return {
        0: axes[-1:], 1: (*axes, "angle"), 3: (*axes, *(f"rotation {axis}" for axis in axes))
    }[kinematics.rotations]  # fmt: skip


def _check_names(fields: Sequence[Field]) -> None:
    names = [field.name for field in fields]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"The scene has two fields of the name {name!r}; rename one of them.")


def _pressure_element(elements: Discretisation, cell: str) -> Any:
    if elements.pressure_on(cell) == "discontinuous":
        return basix.ufl.element("DPC", cell, 1, discontinuous=True)
    return basix.ufl.element("Lagrange", cell, 1)


def _softness(material: Material, scales: Scales) -> float:
    return scales.stress / material.elastic.shear_modulus()


def _permittivity(material: Material, scales: Scales) -> float:
    return material.dielectric.permittivity() / scales.permittivity
