"""Adding a material: the extended tube model that the thesis names, its class and its test."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from dea_fenicsx.materials import IdealDielectric, Material, Strain
from dea_fenicsx.materials.stretches import nominal_stress, taylor


@dataclass(frozen=True)
class ExtendedTube:
    """Kaliske and Heinrich 1999: cross-links Gc of finite length (delta), entanglements Ge."""

    Gc: float
    Ge: float
    delta: float
    beta: float

    def energy(self, s: Strain) -> Any:
        d2, x, room = self.delta * self.delta, s.I1 - 3, self.chain_margin(s)
        links = self.Gc / 2 * ((1 - d2) * x / room + s.ln(room))
        return links + 2 * self.Ge / (self.beta * self.beta) * (s.power_sum(-self.beta) - 3)

    def shear_modulus(self) -> float:
        return self.Gc * (1 - 2 * self.delta * self.delta) + self.Ge

    def spherical_slope(self) -> float:
        return self.Gc * (1 - 2 * self.delta * self.delta) - 2 * self.Ge / self.beta

    def chain_margin(self, s: Strain) -> Any:
        return 1 - self.delta * self.delta * (s.I1 - 3)

    def faults(self) -> list[str]:
        ok = self.Gc > 0 and self.Ge >= 0 and 0 <= self.delta < 0.5 and self.beta > 0
        return [] if ok else [f"{self} needs Gc > 0, Ge >= 0, 0 <= delta < 0.5 and beta > 0"]


def test_extended_tube():
    model = ExtendedTube(Gc=2e5, Ge=1e5, delta=0.1, beta=0.5)
    W, R, H = taylor(model, np.zeros(3))
    assert pytest.approx(0, abs=1e-9) == W
    assert np.allclose(R, model.spherical_slope())
    assert H[0, 0] - H[0, 1] == pytest.approx(2 * model.shear_modulus())
    l = np.array([0.7, 1.5, 3.0])
    x = l**2 + 2 / l - 3
    slope = ((1 - 0.01) / (1 - 0.01 * x) ** 2 - 0.01 / (1 - 0.01 * x)) * 2e5
    by_hand = slope * (l - l**-2) - 4e5 / l * (l**-0.5 - l**0.25)
    assert np.allclose(nominal_stress(model, "uniaxial", l), by_hand, rtol=1e-12)
    assert Material(model, IdealDielectric(3.0)).faults() == []
