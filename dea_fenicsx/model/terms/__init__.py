"""Terms of the energy and of the virtual work: each a class in a file of its own.

A term says on which kernels it lives, whether its tangent is symmetric, whether it couples unknowns
of different cells, and which history it keeps.  `terms_of` is the list of those of a scene: the
terms of this room, and those that conditions declare as `AddedPhysics`.  The virtual work of loads
on surfaces is in `scene.declarations` and `model.loads`.
"""

from dea_fenicsx.materials import ViscousBranch
from dea_fenicsx.model.terms.air import AirElasticity, ShapeOfAir
from dea_fenicsx.model.terms.augmentation import Augmentation
from dea_fenicsx.model.terms.base import EnergyTerm, Term, WorkTerm
from dea_fenicsx.model.terms.dielectric import DielectricEnergy
from dea_fenicsx.model.terms.elastic import Elasticity
from dea_fenicsx.model.terms.flowing import Flowing
from dea_fenicsx.model.terms.incompressibility import Volume
from dea_fenicsx.model.terms.leak import AlikeLeak, MixedLeak
from dea_fenicsx.model.terms.membrane import (
    ReferenceTension,
    WrinkledDielectric,
    WrinkledElasticity,
)
from dea_fenicsx.model.terms.relaxation import DielectricRelaxation
from dea_fenicsx.model.terms.softening import Softening
from dea_fenicsx.model.terms.viscous import Viscous
from dea_fenicsx.scene.scene import Scene

__all__ = ["EnergyTerm", "Term", "WorkTerm", "terms_of"]


def terms_of(scene: Scene) -> list[Term]:
    """The terms of a scene, in the order in which they are added up."""
    augmentation = Augmentation(scene.elements.augmentation)
    found: list[Term] = [Elasticity(), Volume(), augmentation, DielectricEnergy(), Viscous()]
    if any(m.damage is not None for m in scene.materials.values()):
        found.append(Softening())
    if scene.kinematics.is_membrane:
        found.append(ReferenceTension())
    if scene.kinematics.wrinkles:
        slack = scene.kinematics.residual_stiffness
        found += [WrinkledElasticity(slack), WrinkledDielectric(slack)]
    if scene.solids and len(scene.solids) < len(scene.materials):
        found += [AirElasticity(), ShapeOfAir()]
    if scene.leaks:
        found.append(AlikeLeak() if scene.leaks_alike else MixedLeak())
        if any(m.is_dielectric and m.dielectric.relaxation_terms() for m in
               scene.materials.values()):  # fmt: skip
            found.append(DielectricRelaxation())
    branches = [branch for m in scene.materials.values() for branch in m.viscous]
    if flowing := [branch for branch in branches if isinstance(branch, ViscousBranch)]:
        found.append(Flowing(all(branch.is_variational for branch in flowing)))
    return [*found, *(term for added in scene.declared.added for term in added.terms)]
