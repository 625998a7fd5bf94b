"""One trace over a thick sphere's first bifurcations, beside those of the incremental problem."""

import numpy as np
import pytest
from conftest import on_demand

import dea_fenicsx as dea
from dea_fenicsx import exact
from dea_fenicsx.geometry import HollowSphere

A, B, MU = 1e-3, 1.2e-3, 1e5
RUBBER = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(4.0))


def bifurcations(layers, cells, largest, part="half"):
    """Inner radii over A at the bifurcations of one trace of a section."""
    sphere = exact.RoundBalloon(A, B, RUBBER)
    scene = dea.Scene(
        dea.read_gmsh(HollowSphere(A, B, part, layers, cells)), {"wall": RUBBER},
        electrodes=[dea.Electrode("inner", sphere.limits(2e-3)[0].volts), dea.Ground("outer")],
        supports=[dea.Fix("axis", "r"),
                  dea.Fix("equator", "z") if part == "half" else dea.FreeBody()],
        kinematics=dea.Axisymmetric(),
    )  # fmt: skip
    path = dea.Trace("voltage", until=("equator_m", (largest - 1) * A), steps=200)
    record = {"equator": dea.AtPoint((A, 0), "displacement", "r")}
    run = dea.solve(scene, path, record, quiet=True, stability="every")
    for row in run.history[1:]:
        volts = sphere.at(A + row["equator_m"]).volts
        assert row["voltage_V"] == pytest.approx(volts, rel=2e-4)
    return [1 + r["equator_m"] / A for r in run.history if r["event"] == "bifurcation"]


@on_demand
def test_the_first_five_are_located_and_converge():
    """The shapes n = 2, 4, 6, 8 and 10 leave the round states in this order, one at a time."""
    changes = exact.RoundBalloon(A, B, RUBBER).shape_changes(1.7e-3, (2, 4, 6, 8, 10))
    right = np.array([c.state.radius / A for c in changes])
    assert [c.mode for c in changes] == [2, 4, 6, 8, 10]
    coarse, fine = (np.array(bifurcations(*mesh, 1.7)[:5]) for mesh in ((2, 8), (3, 16)))
    assert fine == pytest.approx(right, rel=1e-3)
    assert np.all(abs(coarse - right) > 8 * abs(fine - right))


def off_the_first_five(layers, cells):
    """How far those of a whole section lie from n = 1 to 5, as a share of the radius."""
    changes = exact.RoundBalloon(A, B, RUBBER).shape_changes(1.42e-3)
    assert [c.mode for c in changes] == [1, 2, 3, 4, 5]
    right = np.array([c.state.radius / A for c in changes])
    found = np.array(bifurcations(layers, cells, 1.42, "whole"))
    assert found.shape == right.shape
    return abs(found / right - 1)


def test_those_of_a_whole_section_beside_its_limit_point():
    """One step passes the limit point and three of them, and all are located."""
    assert np.all(off_the_first_five(2, 8) < [2e-5, 5e-5, 3e-4, 7e-4, 2e-3])


@on_demand
def test_those_of_a_whole_section_on_a_finer_mesh():
    assert np.all(off_the_first_five(3, 16) < [2e-6, 1e-5, 3e-5, 7e-5, 2e-4])
