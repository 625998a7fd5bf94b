"""Electrode edges: tapers, the thin-film field, and pull-in of a stack that converges."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, HelicalCell, Layer, MembraneDisc
from dea_fenicsx.materials import EPSILON_0

MU, EPS_R, T = 50e3, 4.7, 1e-3
UNIT = T * np.sqrt(MU / (EPS_R * EPSILON_0))
RUBBER = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))
HELD = [dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")]


def test_thin_film_is_the_full_field_of_a_homogeneous_film():
    """The same path, charge and limit point, with no potential among the unknowns."""
    sets = {
        "full": [dea.Electrode("top", UNIT), dea.Ground("bottom")],
        "thin": [dea.ThinFilm("film", UNIT, start=0.0, end=T)],
    }
    runs = {}
    for name, electrodes in sets.items():
        scene = dea.Scene(block((1, 1, 1)), {"film": RUBBER}, electrodes, HELD)
        runs[name] = dea.solve(
            scene, dea.Trace("voltage", until=("stretch", 1.4), at=(0.5,)),
            {"stretch": dea.MeanStretch(("x_min", "x_max"), "x"),
             "charge": dea.Charge("top" if name == "full" else "film")},
            quiet=True, stability="never",
        )  # fmt: skip
    thin, full = runs["thin"], runs["full"]
    assert thin.summary["unknowns_by_field"]["phi"] == 0
    for column in ("voltage_V", "stretch", "charge_C"):
        assert thin.column(column) == pytest.approx(full.column(column), rel=1e-8, abs=1e-18)
    landed = next(r for r in full.history if r["event"] == "landed")
    assert landed["voltage_V"] == pytest.approx(0.5 * UNIT, rel=1e-12)
    lam = landed["stretch"]
    assert np.sqrt((lam**2 - lam**-4) / lam**4) == pytest.approx(0.5, rel=1e-8)


def test_taper_falls_from_full_potential_to_zero():
    """The given potential is V up to the start, V/2 in the middle and 0 at the end."""
    disc = MembraneDisc(12e-3, 4e-3, 0.5e-3, taper=2e-3, cells=(2, 4, 2))
    device = dea.read_gmsh(disc, MPI.COMM_SELF)
    tops = ("top_active", "top_edge")
    scene = dea.Scene(
        device, dict.fromkeys(device.regions, RUBBER),
        [dea.Electrode(tops, 100.0, taper=dea.Taper(4e-3, 6e-3)), dea.Ground("bottom")],
        [dea.Fix("bottom", "z"), dea.Fix("axis", "r"), dea.Fix("rim", "r")],
        kinematics=dea.Axisymmetric(),
    )  # fmt: skip
    X = np.zeros((5, 3))
    X[:, 0] = (0, 4e-3, 5e-3, 6e-3, 9e-3)
    _, given = scene.declared.potentials[0]
    assert given.volts(X) == pytest.approx([100, 100, 50, 0, 0])


def test_stack_goes_to_pull_in_on_every_mesh(quick_compile):
    """An endless stack with inset ideal electrodes ends at its own limit point, not at an edge.

    Without the augmentation the same meshes lose their stability at 12.4, 10.7 and 8.4 kV, the
    finer the earlier; with it there is no bifurcation before the maximum, which converges.
    """
    limits = []
    for mesh in (1, 2):
        cell = HelicalCell(electrode=0.0, radial=4, rim=1, through=2, grading=4.0).refine(mesh)
        scene = dea.Scene(
            dea.read_gmsh(cell, MPI.COMM_SELF), {"elastomer": RUBBER},
            [dea.Electrode("electrode_a_active", 10e3), dea.Ground("electrode_b_active")],
            [dea.FreeBody()], kinematics=dea.Helical(cell.pitch),
        )  # fmt: skip
        trace = dea.Trace("voltage", first=0.2, steps=60, until=("contraction", 0.4), longest=2.0)
        run = dea.solve(scene, trace, {"contraction": dea.OverallContraction()}, quiet=True,
                        stability="every")  # fmt: skip
        events = [row for row in run.history if row["event"]]
        assert [row["event"] for row in events] == ["maximum"]
        # the limit of each layer by itself is at a contraction of 1 - 2^(-2/3) = 0.370
        assert events[0]["contraction"] == pytest.approx(0.370, abs=0.005)
        limits.append(events[0]["voltage_V"])
    # own values 12500, 12481 and 12470 V on meshes 1, 2 and 4
    assert limits == pytest.approx([12470.0, 12470.0], rel=4e-3)
    assert limits[1] == pytest.approx(12470.0, rel=1.5e-3)


def test_bilayer_curls_to_a_full_circle():
    """A strip of an active and a passive layer, clamped at one end, until its tip is back there.

    At a full circle the middle of the end face has moved by -L along the strip; on the way it was
    farthest up and on one side only, and every state is stable.
    """
    L, h = 8e-3, 0.1e-3
    strip = BoxStack(L, None, [Layer("passive", h), Layer("active", h)], divisions=20)
    scene = dea.Scene(
        dea.read_gmsh(strip, MPI.COMM_SELF),
        {"passive": dea.Material(dea.NeoHookean(MU)), "active": RUBBER},
        [dea.Electrode("top", UNIT * h / T), dea.Ground("interface_1")],
        [dea.Clamp("x_min")], kinematics=dea.PlaneStrain(),
    )  # fmt: skip
    tip = {a: dea.MeanDisplacement("x_max", a) for a in "xy"}
    trace = dea.Trace("voltage", steps=160, until=("voltage_V", 2.06e3))
    run = dea.solve(scene, trace, tip, quiet=True, stability="every")
    x, y = run.column("x_m"), run.column("y_m")
    lowest = int(np.argmin(y))
    turned = int(np.argmin(x))  # the tip is farthest back at three quarters of the circle
    assert 0 < lowest < turned < len(x) - 1
    # back at the root: u_x = -L, and u_y = 0 up to the strip's own thickness
    assert x[-1] > -L > x[turned]
    at = np.interp(-L, x[turned:], y[turned:])
    assert abs(at) < 2 * h
    assert not [row for row in run.history if row["event"] or row["inertia"]]


@pytest.mark.parametrize(
    ("electrode", "words"),
    [
        (dea.ThinFilm("top", 1.0, start=0.0, end=1e-3), "must be a dielectric region"),
        (dea.ThinFilm("film", 1.0, start=1e-3, end=1e-3), "two different coordinates"),
        (dea.ThinFilm("film", 1.0, start=0.0, end=1e-3, along="q"), "two different coordinates"),
        (dea.Electrode("top", 1.0, taper=dea.Taper(1e-3, 1e-3)), "two different coordinates"),
        (dea.Electrode("top", 1.0, taper=dea.Taper(0.0, 1e-3, "q")), "one of r, x, y, z"),
        (dea.Electrode("top", 1.0, taper=dea.Taper(float("nan"), 1.0)), "finite number"),
    ],
)
def test_edges_refuse(electrode, words):
    with pytest.raises(dea.InputError, match=words):
        dea.Scene(block((1, 1, 1)), {"film": RUBBER}, [electrode], HELD)
