"""All declarations of a scene, gathered once and sorted by their kind.

The checks of a scene and the parts of the model take from here what each of them needs, so that
none asks the conditions by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

from dea_fenicsx.scene.body_forces import BodyWork, WeightWork
from dea_fenicsx.scene.cavity import Filling
from dea_fenicsx.scene.condition import Condition, Setting, Told, of_kind
from dea_fenicsx.scene.contact_declarations import UnilateralContact
from dea_fenicsx.scene.declarations import (
    AddedPhysics,
    Declaration,
    FixedDisplacement,
    FixedGlobal,
    FixedPotential,
    FloatingPotential,
    GlobalForce,
    HeatedRegions,
    HeldRigidMotions,
    InitialStretch,
    SheetResistance,
    SurfaceWork,
)
from dea_fenicsx.scene.electrodes import Conducting
from dea_fenicsx.scene.graded import GradedConstant
from dea_fenicsx.scene.part_declarations import (
    RigidAngle,
    RigidForce,
    RigidMoment,
    RigidShift,
    RigidSurface,
)
from dea_fenicsx.scene.periodic import MeanGradient, PeriodicFaces
from dea_fenicsx.scene.springs import SpringForce


@dataclass(frozen=True, eq=False)
class Declared:
    """What the conditions of a scene declare, in the order of the scene.

    Attributes
    ----------
    told
        All declarations but those of the electrodes, each with its condition; prescribed motions
        come first, then supports, then loads.
    displacements
        Displacements on facet groups, each with its condition; prescribed ones come first.
    holds_rigid_motions
        Whether the rigid motions that all else leaves free are held.
    initial_stretches
        Stretches that regions had undergone.
    heated
        Regions that are brought to a temperature.
    fixed_globals, global_forces
        Values of global unknowns, and what does work on such unknowns, each with its condition.
    surface_works
        Loads on surfaces, each with its condition.
    body_works, springs
        Body forces, and springs on rigid parts.
    rigid_surfaces, rigid_angles, rigid_shifts
        Rigid parts, the angles by which they are turned, and the displacements of their centres.
    rigid_moments, rigid_forces
        The moments and the forces on rigid parts, weights of attached bodies included.
    periodic_faces, mean_gradients
        Periodic faces, and what is prescribed of their mean strains.
    potentials, floating
        Electrodes of given and of unknown potential, each with its declaration.
    added
        Fields and terms beyond those that every problem has.
    fillings
        Cavities and what they hold.
    sheets
        Electrodes with a resistance along their surface, each with its declaration.
    contacts
        Surfaces that may touch an obstacle, each with its condition.
    graded
        Constants of materials that vary with the place.
    """

    told: Told
    displacements: list[tuple[Condition, FixedDisplacement]]
    holds_rigid_motions: bool
    initial_stretches: list[InitialStretch]
    heated: list[HeatedRegions]
    fixed_globals: list[tuple[Condition, FixedGlobal]]
    global_forces: list[tuple[Condition, GlobalForce]]
    surface_works: list[tuple[Condition, SurfaceWork]]
    body_works: list[BodyWork]
    springs: list[SpringForce]
    rigid_surfaces: list[RigidSurface]
    rigid_angles: list[RigidAngle]
    rigid_shifts: list[RigidShift]
    rigid_moments: list[RigidMoment]
    periodic_faces: list[PeriodicFaces]
    mean_gradients: list[MeanGradient]
    rigid_forces: list[RigidForce]
    potentials: list[tuple[Conducting, FixedPotential]]
    floating: list[tuple[Conducting, FloatingPotential]]
    added: list[AddedPhysics]
    fillings: list[Filling]
    sheets: list[tuple[Conducting, SheetResistance]]
    contacts: list[tuple[Condition, UnilateralContact]]
    graded: list[GradedConstant]


def gathered(scene: Setting) -> Declared:
    """Ask each condition of a checked scene for its declarations, once."""
    conditions: tuple[Condition, ...] = (*scene.prescribed, *scene.supports, *scene.loads)
    told = _moved_parts([(item, one) for item in conditions for one in item.declarations(scene)])
    electric = [(item, one) for item in scene.electrodes for one in item.declarations(scene)]

    def of[D: Declaration](kind: type[D]) -> list[D]:
        return [one for _, one in of_kind(told, kind)]

    return Declared(
        told=told,
        displacements=of_kind(told, FixedDisplacement),
        holds_rigid_motions=bool(of(HeldRigidMotions)),
        initial_stretches=of(InitialStretch),
        heated=of(HeatedRegions),
        fixed_globals=of_kind(told, FixedGlobal),
        global_forces=of_kind(told, GlobalForce),
        surface_works=of_kind(told, SurfaceWork),
        body_works=of(BodyWork),
        springs=of(SpringForce),
        rigid_surfaces=of(RigidSurface),
        rigid_angles=of(RigidAngle),
        rigid_shifts=of(RigidShift),
        rigid_moments=of(RigidMoment),
        periodic_faces=of(PeriodicFaces),
        mean_gradients=of(MeanGradient),
        rigid_forces=[*of(RigidForce), *_weights(told)],
        potentials=[(e, one) for e, one in electric if isinstance(one, FixedPotential)],
        floating=[(e, one) for e, one in electric if isinstance(one, FloatingPotential)],
        added=of(AddedPhysics),
        fillings=of(Filling),
        sheets=[(e, one) for e, one in electric if isinstance(one, SheetResistance)],
        contacts=of_kind(told, UnilateralContact),
        graded=of(GradedConstant),
    )


def _weights(told: Told) -> list[RigidForce]:
    """The weights of bodies that are attached to rigid parts."""
    bodies = [one for _, one in told if isinstance(one, RigidSurface) and one.attached]
    return [
        RigidForce(
            one.surface, tuple(one.attached.kilograms * a for a in work.acceleration), work.ramp
        )
        for _, work in told if isinstance(work, WeightWork)
        for one in bodies if one.attached
    ]  # fmt: skip


def _moved_parts(told: Told) -> Told:
    """The declarations, with the displacements that are given to rigid parts as those of parts."""
    parts = {one.surface for _, one in told if isinstance(one, RigidSurface)}

    def of_part(one: Declaration) -> Declaration:
        if not isinstance(one, FixedDisplacement) or one.surface not in parts:
            return one
        if one.ramp is None or one.growth is not None or callable(one.metres):
            return one
        return RigidShift(one.surface, one.axis, one.metres, one.ramp)

    return [(item, of_part(one)) for item, one in told]
