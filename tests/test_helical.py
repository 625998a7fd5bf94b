"""The helically periodic cell: closed forms, tangent, ties on any number of ranks, bad input."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from conftest import numbers_of_ranks
from mpi4py import MPI
from scipy.integrate import quad
from scipy.optimize import brentq

import dea_fenicsx as dea
from dea_fenicsx.geometry import HDEA, HelicalCell
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.results.fields import FieldWriter
from dea_fenicsx.results.per_turn import measure_turns
from dea_fenicsx.solvers.tangent import Tangent

MU, EPS_R = 50e3, 4.7
RING = HelicalCell(electrode=0, inset=0, radial=4, through=2, grading=1, grading_through=1)
PLATES = ("electrode_a_active", "electrode_b_active")
UNIT = RING.elastomer * np.sqrt(MU / (EPS_R * EPSILON_0))
WHOLE = {"stretch": dea.OverallStretch(), "twist": dea.OverallTwist(), "force": dea.OverallForce(),
         "torque": dea.OverallTorque()}  # fmt: skip
pytestmark = pytest.mark.usefixtures("quick_compile")


def ring(cell=RING, volts=0.0, pitch=0.0, comm=MPI.COMM_SELF, prestretched=None, **more):
    """A ring of film between ideal electrodes; all tests share its kernel."""
    if prestretched is not None:
        more["prescribed"] = [prestretched, *more.get("prescribed", [])]
    return dea.Scene(
        dea.read_gmsh(cell, comm),
        {"elastomer": dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))},
        electrodes=[dea.Electrode(PLATES[0], volts), dea.Ground(PLATES[1])],
        supports=[dea.FreeBody()],
        kinematics=dea.Helical(pitch),
        **more,
    )


def test_free_rings_are_the_exact_film():
    """Over the limit point at stretch 2^(-2/3) along the field, 0.6874 T sqrt(mu/eps)."""
    trace = dea.Trace("voltage", first=0.1, until=("stretch", 0.5))
    run = dea.solve(ring(volts=UNIT), trace, WHOLE, quiet=True, stability="every")
    lam = run.column("stretch")[1:] ** -0.5
    exact = np.sqrt((lam**2 - lam**-4) / lam**4)
    assert run.column("voltage_V")[1:] / UNIT == pytest.approx(exact, rel=1e-8)
    top = next(row for row in run.history if row["event"] == "maximum")
    assert top["stretch"] == pytest.approx(2 ** (-2 / 3), rel=1e-6)
    assert np.abs(run.column("twist_rad_per_m")).max() < 1e-8
    assert [row["inertia"] for row in run.history if row["stretch"] > 0.64] == [0] * 5


def tube(lam, k, a, b):
    """Axial force and torque of a neo-Hookean tube free on both walls, stretched and twisted.

    r^2 = R^2/lam + D; left Cauchy-Green B_rr = (R/(lam r))^2, B_tt = (r/R)^2 + (k r)^2,
    B_zz = lam^2, B_tz = lam k r; d sigma_rr/dr = (sigma_tt - sigma_rr)/r fixes D (Rivlin 1949).
    """

    def r(R, D):
        return np.sqrt(R * R / lam + D)

    def slope(R, D):
        brr, btt = (R / lam / r(R, D)) ** 2, (r(R, D) / R) ** 2 + (k * r(R, D)) ** 2
        return (btt - brr) / r(R, D) * R / lam / r(R, D)

    D = brentq(lambda D: quad(slope, a, b, args=(D,))[0], -0.9 * a * a / lam, b * b, xtol=1e-18)

    def thrust(R):
        return (quad(slope, a, R, args=(D,))[0] - (R / lam / r(R, D)) ** 2 + lam**2) * R / lam

    force = 2 * np.pi * MU * quad(thrust, a, b)[0]
    torque = 2 * np.pi * MU * quad(lambda R: k * r(R, D) ** 2 * R, a, b)[0]
    return force, torque


def test_torsion_and_extension_of_a_tube():
    """Given motion against Rivlin's force and torque, order 4 in the cells; then given loads.

    Without a structure along zeta the pitch makes no difference.
    """
    lam, k = 1.2, 150.0
    exact = tube(lam, k, RING.inner_radius, RING.outer_radius)
    errors = []
    for pitch, cell in ((0.0, RING), (RING.pitch, RING), (RING.pitch, RING.refine(2))):
        held = ring(cell, pitch=pitch, prescribed=[dea.AxialStretch(lam), dea.Twist(k)])
        run = dea.solve(held, dea.Ramp("stretch", steps=2), WHOLE, quiet=True, stability="never")
        found = (run["force_N"], run["torque_N_m"])
        errors.append(np.abs(np.array(found) / exact - 1))
    assert errors[0] == pytest.approx(errors[1], rel=1e-6)
    assert np.all(errors[2] < [1.1e-5, 3e-5])  # 1.05e-5 and 2.3e-5
    assert np.all(errors[1] / errors[2] > 7)
    loaded = ring(RING.refine(2), pitch=RING.pitch,
                  loads=[dea.AxialForce(found[0]), dea.Torque(found[1])])  # fmt: skip
    run = dea.solve(loaded, dea.Ramp("load", steps=3), WHOLE, quiet=True)
    assert run["stretch"] == pytest.approx(lam, rel=1e-8)
    assert run["twist_rad_per_m"] == pytest.approx(k, rel=1e-8)
    assert (run["force_N"], run["torque_N_m"]) == pytest.approx(found, rel=1e-8)
    assert run.summary["stable"] is True
    # what ParaView shows is the section's true displacement: its top has risen and turned
    u = FieldWriter(run.problem).node_fields()["displacement_m"]
    assert np.ptp(u[:, 1]) == pytest.approx((lam - 1) * RING.pitch, rel=0.02)
    assert np.ptp(u[:, 2]) > 0.9 * np.sin(k * RING.pitch) * RING.inner_radius


def test_a_film_that_was_stretched_before():
    """Left free it shrinks to its natural length, and under voltage it is the exact film.

    L is the stretch along the field from the natural film on: (eps/mu) E^2 = 1/L - L^2.
    """
    path = [dea.Ramp("prestretch", steps=2), dea.Ramp("voltage", steps=2)]
    for given, along in ({"z": 1.3}, 1.3), ({"r": 1.2}, 1.2**-2):
        free = ring(volts=0.5 * UNIT, prestretched=dea.PreStretch("elastomer", **given))
        run = dea.solve(free, path, WHOLE, quiet=True, stability="never")
        lam, volts = run.column("stretch"), run.column("voltage_V") / UNIT
        assert lam[2] == pytest.approx(1 / along, rel=1e-9)
        total = lam[2:] * along
        assert volts[2:] ** 2 == pytest.approx(lam[2:] ** 2 * (1 / total - total**2), abs=1e-9)


def test_a_tube_that_was_stretched_before_it_is_twisted():
    """Rivlin's tube of the test above: its mesh is longer here and has smaller radii.

    The mesh is an affine image of the one there, and the errors are the same.
    """
    before, lam, k = 1.1, 1.2, 150.0
    fine = RING.refine(2)
    thin = dataclasses.replace(
        fine, inner_radius=fine.inner_radius * before**-0.5,
        outer_radius=fine.outer_radius * before**-0.5,
    )  # fmt: skip
    held = ring(thin, pitch=thin.pitch, prestretched=dea.PreStretch("elastomer", z=before),
                prescribed=[dea.AxialStretch(lam / before), dea.Twist(k / before)])  # fmt: skip
    path = [dea.Ramp(("prestretch", "stretch"), steps=2)]
    run = dea.solve(held, path, WHOLE, quiet=True, stability="never")
    exact = tube(lam, k, RING.inner_radius, RING.outer_radius)
    assert run["force_N"] == pytest.approx(exact[0], rel=1.1e-5)
    assert run["torque_N_m"] == pytest.approx(exact[1], rel=3e-5)


def test_taylor_remainder_of_all_unknowns():
    """Remainder of order 2 in a rough state, overall unknowns and periodic ties included."""
    rng = np.random.default_rng(5)
    loads = [dea.AxialForce(0.1), dea.Torque(1e-4)]
    problem = Problem(ring(volts=0.5 * UNIT, pitch=RING.pitch, loads=loads))
    problem.commit(problem.imposed(problem.under(problem.state, {"voltage": 1.0, "load": 1.0})))
    problem.commit(problem.moved(problem.state, 1e-3 * rng.standard_normal(len(problem.free))))
    start, residual = problem.state, problem.unbalanced(problem.residual())
    linear = Tangent(problem)
    tangent = linear.matrix()
    x, y = tangent.createVecs()
    direction = rng.standard_normal(len(problem.free))
    x.array[:] = direction
    tangent.mult(x, y)
    assert linear.times(direction) == pytest.approx(y.array_r, abs=1e-11 * tangent.norm())
    steps, remainders = np.array([1e-4, 1e-5, 1e-6]), []
    for h in steps:
        problem.commit(start)
        problem.commit(problem.moved(problem.state, h * direction))
        change = problem.unbalanced(problem.residual()) - residual - h * y.array_r
        remainders.append(np.linalg.norm(change))
    assert np.polyfit(np.log(steps), np.log(remainders), 1)[0] == pytest.approx(2, abs=0.1)
    assert tangent.isSymmetric(1e-12 * tangent.norm())
    # the load's derivative is that of the residual, as all acts linearly
    problem.commit(start)
    problem.commit(problem.under(problem.state, {"voltage": 1.0, "load": 1.5}))
    change = problem.unbalanced(problem.residual()) - residual
    assert change == pytest.approx(0.5 * linear.by_load("load"), abs=1e-12)


def inset_history(comm):
    """Inset electrodes under voltage, force and torque: numbers of three steps."""
    cell = HelicalCell(electrode=0, radial=8, rim=2, through=2)
    loads = [dea.AxialForce(-0.2, "voltage"), dea.Torque(1e-3, "voltage")]
    scene = ring(cell, 0.4 * UNIT, cell.pitch, comm, loads=loads)
    record = {**WHOLE, "charge": dea.Charge(PLATES[0]),
              "wall": dea.MeanDisplacement("outer", "t")}  # fmt: skip
    run = dea.solve(scene, dea.Ramp(steps=3), record, quiet=True)
    assert run.summary["stable"] is True
    names = ("stretch", "twist_rad_per_m", "force_N", "torque_N_m", "charge_C", "wall_m",
             "max_field_V_per_m")  # fmt: skip
    return {name: list(run.column(name)[1:]) for name in names}


@pytest.mark.slow
@pytest.mark.mpi
def test_same_history_on_any_number_of_ranks(on_ranks):
    here = inset_history(MPI.COMM_SELF)
    assert len(here) == 7
    assert here["stretch"][-1] < 0.97
    for ranks in numbers_of_ranks():
        there = on_ranks("test_helical", "inset_history", ranks)
        for name, values in here.items():
            assert there[name] == pytest.approx(values, rel=1e-8), name


@pytest.mark.parametrize("ends", [{}, {"ends": "flat"}, {"ends": "flat", "cap": 1.7e-3}])
def test_turns_of_a_helical_state(ends):
    """Nodes moved by a known stretch and twist, two turns and more; caps do not count."""
    device = HDEA(turns=3, **ends)
    x = device.mesh().points
    lam, k = 0.9, 40.0
    angle = k * x[:, 2]
    c, s = np.cos(angle), np.sin(angle)
    moved = np.column_stack([c * x[:, 0] - s * x[:, 1], s * x[:, 0] + c * x[:, 1], lam * x[:, 2]])
    # upright, and a body that leans and has moved
    c, s = np.cos(0.1), np.sin(0.1)
    leaning = moved @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + 1e-3
    for there in (moved, leaning):
        turns = measure_turns(x, there - x, device.pitch)
        # the axis found is a mean over whole turns, which a twist of 0.044 a turn tilts by 1e-3:
        # its square is felt
        assert turns.contraction == pytest.approx([0.1, 0.1], abs=1e-6)
        assert turns.twist_rad == pytest.approx([k * device.pitch] * 2, abs=3e-6)
        assert turns.scatter == pytest.approx([0, 0], abs=2e-4)
    with pytest.raises(dea.InputError, match="two turns"):
        measure_turns(x, moved - x, 5 * device.pitch)


BAD = {
    "pitch": (lambda: ring(pitch=1.5 * RING.pitch), "1.5 times the height"),
    "end": (lambda: dea.Scene(dea.read_gmsh(RING, MPI.COMM_SELF), ring().materials,
            supports=[dea.FreeBody()], kinematics=dea.Helical(0.0, ("bottom", "lid"))), "lid"),
    "follower": (lambda: ring(loads=[dea.FollowerPressure("inner", 1e3)]), "DeadPressure"),
    "force on a held cell": (lambda: ring(prescribed=[dea.AxialStretch(1.1)],
                             loads=[dea.AxialForce(1.0)]), "no effect"),
    "stretch": (lambda: ring(prescribed=[dea.AxialStretch(-1.0)]), "must be > 0"),
    "twice": (lambda: ring(prescribed=[dea.Twist(1.0), dea.Twist(2.0)]), "twice"),
    "no cell": (lambda: dea.Scene(dea.read_gmsh(RING, MPI.COMM_SELF), ring().materials,
                supports=[dea.Clamp("bottom")], loads=[dea.Torque(1.0)],
                kinematics=dea.Axisymmetric()), "Helical"),
    "hoop stretch": (lambda: ring(prescribed=[dea.Stretch("inner", "t", 1.1)]), "coordinates"),
    "cells": (lambda: HelicalCell(electrode=0.0, through=1), "through"),
    "inset": (lambda: HelicalCell(inset=3e-3), "leaves no electrode"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_input(case):
    make, words = BAD[case]
    with pytest.raises(dea.InputError, match=words) as caught:
        make()
    assert str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)


def test_ends_held_differently_are_refused():
    fixed = [dea.Displacement("top", "r", 1e-4), dea.Displacement("bottom", "r", 2e-4)]
    with pytest.raises(dea.InputError, match="different values"):
        Problem(ring(prescribed=fixed))
