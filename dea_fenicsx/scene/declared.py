"""All declarations of a scene, gathered once and sorted by their kind.

The checks of a scene and the parts of the model take from here what each of them needs, so that
none asks the conditions by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

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
    HeldRigidMotions,
    InitialStretch,
    RigidAngle,
    RigidMoment,
    RigidSurface,
    SheetResistance,
    SurfaceWork,
)
from dea_fenicsx.scene.electrodes import Conducting
from dea_fenicsx.scene.periodic import MeanGradient, PeriodicFaces


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
    fixed_globals, global_forces
        Values of global unknowns, and what does work on such unknowns, each with its condition.
    surface_works
        Loads on surfaces, each with its condition.
    rigid_surfaces, rigid_angles, rigid_moments
        Rigid parts, the angles by which they are turned, and the moments on them.
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
    """

    told: Told
    displacements: list[tuple[Condition, FixedDisplacement]]
    holds_rigid_motions: bool
    initial_stretches: list[InitialStretch]
    fixed_globals: list[tuple[Condition, FixedGlobal]]
    global_forces: list[tuple[Condition, GlobalForce]]
    surface_works: list[tuple[Condition, SurfaceWork]]
    rigid_surfaces: list[RigidSurface]
    rigid_angles: list[RigidAngle]
    rigid_moments: list[RigidMoment]
    periodic_faces: list[PeriodicFaces]
    mean_gradients: list[MeanGradient]
    potentials: list[tuple[Conducting, FixedPotential]]
    floating: list[tuple[Conducting, FloatingPotential]]
    added: list[AddedPhysics]
    fillings: list[Filling]
    sheets: list[tuple[Conducting, SheetResistance]]
    contacts: list[tuple[Condition, UnilateralContact]]


def gathered(scene: Setting) -> Declared:
    """Ask each condition of a checked scene for its declarations, once."""
    conditions: tuple[Condition, ...] = (*scene.prescribed, *scene.supports, *scene.loads)
    told = [(item, one) for item in conditions for one in item.declarations(scene)]
    electric = [(item, one) for item in scene.electrodes for one in item.declarations(scene)]

    def of[D: Declaration](kind: type[D]) -> list[D]:
        return [one for _, one in of_kind(told, kind)]

    return Declared(
        told=told,
        displacements=of_kind(told, FixedDisplacement),
        holds_rigid_motions=bool(of(HeldRigidMotions)),
        initial_stretches=of(InitialStretch),
        fixed_globals=of_kind(told, FixedGlobal),
        global_forces=of_kind(told, GlobalForce),
        surface_works=of_kind(told, SurfaceWork),
        rigid_surfaces=of(RigidSurface),
        rigid_angles=of(RigidAngle),
        rigid_moments=of(RigidMoment),
        periodic_faces=of(PeriodicFaces),
        mean_gradients=of(MeanGradient),
        potentials=[(e, one) for e, one in electric if isinstance(one, FixedPotential)],
        floating=[(e, one) for e, one in electric if isinstance(one, FloatingPotential)],
        added=of(AddedPhysics),
        fillings=of(Filling),
        sheets=[(e, one) for e, one in electric if isinstance(one, SheetResistance)],
        contacts=of_kind(told, UnilateralContact),
    )
