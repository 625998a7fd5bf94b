"""What softening by the largest energy so far takes off the elastic energy."""

from __future__ import annotations

from typing import Any

import ufl

from dea_fenicsx.model.kernels import Kernel
from dea_fenicsx.model.material_point import MaterialPoint
from dea_fenicsx.model.terms.base import EnergyTerm


class Softening(EnergyTerm):
    """Energy with the slope eta dW/dF, less W, with the largest energy before this step.

    See `materials.damage.OgdenRoxburgh`.  On the way to a new largest energy it has no slope.
    """

    name = "softening"
    stored_as = "elastic"
    history = ("damage",)

    def lives_on(self, kernel: Kernel) -> bool:
        return kernel.damage is not None

    def density(self, at: MaterialPoint) -> Any:
        assert at.kernel.damage is not None
        energy, law = at.kernel.elastic.energy(at.strain), at.kernel.damage.law
        softer = law.energy(at.strain, energy, at.kernel.damage.peak)
        return _unit(at) * (softer - energy)

    def stored(self, at: MaterialPoint) -> Any:
        """What of the elastic energy is lost for good at a new largest energy, or not yet back."""
        assert at.kernel.damage is not None
        energy, law = at.kernel.elastic.energy(at.strain), at.kernel.damage.law
        return _unit(at) * (law.energy(at.strain, energy, _largest(at, energy)) - energy)


def lost(at: MaterialPoint) -> Any:
    """Energy that softening has taken for good, per undeformed volume in units of stress."""
    assert at.kernel.damage is not None
    energy = at.kernel.elastic.energy(at.strain)
    return _unit(at) * at.kernel.damage.law.lost(at.strain, _largest(at, energy))


def _largest(at: MaterialPoint, energy: Any) -> Any:
    """The largest energy with that of the present state."""
    assert at.kernel.damage is not None
    before = at.kernel.damage.peak
    return ufl.conditional(ufl.gt(energy, before), energy, before)


def _unit(at: MaterialPoint) -> Any:
    return at.per_stress * at.heated.modulus * at.swelling
