"""The count of negative eigenvalues where p or phi is not determined, and in each notation."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI
from test_homogeneous_all_models import device as unit_device

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.solvers import linear
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.tangent import Tangent, scalar_masses

RUBBER = dea.Material(dea.NeoHookean(5e4))
FILM = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))
STIFF_FILM = dea.Material(dea.NeoHookean(5e7), dea.IdealDielectric(9.0))
SPONGE = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0), bulk_modulus=2e5)

PLACES = {
    "space": (dea.ThreeD(), "z", ("x", "y")),
    "plane strain": (dea.PlaneStrain(), "y", ("x",)),
    "generalised plane strain": (dea.GeneralisedPlaneStrain(1e-3), "y", ("x",)),
    "axisymmetric": (dea.Axisymmetric(), "z", ("r",)),
}


def stack(place, pad, comm=MPI.COMM_SELF, volts=5e4, driven=None):
    """A film with electrodes, and above it two pads that no electrode touches, on spacers."""
    kinematics, across, along = PLACES[place]
    names = ("film", "spacer", "pad", "spacer_2", "pad_2")
    layers = [Layer("film", 1e-3)] + [Layer(name, 1e-4) for name in names[1:]]
    width = 4e-3 if place == "space" else None
    dev = dea.read_gmsh(BoxStack(4e-3, width, layers, divisions=(1,) * len(along)), comm)
    materials = dict(zip(names, (FILM, RUBBER, pad, RUBBER, pad), strict=True))
    return dea.Scene(
        dev, materials, [driven or dea.Electrode("interface_1", volts), dea.Ground("bottom")],
        [dea.Fix("bottom", across)]
        + [dea.Fix(f"{'x' if a == 'r' else a}_min", a) for a in along],
        kinematics=kinematics,
    )  # fmt: skip


def counts(scene, factor="whole", steps=9):
    """Counts along a trace from rest over the largest voltage."""
    run = dea.solve(
        scene, dea.Trace("voltage", first=0.2, steps=steps), quiet=True, stability="every",
        options=dea.NewtonOptions(factor=factor),
    )  # fmt: skip
    return [row["inertia"] for row in run.history if not row["event"]]


def count_now(scene, factors=None):
    """The count in equilibrium at the given factors, by the solver's usual way."""
    problem = Problem(scene)
    solver = NewtonSolver(problem)
    attempt = solver.solve(problem.state, dict.fromkeys(problem.factors, 0.0) | (factors or {}))
    assert attempt.converged
    problem.commit(attempt.found)
    solver.refresh_inertia()
    return solver.inertia.excess


@pytest.mark.parametrize("mass", [1e-8, 1e-10])
def test_a_dielectric_without_electrode_does_not_shift_the_count(mass, monkeypatch):
    """0 before the largest voltage, 1 behind it, as where the pads are rubber."""
    monkeypatch.setattr(linear, "SCALAR_MASS", mass)
    passive = counts(stack("axisymmetric", RUBBER))
    assert passive == sorted(passive) and set(passive) == {0, 1}
    assert counts(stack("axisymmetric", FILM)) == passive


@pytest.mark.parametrize("pad", [FILM, STIFF_FILM, SPONGE], ids=["film", "stiff", "sponge"])
@pytest.mark.parametrize("place", PLACES)
def test_the_count_is_0_at_rest_and_under_a_small_voltage(place, pad):
    scene = stack(place, pad, volts=1e3)
    assert count_now(scene) == 0
    assert count_now(scene, {"voltage": 1.0}) == 0


def test_a_given_charge_beside_a_pad_without_electrode():
    scene = stack("plane strain", FILM, driven=dea.ChargedElectrode("interface_1", 1e-9))
    ramp = scene.ramps[0]
    assert count_now(scene) == 0
    assert count_now(scene, {ramp: 1.0}) == 0


def test_split_factors_prove_nothing_stable_behind_the_largest_voltage():
    """A zero eigenvalue of phi would make 0 of the 1 behind the maximum."""
    found = counts(stack("space", FILM), factor="split", steps=10)
    assert found == sorted(found) and set(found) == {0, 1}


def held_block(kinematics, cells, comm=MPI.COMM_SELF):
    """A block whose sides cannot move along their normals: a constant p does no work."""
    three = len(cells) == 3
    layer = Layer("film", 1e-3, divisions=cells[-1])
    dev = dea.read_gmsh(BoxStack(1e-3, 1e-3 if three else None, [layer], cells[:-1]), comm)
    axes = kinematics.axes
    sides = {"x_min": axes[0], "x_max": axes[0], "bottom": axes[-1], "top": axes[-1]}
    if three:
        sides |= {"y_min": "y", "y_max": "y"}
    return dea.Scene(
        dev, {"film": FILM}, [dea.Electrode("top", 1e3), dea.Ground("bottom")],
        [dea.Fix(name, axis) for name, axis in sides.items()], kinematics=kinematics,
    )  # fmt: skip


@pytest.mark.parametrize("mass", [1e-8, 1e-10])
@pytest.mark.parametrize(
    ("kinematics", "cells"),
    [(dea.ThreeD(), (2, 2, 1)), (dea.PlaneStrain(), (3, 2)), (dea.Axisymmetric(), (3, 2))],
    ids=["space", "plane", "axisymmetric"],
)
def test_a_block_that_is_held_along_all_normals(kinematics, cells, mass, monkeypatch):
    monkeypatch.setattr(linear, "SCALAR_MASS", mass)
    run = dea.solve(held_block(kinematics, cells), dea.Ramp(steps=2), quiet=True,
                    stability="every")  # fmt: skip
    assert [row["inertia"] for row in run.history] == [0, 0, 0]
    assert run.summary["stable"] is True


@pytest.mark.parametrize("cell", ["tetrahedron", "triangle", "hexahedron", "quadrilateral"])
@pytest.mark.parametrize("open_sides", [0, 1, 2])
def test_cells_whose_faces_are_clamped(cell, open_sides):
    """Clamped on all sides but some: cells in the corners have no node that could move.

    At rest W is convex and nothing loads the body, so that it is stable; so it is under a small
    load.
    """
    three = cell in ("tetrahedron", "hexahedron")
    names = [f"{axis}_{end}" for axis in ("xyz" if three else "xy") for end in ("min", "max")]
    sides = names[: len(names) - open_sides]
    load = dea.DeadLoad(names[-1], (100.0, 50.0, 20.0) if three else (100.0, 50.0))
    scene = dea.Scene(
        unit_device(cell), {"film": RUBBER}, supports=[dea.Clamp(side) for side in sides],
        loads=[load], kinematics=dea.ThreeD() if three else dea.PlaneStrain(),
    )  # fmt: skip
    assert count_now(scene) == 0
    assert count_now(scene, {load.ramp: 1.0}) == 0


def counts_on_ranks(comm):
    """Counts of a stack whose pads float, and of a block of one cell, which leaves ranks empty."""
    run = dea.solve(held_block(dea.PlaneStrain(), (1, 1), comm), dea.Ramp(steps=1), quiet=True)
    floating = count_now(stack("axisymmetric", FILM, comm, volts=1e3), {"voltage": 1.0})
    return [floating, run.history[-1]["inertia"]]


def trace_on_ranks(comm):
    """Counts along a trace of the stack."""
    return counts(stack("axisymmetric", FILM, comm))


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_the_count_on_several_ranks(on_ranks, ranks):
    assert on_ranks("test_stability_count", "counts_on_ranks", ranks) == [0, 0]


@pytest.mark.mpi
def test_the_count_along_a_trace_on_two_ranks(on_ranks):
    here = trace_on_ranks(MPI.COMM_SELF)
    assert set(here) == {0, 1}
    assert on_ranks("test_stability_count", "trace_on_ranks", 2) == here


def test_masses_are_positive_and_only_on_p_and_phi():
    """They add up to volume/mu over all cells, and are added to the diagonal on request only."""
    problem = Problem(stack("axisymmetric", STIFF_FILM))
    masses = scalar_masses(problem)
    assert np.all(masses[problem.roles.free(Role.MOTION)] == 0)
    assert np.all(masses[problem.roles.free(Role.MULTIPLIER)] > 0)
    assert np.all(masses[problem.roles.free(Role.POTENTIAL)] > 0)
    # the film takes 1 mm of the height, spacers and pads 0.1 mm each; the scales are the softest
    # dielectric's modulus and the largest permittivity, and lengths are in units of 4 mm
    area = np.pi / 4 * 0.1
    pressures = problem.roles.free(Role.MULTIPLIER)
    assert masses[pressures].sum() == pytest.approx(area * (10 + 2 + 2e-3))
    tangent = Tangent(problem)
    plain = tangent.matrix().getDiagonal().array.copy()
    shifted = tangent.matrix(1e-3).getDiagonal().array
    rounding = 4e-16 * np.max(np.abs(plain))  # of a difference of two diagonals
    assert plain - shifted == pytest.approx(1e-3 * masses, abs=rounding)


PAIRS = {
    "I2": (dea.MooneyRivlin(0.0, 1e4), dea.Ogden((-2e4,), (-2.0,))),
    "I1": (dea.MooneyRivlin(2e4, 0.0), dea.Ogden((4e4,), (2.0,))),
    "both": (dea.MooneyRivlin(1e4, 5e3), dea.Ogden((2e4, -1e4), (2.0, -2.0))),
    "both, by Abaqus": (
        dea.MooneyRivlin(1e4, 5e3), dea.Ogden.from_abaqus((2e4, 1e4), (2.0, -2.0))
    ),
    "neo-Hookean": (dea.NeoHookean(4e4), dea.Yeoh(2e4, 0.0, 0.0)),
}  # fmt: skip


def stretched(elastic, stretch, cells=8):
    """Force and counts of a disc that is stretched along r, in which nothing is unstable."""
    run = dea.solve(
        dea.Scene(
            dea.read_gmsh(BoxStack(5e-3, None, [Layer("film", 1e-3)], (cells,)), MPI.COMM_SELF),
            {"film": dea.Material(elastic)},
            supports=[dea.Fix("bottom", "z"), dea.Fix("x_min", "r")],
            prescribed=[dea.Stretch("x_max", "r", stretch)], kinematics=dea.Axisymmetric(),
        ),
        dea.Ramp("stretch", steps=8), {"F": dea.Reaction("x_max", "r")}, quiet=True,
        stability="every",
    )  # fmt: skip
    return run["F_N"], {row["inertia"] for row in run.history}, {r["event"] for r in run.history}


@pytest.mark.parametrize("pair", PAIRS)
def test_one_energy_in_two_notations_has_one_count_and_one_force(pair, quick_compile):
    """The force is 2 pi R T (dW/de_r - dW/de_z)/lam, with e the logarithms of the stretches."""
    lam = 3.0
    one, other = (stretched(elastic, lam) for elastic in PAIRS[pair])
    C10, C01 = {"I2": (0, 1e4), "I1": (2e4, 0), "neo-Hookean": (2e4, 0)}.get(pair, (1e4, 5e3))
    stress = 2 * (C10 + C01 * lam**2) * (lam**2 - lam**-4)
    assert one[0] == pytest.approx(2 * np.pi * 5e-3 * 1e-3 * stress / lam, rel=1e-8)
    assert other[0] == pytest.approx(one[0], rel=1e-9)
    for _, inertia, events in (one, other):
        assert inertia == {0} and events == {""}


@pytest.mark.parametrize("alpha", [-4.0, -1.0, 1.13, 5.0])
def test_ogden_films_show_no_false_eigenvalues(alpha, quick_compile):
    """|alpha| >= 1: the force along r grows with the stretch, so that no neck forms."""
    assert stretched(dea.Ogden((4e4 / alpha,), (alpha,)), 3.0)[1] == {0}


@pytest.mark.slow
@pytest.mark.parametrize("elastic", PAIRS["I2"], ids=["Mooney-Rivlin", "Ogden"])
def test_a_film_in_space_shows_no_false_eigenvalues(elastic):
    """Stretched four times along both axes, W = 1e4 (I2 - 3)."""
    scene = dea.Scene(
        block((3, 3, 2), 4e-3, 1e-3), {"film": dea.Material(elastic)},
        supports=[dea.Fix("bottom", "z"), dea.Fix("x_min", "x"), dea.Fix("y_min", "y")],
        prescribed=[dea.Stretch("x_max", "x", 4.0), dea.Stretch("y_max", "y", 4.0)],
    )  # fmt: skip
    run = dea.solve(scene, dea.Ramp("stretch", steps=10), quiet=True, stability="every")
    assert {row["inertia"] for row in run.history} == {0}


class Numbers:
    """The strain of a matrix F in numbers, as `StrainOf` has it in symbols."""

    def __init__(self, F):
        self.square = np.linalg.eigvalsh(F.T @ F)
        self.I1 = self.square.sum()
        self.I2 = (self.I1**2 - (self.square**2).sum()) / 2

    def power_sum(self, alpha):
        return (self.square ** (alpha / 2)).sum()


@pytest.mark.parametrize(
    "elastic",
    [dea.MooneyRivlin(2e4, -5e3), dea.MooneyRivlin(0.0, 1e4), dea.Ogden((-2e4,), (-2.0,)),
     dea.Ogden((6.3e5, 1.2e3, -1e4), (1.3, 5.0, -2.0)), dea.Ogden((9e4, -1e3), (0.5, 3.0))],
)  # fmt: skip
def test_the_augmentation_is_nowhere_negative(elastic):
    """Also for volumes that change, and for constants of which one is negative."""
    rng = np.random.default_rng(11)
    for size in (1e-3, 0.1, 0.5, 2.0):
        for _ in range(50):
            F = np.eye(3) + size * rng.standard_normal((3, 3))
            lnJ = np.log(abs(np.linalg.det(F)))
            rounding = 1e-14 * elastic.shear_modulus()
            assert elastic.stress_size(Numbers(F), lnJ) >= -rounding
    assert elastic.stress_size(Numbers(np.eye(3)), 0.0) == pytest.approx(0, abs=1e-9)


def test_every_model_has_a_positive_modulus():
    """The augmentation of models without a size of their own is relative to it."""
    class Wrong(dea.NeoHookean):
        def shear_modulus(self):
            return -1.0

    assert "shear modulus" in dea.Material(Wrong(1.0)).faults()[0]
