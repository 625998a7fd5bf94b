"""Deformation, field and energy at a point of the material, symbolic.

The energy of a problem is stationary; it is

    Pi = int W(F) + p (J - 1) - p^2/(2 kappa) dX - 1/2 int eps J |F^-T E|^2 dX - work of loads

with E = -Grad phi, all dimensionless: lengths in L, stresses in mu, potentials in L sqrt(mu/eps),
where mu and eps are the scales of `Scales`.  Its terms are in `model.terms`.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, NamedTuple

import ufl

from dea_fenicsx.model.electric_point import ElectricPoint
from dea_fenicsx.model.heat import Heated
from dea_fenicsx.model.kernels import BoundDebye, Kernel
from dea_fenicsx.model.tension_field import TensionField
from dea_fenicsx.scene.kinematics import GlobalMotion, Kinematics, StrainOf, cofactor
from dea_fenicsx.scene.kinematics_base import place_of
from dea_fenicsx.support.compat import dolfinx


class Deformation(NamedTuple):
    """The deformation of a device, symbolic and dimensionless; all of its kernels share it.

    Attributes
    ----------
    F, cofactor, J
        Deformation gradient as a variable, its cofactor and its determinant.
    """

    F: Any
    cofactor: Any
    J: Any

    @classmethod
    def of(
        cls, mesh: Any, kinematics: Kinematics, displacement: Any, motion: GlobalMotion | None
    ) -> Deformation:
        """That of a displacement and of what the deformation has beside it, or None."""
        x = ufl.SpatialCoordinate(mesh)
        F = ufl.variable(
            ufl.Identity(3) + kinematics.displacement_gradient(displacement, x, motion)
        )
        return cls(F, *cofactor(F))


class MaterialPoint:
    """Fields of a kernel at a point, symbolic and dimensionless.

    Parameters
    ----------
    mesh, kinematics, kernel
        The mesh, the kinematics and the kernel.
    stress
        Pa in a unit of stress.
    fields
        The fields of the mixed function by name.
    deformed
        The deformation.
    motion
        What it has beside its fields, or None.

    Attributes
    ----------
    kernel
        The kernel.
    F, J, cofactor
        Deformation gradient, its determinant and cofactor, from the mesh as it is.
    total
        F times the pre-stretch: what the material has undergone.
    heated
        The factors of its temperature.
    elastic_F, elastic_J
        What strains the material beyond its unloaded state at its temperature: `total` (in a
        region with a bulk modulus F) and J without the thermal expansion.
    swelling
        Volume of the unloaded material at its temperature per volume of the mesh.
    stretch_factors
        Factor of each ramp of a pre-stretch, as a variable.
    strain
        What an elastic model needs to know of the deformation.
    p
        The pressure.
    per_stress
        One over the unit of stress, as a constant of the form, not of the code.
    energy
        Energy per undeformed volume: the sum of all terms, which `Forms` adds up.
    """

    energy: Any

    def __init__(
        self,
        mesh: Any,
        kinematics: Kinematics,
        kernel: Kernel,
        stress: float,
        fields: Mapping[str, Any],
        deformed: Deformation,
        motion: GlobalMotion | None = None,
    ) -> None:
        self.kernel, self.fields = kernel, fields
        self._mesh, self._kinematics, self._motion = mesh, kinematics, motion
        self._x = ufl.SpatialCoordinate(self._mesh)
        self.F, self.cofactor, self.J = deformed
        if kernel.is_membrane:  # by its thickness stretch
            self.J = self.constant(1.0)
        self._heating: dict[str, Any] = {}
        self.stretch_factors = {r: ufl.variable(t) for r, (t, _) in kernel.prestretch.items()}
        self.total = self._stretched(self.F)
        self.heated = Heated(kernel.heat)
        if self.heated.factor is not None:
            assert kernel.heat is not None and kernel.heat.ramp is not None
            self._heating = {kernel.heat.ramp: self.heated.factor}
        self.per_stress = self.constant(1 / stress)
        scale = 1 if kernel.is_incompressible or kernel.is_foam else self.J ** (-2 / 3)
        place = place_of(kinematics, self._x)
        self.elastic_F = self.total if kernel.is_incompressible else self.F
        self.elastic_J, self.swelling = self.J, 1.0
        if self.heated.swells:
            self.swelling = self.heated.stretch**3
            self.elastic_F = self.elastic_F / self.heated.stretch
            self.elastic_J = self.J / self.swelling
        # the volume-preserving part knows nothing of an expansion
        strained = self.F if kernel.kappa is not None and not kernel.is_foam else self.elastic_F
        self.strain = StrainOf(strained, scale, place, self.constant(kernel.length))
        self.p = fields["p"]

    def constant(self, value: float) -> Any:
        """A number as a constant of the form, so that another value needs no compilation."""
        return dolfinx.fem.Constant(self._mesh, value)

    def _stretched(self, F: Any) -> Any:
        """F times the pre-stretch, whose determinant is 1: volumes and J are those of the mesh."""
        if not self.stretch_factors:
            return F
        powers = [
            sum(self.stretch_factors[ramp] * logs[i]
                for ramp, (_, logs) in self.kernel.prestretch.items())
            for i in range(3)
        ]  # fmt: skip
        stretch = ufl.diag(ufl.as_vector([ufl.exp(power) for power in powers]))
        film = self._kinematics.film
        if film is not None and (turn := film.frame(self._x)) is not None:
            stretch = ufl.dot(ufl.dot(turn, stretch), ufl.transpose(turn))
        return ufl.dot(F, stretch)

    @property
    def prestretch(self) -> Any:
        """The pre-stretch, 3 x 3, symmetric."""
        return self._stretched(ufl.Identity(3))

    def gradient_of_change(self, change: Any) -> Any:
        """The change of F with that of the displacement, a vector; 3 x 3.

        F is linear in the displacement beside a part that does not depend on it.
        """
        there, back = (
            self._kinematics.displacement_gradient(sign * change, self._x, self._motion)
            for sign in (1, -1)
        )
        return (there - back) / 2

    @cached_property
    def cofactor_field(self) -> Any:
        """J F^-T E with E = -Grad phi: J times the true field."""
        return self._pulled(self.nominal_field)

    def _pulled(self, nominal: Any) -> Any:
        """J times the true field of a nominal field."""
        if self.kernel.is_membrane:  # E is along N, and cof(F) N = F N/|F N|^2
            through = ufl.dot(self.F, self.normal)
            return ufl.dot(nominal, self.normal) / ufl.dot(through, through) * through
        return ufl.dot(self.cofactor, nominal)

    @cached_property
    def electric(self) -> ElectricPoint:
        """What the dielectric needs to know of strain and field."""
        return ElectricPoint(self, self.cofactor_field)

    def displacement_of(self, potential: Any) -> Any:
        """Nominal displacement of another potential at the present deformation.

        Where displacement and field are not proportional, it is the change of the displacement
        with that of the potential at the present field.
        """
        field = -self._kinematics.gradient(potential, self._x, self._motion)
        law = self.kernel.electric
        assert law is not None
        if law.is_linear:
            return ElectricPoint(self, self._pulled(field)).displacement
        present = ufl.variable(self.nominal_field)
        there = ElectricPoint(self, self._pulled(present)).displacement
        return ufl.dot(ufl.diff(there, present), field)

    @property
    def nominal_field(self) -> Any:
        """E = -Grad phi, whose flux lines are those of the undeformed body."""
        return -self._kinematics.gradient(self.fields["phi"], self._x, self._motion)

    @property
    def displacement_field(self) -> Any:
        """Nominal electric displacement: charge per undeformed area."""
        return self.electric.displacement

    def polarisation(self, term: BoundDebye) -> Any:
        """Nominal polarisation of a term of dielectric relaxation."""
        return term.history + term.share * term.eps / self.kernel.eps * self.displacement_field

    @property
    def true_field(self) -> Any:
        """The true electric field F^-T E; 0 where no field lives."""
        return ufl.zero(3) if self.kernel.eps is None else self.cofactor_field / self.J

    @cached_property
    def tension_field(self) -> TensionField:
        """The relaxed state of a membrane that wrinkles."""
        return TensionField(self)

    @property
    def widening(self) -> Any:
        """Charge of a film with its wrinkles over that of its surface without them."""
        kept = self.constant(self._kinematics.residual_stiffness)
        before = ufl.dot(self.prestretch, self.normal)
        through = ufl.dot(self.F, self.normal)
        ahead, across = self.tension_field.squares
        wider = ahead * across * ufl.dot(before, before) * ufl.dot(through, through)
        return ufl.conditional(self.tension_field.taut, 1.0, kept + (1 - kept) * wider)

    @property
    def relaxable(self) -> Any:
        """Positive where a membrane that wrinkles has a relaxed energy; None of all else."""
        return self.tension_field.relaxable if self._kinematics.wrinkles else None

    @property
    def chain_margin(self) -> Any:
        """Distance to the lock-up of chains; 1 where there is none."""
        margin = self.kernel.elastic.chain_margin(self.strain)
        return ufl.as_ufl(1.0) if margin is None else margin

    @cached_property
    def rates(self) -> dict[str, Any]:
        """Derivatives of the energy by the factors of pre-stretches and of temperatures."""
        return {ramp: ufl.diff(self.energy, t) for ramp, t in self.strain_factors.items()}

    @property
    def strain_factors(self) -> dict[str, Any]:
        """Factor of each ramp of a pre-stretch or of a temperature, as a variable."""
        return {**self.stretch_factors, **self._heating}

    @property
    def cauchy_stress(self) -> Any:
        """True stress J^-1 (dPi/dF) F^T, electrostatic part included.

        That of a membrane has in addition the pressure with which its faces bear no stress.
        """
        found = ufl.dot(ufl.diff(self.energy, self.F), ufl.transpose(self.F)) / self.J
        if not self.kernel.is_membrane:
            return found
        through = ufl.dot(self.F, self.normal)
        faces = ufl.dot(through, ufl.dot(found, through)) / ufl.dot(through, through)
        return found - faces * ufl.Identity(3)

    @property
    def normal(self) -> Any:
        """Undeformed unit normal N of a membrane; the length of F N is its thickness stretch."""
        return self._kinematics.film.unit_normal(self._x)
