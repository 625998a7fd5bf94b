"""Membranes against exact states of films, cones and balloons, and against resolved wrinkles."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT, on_demand
from demo_checks import check_cone_of_a_membrane
from membrane_scenes import (
    EPS,
    EPS0,
    LENGTH,
    MU,
    RUBBER,
    STRETCHES,
    THICKNESS,
    WIDTH,
    balloon,
    cone,
    film,
    round_balloon,
    sheet,
    volts,
)
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import Cone
from dea_fenicsx.geometry import Balloon, Meridian, _gmsh
from dea_fenicsx.support.compat import dolfinx

FIELD = volts(1.0, 1.0)  # V/m
AREA = LENGTH * WIDTH


# ------------------------------------------------------------------------- flat films


@pytest.mark.parametrize("e, loads", [(0.6, (0.0, 0.0)), (0.4, (0.6, 0.2))])
def test_free_films_reach_the_exact_state(e, loads):
    """s_i = [l_i^2 - l_3^2 - e^2/l_3^2]/l_i, the charge eps e (l_1 l_2)^2, l_3 = 1/(l_1 l_2)."""
    dead = [dea.DeadLoad("right", (MU * loads[0], 0.0)), dea.DeadLoad("top", (0.0, MU * loads[1]))]
    scene = film(e=e, loads=dead)
    path = [dea.Ramp(["load"], steps=1), dea.Ramp(["voltage"], steps=3)]
    failures = [dea.LossOfTension(), dea.ElectricalBreakdown()]
    run = dea.solve(scene, path, STRETCHES, failures=failures, quiet=True)
    x, y, z = (float(run[name]) for name in "xyz")
    assert z == pytest.approx(1 / (x * y), rel=1e-12)
    for stretch, load in zip((x, y), loads, strict=True):
        assert (stretch**2 - z**2 - (e / z) ** 2) / stretch == pytest.approx(load, abs=1e-10)
    charge = EPS * EPS0 * FIELD * e * (x * y) ** 2 * AREA
    assert float(run["Q_C"]) == pytest.approx(charge, rel=1e-10)
    ratio = run.history["breakdown_ratio"][-1]
    assert ratio == pytest.approx(e * FIELD / z / 1e9, rel=1e-9)
    least = min(s * stretch for s, stretch in zip(loads, (x, y), strict=True)) * MU
    assert run.history["tension_Pa"][-1] == pytest.approx(least, abs=1e-5)
    assert run.history["negative_modes"][-1] == 0


def test_pull_in_of_a_free_film():
    """V = 0.687365 H sqrt(mu/eps), by arc length."""
    scene = film(e=1.0)
    run = dea.solve(scene, dea.Trace("voltage", steps=12), quiet=True)
    top = next(row for row in run.history if row["event"] == "maximum")
    assert top["voltage_V"] == pytest.approx(0.687365 * volts(1.0, THICKNESS), rel=2e-6)


def test_a_charge_in_place_of_a_voltage():
    """The potential that belongs to a given charge is that of the free film under voltage."""
    a, e = 1.2, (1.2**-2 - 1.2**-8) ** 0.5
    charge = EPS * EPS0 * FIELD * e * a**4 * AREA
    scene = film(electrodes=[dea.ChargedElectrode("film", charge)])
    wanted = {"x": STRETCHES["x"], "V": dea.Potential("film")}
    run = dea.solve(scene, dea.Ramp(["charge"], steps=3), wanted, quiet=True)
    assert float(run["x"]) == pytest.approx(a, rel=1e-9)
    assert float(run["V_V"]) == pytest.approx(volts(e, THICKNESS), rel=1e-9)


# -------------------------------------------------------------------------- wrinkles


SLACK = 1e-4


def wrinkled(a, e, stretch=None):
    """A film that is stretched by a along x and held at its width, and then charged."""
    scene = film(
        e=e, kinematics=dea.Membrane(THICKNESS, relaxed=True, slack=SLACK),
        supports=[dea.Fix("left", "x"), dea.Fix("bottom", "y"), dea.Fix("top", "y")],
        prescribed=[dea.Stretch("right", "x", a)],
    )  # fmt: skip
    wanted = {"x": dea.Reaction("right", "x"), "y": dea.Reaction("top", "y"),
              "Q": dea.Charge("film"), "U": dea.Energy("elastic")}  # fmt: skip
    path = [dea.Ramp(["stretch"], steps=2), dea.Ramp(["voltage"], steps=3)]
    return dea.solve(scene, path, wanted, quiet=True)


def forces(a, n, e):
    """Nominal tensions along and across, without wrinkles, at stretches a and n."""
    thin = 1 / (a * n)
    return ((a**2 - thin**2 - (e / thin) ** 2) / a, (n**2 - thin**2 - (e / thin) ** 2) / n)


def test_a_wrinkled_film_bears_tension_along_its_wrinkles_alone():
    """At the natural width n^4 = 1/(a^2 (1 - e^2 a^2)); the residual stiffness is as stated."""
    a, e = 1.5, 0.53
    n = (a**2 * (1 - e**2 * a**2)) ** -0.25
    assert n > 1
    run = wrinkled(a, e)
    assert forces(a, n, e)[1] == pytest.approx(0, abs=1e-14)
    along, across = (
        SLACK * full + (1 - SLACK) * relaxed
        for full, relaxed in zip(forces(a, 1.0, e), forces(a, n, e), strict=True)
    )
    assert float(run["x_N"]) == pytest.approx(along * MU * WIDTH * THICKNESS, rel=1e-9)
    assert float(run["y_N"]) == pytest.approx(across * MU * LENGTH * THICKNESS, rel=1e-6)
    wider = SLACK + (1 - SLACK) * n**2
    charge = EPS * EPS0 * FIELD * e * a**2 * wider * AREA
    assert float(run["Q_C"]) == pytest.approx(charge, rel=1e-9)
    energies = [MU / 2 * (a**2 + w**2 + (a * w) ** -2 - 3) for w in (1.0, n)]
    energy = (SLACK * energies[0] + (1 - SLACK) * energies[1]) * AREA * THICKNESS
    assert float(run["U_J"]) == pytest.approx(energy, rel=1e-9)
    assert run.history["negative_modes"][-1] == 0


def test_a_slack_film_bears_nothing_but_its_residual_stiffness():
    """Below its natural stretch s, s^6 (1 - e^2 s^2) = 1, it has the charge of the free film."""
    e, a = 0.4, 1.02
    s = min(root.real for root in np.sqrt(np.roots([-(e**2), 1, 0, 0, -1]).astype(complex))
            if abs(root.imag) < 1e-9 and root.real > 0)  # fmt: skip
    assert s > a
    run = wrinkled(a, e)
    along, across = (SLACK * tension for tension in forces(a, 1.0, e))
    assert float(run["x_N"]) == pytest.approx(along * MU * WIDTH * THICKNESS, rel=1e-6)
    assert float(run["y_N"]) == pytest.approx(across * MU * LENGTH * THICKNESS, rel=1e-6)
    charge = EPS * EPS0 * FIELD * e * (SLACK * a**2 + (1 - SLACK) * s**4) * AREA
    assert float(run["Q_C"]) == pytest.approx(charge, rel=1e-7)


def test_where_no_relaxed_energy_exists_the_run_says_so():
    """At e a = 1 the natural width is infinite."""
    with pytest.raises(dea.EquilibriumLost, match="wrinkles whose width no equilibrium limits"):
        wrinkled(1.5, 0.7)


def test_relaxed_films_follow_resolved_wrinkles():
    """A film between clamps, stretched by a dead load along them, which buckles under voltage."""
    width, e, load = 20e-3, 0.57, 0.5 * MU
    thin = width / 50
    mesh = dolfinx.mesh.create_rectangle(
        MPI.COMM_SELF, [(0.0, 0.0), (width, thin)], [12, 1], dolfinx.mesh.CellType.quadrilateral
    )
    sides = {"left": dea.OnPlane("x", 0.0), "right": dea.OnPlane("x", width),
             "bottom": dea.OnPlane("y", 0.0), "top": dea.OnPlane("y", thin)}  # fmt: skip
    solid = dea.Scene(
        dea.from_dolfinx(mesh, regions="film", surfaces=sides), {"film": RUBBER},
        electrodes=[dea.Electrode("top", volts(e, thin)), dea.Ground("bottom")],
        supports=[dea.Clamp("left"), dea.Clamp("right")],
        loads=[dea.AxialForce(load * width * thin),
               dea.DeadLoad("bottom", (0.0, 1e-5 * MU), ramp="push")],
        kinematics=dea.GeneralisedPlaneStrain(10e-3),
    )  # fmt: skip
    path = [dea.Ramp(["load", "push"], steps=2), dea.Ramp(["voltage"], steps=8)]
    wanted = {"along": dea.OverallStretch(),
              "across": dea.OverRegion("stretch", "mean", "x")}  # fmt: skip
    resolved = dea.solve(solid, path, wanted, quiet=True)
    membrane = film(
        device=sheet(length=width, width=10e-3, divisions=(2, 2)),
        electrodes=[dea.Electrode("film", volts(e, thin))],
        supports=[dea.Fix("left", "x"), dea.Fix("right", "x"), dea.Fix("bottom", "y")],
        loads=[dea.DeadLoad("top", (0.0, load))], kinematics=dea.Membrane(thin, relaxed=True),
    )  # fmt: skip
    path = [dea.Ramp(["load"], steps=1), dea.Ramp(["voltage"], steps=4)]
    relaxed = dea.solve(membrane, path, STRETCHES, quiet=True)
    a = float(relaxed["y"])
    natural = (a**2 * (1 - e**2 * a**2)) ** -0.25
    assert natural > 1.05  # far beyond the onset of wrinkles
    assert float(resolved["along"]) == pytest.approx(a, rel=0.01)
    assert float(resolved["across"]) == pytest.approx(natural, rel=0.02)


# ---------------------------------------------------------------- membranes of revolution


@pytest.mark.parametrize("lp, q, resting, charged", [
    (1.5, 0.5, 0.62978662, 0.64420238), (2.0, 1.0, 1.20994855, 1.26067753),
])  # fmt: skip
def test_cones_in_the_limit_of_a_thin_membrane(lp, q, resting, charged):
    run, z = cone(lp, q, 0.1)
    assert z[-3] == pytest.approx(resting, rel=1e-6)
    assert z[-1] == pytest.approx(charged, rel=1e-6)
    assert z[-1] == pytest.approx(Cone(lp, q, 0.1).deflection(), rel=1e-6)
    assert np.all(run.history["negative_modes"][1:] == 0)
    assert np.all(run.history["tension_Pa"][1:] > 0)  # nowhere slack, which is watched unasked


def test_balloons_in_the_limit_of_a_thin_membrane(tmp_path):
    """P R/(mu H) = 2 (1/a - 1/a^7 - e^2 a), by a meridian that ends on the axis."""
    run = round_balloon(a=1.2)
    assert float(run["radius_m"]) / 1e-2 + 1 == pytest.approx(1.2, rel=1e-6)
    assert float(run["pole_m"]) / 1e-2 + 1 == pytest.approx(1.2, rel=1e-6)
    charge = EPS * EPS0 * FIELD * 0.3 * 2 * np.pi * 1e-4 * 1.2**4
    assert float(run["Q_C"]) == pytest.approx(charge, rel=1e-6)


@on_demand
def test_balloons_in_space_converge():
    """An eighth of a sphere as a surface in space; the error of the charge falls by 16 or so."""
    errors = []
    for cells in (2, 4):
        supports = [dea.Fix(f"{axis}_min", axis) for axis in "xyz"]
        run = balloon(dea.device(Balloon(1e-2, cells), MPI.COMM_SELF), supports,
                      dea.SurfaceMembrane(1e-4), (0.0, 0.0, 0.0))  # fmt: skip
        exact = EPS * EPS0 * FIELD * 0.3 * np.pi / 2 * 1e-4 * 1.2**4
        errors.append(abs(float(run["Q_C"]) / exact - 1))
    assert errors[0] > 8 * errors[1]
    assert errors[1] < 2e-4


# --------------------------------------------------------------------------- geometry


@pytest.mark.parametrize("shape", [
    Meridian((3e-3, 1e-3), (10e-3, 0.0), cells=3, grading=2.0),
    Meridian((0.0, 1e-2), (1e-2, 0.0), (0.0, 0.0), cells=8), Balloon(1e-2, cells=6),
])  # fmt: skip
def test_surfaces_have_their_closed_form_measures(shape):
    for built in (shape, shape.refine(2)):
        built.mesh().check()
        with _gmsh.temporary_model(built.mesh(), "surface") as model:
            found = {name: size for name, (_, _, size) in _gmsh.measure(model).items()}
        for name, size in built.measures().items():
            assert found[name] == pytest.approx(size, rel=3e-5)


@pytest.mark.parametrize("given, told", [
    (dict(start=(0.0, 0.0), end=(0.0, 0.0)), "the same point"),
    (dict(start=(-1.0, 0.0), end=(1.0, 0.0)), "radius must be >= 0"),
    (dict(start=(1.0, 0.0), end=(0.0, 2.0), centre=(0.0, 0.0)), "equally far from it"),
    (dict(start=(0.0, 1.0), end=(0.0, -1.0), centre=(0.0, 0.0)), "no shorter side"),
    (dict(start=1.0, end=(0.0, -1.0)), "two numbers"),
])  # fmt: skip
def test_meridians_that_are_none_are_refused(given, told):
    with pytest.raises(dea.InputError, match=told):
        Meridian(**given)


# --------------------------------------------------------------------------- ranks, refusals


@pytest.mark.mpi
def test_membranes_on_three_ranks(on_ranks):
    """More ranks than cells, too, in the balloon's meridian of two cells."""
    from membrane_scenes import on_all_ranks

    here, there = on_all_ranks(MPI.COMM_SELF), on_ranks("membrane_scenes", "on_all_ranks", 3)
    assert here["balloon"] == pytest.approx(2e-4, rel=0.02)
    for name, value in here.items():
        assert there[name] == pytest.approx(value, rel=1e-9), name


FILM = dict(supports=[dea.Fix("left", "x"), dea.Fix("bottom", "y")])
GENT = dea.Material(dea.Gent(MU, 50.0), electric=dea.IdealDielectric(EPS))


def line(**changes):
    device = dea.device(Meridian((0.1, 0.0), (0.2, 0.0), cells=2), MPI.COMM_SELF)
    given = dict(materials={"film": RUBBER}, supports=[dea.Clamp("end")],
                 kinematics=dea.AxisymmetricMembrane(1e-3))  # fmt: skip
    return dea.Scene(device, **(given | changes))


@pytest.mark.parametrize("make, told", {
    "an edge as an electrode": (
        lambda: film(electrodes=[dea.Electrode("top", 1.0)]), "acts through its thickness"),
    "a taper": (
        lambda: film(electrodes=[dea.Electrode("film", 1.0, taper=dea.Taper(0.0, 0.1, "x"))]),
        "leave taper= out"),
    "a thin film": (
        lambda: film(electrodes=[dea.ThinFilm("film", 1.0, end=1.0)]), "ThinFilm 'film' is for"),
    "a passive film as an electrode": (
        lambda: film(materials={"film": dea.Material(dea.NeoHookean(MU))}), "must be the dielec"),
    "a bulk modulus": (
        lambda: film(materials={"film": dea.Material(dea.NeoHookean(MU), bulk_modulus=1e9)},
                     electrodes=()), "follows from incompressibility"),
    "a thickness of nothing": (
        lambda: film(kinematics=dea.Membrane(0.0)), "The thickness of Membrane"),
    "no residual stiffness": (
        lambda: film(kinematics=dea.Membrane(1e-3, relaxed=True, slack=0.0)), "between 0 and 1"),
    "a Gent film with wrinkles under voltage": (
        lambda: film(materials={"film": GENT}, kinematics=dea.Membrane(1e-3, relaxed=True)),
        "natural width of a wrinkled Gent film"),
    "a solid's mesh": (
        lambda: film(kinematics=dea.SurfaceMembrane(1e-3)), "a mesh of surfaces in 3"),
    "a flat mesh of revolution": (
        lambda: film(kinematics=dea.AxisymmetricMembrane(1e-3)), "a mesh of lines in 2"),
    "a membrane's mesh as a solid": (
        lambda: line(kinematics=dea.Axisymmetric()), "cells of dimension 1 in 2"),
    "pressure in the plane": (
        lambda: film(loads=[dea.MembranePressure("film", 1.0, (0.0, 0.0))]), "leave its plane"),
    "a pressure from within the surface": (
        lambda: dea.solve(line(loads=[dea.MembranePressure("film", 1.0, (0.0, 0.0))]),
                          dea.Ramp(steps=1), quiet=True), "not clear to which side"),
    "a pressure on an edge": (
        lambda: line(loads=[dea.FollowerPressure("start", 1.0)]), "acts on the faces of a solid"),
    "a normal for the loss of tension": (
        lambda: dea.solve(line(loads=[dea.DeadLoad("start", (1.0, 0.0))]), dea.Ramp(steps=1),
                          quiet=True, failures=[dea.LossOfTension("z")]), "leave normal= out"),
}.values())  # fmt: skip
def test_what_a_membrane_cannot_do_is_told(make, told):
    with pytest.raises(dea.InputError, match=told) as error:
        make()
    assert len(str(error.value)) <= 400


def check_picture_of_a_meridian(folder):
    """It is the surface of revolution: its undeformed area, and where the rim and the disc go."""
    skin = pytest.importorskip("dea_fenicsx.pictures.skin")
    found = skin.skin_of(folder, ["field_strength_MV_per_m"], ("r", "z", "hoop"), np.empty(0, int))
    corners = found.points[found.triangles]
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    radii = np.hypot(*found.points[:, :2].T)
    ring = np.pi * (radii.max() ** 2 - radii.min() ** 2)
    assert not found.flat and radii.max() / radii.min() > 2
    chord = np.sin(2 * np.pi / 72) / (2 * np.pi / 72)  # of 72 sectors, cells of a polygon
    assert np.linalg.norm(sides, axis=1).sum() / 2 == pytest.approx(ring * chord, rel=1e-9)
    lift = found.moved[-1][:, 2]
    assert lift[radii == radii.max()] == pytest.approx(0.0, abs=1e-12)
    assert np.abs(lift).max() == pytest.approx(np.abs(lift[radii < 1.01 * radii.min()]).min())
    dea.pictures.deformed(folder)
    assert (folder / "field_strength.png").stat().st_size > 10_000


@pytest.mark.demo
def test_the_cone_of_a_membrane(start, tmp_path):
    demo = ROOT / "demos" / "cone.py"
    done = start(demo, "--membrane", "--cells", 20, "--out", tmp_path, "--quiet", check=True)
    check_cone_of_a_membrane(tmp_path, done.stdout)
    check_picture_of_a_meridian(tmp_path)
    both = start(demo, "--membrane", "--solid", "--out", tmp_path)
    assert both.returncode != 0 and "exclude each other" in both.stderr
