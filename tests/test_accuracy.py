"""Estimates of discretisation errors, and runs whose error is as small as was asked for."""

from __future__ import annotations

import json
import tempfile
from dataclasses import replace
from pathlib import Path

import gmsh
import numpy as np
import pytest
import ufl
from mpi4py import MPI
from test_convergence import EPS_R, MU, VOLTS, A, B, TriangleStrip, solve_tube

import dea_fenicsx as dea
from dea_fenicsx.exact import RoundBalloon
from dea_fenicsx.geometry import (
    HDEA,
    Balloon,
    BoxStack,
    DiskStack,
    HelicalCell,
    HollowSphere,
    Layer,
    Meridian,
    _gmsh,
)  # fmt: skip
from dea_fenicsx.geometry.bisected import Bisected, sheets
from dea_fenicsx.geometry.quartic import of_order, quartic
from dea_fenicsx.gradients.discretisation import DiscretisationError
from dea_fenicsx.mesh.sheets import over_sheets, with_exact_shape
from dea_fenicsx.run.accuracy import AccuracySearch, Level
from dea_fenicsx.run.size_field import write_sizes
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError

pytestmark = pytest.mark.usefixtures("quick_compile")
WALL = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))
WIDER = {"wider": dea.MeanDisplacement("x_max", "r"), "charge": dea.Charge("x_min")}
CLAMPED_M = 4.88003e-6
"""Its displacement with 560 graded cells of degree 3, to 2e-6."""


def tube(comm=MPI.COMM_SELF, clamped=False, volts=VOLTS):
    """A tube with a radial field: of one cell and exact, or clamped at its lower end."""
    strip = BoxStack(B - A, None, [Layer("wall", B - A, 2 if clamped else 1)], 1, x0=A)
    held = [dea.Clamp("bottom")] if clamped else [dea.Fix("bottom", "z"), dea.Fix("top", "z")]
    return dea.Scene(
        dea.device(strip, comm), {"wall": WALL}, [dea.Electrode("x_min", volts),
        dea.Ground("x_max")], held, kinematics=dea.Axisymmetric(),
    )  # fmt: skip


FAMILIES = {
    "strip": BoxStack(20e-3, None, [Layer("a", 1e-3), Layer("b", 1e-3)], 3, grading=4),
    "straight": BoxStack(20e-3, 5e-3, [Layer("a", 1e-3)], (2, 2), order=1),
    "section": HollowSphere(1e-3, 1.2e-3, "half", 1, 4),
    "octant": HollowSphere(1e-3, 1.2e-3, "octant", 1, 4),
    "surface": Balloon(1e-3, 4),
    "line": Meridian((0, 1e-3), (1e-3, 0), (0, 0), cells=4),
    "cell": HelicalCell(radial=2, rim=1, through=2),
    "disc": DiskStack(5e-3, [Layer("a", 1e-3)], radial=2, angular=8),
    "helix": HDEA(turns=1, angular=8, radial=2),
}


@pytest.mark.parametrize("name", FAMILIES)
def test_halved_sheets_keep_names_and_sizes(name):
    """All groups are there with their sizes, no node hangs, and curved cells come closer."""
    family = FAMILIES[name]
    number = sheets(family.mesh())
    halved = Bisected(family).halved(np.unique(number)[::2]).halved(np.array([1]))
    mesh = halved.mesh()
    mesh.check()
    assert len(mesh.cells) > len(family.mesh().cells)

    def sizes(mesh):
        with _gmsh.temporary_model(mesh, "device") as model:
            return {k: size for k, (_, _, size) in _gmsh.measure(model).items()}

    def off(found):
        return max(abs(found[k] / size - 1) for k, size in halved.measures().items() if size)

    found, before = sizes(mesh), sizes(family.mesh())
    assert set(found) == set(before) and off(found) < 1.01 * off(before) + 1e-12
    # each node in the middle of a side belongs to the cells on both of its sides
    assert len(np.unique(mesh.cells)) == len(mesh.points)
    assert len(np.unique(np.round(mesh.points / 1e-9), axis=0)) == len(mesh.points)


def test_sheets_of_a_device():
    """Each part of a cell is added to the sheet that divides this cell along its axis."""
    family = BoxStack(3.0, 2.0, [Layer("a", 1.0, 2)], (3, 1))
    device = dea.device(family, MPI.COMM_SELF)
    parts = np.tile([100.0, 10.0, 1.0], (6, 1))
    found = over_sheets(device, family.mesh(), parts)
    assert sorted(found) == [3.0, 3.0, 60.0, 200.0, 200.0, 200.0]


def summed(comm):
    """Sums over the sheets of a grid, and the sizes as they are written for gmsh."""
    family = BoxStack(3.0, 2.0, [Layer("a", 1.0, 2)], (3, 1))
    device = dea.device(family, comm)
    owned = device.owned_cells()
    number = np.asarray(device.mesh.topology.original_cell_index[:owned])
    parts = np.sqrt(2.0 + number[:, None]) * [100.0, 10.0, 1.0]
    sums = over_sheets(device, family.mesh(), parts)
    error = DiscretisationError("tip", 1.0, 0.1, 0.1, 100, 2, parts)
    folder = Path(comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None, root=0))
    write_sizes(folder / "sizes.pos", device, error, 1e-2)
    return [sums.tolist(), (folder / "sizes.pos").read_text()] if comm.rank == 0 else None


@pytest.mark.mpi
def test_sheets_and_sizes_on_ranks(on_ranks):
    alone = summed(MPI.COMM_SELF)
    assert alone[1].count("SH(") == 6
    for ranks in (2, 7):
        assert on_ranks("test_accuracy", "summed", ranks) == alone


def test_exact_shape_of_a_sphere():
    device = dea.device(HollowSphere(1e-3, 1.2e-3, "octant", 1, 4), MPI.COMM_SELF)
    exact = with_exact_shape(device)
    volume = np.pi / 6 * (1.2e-3**3 - 1e-3**3)

    def off(d):
        found = dolfinx.fem.assemble_scalar(compat.compile_form(1.0 * ufl.dx(domain=d.mesh)))
        return abs(found * d.length**3 / volume - 1)

    assert off(exact) < off(device) / 300
    strip = dea.device(FAMILIES["strip"], MPI.COMM_SELF)
    assert with_exact_shape(strip) is strip


def test_the_tube_is_as_exact_as_asked(tmp_path):
    """One cell of degree 3 is enough, and the estimates tell the error within a factor of 2."""
    run = dea.solve(
        tube(), dea.Ramp(steps=4), WIDER, tmp_path / "tube", quiet=True,
        accuracy=("wider_m", 1e-4), estimate=["charge_C"],
    )  # fmt: skip
    k, _ = solve_tube()
    exact = float(np.sqrt(B**2 + k) - B)
    told = json.loads((tmp_path / "tube" / "summary.json").read_text("utf-8"))["accuracy"]
    assert told["reached"] and told["degree"] == 3 and len(run.history) == 5
    assert abs(run["wider_m"] / exact - 1) < 1e-4
    for level in told["levels"]:
        true = exact - level["value"]
        assert 0.5 < level["estimate"] / true < 2
        assert 0.5 < level["error"] * level["value"] / abs(true) < 2
    own = run.discretisation_error("wider")
    assert own.relative == pytest.approx(told["error"], rel=1e-6)
    assert set(run.summary["discretisation_error"]) == {"charge_C", "wider_m"}


def test_corners_get_small_cells():
    """A clamped end: degree 3, and cells that become smaller towards its corners alone."""
    found = dea.solve(
        tube(clamped=True), dea.Ramp(steps=4), WIDER, quiet=True, accuracy=("wider", 1e-3)
    )  # fmt: skip
    told = found.summary["accuracy"]
    assert told["reached"] and abs(found["wider_m"] / CLAMPED_M - 1) < 1e-3
    # At the corner of clamp and electrode parts of both signs cancel: the error of one mesh comes
    # out as a sixth of the true one; the largest error is what is compared with the asked one.
    for level in told["levels"]:
        assert level["largest"] * level["value"] > 0.5 * abs(CLAMPED_M - level["value"])
    assert found.problem.scene.device.quality["largest_aspect"] > 2


def test_curved_cells_are_part_of_the_error():
    """Two cells of a sphere: nearly all of the error of its area is that of their shape."""
    sphere = RoundBalloon(1e-3, 1.2e-3, WALL)
    device = dea.device(HollowSphere(1e-3, 1.2e-3, "half", 1, 2), MPI.COMM_SELF)
    scene = dea.Scene(
        device, {"wall": WALL}, [dea.Electrode("inner", sphere.at(1.15e-3).volts),
        dea.Ground("outer")], [dea.Fix("axis", "r"), dea.Fix("equator", "z")],
        kinematics=dea.Axisymmetric(),
    )  # fmt: skip
    run = dea.solve(scene, dea.Ramp(steps=3), {"area": dea.Area("inner")}, quiet=True)
    found = run.discretisation_error("area")
    true = 2 * np.pi * 1.15e-3**2 - run["area_m2"]
    assert 0.5 < found.estimate / true < 2 and found.value == pytest.approx(run["area_m2"])


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (dict(accuracy=("wide_m", 1e-3)), "did you mean 'wider_m'"),
        (dict(accuracy=("wider_m", 0.0)), "must be an error relative to its value"),
        (dict(accuracy=("wider_m", -1e-3)), "must be an error relative to its value"),
        (dict(accuracy=("wider_m", "fine")), "must be an error relative to its value"),
        (dict(accuracy=("wider_m",)), "a recorded name and the largest relative error"),
        (dict(accuracy=(3, 1e-3)), "must be a name in record="),
        (dict(accuracy=("wider_m", 1e-3), resume=True), "leave resume="),
        (dict(estimate=["wide"]), "did you mean 'wider'"),
        (dict(estimate="wider"), "a list of recorded names"),
    ],
)  # fmt: skip
def test_bad_input(options, told):
    with pytest.raises(InputError, match="(?i)" + told.replace("(", r"\(")) as caught:
        dea.solve(tube(), dea.Ramp(steps=1), WIDER, quiet=True, **options)
    assert len(str(caught.value)) <= 400


def test_what_has_no_derivative_has_no_estimate():
    most = {"most": dea.LargestDisplacement("x_max", "r")}
    with pytest.raises(InputError, match="it jumps from one node to another"):
        dea.solve(tube(), dea.Ramp(steps=1), most, quiet=True, accuracy=("most_m", 1e-3))


class Wider:
    """An observable of a script, of which no integrals are known."""

    unit = "m"

    def bind(self, problem):
        return WIDER["wider"].bind(problem)


def test_an_observable_of_a_script():
    """Without a dual solution the change of the state itself gives the same."""
    both = WIDER | {"own": Wider()}
    run = dea.solve(tube(), dea.Ramp(steps=4), both, quiet=True)
    own, known = (run.discretisation_error(name) for name in ("own", "wider"))
    assert own.estimate == pytest.approx(known.estimate, rel=1e-6)
    assert own.linear == pytest.approx(known.linear, rel=1e-5) and own.cells is None


class Sized(TriangleStrip):
    """The triangles of the tube, with sizes from a file."""

    def __init__(self, cells, sizes=None):
        super().__init__(cells)
        self.sizes = sizes

    def build(self):
        model = super().build()
        if self.sizes is not None:
            model.mesh.clear()
            gmsh.merge(str(self.sizes))
            field = model.mesh.field.add("PostView")
            model.mesh.field.setAsBackgroundMesh(field)
            model.mesh.generate(2)
        return model


def test_sizes_for_a_mesh_from_elsewhere(tmp_path, monkeypatch):
    """Cells of the sizes that a run asks for take the error down, most of all at the corner."""
    monkeypatch.setattr("dea_fenicsx.run.accuracy.MOST_CHOICES", 1)

    def error(sizes, out):
        scene = replace(tube(clamped=True), device=dea.device(Sized(2, sizes), MPI.COMM_SELF))
        run = dea.solve(
            scene, dea.Ramp(steps=4), WIDER, out, quiet=True, accuracy=("wider", 1e-4)
        )  # fmt: skip
        return run.summary["accuracy"]["error"], run.summary["accuracy"]["cells"]

    coarse, cells = error(None, tmp_path / "coarse")
    finer, more = error(tmp_path / "coarse" / "sizes.pos", tmp_path / "finer")
    assert more > cells and finer < coarse / 4


def test_an_accuracy_that_is_not_reached_is_told(monkeypatch, capsys):
    monkeypatch.setattr("dea_fenicsx.run.accuracy.MOST_CHOICES", 1)
    run = dea.solve(tube(), dea.Ramp(steps=4), WIDER, accuracy=("wider_m", 1e-6))
    told = run.summary["accuracy"]
    assert not told["reached"] and told["error"] > 1e-6 and told["degree"] == 2
    assert "the search ends with discretisation number 1." in capsys.readouterr().out


def test_where_no_parts_are_known_all_cells_are_halved():
    """An observable of a script: first the degree, then uniformly finer meshes."""
    scene = replace(tube(clamped=True), elements=dea.Discretisation(degree=4))
    run = dea.solve(
        scene, dea.Ramp(steps=4), {"own": Wider()}, quiet=True, accuracy=("own", 3e-2)
    )  # fmt: skip
    told = run.summary["accuracy"]
    assert told["reached"] and [level["cells"] for level in told["levels"][:2]] == [2, 8]
    assert abs(run["own_m"] / CLAMPED_M - 1) < 3e-2


def test_a_finer_mesh_that_loses_equilibrium(monkeypatch):
    """What a coarse mesh bears is no answer of known accuracy then."""
    tried = AccuracySearch._try

    def lost(self, scene):
        if self.levels:
            raise dea.EquilibriumLost("Equilibrium was lost.")
        return tried(self, scene)

    monkeypatch.setattr(AccuracySearch, "_try", lost)
    run = dea.solve(
        tube(clamped=True), dea.Ramp(steps=4), WIDER, quiet=True, accuracy=("wider", 0.1)
    )  # fmt: skip
    told = run.summary["accuracy"]
    assert told["lost"] and not told["reached"] and told["degree"] == 2


def test_predictions_that_drift():
    """The spread of what three meshes predict is doubt; a first mesh alone is doubted, too."""
    search = AccuracySearch("wider", WIDER["wider"], 1e-2, lambda scene: None, lambda line: None)

    def level(value, estimate):
        return DiscretisationError("wider", value, estimate, estimate, 1, 3)

    assert search._drifting(1e-3, level(1.0, 1e-3)) == pytest.approx(3e-3)
    tried = ((7.0, 7.0), (0.9, 0.01), (0.95, 0.01))
    search.levels = [Level(3, 1, 1, v, e, e, e, 0.0) for v, e in tried]
    assert search._drifting(1e-3, level(1.0, 1e-3)) == pytest.approx(1e-3 + 1.001 - 0.91)


CURVED = {
    "round core": DiskStack(5e-3, [Layer("a", 1e-3)], radial=2, angular=8),
    "helix": HDEA(turns=1, angular=8, radial=2),
    "graded line": Meridian((0, 1e-3), (1e-3, 0), (0, 0), cells=4, grading=3.0),
    "surface": Balloon(1e-3, 4),
    "octant": HollowSphere(1e-3, 1.2e-3, "octant", 1, 4),
}


@pytest.mark.parametrize("name", CURVED)
def test_all_curved_families_have_cells_of_fourth_order(name):
    """They hold the nodes of the quadratic cells, and lie closer to the device's true size."""
    family = CURVED[name]
    mesh, found = family.mesh(), quartic(family)
    assert of_order(found, 2).points[of_order(found, 2).cells] == pytest.approx(
        mesh.points[mesh.cells], abs=1e-12
    )

    def off(mesh):
        with _gmsh.temporary_model(mesh, "device") as model:
            return {k: size for k, (_, _, size) in _gmsh.measure(model).items()}

    halved = off(Bisected(family).halved(np.unique(sheets(mesh))).mesh())
    coarse, exact = off(mesh), family.measures()
    before = {k: abs(coarse[k] / size - 1) for k, size in exact.items() if size}
    curved = [k for k, error in before.items() if error > 1e-9]
    assert curved and all(abs(halved[k] / exact[k] - 1) < before[k] / 8 for k in curved)


def searched(comm):
    """What the search tries with the clamped tube, on some ranks."""

    def solved(scene):
        return dea.solve(scene, dea.Ramp(steps=1), WIDER, quiet=True, stability="never")

    scene = replace(tube(comm, clamped=True), elements=dea.Discretisation(degree=3))
    search = AccuracySearch("wider", WIDER["wider"], 2.5e-2, solved, lambda line: None)
    search.find(scene)
    return [[one.cells, one.value, one.estimate] for one in search.levels]


@pytest.mark.mpi
@pytest.mark.slow
def test_three_ranks_choose_alike(on_ranks):
    alone, three = searched(MPI.COMM_SELF), on_ranks("test_accuracy", "searched", 3)
    assert [one[0] for one in alone] == [one[0] for one in three]
    assert np.array(alone) == pytest.approx(np.array(three), rel=1e-6)
