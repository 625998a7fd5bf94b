"""Optimisation with gradients, against the optimum of a laminate."""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from conftest import block, on_demand
from mpi4py import MPI
from scipy.optimize import minimize_scalar

import dea_fenicsx as dea
from dea_fenicsx.design import EFFECTIVE_MU, Analysis, improve, search
from dea_fenicsx.design.variations import variation
from dea_fenicsx.geometry import HelicalCell
from dea_fenicsx.support.compat import dolfinx

pytestmark = pytest.mark.usefixtures("quick_compile")
T, VOLTS, LENGTH, MIDDLE = 1e-3, 100.0, 8.0, 2.0
STIFF = dea.Material(dea.NeoHookean(2e5), dea.IdealDielectric(3.0))
SLOPE = dea.Expression(lambda at: at.F[1, 0], "mean", ("active_middle", "passive_middle"))
"""Slope over the middle: there it is the curvature times the distance from the middle plane."""

ANALYSIS = Analysis({"slope": SLOPE}, dea.Ramp(steps=1), {"options": dea.NewtonOptions(1e-12)})


def bilayer(comm, ratio, volts=VOLTS, mu=5e4):
    """Half of a strip of two layers; what is near its free end does not reach its middle."""
    n = (8, 2)
    corners = [(0.0, 0.0), (LENGTH, 2.0)]
    mesh = dolfinx.mesh.create_rectangle(
        comm, corners, n, dolfinx.mesh.CellType.quadrilateral,
        ghost_mode=dolfinx.mesh.GhostMode.shared_facet,
    )  # fmt: skip
    cells = np.arange(mesh.topology.index_map(2).size_local + mesh.topology.index_map(2).num_ghosts,
                      dtype=np.int32)  # fmt: skip
    centres = dolfinx.mesh.compute_midpoints(mesh, 2, cells)
    tags = 1 + (centres[:, 1] > 1) + 2 * (centres[:, 0] > MIDDLE)
    x = mesh.geometry.x
    x[:, 1] = np.where(x[:, 1] > 1, 1 + ratio * (x[:, 1] - 1), x[:, 1])
    device = dea.from_dolfinx(
        mesh, dolfinx.mesh.meshtags(mesh, 2, cells, tags.astype(np.int32)),
        regions={"active_middle": 1, "passive_middle": 2, "active": 3, "passive": 4},
        surfaces={"left": dea.OnPlane("x", 0.0), "bottom": dea.OnPlane("y", 0.0),
                  "between": dea.Interior(dea.OnPlane("y", T))}, unit=T,
    )  # fmt: skip
    soft = dea.Material(dea.NeoHookean(mu), dea.IdealDielectric(3.0))
    return dea.Scene(
        device,
        {name: soft if name.startswith("active") else STIFF for name in device.regions},
        electrodes=[dea.Electrode("bottom", volts), dea.Ground("between")],
        supports=[dea.Fix("left", "x"), dea.FreeBody()], kinematics=dea.PlaneStrain(T),
    )  # fmt: skip


def curvature(ratio, volts=VOLTS, mu=5e4):
    soft = dea.Material(dea.NeoHookean(mu), dea.IdealDielectric(3.0))
    plies = [dea.exact.Ply(soft, T, driven=True), dea.exact.Ply(STIFF, ratio * T)]
    return dea.exact.Laminate(plies).curvature(volts)


def test_the_best_thickness_of_a_passive_layer(tmp_path):
    """The thickness ratio of largest curvature, to 1e-4 in at most ten designs; then once more."""
    exact = minimize_scalar(
        lambda r: -abs(curvature(r)), bounds=(0.05, 2.0), method="bounded", options={"xatol": 1e-9}
    ).x

    def search(**more):
        return improve(
            bilayer, {"ratio": (0.1, 1.5, 1.0)}, {"slope": "max"}, ANALYSIS,
            out=tmp_path, quiet=True, comm=MPI.COMM_SELF, **more,
        )  # fmt: skip

    found = search()
    assert found.converged and found.feasible and found.evaluations <= 10
    assert found.design["ratio"] == pytest.approx(exact, rel=1e-4)
    assert found.quantities["slope"] > found.before["slope"]
    kept = next(tmp_path.glob("designs.0.jsonl"))
    lines = kept.read_text().splitlines(keepends=True)
    kept.write_text("".join(lines[:3]) + lines[3][:20])  # as a kill leaves it
    again = search(resume=True)
    assert again.design == found.design and again.evaluations == found.evaluations
    assert again.solved == found.evaluations - 3


def test_rates_of_constants_voltages_and_nodes_add_up():
    """A variable that changes all three at once, against solved neighbours."""

    def build(comm, p):
        return bilayer(comm, 0.5 + 0.2 * p, VOLTS * (1 + p), 5e4 * (1 + p**2))

    def slope(p):
        run = dea.solve(build(MPI.COMM_SELF, p), ANALYSIS.items, ANALYSIS.record, quiet=True,
                        **ANALYSIS.solve)  # fmt: skip
        return run, run["slope"]

    run, _ = slope(0.5)
    change = variation(build, run.problem, {"p": 0.5}, "p", (0.0, 1.0), MPI.COMM_SELF)
    assert set(change.rates) == {"active.elastic.mu", "active_middle.elastic.mu"}
    found = run.sensitivity("slope", change.variables())
    total = change.total(found.derivatives, run.problem.factors)
    h = 1e-3
    assert total == pytest.approx((slope(0.5 + h)[1] - slope(0.5 - h)[1]) / (2 * h), rel=1e-5)


@pytest.mark.parametrize("method", ["SLSQP", "MMA"])
def test_a_constraint_holds(method):
    """At 120 V at most a stroke that grows with the voltage ends there."""
    if method == "MMA":
        pytest.importorskip("nlopt")
    volts = {"volts": dea.Potential("bottom"), "slope": SLOPE}
    found = improve(
        lambda comm, volts: bilayer(comm, 0.3, volts), {"volts": (50.0, 200.0)}, {"slope": "max"},
        Analysis(volts, dea.Ramp(steps=1)), {"volts": (None, 120.0)}, quiet=True,
        comm=MPI.COMM_SELF, method=method,
    )  # fmt: skip
    assert found.feasible and found.design["volts"] == pytest.approx(120.0, rel=1e-6)


def test_the_largest_voltage_with_a_margin_against_pull_in():
    """A free film pulls in at 0.687 T sqrt(mu/eps): the voltage is that over the margin."""
    mu, eps_r = 5e4, 3.0

    def film(comm, volts, thickness):
        return dea.Scene(
            block((1, 1, 1), 1e-3, thickness),
            {"film": dea.Material(dea.NeoHookean(mu), dea.IdealDielectric(eps_r))},
            [dea.Electrode("top", volts), dea.Ground("bottom")],
            [dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
        )  # fmt: skip

    thin = {"thin": dea.MeanStretch(("bottom", "top"), "z")}
    found = improve(
        film, {"volts": (2e3, 12e3, 4e3), "thickness": (3e-4, 5e-4, 4e-4)}, {"v": "max"},
        [Analysis({"v": dea.Potential("top")}, dea.Ramp(steps=1)),
         Analysis(thin, dea.Trace("voltage", first=0.5, until=("thin", 0.55)))],
        {"pull-in margin": (1.5, None)}, quiet=True, comm=MPI.COMM_SELF,
    )  # fmt: skip
    best = 0.687364818 * 5e-4 * np.sqrt(mu / (eps_r * dea.materials.EPSILON_0)) / 1.5
    assert found.converged and found.design["thickness"] == pytest.approx(5e-4)
    assert found.design["volts"] == pytest.approx(best, rel=1e-5)


@pytest.mark.parametrize("changes, words", [
    ({"variables": {"ratio": (0.1, 1.5, 3.0)}}, "must lie in its range"),
    ({"variables": {"ratio": 0.5}}, "All variables are fixed"),
    ({"objective": {"slop": "max"}}, "did you mean 'slope'"),
    ({"objective": {"slope": "most"}}, 'must be "min" or "max"'),
    ({"constraints": {"pull-in": (1.0, None)}}, "no quantity 'pull-in'"),
    ({"build": lambda comm, ratio: bilayer(comm, 0.5)}, "changes nothing"),
    ({"build": lambda comm, ratio: 3}, "must return a Scene"),
    ({"resume": True}, "give out="),
])  # fmt: skip
def test_what_is_wrong_is_told(changes, words):
    given = {
        "build": bilayer, "variables": {"ratio": (0.1, 1.5)}, "objective": {"slope": "max"},
        "analyses": ANALYSIS, "quiet": True, "comm": MPI.COMM_SELF,
    }  # fmt: skip
    with pytest.raises(dea.InputError) as caught:
        improve(**(given | changes))
    told = str(caught.value)
    assert words in told and len(told) <= 400 and told.endswith(".")


def slope_by_ratio(comm):
    run = dea.solve(bilayer(comm, 1.0), ANALYSIS.items, ANALYSIS.record, quiet=True,
                    **ANALYSIS.solve)  # fmt: skip
    change = variation(bilayer, run.problem, {"ratio": 1.0}, "ratio", (0.1, 1.5), comm)
    return list(run.sensitivity("slope", change.variables()).values())


@pytest.mark.mpi
def test_three_ranks_find_what_one_finds(on_ranks):
    found = on_ranks("test_improving", "slope_by_ratio", 3)
    assert np.array(found) == pytest.approx(np.array(slope_by_ratio(MPI.COMM_SELF)), rel=1e-8)


# --------------------------------------------------------------------------------- a helical cell

STRENGTH, SAFETY, INSET, ELECTRODE = 80e6, 1.2, 0.1e-3, 50e-6
HELICAL = dea.Material(dea.NeoHookean(EFFECTIVE_MU), dea.IdealDielectric(10.0, STRENGTH))


def cell(comm, outer, inner, extra, volts):
    """A cell of rings; `extra` is the thickness above the least of the thesis's Table 4.1.

    That is 0.1 mm, or where the ring is so wide that the pitch angle falls to a degree.
    """
    least = max(1e-4, np.pi * outer * np.tan(np.radians(1.0)) - ELECTRODE)
    shape = HelicalCell(outer, inner, INSET, least + extra, ELECTRODE, radial=6, through=2,
                        grading_rim=3, grading_through=3, films=True)  # fmt: skip
    metal = dea.Material(dea.NeoHookean(EFFECTIVE_MU), dea.Conductor())
    device = dea.device(shape, comm)
    electrodes = [dea.Electrode("electrode_a", volts), dea.Ground("electrode_b")]
    return dea.Scene(
        device, {n: metal if "electrode" in n else HELICAL for n in device.regions}, electrodes,
        supports=[dea.FreeBody()], kinematics=dea.Helical(0.0),
    )  # fmt: skip


@on_demand
def test_a_helical_actuator_by_its_cell():
    """Least voltage for 10 % with a margin against breakdown, beside the front of NSGA-II.

    The front's model leaves out that electrodes and rims resist.  So its design is judged in the
    cell, too: there the improved one needs no more voltage, and keeps its margin.
    """
    field = dea.Expression(
        lambda at: (SAFETY / STRENGTH) ** 2 * ufl.dot(at.E, at.E), "mean",
        ("film_below", "film_above"),
    )  # fmt: skip
    record = {"contraction": dea.OverallContraction(), "volts": dea.Potential("electrode_a"),
              "field": field}  # fmt: skip
    analysis = Analysis(record, dea.Ramp("voltage", steps=4), {"stability": "never"})
    free = {"outer": (2e-3, 5e-3, 3.5e-3), "inner": (1e-3, 1.7e-3, 1.5e-3),
            "extra": (0.0, 4e-4, 1e-4), "volts": (2e3, 20e3, 9e3)}  # fmt: skip

    def least(variables, bounds):
        return improve(cell, variables, {"volts": "min"}, analysis, bounds, quiet=True, most=30,
                       tolerance=1e-7, comm=MPI.COMM_SELF)  # fmt: skip

    found = least(free, {"contraction": (0.1, None), "field": (None, 1.0)})
    assert found.converged and found.feasible and found.evaluations <= 30
    front = search(HELICAL, {"eps_r": 10.0}, constraints={"breakdown": SAFETY}, inset=INSET)
    enough = np.flatnonzero(front["strain"] >= 0.1)
    best = front.row(int(enough[np.argmin(front["voltage"][enough])]))
    extra = best["elastomer"] - 1e-4
    assert 0 <= extra < 1e-6
    beside = least(
        {"outer": best["outer_radius"], "inner": best["inner_radius"], "extra": extra,
         "volts": (2e3, 8e3, 6e3)}, {"contraction": (0.1, None)},
    )  # fmt: skip
    assert found.quantities["volts"] < beside.quantities["volts"]
    assert best["voltage"] < found.quantities["volts"] < 1.4 * best["voltage"]
