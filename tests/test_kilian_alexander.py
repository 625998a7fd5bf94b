"""The energies of Kilian and of Alexander by hand, by `check_law`, and in elements."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import on_demand
from test_fibres import taylor_order
from test_homogeneous_all_models import KERNELS, run

import dea_fenicsx as dea
from dea_fenicsx.exact import Dead, Film, Held, trace
from dea_fenicsx.materials.stretches import nominal_stress
from dea_fenicsx.scene.kinematics import PlaneStrain, ThreeD

pytestmark = pytest.mark.usefixtures("quick_compile")
KILIAN = dea.VanDerWaals(5e4, 8.0, 0.25, 0.1)
ALEXANDER = dea.Alexander(2e4, 1.5e4, 1e3, 2e-4, 0.8)
LAWS = {"Kilian": KILIAN, "Alexander": ALEXANDER}
STRETCH = np.array([0.6, 1.3, 2.5, 5.0])


def slopes(name, I1, I2):
    """dW/dI1 and dW/dI2."""
    if name == "Alexander":
        return 2e4 * np.exp(2e-4 * (I1 - 3) ** 2), 1.5e4 / (I2 - 3 + 0.8) + 1e3
    x = 0.9 * (I1 - 3) + 0.1 * (I2 - 3)
    z = np.sqrt(x / 61)
    slope = 5e4 / 2 * (1 / (1 - z) - 0.25 * np.sqrt(x / 2))
    return 0.9 * slope, 0.1 * slope


@pytest.mark.parametrize("name", LAWS)
def test_uniaxial_stress_by_hand(name):
    I1, I2 = STRETCH**2 + 2 / STRETCH, 2 * STRETCH + STRETCH**-2
    first, second = slopes(name, I1, I2)
    by_hand = 2 * (STRETCH - STRETCH**-2) * (first + second / STRETCH)
    due = 1e-6 if name == "Kilian" else 1e-12  # see `materials.kilian.ROOT_OFFSET`
    assert nominal_stress(LAWS[name], "uniaxial", STRETCH) == pytest.approx(by_hand, rel=due)


@pytest.mark.parametrize("name", LAWS)
def test_law_is_checked(name):
    assert dea.check_law(LAWS[name]).tangent_order > 1.95


@on_demand
@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("loads", [(2e4, 1e4, 5e3), (4e3, 4e3, 1.2e4)])
@pytest.mark.parametrize("kinematics, cell", KERNELS)
def test_elements_are_the_film(name, loads, kinematics, cell):
    """Under dead loads and a voltage; the field is along the last axis of the mesh."""
    first, second, volts = loads
    if not isinstance(kinematics, ThreeD):
        second = first
    stretches, charge, problem = run(kinematics, cell, LAWS[name], first, second, volts)
    side = Held(1.0) if isinstance(kinematics, PlaneStrain) else Dead(second)
    material = dea.Material(LAWS[name], dea.IdealDielectric(4.7))
    film = Film(material, 1e-3, Dead(first), side)
    exact = next(s for s, stable in trace(film).states_at(volts) if stable)
    three = isinstance(kinematics, ThreeD)
    expected = exact.stretches if three else exact.stretches[[0, 2]]
    assert abs(expected[0] - 1) > 0.02
    assert np.abs(stretches - expected).max() < 1e-8
    if first > 1e4:  # third derivatives of Kilian's law have no bound at rest
        order, _ = taylor_order(problem)
        assert order == pytest.approx(2, abs=0.1)


BAD = {
    "mu": (dea.VanDerWaals(-1.0, 8.0, 0.2), "mu is -1.0"),
    "lam_m": (dea.VanDerWaals(1e4, 1.5, 0.2), "must be a finite number > sqrt"),
    "beta": (dea.VanDerWaals(1e4, 8.0, 0.2, 2.0), "beta is 2.0"),
    "gamma": (dea.Alexander(1e4, 0.0, 0.0, 0.0, 0.0), "gamma is 0.0"),
    "k": (dea.Alexander(1e4, 0.0, 0.0, -1.0, 1.0), "k is -1.0"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_constants_are_told(case):
    law, words = BAD[case]
    assert words in law.faults()[0]
