"""Rubber that softens by its largest energy so far, against its law in closed form."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import block

import dea_fenicsx as dea
from dea_fenicsx import exact
from dea_fenicsx.materials.stretches import nominal_stress, taylor

pytestmark = pytest.mark.usefixtures("quick_compile")
LAW = dea.OgdenRoxburgh(r=1.6, m=8e3, beta=0.1)
GENT = dea.Gent(5e4, 80.0)
RUBBER = dea.Material(GENT, dea.IdealDielectric(4.7), damage=LAW)
TIGHT = dea.NewtonOptions(tolerance=1e-12)
TOP = 2.2


def strip(material, path, device=None, volts=0.0):
    """A strip in plane strain whose length is prescribed; stretch 2.2 at factor 1."""
    held = [dea.Fix("x_min", "x"), dea.Fix("bottom", "y")]
    scene = dea.Scene(
        device or block((2, 2)), {"film": material}, [dea.Electrode("top", volts),
        dea.Ground("bottom")], held, [dea.Stretch("x_max", "x", TOP)],
        kinematics=dea.PlaneStrain(),
    )  # fmt: skip
    record = {
        "F": dea.Reaction("x_max", "x"), "lost": dea.DamageLoss(), "stored": dea.Energy("elastic")
    }  # fmt: skip
    return dea.solve(scene, path, record, quiet=True, options=TIGHT)


def undamaged(stretch):
    """Energy in Pa and nominal stress in Pa in planar tension."""
    e = np.log([stretch, 1.0, 1 / stretch])
    return float(taylor(GENT, e)[0]), float(nominal_stress(GENT, "planar", np.array([stretch]))[0])


def eta(energy, peak):
    return 1 - math.erf((peak - energy) / (LAW.m + LAW.beta * peak)) / LAW.r


def factor(stretch):
    return (stretch - 1) / (TOP - 1)


CYCLE = [
    dea.Ramp("stretch", factor(1.8), steps=3), dea.Ramp("stretch", factor(1.3), steps=2),
    dea.Ramp("stretch", factor(1.6), steps=2), dea.Ramp("stretch", 1.0, steps=4),
    dea.Ramp("stretch", factor(1.5), steps=2),
]  # fmt: skip


@pytest.fixture(scope="module")
def cycle():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DEA_FENICSX_CFLAGS", "-O1 -g0")
        return strip(RUBBER, CYCLE).history


def states(history):
    """Stretch, largest stretch so far, and row of each step."""
    peak = 1.0
    for row in history:
        stretch = 1 + row["stretch_factor"] * (TOP - 1)
        peak = max(peak, stretch)
        yield stretch, peak, row


def test_stress_of_a_cycle_is_that_of_the_law(cycle):
    """eta times that of the undamaged rubber, at each of 13 states; force per 1 m of depth."""
    for stretch, peak, row in states(cycle):
        energy, stress = undamaged(stretch)
        by_hand = eta(energy, undamaged(peak)[0]) * stress * 1e-3
        assert abs(float(row["F_N"])) == pytest.approx(by_hand, rel=1e-8, abs=1e-9)


def test_unloading_is_softer_than_loading(cycle):
    found = {round(s, 9): float(row["F_N"]) for s, p, row in states(cycle) if s < p - 1e-9}
    assert len(found) >= 5
    for stretch, force in found.items():
        assert abs(force) < 0.95 * undamaged(stretch)[1] * 1e-3


def test_what_is_lost_never_comes_back(cycle):
    """It grows with the largest energy alone, and loss and stored energy are the work done."""
    before = 0.0
    for stretch, peak, row in states(cycle):
        energy, top = undamaged(stretch)[0], undamaged(peak)[0]
        assert float(row["lost_J"]) >= before - 1e-14
        before = float(row["lost_J"])
        size = LAW.m + LAW.beta * top
        x = top / size
        grown = x * math.erf(x) + (math.exp(-x * x) - 1) / math.sqrt(math.pi)
        assert before == pytest.approx(size / LAW.r * grown * 1e-6, rel=1e-8, abs=1e-15)
        if stretch == peak:  # all the work of the first loading, which no unloading has reduced
            done = before + float(row["stored_J"])
            assert done == pytest.approx(energy * 1e-6, rel=1e-8, abs=1e-15)


def test_loss_of_a_cycle_is_the_area_of_its_loop():
    """From rest to a largest energy and back, by quadrature of the stress in closed form."""
    from scipy.integrate import quad

    top = undamaged(TOP)[0]

    def gap(stretch):
        energy, stress = undamaged(stretch)
        return (1 - eta(energy, top)) * stress

    size = LAW.m + LAW.beta * top
    x = top / size
    lost = size / LAW.r * (x * math.erf(x) + (math.exp(-x * x) - 1) / math.sqrt(math.pi))
    assert quad(gap, 1.0, TOP, epsabs=1e-10)[0] == pytest.approx(lost, rel=1e-9)


def test_states_do_not_depend_on_the_number_of_steps(cycle):
    path = [replace(ramp, steps=1) for ramp in CYCLE]
    assert float(strip(RUBBER, path)["F_N"]) == pytest.approx(float(cycle[-1]["F_N"]), rel=1e-9)


def test_film_under_voltage_after_a_first_pull():
    """Dead load up and down, then voltage: the exact film of the softened rubber."""
    held = [dea.Fix("x_min", "x"), dea.Fix("bottom", "y")]
    scene = dea.Scene(
        block((2, 2)), {"film": RUBBER}, [dea.Electrode("top", 1.2e4), dea.Ground("bottom")], held,
        loads=[dea.DeadLoad("x_max", (6e4, 0.0))], kinematics=dea.PlaneStrain(),
    )  # fmt: skip
    path = [
        dea.Ramp("load", 1.0, steps=3), dea.Ramp("load", 0.2, steps=3), dea.Ramp("voltage", steps=2)
    ]  # fmt: skip
    record = {"x": dea.MeanStretch(("x_min", "x_max"), "x")}
    run = dea.solve(scene, path, record, quiet=True, options=TIGHT)
    peak = undamaged(first_stretch())[0]
    film = exact.Film(RUBBER.softened(peak), 1e-3, exact.Dead(1.2e4), exact.Held(1.0))
    (state, _), *_ = exact.trace(film, 4.0).states_at(1.2e4)
    assert float(run["x"]) == pytest.approx(state.stretches[0], rel=1e-8)


def first_stretch():
    """Stretch of the undamaged film under 60 kPa."""
    from scipy.optimize import brentq

    return brentq(lambda s: undamaged(s)[1] - 6e4, 1.01, 4.0, xtol=1e-14)


def test_law_of_a_softened_rubber_is_checked():
    """Rest, moduli, stress and tangent, below the largest energy."""
    found = dea.check_law(RUBBER.softened(2e5).elastic)
    assert found.tangent_order > 1.95


BAD = {
    "r": (dict(r=0.9, m=1e3), "r of OgdenRoxburgh is 0.9"),
    "m": (dict(r=2.0, m=0.0), "m is 0.0, but must be a finite number > 0"),
    "beta": (dict(r=2.0, m=1.0, beta=-1.0), "beta of OgdenRoxburgh is -1.0"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_constants_are_refused(case):
    given, words = BAD[case]
    with pytest.raises(dea.InputError, match=words):
        strip(replace(RUBBER, damage=dea.OgdenRoxburgh(**given)), [])


def test_a_material_without_damage_does_not_soften():
    with pytest.raises(dea.InputError, match="give it damage=OgdenRoxburgh"):
        replace(RUBBER, damage=None).softened(1e3)
    with pytest.raises(dea.InputError, match="energy >= 0 in Pa"):
        RUBBER.softened(-1.0)
