"""Foams, the extended tube, the energy from data, and the check of a law of one's own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import ufl
from conftest import ROOT, block, on_demand
from scipy.optimize import brentq
from test_fibres import everything, taylor_order
from test_homogeneous_all_models import KERNELS, run

import dea_fenicsx as dea
from dea_fenicsx import exact
from dea_fenicsx.exact import Dead, Film, Held, trace
from dea_fenicsx.materials import (
    BlatzKo,
    ExtendedTube,
    IdealDielectric,
    Material,
    NeoHookean,
    Ogden,
    OgdenHill,
    SplineEnergy,
    fit,
    read_data,
)
from dea_fenicsx.materials.stretches import nominal_stress, taylor
from dea_fenicsx.scene.kinematics import Axisymmetric, PlaneStrain, ThreeD

pytestmark = pytest.mark.usefixtures("quick_compile")
FOAM = OgdenHill((4e4, 5e3), (2.0, -2.0), (0.3, 0.8))
TESTS = {"uniaxial": "UT", "planar": "PS", "equibiaxial": "ET"}


def treloar():
    folder = ROOT / "demos" / "fit_rubber_data"
    return {
        test: read_data(folder / f"treloar1944_{name}.txt", test, stretch=1, stress=0, unit=1e6)
        for test, name in TESTS.items()
    }


def rms(model, curve):
    """Root mean square error of the nominal stress in Pa."""
    found = nominal_stress(model, curve.test, curve.stretch)
    return float(np.sqrt(np.mean((found - curve.stress) ** 2)))


def meets_the_exact_state(law, kinematics, cell):
    """Stretches and charge to 1e-8, and a tangent of order 2."""
    second = 1e4 if isinstance(kinematics, ThreeD) else 2e4
    held = isinstance(kinematics, PlaneStrain)
    stretches, charge, problem = run(kinematics, cell, law, 2e4, second, 5e3)
    film = Film(
        Material(law, IdealDielectric(4.7)), 1e-3, Dead(2e4), Held(1.0) if held else Dead(second)
    )
    exact = next(s for s, stable in trace(film).states_at(5e3) if stable)
    wanted = exact.stretches if isinstance(kinematics, ThreeD) else exact.stretches[[0, 2]]
    assert abs(wanted[0] - 1) > 0.02
    assert np.abs(stretches - wanted).max() < 1e-8
    area = np.pi * 1e-6 if isinstance(kinematics, Axisymmetric) else 1e-6
    assert charge == pytest.approx(exact.charge * area, rel=1e-8)
    assert taylor_order(problem)[0] == pytest.approx(2, abs=0.1)
    return exact


@pytest.mark.slow
@pytest.mark.parametrize("kinematics, cell", KERNELS[:1] + KERNELS[2:])
def test_foam_is_the_exact_film(kinematics, cell):
    exact = meets_the_exact_state(BlatzKo(5e4), kinematics, cell)
    assert np.prod(exact.stretches) > 1.1


def test_a_foam_alone_rests_and_moves():
    """Its residual is told relative to forces of its own, since it has no pressure."""
    scene = dea.Scene(
        block(), {"film": Material(BlatzKo(5e4))}, supports=[dea.Clamp("bottom")],
        loads=[dea.DeadLoad("top", (0.0, 0.0, 1e3))],
    )  # fmt: skip
    stretch = {"stretch": dea.MeanStretch(("bottom", "top"), "z")}
    run = dea.solve(scene, dea.Ramp(steps=1), stretch, quiet=True)
    assert 1.004 < float(run["stretch"]) < 1 + 1e3 / 125e3  # clamped: stiffer than a free bar


@on_demand
@pytest.mark.parametrize("kinematics, cell", KERNELS)
@pytest.mark.parametrize("law", [FOAM, ExtendedTube(8e4, 4e4, 0.1, 0.5)], ids=["foam", "tube"])
def test_long_energies_are_the_exact_film(law, kinematics, cell):
    meets_the_exact_state(law, kinematics, cell)


@pytest.mark.slow
@pytest.mark.parametrize("kinematics, cell", KERNELS[2:3])
def test_energy_from_data_is_the_exact_film(kinematics, cell):
    """The spline of all of Treloar's data, ten times softer."""
    law = SplineEnergy.from_data(list(treloar().values()))
    first, second = (tuple(x / 10 for x in c) for c in (law.curvature_1, law.curvature_2))
    soft = SplineEnergy(
        law.slope_1 / 10, law.knots_1, first, law.slope_2 / 10, law.knots_2, second
    )  # fmt: skip
    meets_the_exact_state(soft, kinematics, cell)


def test_moduli_of_foams_and_a_bar():
    """A Blatz-Ko bar of stretch l narrows to l^(-1/4) under mu (1 - l^(-5/2)) / sqrt l."""
    for law in (BlatzKo(5e4), FOAM):
        W, R, H = taylor(law, np.zeros(3))
        assert pytest.approx(0, abs=1e-9) == W
        assert np.abs(R).max() < 1e-9
        assert (H[0, 0] - H[0, 1]) / 2 == pytest.approx(law.shear_modulus())
        assert H.sum() / 9 == pytest.approx(law.initial_bulk_modulus())
        assert Material(law).bulk_modulus == law.initial_bulk_modulus()
    bar = Film(Material(BlatzKo(5e4), IdealDielectric(3.0)), 1e-3, Dead(2e4))
    exact = next(s for s, ok in trace(bar).states_at(1.0) if ok)
    long = brentq(lambda l: 5e4 * (1 - l**-2.5) * l**-0.5 - 2e4, 1.0, 2.0)
    assert exact.stretches == pytest.approx([long, long**-0.25, long**-0.25], rel=1e-9)


@pytest.mark.parametrize("left_out", TESTS)
def test_data_of_two_tests_predict_the_third(left_out):
    """Treloar 1944: nearer to the third test than Ogden's three terms from the same two tests."""
    curves = treloar()
    known = [curve for test, curve in curves.items() if test != left_out]
    law = SplineEnergy.from_data(known)
    ogden = fit(Ogden.from_eq76([1e5] * 3, [1.5, 5.0, -2.0]), known, starts=2).model
    own, other = (rms(model, curves[left_out]) for model in (law, ogden))
    assert law.faults() == []
    assert own < 0.75 * other
    assert own < {"uniaxial": 0.6e6, "planar": 0.02e6, "equibiaxial": 0.03e6}[left_out]


def test_energy_from_data_finds_a_neo_hookean_rubber():
    """Exact data of mu/2 (I1 - 3) = 3 mu/2 (x^2 - 1): slope and curvature 3 mu."""
    stretch = np.linspace(1.05, 3, 20)
    curves = [
        dea.materials.TestData(test, stretch, nominal_stress(NeoHookean(5e4), test, stretch))
        for test in TESTS
    ]
    law = SplineEnergy.from_data(curves)
    assert law.slope_1 == pytest.approx(15e4, rel=1e-6)
    assert law.curvature_1 == pytest.approx([15e4] * 5, rel=1e-6)
    assert law.slope_2 < 1e-3
    assert law.shear_modulus() == pytest.approx(5e4, rel=1e-6)


@dataclass(frozen=True)
class Own:
    """mu/2 (I1 - 3) + mu/10 |C - 1|^2, written with UFL."""

    mu: float = np.float32(2.0**15)

    def energy(self, s):
        strain = s.C - ufl.Identity(3)
        return self.mu / 2 * (ufl.tr(s.C) - 3) + self.mu / 10 * ufl.inner(strain, strain)

    def shear_modulus(self):
        return float(self.mu) * 1.4

    def spherical_slope(self):
        return float(self.mu)

    def chain_margin(self, s):
        return None

    def faults(self):
        return []


class Restless(Own):
    def energy(self, s):
        return super().energy(s) + self.mu * (s.I1 - 3)


class Turning(Own):
    def energy(self, s):
        return super().energy(s) + self.mu / 10 * (s.F[0, 1] - s.F[1, 0]) ** 2


class Soft(Own):
    def energy(self, s):
        return super().energy(s) - self.mu * ufl.inner(s.C - ufl.Identity(3), s.C - ufl.Identity(3))


class Misstated(Own):
    def shear_modulus(self):
        return float(self.mu)


@pytest.mark.parametrize("law", [Own(), NeoHookean(5e4), BlatzKo(4e4), everything()])
def test_laws_pass_their_check(law):
    found = dea.check_law(law)
    assert min(found.stress_order, found.tangent_order) > 1.95
    assert found.modulus > 0
    assert (found.numeric is None) == (not isinstance(law, NeoHookean | BlatzKo))


WRONG = {"not at rest": Restless(), "not objective": Turning(), "negative stiffness": Soft(),
         "states the shear modulus": Misstated(), "mu is -1": NeoHookean(-1.0)}  # fmt: skip


@pytest.mark.parametrize("words", WRONG)
def test_a_law_that_is_wrong_is_refused(words):
    with pytest.raises(dea.InputError, match=words) as told:
        dea.check_law(WRONG[words])
    assert len(str(told.value)) <= 400


FLAT = (0.0, 0.0)
BAD = {
    "beta > -1/3|each beta": Material(OgdenHill((4e4,), (2.0,), (-0.5,))),
    "leave it out": Material(BlatzKo(5e4), bulk_modulus=1e6),
    "must rise from 1": Material(SplineEnergy(1.0, (1.0, 1.0), FLAT, 1.0, (1.0, 2.0), FLAT)),
    "must be convex": Material(SplineEnergy(1.0, (1.0, 2.0), (0.0, -1.0), 1.0, (1.0, 2.0), FLAT)),
    "delta is 0.7": Material(ExtendedTube(1e5, 1e5, 0.7, 0.5)),
}  # fmt: skip


@pytest.mark.parametrize("words", BAD)
def test_bad_constants(words):
    faults = BAD[words].faults()
    assert any(word in faults[0] for word in words.split("|"))
    with pytest.raises(dea.InputError):
        nominal_stress(BlatzKo(5e4), "uniaxial", 1.1)


def test_states_of_kept_volume_refuse_foams():
    foam = Material(BlatzKo(5e4), dea.IdealDielectric(4.7))
    for state in (
        lambda: exact.nominal_stress(foam, 1e-3, 1.3, 1.2, voltage=1e3),
        lambda: exact.second_variation(foam, 1.3, 1.2, 100.0),
        lambda: exact.failure_map(foam, 1e-3, 1.2),
        lambda: exact.harvesting_cycle(foam, 1.5, 3.0, 0.05),
        lambda: exact.RoundBalloon(1e-2, 1.2e-2, foam),
    ):
        with pytest.raises(dea.InputError, match="keeps its volume"):
            state()
