"""Derivatives of the loads of buckling, breakdown, loss of tension and of a stretch limit."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest
import test_hessian
from conftest import block
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import FREE, Dead, Film, Held, trace
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.materials.electric import Breakdown

pytestmark = pytest.mark.usefixtures("quick_compile")
TIGHT = dea.NewtonOptions(tolerance=1e-12)
MU, EPS_R, L, T = 5e4, 3.0, 1e-3, 5e-4
EPS = EPS_R * EPSILON_0
SLENDER = 20.0
STRONG = Breakdown(30e6, 0.6)
"""A breakdown field that grows with the stretch."""


def solved(scene, path, **options):
    try:
        return dea.solve(scene, path, quiet=True, options=TIGHT, **options)
    except dea.EquilibriumLost as lost:  # the event may lie before a pull-in
        return lost.run


# ------------------------------------------------------------------------------------ buckling


def strip(comm=MPI.COMM_SELF, cells=8, mu=MU, h=1e-4, bulk_modulus=None):
    """A clamped strip; at factor 1 the voltage is Euler's for h = 0.1 mm."""
    shape = BoxStack(SLENDER * 1e-4, None, [Layer("strip", h)], divisions=cells, grading=2.0)
    device = dea.device(shape, comm)
    field = sqrt(4 * np.pi**2 / 3 * MU / EPS) / SLENDER
    film = dea.Material(dea.NeoHookean(mu), dea.IdealDielectric(EPS_R), bulk_modulus=bulk_modulus)
    return dea.Scene(
        device, dict.fromkeys(device.regions, film),
        [dea.Electrode("top", field * 1e-4), dea.Ground("bottom")],
        [dea.Clamp("x_min"), dea.Clamp("x_max")], kinematics=dea.PlaneStrain(),
    )  # fmt: skip


def buckled(**changed):
    return solved(strip(**changed), dea.Ramp("voltage", to=1.3, steps=3), stability="every")


def test_buckling_of_a_clamped_strip():
    """V = h sqrt(mu/eps) g(h/L): its derivatives by mu, eps and the size are closed forms."""
    larger = dea.ShapeChange("size", lambda X: X / L)
    run = buckled(cells=12)
    to = ["strip.elastic.mu", "strip.electric.eps_r", larger, "thickness:strip:y"]
    found = run.sensitivity("buckling", to)
    event = next(row for row in run.history if row["event"] == "bifurcation")
    volts = found.value
    assert volts == pytest.approx(event["voltage_V"], rel=1e-6)
    exact = [volts / (2 * MU), -volts / (2 * EPS_R), volts / L]
    assert list(found.values())[:3] == pytest.approx(exact, rel=1e-8)
    # Euler's voltage goes with the square of the thickness; a strip of L/h = 20 shears, too
    assert found["thickness:strip:y"] * 1e-4 / volts == pytest.approx(2, abs=0.03)


def test_a_strip_that_shortens_before_it_buckles():
    """A central difference is off by the square of its step; the state moves with the load."""
    base = {"strip.elastic.mu": MU, "strip.bulk_modulus": 2e5, "thickness:strip:y": 1e-4}
    found = buckled(bulk_modulus=2e5).sensitivity("buckling", list(base))
    for (name, value), key in zip(base.items(), ("mu", "bulk_modulus", "h"), strict=True):
        errors = []
        for h in (2e-2, 1e-2):
            ends = [
                buckled(**{"bulk_modulus": 2e5, key: value * (1 + s * h)})
                .sensitivity("buckling", "strip.elastic.mu").value
                for s in (1, -1)
            ]  # fmt: skip
            errors.append((ends[0] - ends[1]) / (2 * h * value) / found[name] - 1)
        assert abs(errors[1]) < 1e-4 and errors[0] / errors[1] == pytest.approx(4, rel=0.02)


def on_ranks_found(comm):
    run = solved(strip(comm, cells=4), dea.Ramp("voltage", to=1.3, steps=3), stability="every")
    found = run.sensitivity("buckling", ["strip.elastic.mu", "thickness:strip:y"])
    return [found.value, *found.values(), *test_hessian.found_on(comm)]


@pytest.mark.slow
@pytest.mark.mpi
def test_three_ranks_find_what_one_finds(on_ranks):
    alone = on_ranks_found(MPI.COMM_SELF)
    assert on_ranks("test_event_loads", "on_ranks_found", 3) == pytest.approx(alone, rel=1e-8)


# ------------------------------------------------------------------------------------ failures


def film(dead=0.0, held=(None, None), breakdown=None):
    """A block of film under a dead load along x, or with stretches that are held."""
    stretched = zip(("x_max", "y_max"), "xy", held, strict=True)
    material = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R, breakdown=breakdown))
    scene = dea.Scene(
        block((2, 1, 1), L, T), {"film": material},
        [dea.Electrode("top", 20e3), dea.Ground("bottom")],
        [dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
        [dea.Stretch(where, axis, l) for where, axis, l in stretched if l],
        [dea.DeadLoad("x_max", (dead, 0.0, 0.0))] if dead else [],
    )  # fmt: skip
    first = tuple(name for name in scene.ramps if name != "voltage")
    return scene, [dea.Ramp(first, steps=3), dea.Ramp("voltage", steps=8)]


def exact_voltage(kind, dead, held, mu=MU, eps_r=EPS_R, field=STRONG.field):
    strong = Breakdown(field, STRONG.exponent)
    material = dea.Material(dea.NeoHookean(mu), dea.IdealDielectric(eps_r, breakdown=strong))
    return trace(Film(material, T, Dead(dead), held)).event(kind).voltage


def slope(of, value):
    """A derivative by a formula of fourth order, whose error is about 1e-12."""
    h = 1e-3 * value
    near, far = of(value + h) - of(value - h), of(value + 2 * h) - of(value - 2 * h)
    return (8 * near - far) / (12 * h)


@pytest.mark.parametrize("kind, told, dead, held", [
    ("breakdown", "breakdown", 4e4, FREE),
    ("loss of tension", "loss of tension 2", 1e5, Held(1.3)),
])  # fmt: skip
def test_voltage_of_a_failure_against_the_exact_film(kind, told, dead, held):
    scene, path = film(dead, (None, getattr(held, "stretch", None)), STRONG)
    run = solved(scene, path, failures=[dea.ElectricalBreakdown(), dea.LossOfTension("z")])
    to = ["film.elastic.mu", "film.electric.eps_r", "film.electric.breakdown", "load"]
    found = run.sensitivity(kind, [*to, "thickness:film:z"])
    assert found.value == pytest.approx(exact_voltage(told, dead, held), rel=1e-8)
    exact = [
        slope(lambda mu: exact_voltage(told, dead, held, mu=mu), MU),
        slope(lambda eps: exact_voltage(told, dead, held, eps_r=eps), EPS_R),
        slope(lambda E: exact_voltage(told, dead, held, field=E), STRONG.field),
        dead * slope(lambda s: exact_voltage(told, s, held), dead),
        found.value / T,
    ]
    assert list(found.values()) == pytest.approx(exact, rel=1e-8, abs=1e-9)


def test_loss_of_tension_where_two_stresses_vanish_at_once():
    """V = T lam3 sqrt(mu (lam^2 - lam3^2)/eps) with lam3 = lam^-2."""
    scene, path = film(held=(1.5, 1.5))
    run = solved(scene, path, failures=[dea.LossOfTension("z")])

    def volts(factor):
        lam = 1 + 0.5 * factor
        return T * lam**-2 * sqrt(MU * (lam**2 - lam**-4) / EPS)

    found = run.sensitivity("loss of tension", ["film.elastic.mu", "stretch"])
    assert found.value == pytest.approx(volts(1), rel=1e-8)
    assert list(found.values()) == pytest.approx([volts(1) / (2 * MU), slope(volts, 1)], rel=1e-8)
    wider = dea.ShapeChange("wider", lambda X: np.array([[x / L, 0, 0] for x in X[:, 0]]))
    assert run.sensitivity("loss of tension", wider)["wider"] == pytest.approx(
        0, abs=1e-9 * volts(1) / L
    )


def test_load_of_a_stretch_limit():
    """sigma = mu (lam^2 - 1/lam) at lam = 1.6, so that the load is mu (lam - 1/lam^2)."""
    scene, path = film(dead=1e5)
    run = solved(scene, path[:1], failures=[dea.StretchLimit(1.6)])
    found = run.sensitivity("stretch limit", ["film.elastic.mu", "thickness:film:z"])
    factor = MU * (1.6 - 1.6**-2) / 1e5
    assert found.value == pytest.approx(factor, rel=1e-8)
    assert list(found.values()) == pytest.approx([factor / MU, 0], rel=1e-8, abs=1e-9 / T)


# ------------------------------------------------------------------------------------ refusals


def test_what_has_no_derivative_is_told():
    scene, path = film(4e4, breakdown=STRONG)
    run = solved(scene, path)
    for name, to, words in (
        ("buckling", ["film.elastic.mu"], 'stability="every"'),
        ("loss of tension", ["film.elastic.mu"], "failures="),
        ("breakdown", ["voltage"], "the load of the event itself"),
        ("breakdown", ["film.elastic.my"], "did you mean"),
        ("breakdown", [], "names no variable"),
    ):
        with pytest.raises(dea.InputError, match=words):
            run.sensitivity(name, to)
    with pytest.raises(dea.InputError, match="step=0 is no event"):
        run.sensitivity("breakdown", ["film.elastic.mu"], step=0)


def test_an_imperfection_takes_the_bifurcation_away():
    """A strip with a bow bends from the first volt on."""

    def bow(X):
        return np.array([[0, np.sin(np.pi * x / (SLENDER * 1e-4)) ** 2, 0] for x in X[:, 0]])

    with pytest.raises(dea.InputError, match=r"'bow', because .* has no bifurcation"):
        buckled().sensitivity("buckling", dea.ShapeChange("bow", bow))


def test_two_modes_at_one_load():
    """A square column buckles both ways at once, at a given strain.

    By its size the displacement at that strain grows in proportion; its height along z parts the
    two modes.
    """
    a = 1e-3
    device = dea.device(BoxStack(8 * a, a, [Layer("rod", a)], divisions=(4, 1)), MPI.COMM_SELF)
    scene = dea.Scene(
        device, {"rod": dea.Material(dea.NeoHookean(MU))},
        supports=[dea.Clamp("x_min"), dea.Fix("x_max", "y"), dea.Fix("x_max", "z")],
        prescribed=[dea.Displacement("x_max", "x", -a, ramp="push")],
    )  # fmt: skip
    path = dea.Ramp("push", to=0.6, steps=4)
    run = dea.solve(scene, path, quiet=True, stability="every", options=TIGHT)
    size = dea.ShapeChange("size", lambda X: X / a)
    found = run.sensitivity("buckling", [size, "rod.elastic.mu"])
    assert found["size"] == pytest.approx(found.value / a, rel=1e-7)
    assert MU * found["rod.elastic.mu"] == pytest.approx(0, abs=1e-7 * found.value)
    with pytest.raises(dea.InputError, match="two modes buckle at one load"):
        run.sensitivity("buckling", "thickness:rod:z")
