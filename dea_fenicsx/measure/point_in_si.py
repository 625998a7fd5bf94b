"""The fields at a place of the body as a user writes with them: symbolic, and in SI units."""

from __future__ import annotations

from typing import Any

import ufl

from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support.errors import InputError


class PointInSI:
    """The fields at a place of the body, symbolic, in SI units.

    Vectors and tensors have three axes in all kinematics: x, y, z, or r, hoop, z.  Only `X` and `u`
    have the components of the mesh and of the displacement.

    Parameters
    ----------
    problem, kernel
        The problem, and the number of the kernel whose regions hold the place.
    """

    def __init__(self, problem: Problem, kernel: int) -> None:
        self._problem, self._at = problem, problem.states[kernel]

    def _times(self, value: Any, unit: float) -> Any:
        return self._at.constant(unit) * value

    @property
    def X(self) -> Any:
        """Undeformed position in m."""
        x = ufl.SpatialCoordinate(self._problem.mesh)
        return self._times(x, self._problem.scales.length)

    @property
    def u(self) -> Any:
        """Displacement in m."""
        return self._times(self._at.fields["u"], self._problem.scales.length)

    @property
    def F(self) -> Any:
        """Deformation gradient from the mesh as it is, 3 x 3."""
        return self._at.F

    @property
    def J(self) -> Any:
        """Volume per undeformed volume, det F."""
        return self._at.J

    @property
    def total(self) -> Any:
        """F times the pre-stretch, 3 x 3: what the material has undergone."""
        return self._at.total

    @property
    def E(self) -> Any:
        """True electric field in V/m, three components; 0 where there is no dielectric."""
        return self._times(self._at.true_field, self._problem.scales.field)

    @property
    def potential(self) -> Any:
        """Electric potential in V.

        Raises
        ------
        InputError
            If the scene has no electrodes.
        """
        if self._problem.potential is None:
            raise InputError("An Expression of the potential needs a scene with electrodes.")
        return self._times(self._at.fields["phi"], self._problem.scales.potential)

    @property
    def stress(self) -> Any:
        """Cauchy stress in Pa, electrostatic part included, 3 x 3."""
        return self._times(self._at.cauchy_stress, self._problem.scales.stress)

    @property
    def strain_energy(self) -> Any:
        """Elastic energy per undeformed volume in J/m^3, as in `Energy("elastic")`."""
        terms = (t for t in self._problem.forms.terms if t.stored_as == "elastic")
        found = [t.stored(self._at) for t in terms if t.lives_on(self._at.kernel)]
        total = sum(one for one in found if one is not None)
        return self._times(total, self._problem.scales.stress)
