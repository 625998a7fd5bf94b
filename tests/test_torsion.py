"""Torsional springs and tabulated force laws, against balances of forces and moments."""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from conftest import block
from scipy.integrate import quad
from scipy.interpolate import PchipInterpolator

import dea_fenicsx as dea

pytestmark = pytest.mark.usefixtures("quick_compile")

MU, H, DEPTH = 5e4, 1e-3, 2e-3
FILM = {"film": dea.Material(dea.NeoHookean(MU))}
EXACT = {"quiet": True, "options": dea.NewtonOptions(tolerance=1e-12)}
ELONGATIONS = np.array([-0.4, -0.1, 0.0, 0.05, 0.2, 0.5]) * H
FORCES = np.array([-0.05, -0.01, 0.0, 0.02, 0.025, 0.06])


def turned(*springs, moment=2e-6, turns="z", kinematics=None, **more):
    """A block on a clamped floor with a rigid lid, on which a moment acts."""
    space = kinematics is None
    return dea.Scene(
        block((1, 1, 1)) if space else block((1, 1)), FILM,
        kinematics=kinematics or dea.ThreeD(),
        supports=[dea.Clamp("bottom"), dea.Rigid("top", turns=turns), *springs],
        loads=[dea.Moment("top", moment)], **more,
    )  # fmt: skip


RECORD = {"a": dea.PartRotation("top"), "E": dea.Energy("springs")}


@pytest.mark.parametrize("kinematics", [None, dea.PlaneStrain(DEPTH)])
def test_the_spring_takes_its_moment(kinematics):
    """With a spring the lid turns as far as it does without one under the rest of the moment."""
    k = 5e-6
    path = dea.Ramp("load", steps=2)
    run = dea.solve(
        turned(dea.TorsionSpring("top", k), kinematics=kinematics), path, RECORD, **EXACT
    )
    angle = run["a_rad"]
    assert abs(angle) > 0.02
    assert run["E_J"] == pytest.approx(k * angle**2 / 2, rel=1e-9)
    rest = turned(moment=2e-6 - k * angle, kinematics=kinematics)
    alone = dea.solve(rest, path, {"a": RECORD["a"]}, **EXACT)
    assert alone["a_rad"] == pytest.approx(angle, rel=1e-9)


@pytest.mark.parametrize("kinematics", [None, dea.PlaneStrain(DEPTH)])
def test_a_torsional_spring_holds_a_device(kinematics):
    """The floor of a block on a hinge with a spring turns by the moment on its lid over k."""
    k, moment = 5e-6, 2e-6
    space = kinematics is None
    scene = dea.Scene(
        block((1, 1, 1)) if space else block((1, 1)), FILM,
        kinematics=kinematics or dea.ThreeD(), supports=[
            dea.Rigid("bottom", held="xyz" if space else "xy", turns="z"),
            dea.Rigid("top", turns="z"), dea.TorsionSpring("bottom", k),
        ], loads=[dea.Moment("top", moment)],
    )  # fmt: skip
    record = {"a": dea.PartRotation("bottom"), "m": dea.PartMoment("bottom")}
    run = dea.solve(scene, dea.Ramp("load", steps=2), record, **EXACT)
    assert run["a_rad"] == pytest.approx(moment / k, rel=1e-9)
    assert run.summary["inertia"] == 0


def test_a_torsional_spring_without_stiffness_holds_nothing():
    scene = dea.Scene(
        block((1, 1)), FILM, kinematics=dea.PlaneStrain(DEPTH),
        supports=[dea.Rigid("bottom", held="xy"), dea.TorsionSpring("bottom", lambda a: a**3)],
        loads=[dea.DeadLoad("top", (1.0, 0.0))],
    )  # fmt: skip
    with pytest.raises(dea.InputError, match="can move freely: rotation"):
        dea.solve(scene, dea.Ramp("load", steps=1), {}, **EXACT)


def test_a_strained_torsional_spring():
    """Between two parts the difference of the angles counts, less the angle without moment."""
    k, rest = 5e-6, 0.3

    def run(*springs, loads=()):
        scene = dea.Scene(
            block((1, 1)), FILM, kinematics=dea.PlaneStrain(DEPTH), loads=loads,
            supports=[dea.Rigid("bottom", held="xy"), dea.Rigid("top"), *springs],
            prescribed=[dea.Turn("bottom", 0.1)],
        )  # fmt: skip
        path = dea.Ramp(("spring" if springs else "load", "turn"), steps=2)
        return dea.solve(scene, path, {"a": RECORD["a"]}, **EXACT)["a_rad"]

    angle = run(dea.TorsionSpring("top", k, to="bottom", rest=rest))
    assert angle > 0.11
    moment = -k * (angle - 0.1 - rest)
    assert run(loads=[dea.Moment("top", moment)]) == pytest.approx(angle, rel=1e-9)


def test_a_table_is_followed():
    """The bar bears what the tabulated spring leaves, to 1e-10; its energy is the integral."""
    law = dea.TableLaw(ELONGATIONS, FORCES)
    pchip = PchipInterpolator(ELONGATIONS, FORCES)
    scene = dea.Scene(
        block((1, 1)), FILM, kinematics=dea.PlaneStrain(DEPTH),
        supports=[
            dea.Fix("x_min", "x"), dea.Fix("bottom", "y"), dea.Rigid("x_max", turns=""),
            dea.Spring("x_max", law, "x"),
        ],
        loads=[dea.Force("x_max", (0.1, 0.0))],
    )  # fmt: skip
    run = dea.solve(scene, dea.Ramp("load", steps=6), {
        "u": dea.PartDisplacement("x_max", "x"), "E": dea.Energy("springs"),
        "R": dea.Reaction("x_min", "x"),
    }, **EXACT)  # fmt: skip
    for row in run.history[1:]:
        d = row["u_m"]
        assert row["R_N"] == pytest.approx(float(pchip(d)) - 0.1 * row["load_factor"], rel=1e-9)
        wanted = quad(pchip, 0, d, points=[x for x in ELONGATIONS if 0 < x < d] or None)[0]
        assert row["E_J"] == pytest.approx(wanted, rel=1e-8)
    assert run["u_m"] > 0.05 * H


def test_a_table_as_a_function():
    """The same for numbers and expressions, monotone between points, straight beyond them."""
    law, pchip = dea.TableLaw(ELONGATIONS, FORCES), PchipInterpolator(ELONGATIONS, FORCES)
    for d in np.linspace(-0.39, 0.49, 23) * H:
        assert law(d) == pytest.approx(float(pchip(d)), abs=1e-15)
        assert float(law(ufl.as_ufl(d))) == pytest.approx(law(d), abs=1e-15)
        work = pchip.antiderivative()(d) - pchip.antiderivative()(0.0)
        assert law.energy(d) == pytest.approx(float(work), abs=1e-15)
    end = float(pchip.derivative()(0.5 * H))
    assert law(0.7 * H) == pytest.approx(0.06 + 0.2 * H * end, rel=1e-12)
    assert law(0.0) == law.energy(0.0) == 0
    assert hash(law) == hash(dea.TableLaw(tuple(ELONGATIONS), list(FORCES)))


@pytest.mark.parametrize("x, f, words", [
    ([0.0], [0.0], "from 2 to"), ([0.0, 1.0], [0.0], "as many of both"),
    ([0.0, 0.0], [0.0, 1.0], "must rise"), ([0.0, np.nan], [0.0, 1.0], "finite numbers"),
    (1.0, [0.0, 1.0], "a list of numbers"), ([0.0, 1.0], "ab", "a list of numbers"),
])  # fmt: skip
def test_tables_that_are_refused(x, f, words):
    with pytest.raises(dea.InputError, match=words):
        dea.TableLaw(x, f)


@pytest.mark.parametrize("given, turns, words", [
    (dict(where="bottom"), "z", "needs a rigid part"), (dict(about="x"), "z", "turns about z"),
    (dict(), None, "give Rigid"), (dict(law=float("inf")), "z", "stiffness of the torsional"),
    (dict(law="stiff"), "z", "a stiffness in N m/rad"), (dict(to="top"), "z", "leave to= out"),
    (dict(about="w"), "z", "must be about x or y or z"),
    (dict(rest=0.1, ramp="load"), "z", "share the ramp"),
])  # fmt: skip
def test_torsional_springs_that_are_refused(given, turns, words):
    with pytest.raises(dea.InputError, match=words):
        turned(dea.TorsionSpring(**dict(where="top", law=1e-6) | given), turns=turns)
