"""Films with stiffeners: exact finite bending, finite elements beside it, bounds, bad input."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import Film, Held, Laminate, Ply, bend, trace
from dea_fenicsx.geometry import StiffenedFilm, StiffenedSection
from dea_fenicsx.materials import EPSILON_0

MU, EPS_R, H = 50e3, 4.7, 0.2e-3
FILM = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))
BACK = dea.Material(dea.NeoHookean(4 * MU))
UNIT = H * np.sqrt(MU / (EPS_R * EPSILON_0))
pytestmark = pytest.mark.usefixtures("quick_compile")


# ---- exact finite bending ----------------------------------------------------------------------


@pytest.mark.parametrize("across", ["held", "uniform"])
def test_small_voltage_is_the_laminate(across):
    plies = [Ply(BACK, H / 2), Ply(FILM, H, driven=True), Ply(BACK, H / 8)]
    volts = 1e-3 * UNIT
    (state,) = bend(plies, volts, across)
    flat = Laminate(plies, across)
    assert state.angle_per_length == pytest.approx(flat.curvature(volts), rel=1e-5)
    assert state.bottom - 1 == pytest.approx(flat.strains(volts)[0], rel=1e-5)
    assert state.across - 1 == pytest.approx(flat.strains(volts)[2], rel=1e-4, abs=1e-12)


def test_layers_that_are_one_layer():
    """A driven film between no others is the exact film; cut passive layers make no difference."""
    volts = 0.6 * UNIT
    state = bend([Ply(FILM, H, driven=True)], volts)[0]
    exact, _ = trace(Film(FILM, H, second=Held(1.0))).states_at(volts)[0]
    assert state.bottom == pytest.approx(exact.stretches[0], rel=1e-10)
    assert abs(state.angle_per_length) * H < 1e-10
    whole = bend([Ply(BACK, H), Ply(FILM, H, driven=True)], [volts, 1.5 * volts])[-1]
    cut = bend([Ply(BACK, H / 3), Ply(BACK, 2 * H / 3), Ply(FILM, H, driven=True)], 1.5 * volts)
    assert cut[0].angle_per_length == pytest.approx(whole.angle_per_length, rel=1e-10)


def test_mirrored_layers_bend_the_other_way():
    plies = [Ply(BACK, H / 2), Ply(FILM, H, driven=True)]
    up, down = (bend(p, 0.8 * UNIT)[0] for p in (plies, plies[::-1]))
    assert down.angle_per_length == pytest.approx(-up.angle_per_length, rel=1e-10)
    stretch = np.sqrt(up.bottom**2 + 2 * up.angle_per_length * 1.5 * H)  # of the top
    assert down.bottom == pytest.approx(stretch, rel=1e-10)


@pytest.mark.parametrize("make, words", [
    (lambda: bend([], 1.0), "no plies"),
    (lambda: bend([Ply(FILM, H)], 1.0, "free"), "across"),
    (lambda: bend([Ply(dea.Material(dea.NeoHookean(MU), None, 1e6), H)], 1.0), "bulk modulus"),
    (lambda: bend([Ply(FILM, H, driven=True)], 3 * UNIT), "no equilibrium"),
    (lambda: StiffenedSection(strip=(50e-3, 60e-3)), "must lie on the film"),
    (lambda: StiffenedSection(strip=(-1e-3, 1e-3)), "must lie on the film"),
    (lambda: StiffenedSection(offset=1e-3), "offset is 0.001 m"),
    (lambda: StiffenedSection(offset=-1e-5), "offset is -1e-05 m"),
    (lambda: StiffenedSection(offset=0.1e-3), "or on its top"),
    (lambda: StiffenedSection(thickness=0.0), "thickness is 0.0"),
    (lambda: StiffenedFilm(length=40e-3), "lies outside the film"),
    (lambda: StiffenedFilm(corners=((1e-3, 1e-3),) * 3), "four points"),
    (lambda: StiffenedFilm(corners=StiffenedFilm().corners[::-1]), "counterclockwise"),
    (lambda: StiffenedFilm(offset=1.0), "offset is 1 m"),
])  # fmt: skip
def test_refuses(make, words):
    with pytest.raises(dea.InputError, match=words) as caught:
        make()
    assert str(caught.value).endswith(".") and "\n" not in str(caught.value)


# ---- finite elements ---------------------------------------------------------------------------


def section(shape, volts, stiff=BACK):
    """A section that is clamped at one end, driven across the film."""
    return dea.Scene(
        dea.read_gmsh(shape, MPI.COMM_SELF), {"film": FILM, "stiffener": stiff},
        electrodes=[dea.Electrode("top", volts), dea.Ground("bottom")],
        supports=[dea.Clamp("x_min")], kinematics=dea.PlaneStrain(),
    )  # fmt: skip


ANGLE = {"angle": dea.Rotation("x_max", "z")}


def test_a_bilayer_bends_as_exact_theory_says_up_to_90_degrees():
    """Asked: 2 %.  The clamp, which holds the thickness, takes the angle of 0.4 layers of length;
    between strips of 60 and 30 layers it drops out."""
    plies = [Ply(FILM, H, driven=True), Ply(BACK, H / 2)]
    volts = np.linspace(0.1, 0.8, 15) * UNIT
    exact = -np.array([s.angle_per_length * 60 * H for s in bend(plies, volts)])
    top = float(np.interp(np.pi / 2, exact, volts))
    angles = []
    for layers in (60, 30):
        shape = StiffenedSection(length=layers * H, strip=(0.0, layers * H), thickness=H,
                                 stiffener=H / 2, cells=(1, layers // 2, 1), through=1)  # fmt: skip
        run = dea.solve(section(shape, top), dea.Ramp("voltage", steps=5), ANGLE, quiet=True)
        assert run.summary["stable"] is True
        angles.append(run.column("angle_rad")[1:])
    states = bend(plies, run.column("voltage_V")[1:])
    theory = np.array([-s.angle_per_length * 60 * H for s in states])
    assert theory[-1] == pytest.approx(np.pi / 2, rel=0.01)
    assert angles[0] == pytest.approx(theory, rel=0.01)
    assert 2 * (angles[0] - angles[1]) == pytest.approx(theory, rel=2e-3)


def test_a_stiffener_in_the_middle_does_not_bend_the_film():
    """An offset one does, the more the farther it lies off."""
    driven = dea.Material(BACK.elastic, FILM.electric)
    angles = []
    for offset in (0.0, H / 8, H / 4):
        shape = StiffenedSection(length=4e-3, strip=(1e-3, 3e-3), thickness=H, stiffener=H / 4,
                                 offset=offset, cells=(4, 6, 4))  # fmt: skip
        run = dea.solve(section(shape, 0.5 * UNIT, driven), dea.Ramp("voltage", steps=2), ANGLE,
                        quiet=True, stability="never")  # fmt: skip
        angles.append(run["angle_rad"])
    assert abs(angles[0]) < 1e-8
    assert 1e-3 < angles[1] < angles[2]


def test_a_strip_raises_the_voltage_within_the_rule_of_mixtures():
    """Pre-stretched film, width held, strip on the diagonal in its middle plane.

    Lower bound: the film alone.  Upper: film and strip strained alike, plane stress.
    """
    l1, l2, h = 2.125, 2.75, 0.2e-3
    a, b = l1 * 10e-3, l2 * 10e-3
    film = Film(FILM, h * l1 * l2, second=Held(l2)).prestretched(l1, l2)
    branch = trace(film)
    volts = branch.at_stretch(1.05 * l1)[0].voltage
    corner = np.array([[0.1, 0.08], [0.92, 0.9], [0.9, 0.92], [0.08, 0.1]]) * [a, b]
    stiff = dea.Material(dea.NeoHookean(100 * MU), FILM.electric)
    shape = StiffenedFilm(a, b, corners=corner, thickness=h, stiffener=h / 5, offset=0.0, along=2,
                          beside=2, through=1)  # fmt: skip
    scene = dea.Scene(
        dea.read_gmsh(shape, MPI.COMM_SELF), {"film": FILM, "stiffener": stiff},
        electrodes=[dea.Electrode("top", volts), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "xz"), dea.Fix("x_max", "z"), dea.Fix("y_min", "y"),
                  dea.Fix("y_max", "y")],
        prescribed=[dea.PreStretch("film", x=l1, y=l2)],
        loads=[dea.DeadLoad("x_max", (film.first.pascal * l1, 0.0, 0.0))],
    )  # fmt: skip
    record = {"stretch": dea.MeanStretch(("x_min", "x_max"), "x"),
              "lift": dea.LargestDisplacement("bottom", "z")}  # fmt: skip
    run = dea.solve(scene, [dea.Ramp(("prestretch", "load"), steps=3),
                            dea.Ramp("voltage", steps=2)], record, quiet=True)  # fmt: skip
    strain = run["stretch"] - 1
    alone = branch.at_stretch(l1 * (1 + strain))[0].voltage
    share = shape.measures()["stiffener"] / (a * b * h)
    extra = Ply(stiff, h / 5).plane_modulus * share * strain
    mixed = np.sqrt(alone**2 + extra * h**2 / (EPS_R * EPSILON_0 * (1 + strain)))
    assert alone * 1.002 < volts < mixed
    assert 0 < strain < 0.05
    assert run.summary["stable"] is True
