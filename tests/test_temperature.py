"""Materials that change with temperature, against films in closed form and in time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import ufl
from conftest import block, on_demand
from mpi4py import MPI
from scipy.integrate import quad

import dea_fenicsx as dea
from dea_fenicsx import exact
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials.stretches import nominal_stress
from dea_fenicsx.model.heat import SymbolicNumbers
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.run.reuse import _kind

pytestmark = pytest.mark.usefixtures("quick_compile")
COLD, WARM, HOT = 283.15, 293.15, 333.15
TABLE = dea.TabulatedChange([253.15, 273.15, 313.15, 353.15], [4.9, 4.8, 4.5, 4.1])
THERMAL = dea.Thermal(
    WARM, 253.15, 353.15, modulus=dea.LinearChange(-4e-3), permittivity=TABLE, expansion=1e-3
)
LAWS = {
    "entropic": dea.Entropic(), "linear": dea.LinearChange(-4e-3), "table": TABLE,
    "WLF": dea.WLF(8.0, 100.0), "Arrhenius": dea.Arrhenius(6e4),
}  # fmt: skip
VOLTS = 1.5e4


# ---------------------------------------------------------------- laws


def test_laws_by_hand():
    """Factors at 313.15 K of a reference of 293.15 K."""
    by_hand = {
        "entropic": 313.15 / 293.15, "linear": 1 - 0.08, "table": 4.5 / float(TABLE._curve(WARM)),
        "WLF": 10 ** (-8 * 20 / 120),
        "Arrhenius": math.exp(6e4 / 8.314462618 * (1 / 313.15 - 1 / WARM)),
    }  # fmt: skip
    for name, law in LAWS.items():
        assert law.factor(WARM, WARM) == pytest.approx(1.0, rel=1e-14)
        assert law.factor(313.15, WARM) == pytest.approx(by_hand[name], rel=1e-9)


@pytest.mark.parametrize("name", LAWS)
def test_laws_are_the_same_in_elements(name):
    for kelvin in (254.0, 290.0, 313.15, 350.0):
        found = LAWS[name].factor(ufl.as_ufl(kelvin), WARM, SymbolicNumbers)
        value = float(found if isinstance(found, float) else found(()))
        assert value == pytest.approx(float(LAWS[name].factor(kelvin, WARM)), rel=1e-13)


def test_temperatures_are_kelvin_or_quantities():
    pint = pytest.importorskip("pint")
    degrees = pint.UnitRegistry().Quantity
    given = replace(THERMAL, reference=degrees(20.0, "degC"))
    assert given.reference == pytest.approx(WARM, rel=1e-14)
    assert dea.Temperature("film", degrees(60.0, "degC")).kelvin == pytest.approx(HOT, rel=1e-14)


@pytest.mark.parametrize("law", [
    dea.IdealDielectric(4.0), dea.Electrostriction(4.0, 1.0, 0.5),
    dea.SaturatingDielectric(4.0, 1e-3),
    dea.TabulatedPermittivity([1.0, 2.0, 3.0], [4.0, 3.5, 3.3]),
], ids=lambda law: type(law).__name__)  # fmt: skip
def test_charge_of_any_dielectric_grows_by_the_factor(law):
    """D at a given strain and field."""
    material = dea.Material(dea.NeoHookean(5e4), law, thermal=THERMAL)
    e = np.log([[1.3], [1.1], [1 / 1.43]])
    cold, hot = (exact.Film(m, 1e-3).electric.maxwell(e, 2e7) for m in (material, material.at(HOT)))
    assert hot == pytest.approx(THERMAL.permittivity_factor(HOT) * cold, rel=1e-12)


def test_stress_of_a_material_at_a_temperature():
    material = dea.Material(dea.Gent(5e4, 80.0), thermal=replace(THERMAL, modulus=dea.Entropic()))
    hot = nominal_stress(material.at(HOT).elastic, "uniaxial", np.array([1.5, 2.0]))
    cold = nominal_stress(material.elastic, "uniaxial", np.array([1.5, 2.0]))
    assert hot == pytest.approx(cold * HOT / WARM, rel=1e-13)


def test_adiabatic_rise_by_hand():
    """A power that grows as 2 W/s for 3 s is 9 J, in 2 cm^3 of 2 MJ/(K m^3)."""
    thermal = replace(THERMAL, heat_capacity=2e6)
    time = np.linspace(0.0, 3.0, 7)
    assert thermal.adiabatic_rise(time, 2 * time, 2e-6)[-1] == pytest.approx(9 / 4, rel=1e-12)
    with pytest.raises(dea.InputError, match="no heat_capacity"):
        THERMAL.adiabatic_rise(time, time, 1e-6)


# ---------------------------------------------------------------- films in elements


def heated(material, kelvin=HOT, start=COLD, volts=VOLTS, device=None, pull=8e3, **more):
    """A film in plane strain, or in space, that is loaded, then heated."""
    device = device or block((2, 2))
    last = "z" if device.mesh.geometry.dim == 3 else "y"
    held = [dea.Fix("x_min", "x"), dea.Fix("bottom", last)]
    if last == "z":
        held.append(dea.Fix("y_min", "y"))
    load = dea.DeadLoad("x_max", (pull, 0.0, 0.0)[: device.mesh.geometry.dim])
    kinematics = dea.ThreeD() if last == "z" else dea.PlaneStrain()
    return dea.Scene(
        device, {"film": material}, [dea.Electrode("top", volts), dea.Ground("bottom")], held,
        [dea.Temperature("film", kelvin)], [load], kinematics, temperature=start, **more,
    )  # fmt: skip


PATH = [dea.Ramp("load", steps=2), dea.Ramp("voltage", steps=2), dea.Ramp("temperature", steps=3)]
RECORD = {"x": dea.MeanStretch(("x_min", "x_max"), "x"), "Q": dea.Charge("top")}
TIGHT = dea.NewtonOptions(tolerance=1e-12)
RUBBERS = {
    "incompressible": (dea.Gent(5e4, 80.0), None),
    "bulk modulus": (dea.Gent(5e4, 80.0), 5e5),
    "foam": (dea.OgdenHill((5e4,), (2.0,), (0.5,)), None),
}


def against_film(material, device=None):
    """Stretch and charge in elements and of the exact film."""
    run = dea.solve(heated(material, device=device), PATH, RECORD, quiet=True, options=TIGHT)
    across = exact.Dead(0.0) if device else exact.Held(1.0)
    film = exact.Film(material, 1e-3, exact.Dead(8e3), across).at(HOT, COLD)
    (state, _), *_ = exact.trace(film, 3.0).states_at(VOLTS)
    wider = THERMAL.stretch(HOT) / THERMAL.stretch(COLD)
    area = 1e-6 if device else 1e-3  # a depth of 1 m
    assert float(run["x"]) == pytest.approx(wider * state.stretches[0], rel=1e-8)
    assert float(run["Q_C"]) == pytest.approx(wider**2 * area * state.charge, rel=1e-8)
    return run


@pytest.mark.parametrize("kind", RUBBERS)
def test_film_that_is_heated_under_load(kind):
    """Modulus, permittivity and expansion change together, on a ramp."""
    elastic, bulk = RUBBERS[kind]
    against_film(dea.Material(elastic, dea.IdealDielectric(4.7), bulk, thermal=THERMAL))


@on_demand
@pytest.mark.parametrize("kind", RUBBERS)
def test_film_in_space_that_is_heated_under_load(kind):
    elastic, bulk = RUBBERS[kind]
    material = dea.Material(elastic, dea.IdealDielectric(4.7), bulk, thermal=THERMAL)
    against_film(material, block())


def test_scene_at_a_temperature_is_one_of_the_material_there():
    material = dea.Material(
        dea.Gent(5e4, 80.0), dea.IdealDielectric(4.7), thermal=THERMAL
    )  # fmt: skip
    told = replace(heated(material, start=HOT), prescribed=())
    there = replace(told, materials={"film": material.at(HOT)}, temperature=None)
    found = [dea.solve(s, PATH[:2], RECORD, quiet=True, options=TIGHT) for s in (told, there)]
    for name in ("x", "Q_C"):
        assert float(found[0][name]) == pytest.approx(float(found[1][name]), rel=1e-10)


def test_another_expansion_is_no_constant_of_the_same_problem():
    """A built problem is not used again for a material that changes otherwise with temperature."""
    film = dea.Material(dea.Gent(5e4, 80.0), dea.IdealDielectric(4.7), thermal=THERMAL)
    wider = replace(film, thermal=replace(THERMAL, expansion=2e-3))
    softer = replace(film, damage=dea.OgdenRoxburgh(2.0, 1e4))
    kinds = {_kind(m) for m in (film, wider, softer, replace(film, thermal=None))}
    assert len(kinds) == 4


def test_forces_of_a_ramp_are_the_derivative_of_the_residual():
    material = dea.Material(dea.Gent(5e4, 80.0), dea.IdealDielectric(4.7), thermal=THERMAL)
    problem = Problem(heated(material))
    values = problem.w.x.array.copy()
    moved = values + 0.02 * np.random.default_rng(1).standard_normal(len(values))

    def residual(factor):
        factors = problem.state.factors | {"temperature": factor, "voltage": 1.0}
        state = replace(problem.state, values=moved, factors=factors)
        with problem.at(state):
            return problem.residual().copy(), problem.forms.load_vector("temperature")

    h = 1e-5  # at 0.5, since the slope of the table bends at its points
    slope = (residual(0.5 + h)[0] - residual(0.5 - h)[0]) / (2 * h)
    assert np.abs(slope - residual(0.5)[1]).max() < 1e-8 * np.abs(slope).max()


# ---------------------------------------------------------------- in time


SHIFT = dea.WLF(4.0, 100.0)
VISCOUS = dea.Material(
    dea.Gent(5e4, 80.0), dea.IdealDielectric(4.7), viscous=[dea.Maxwell(8e4, 2.0)],
    thermal=dea.Thermal(WARM, 253.15, 353.15, shift=SHIFT),
)  # fmt: skip


def test_creep_while_the_film_warms_up_follows_the_reduced_time():
    """The stretch at t is that of a film at the reference at int dt/a(T(t))."""
    warm = dea.Rise(1.0, 3.0)
    march = dea.March(4.0, {"load": 1.0, "temperature": warm}, tolerance=1e-6)
    run = dea.solve(heated(VISCOUS, start=WARM, pull=2e4), march, RECORD, quiet=True)

    def speed(t):
        return 1 / SHIFT.factor(WARM + (HOT - WARM) * min(t / 3.0, 1.0), WARM)

    reduced = quad(speed, 0.0, 4.0, points=[3.0], epsabs=1e-12)[0]
    film = exact.Film(replace(VISCOUS, thermal=None), 1e-3, exact.Dead(2e4), exact.Held(1.0))
    course = exact.march(film, reduced)
    assert float(run["x"]) == pytest.approx(course.stretch(reduced), rel=2e-6)
    assert reduced > 6.0


# ---------------------------------------------------------------- fields of temperature


def bend(comm):
    """Curvature in 1/m of a free strip whose temperature rises through its thickness."""
    thermal = dea.Thermal(WARM, 253.15, 353.15, expansion=1e-4)
    strip = BoxStack(10e-3, None, [Layer("film", 1e-3, divisions=2)], divisions=(8,))
    scene = dea.Scene(
        dea.read_gmsh(strip, comm), {"film": dea.Material(dea.NeoHookean(5e4), thermal=thermal)},
        supports=[dea.FreeBody()], kinematics=dea.PlaneStrain(),
        prescribed=[dea.Temperature("film", lambda x: WARM + 2e4 * (x[1] - 0.5e-3))],
    )  # fmt: skip
    bottom = dea.Curvature((0.0, 0.0), (10e-3, 0.0))
    run = dea.solve(scene, dea.Ramp(steps=2), {"k": bottom}, quiet=True)
    return float(run["k_per_m"])


@pytest.mark.slow
@pytest.mark.mpi
def test_strip_with_a_gradient_of_temperature_bends(on_ranks):
    """Curvature 3/2 expansion dT/dy in plane strain, for Poisson's ratio 1/2; on 3 ranks, too."""
    found = bend(MPI.COMM_SELF)
    assert abs(found) == pytest.approx(1.5 * 1e-4 * 2e4, rel=5e-3)
    assert on_ranks("test_temperature", "bend", 3) == pytest.approx(found, rel=1e-8)


# ---------------------------------------------------------------- bad input


RUBBER = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(4.7), thermal=THERMAL)
BAD = {
    "above the data": (lambda: RUBBER.at(360.0), "is 360.0 K, but the data .* to 353.15 K"),
    "a scene below": (lambda: heated(RUBBER, start=200.0), "of 'film' in the scene is 200.0 K"),
    "a ramp above": (lambda: heated(RUBBER, 400.0), "is 400.0 K, but the data of the material"),
    "no thermal": (lambda: heated(replace(RUBBER, thermal=None)), "give the material thermal="),
    "no number": (lambda: heated(RUBBER, math.nan), "must be a finite number"),
    "a table too short": (
        lambda: heated(replace(RUBBER, thermal=replace(THERMAL, high=370.0))),
        "is known from 253.15 to",
    ),
    "WLF at its end": (
        lambda: heated(replace(RUBBER, thermal=replace(THERMAL, shift=dea.WLF(8.0, 30.0)))),
        "known from 263.15",
    ),
    "a modulus below 0": (
        lambda: heated(replace(RUBBER, thermal=replace(THERMAL, modulus=dea.LinearChange(-0.02)))),
        "not > 0 somewhere",
    ),
    "the reference outside": (
        lambda: heated(replace(RUBBER, thermal=replace(THERMAL, low=300.0))), "0 < low <= reference"
    ),
    "a permittivity below 1": (
        lambda: replace(RUBBER, electric=dea.IdealDielectric(1.05)).at(350.0), "number >= 1"
    ),
    "a general branch": (
        lambda: heated(replace(RUBBER, viscous=(dea.ViscousBranch(dea.Gent(5e4, 80.0), 1.0),))),
        "a ViscousBranch takes none in a scene",
    ),
    "one ramp for two": (
        lambda: replace(
            heated(RUBBER), loads=[dea.DeadLoad("x_max", (1.0, 0.0), ramp="temperature")]
        ), "share the ramp",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused_in_one_sentence(case):
    make, words = BAD[case]
    with pytest.raises(dea.InputError, match=words) as told:
        make()
    assert len(str(told.value)) <= 400


def test_a_path_that_leaves_the_data_ends_with_a_sentence():
    with pytest.raises(dea.InputError, match=r"at factor 1\.5 of .temperature. is 358\.15 K"):
        dea.solve(heated(RUBBER), dea.Ramp("temperature", 1.5, steps=1), quiet=True)
