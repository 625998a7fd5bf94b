"""Multigrid against factors: the same answers, iterations that do not grow, and what is refused."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from conftest import on_demand
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.solvers.newton import NewtonSolver
from tests.bench.tetrahedra import write_box

SOFT = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))
STIFF = dea.Material(dea.NeoHookean(5e6), bulk_modulus=5e8)
MULTIGRID = dea.NewtonOptions(factor="multigrid")


def pair(n=1, stiff=STIFF, **elements):
    """A soft film on a stiff compressible one, held at one side."""
    layers = [Layer("stiff", 1e-3, n), Layer("soft", 1e-3, n)]
    device = dea.read_gmsh(BoxStack(2e-3, 2e-3, layers, 2 * n), MPI.COMM_SELF)
    return dea.Scene(
        device, {"stiff": stiff, "soft": SOFT},
        electrodes=[dea.Electrode("top", 8e3), dea.Ground("interface_1")],
        supports=[dea.Clamp("x_min")], elements=dea.Discretisation(**elements),
    )  # fmt: skip


def tetrahedra(n=1):
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "box.msh"
        write_box(file, (2e-3, 2e-3, 1e-3), (2 * n, 2 * n, n))
        device = dea.read_gmsh(file, MPI.COMM_SELF)
    return dea.Scene(device, {"film": SOFT}, [dea.Electrode("top", 8e3), dea.Ground("bottom")],
                     [dea.Clamp("x_min")])  # fmt: skip


def solved(scene, options=None, **how):
    record = {"seen": dea.MeanDisplacement("x_max", "z"), "charge": dea.Charge("top")}
    return dea.solve(scene, dea.Ramp(steps=2), record, quiet=True, options=options, **how)


def check_alike(scene):
    with_factor, without = solved(scene), solved(scene, MULTIGRID)
    for name in ("seen_m", "charge_C"):
        assert without[name] == pytest.approx(with_factor[name], rel=1e-8)
    return without


def test_hexahedra_and_what_is_told(tmp_path):
    """The same state as with a factor, while nothing is counted, and that is told."""
    check_alike(pair())
    run = solved(pair(), MULTIGRID, out=tmp_path)
    assert run.history[-1]["negative_modes"] is None
    assert run.summary["stable"] is None
    assert "not counted with multigrid" in (tmp_path / "run.log").read_text()
    assert "not counted with multigrid" in run.summary["message"]


def test_tetrahedra():
    check_alike(tetrahedra())


@on_demand
@pytest.mark.parametrize("scene", [lambda: pair(degree=3), lambda: pair(degree=4),
                                   lambda: pair(degree=3, potential_degree=1)])  # fmt: skip
def test_higher_degrees(scene):
    check_alike(scene())


def test_krylov_iterations_do_not_grow_with_the_mesh():
    firm = dea.Material(dea.NeoHookean(5e6))
    few, many = (
        solved(pair(n, firm), MULTIGRID, stability="never").summary for n in (2, 3)
    )
    assert many["newton_iterations"] <= few["newton_iterations"] + 1
    assert many["krylov_iterations"] <= 1.15 * few["krylov_iterations"]


def charged(device):
    return {"electrodes": [dea.ChargedElectrode("top", 1e-9), dea.Ground("bottom")],
            "supports": [dea.Clamp("x_min")]}  # fmt: skip


def free(device):
    return {"supports": [dea.FreeBody()]}


@pytest.mark.parametrize(("parts", "words"), [(charged, "nothing is tied"),
                                              (free, "a device that is held")])  # fmt: skip
def test_what_is_refused(parts, words):
    device = dea.read_gmsh(BoxStack(1e-3, 1e-3, [Layer("film", 1e-3)], 1), MPI.COMM_SELF)
    scene = dea.Scene(device, {"film": SOFT}, **parts(device))
    with pytest.raises(dea.InputError, match=words):
        NewtonSolver(Problem(scene), MULTIGRID)


def test_a_plane_is_refused():
    strip = dea.read_gmsh(BoxStack(1e-3, None, [Layer("film", 1e-3)], 1), MPI.COMM_SELF)
    scene = dea.Scene(strip, {"film": SOFT}, supports=[dea.Clamp("x_min")],
                      kinematics=dea.PlaneStrain(1e-3))  # fmt: skip
    with pytest.raises(dea.InputError, match="a device in space"):
        NewtonSolver(Problem(scene), MULTIGRID)


def test_counts_at_each_step_are_refused():
    with pytest.raises(dea.InputError, match="makes none"):
        solved(pair(), MULTIGRID, stability="every")
