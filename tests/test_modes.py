"""Modes of vibration against closed forms, and against a dense solver."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
from motion_scenes import CLAMPED, at_rest, rubber, sphere, strip
from mpi4py import MPI
from scipy.linalg import eigh
from scipy.optimize import brentq

import dea_fenicsx as dea
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.solvers.tangent import Tangent

BREATHING = {0.05: 3.03716946, 0.135: 1.14898955}
"""omega of the thick sphere's breathing about equilibrium at a voltage, of its exact equation."""

HIGHER = {0.05: (1.1347, 1.5224, 1.9686), 0.135: (0.8877, 1.0680)}
"""omega of the shapes n = 2, 3, ..., which lie below, by finer axisymmetric elements."""


def breathes(modes, number):
    """Whether a mode moves all of the sphere outward."""
    pole, equator = (
        modes.derivative(dea.AtPoint(point, "displacement", axis), number)
        for point, axis in (((0.0, 1.0), "z"), ((1.0, 0.0), "r"))
    )
    return abs(pole - equator) < 1e-2 * abs(pole)


@pytest.mark.parametrize("volts", BREATHING)
def test_breathing_of_a_thick_sphere(volts):
    """To 1e-5, told apart from the shapes n = 2 and 4 by its own shape."""
    run = dea.solve(sphere(volts, cells=(3, 10)), dea.Ramp("voltage", steps=3), quiet=True)
    modes = dea.modes(run, 4)
    omega = 2 * np.pi * modes.frequencies
    (number,) = (k for k in range(4) if breathes(modes, k))
    assert omega[number] == pytest.approx(BREATHING[volts], rel=2e-5)
    assert omega[0] == pytest.approx(HIGHER[volts][0], rel=1e-3)
    if len(HIGHER[volts]) > 2:
        assert omega[1] == pytest.approx(HIGHER[volts][2], rel=1e-3)
    assert modes.stable and modes.growing == 0 and len(modes.growth_rates) == 0
    assert np.all(modes.errors < 1e-9 * np.abs(modes.squares))


def test_a_free_sphere():
    """The whole section floats: its rigid motion is counted, and shapes of odd n appear."""
    run = dea.solve(sphere(0.05, part="whole"), dea.Ramp("voltage", steps=2), quiet=True)
    modes = dea.modes(run, 5)
    omega = 2 * np.pi * modes.frequencies
    assert modes.rigid_motions == 1
    assert omega[:3] == pytest.approx(HIGHER[0.05], rel=5e-3)
    assert omega[4] == pytest.approx(BREATHING[0.05], rel=1e-5)
    assert "1 rigid motions of a free body are not listed" in str(modes)


def dense(matrix):
    return matrix.getValues(*(np.arange(n, dtype=np.int32) for n in matrix.getSize()))


def test_a_free_strip_against_a_dense_solver():
    """With S = K^-1 about a shift, C^T S C has the eigenvalues 1/(omega^2 - shift)."""
    scene = strip(cells=(3, 1), length=3.0)
    modes = dea.modes(at_rest(scene), 4)
    problem, shift = Problem(scene, released=True), 0.37
    mass = problem.massive()
    mass.stiffness = shift
    K, M = dense(Tangent(problem).matrix(0.0)), dense(mass.reduced(problem.free, problem.expansion))
    u = problem.roles.free(Role.MOTION)
    C = np.linalg.cholesky(M[np.ix_(u, u)])
    S = C.T @ np.linalg.inv(K)[np.ix_(u, u)] @ C
    found = np.sort(eigh((S + S.T) / 2, eigvals_only=True))[::-1]
    known = 1 / found[:7] - shift
    assert np.abs(known[:3]).max() < 1e-9
    assert modes.rigid_motions == 3
    assert modes.squares == pytest.approx(known[3:], rel=1e-9)
    # no shape has momentum
    for shape in modes.shapes:
        pushed = mass.times(shape[: problem.owned])
        for part in problem.displacement:
            assert abs(pushed[part.dofs].sum()) < 1e-9


def test_a_buckled_strip():
    """Beyond Euler's voltage the flat strip has one motion that grows."""
    euler = np.sqrt(4 * np.pi**2 / 3) / 20
    scene = strip(euler, CLAMPED, cells=(10, 1), length=20.0)
    squares = []
    for factor in (0.5, 1.25):
        run = dea.solve(scene, dea.Ramp("voltage", factor, 2), {"f": dea.Frequency()}, quiet=True)
        modes = dea.modes(run, 2)
        squares.append(modes.squares)
        assert run["f_Hz"] == pytest.approx(modes.signed_frequencies[0], rel=1e-9)
    assert modes.growing == 1 and not modes.stable
    assert np.isnan(modes.frequencies[0]) and modes.signed_frequencies[0] < 0
    assert modes.growth_rates == pytest.approx([np.sqrt(-modes.squares[0])])
    # of a slender strip omega^2 falls with the square of the voltage, to 0 at Euler's
    line = np.polyfit([0.25, 1.5625], [square[0] for square in squares], 1)
    assert -line[1] / line[0] == pytest.approx(1.0, abs=0.05)


def test_responses_of_a_branch():
    """At rest a branch of modulus g stiffens each mode by 1 + g, or not at all."""
    run = at_rest(sphere(viscous=[dea.Maxwell(1.5, 0.5)]))
    fast, slow = (dea.modes(run, 3, response=name) for name in ("instantaneous", "relaxed"))
    plain = dea.modes(at_rest(sphere()), 3)
    assert fast.squares == pytest.approx(2.5 * plain.squares, rel=1e-9)
    # a relaxed branch still resists changes of volume, which elements keep on the average only
    assert slow.squares == pytest.approx(plain.squares, rel=3e-3)


def breathing_with_kept_polarisation(volts, late, B=1.2):
    """omega^2 about equilibrium with eps = 1 and a polarisation of eps = `late` that has followed.

    Of the round state r^3 = R^3 + a^3 - 1, with s = R^2/r^2 and the polarisation P(R) that stays,
    the energy over 4 pi is int (W - E^2/(2 s^2) + s^2 P^2/(2 late) - P E) R^2 dR, where
    E/s^2 + P = c/R^2 and int E dR = V.
    """
    x, w = np.polynomial.legendre.leggauss(40)
    R, w = 1 + (B - 1) * (x + 1) / 2, w * (B - 1) / 2

    def energy(a, P=None):
        s = (R**3 / (R**3 + a**3 - 1)) ** (2 / 3)
        eps, held = (1 + late, 0.0) if P is None else (1.0, P)
        c = (eps * volts + w @ (s**2 * held)) / (w @ (s**2 / R**2))
        E = s**2 * (c / R**2 - held) / eps
        electric = -eps * E**2 / (2 * s**2) - held * E
        if P is not None:
            electric = electric + s**2 * P**2 / (2 * late)
        return w @ ((s**2 + 2 / s - 3) / 2 * R**2 + electric * R**2), late * E / s**2

    h = 1e-3
    a = brentq(lambda a: energy(a + h)[0] - energy(a - h)[0], 1.0, 1.3, xtol=1e-14)
    P = energy(a)[1]
    bend = sum(k * energy(a + n * h, P)[0] for n, k in ((-1, 1), (0, -2), (1, 1))) / h**2
    b = (a**3 + B**3 - 1) ** (1 / 3)
    return bend / (a**4 * (1 / a - 1 / b))


def test_polarisations_that_follow_late():
    """In no time none follows; when all have followed, they stay as they are in a vibration."""
    plain = dea.modes(dea.solve(sphere(0.1), dea.Ramp("voltage", steps=2), quiet=True), 4)
    late = dea.IdealDielectric(1 / EPSILON_0, relaxation=[dea.Debye(0.5 / EPSILON_0, 1e3)])
    scene, found = sphere(0.1, electric=late), []
    for path in ([], [dea.March(5e4, steps=4)]):
        run = dea.solve(scene, [dea.Ramp("voltage", steps=2), *path], quiet=True)
        found.append(dea.modes(run, 4))
        assert "stays as it is in these vibrations" in str(found[-1])
        assert np.all(found[-1].errors < 1e-9 * found[-1].squares)
    assert plain.note == "" and found[0].squares == pytest.approx(plain.squares, rel=1e-8)
    for modes, known in ((plain, (0.1, 1e-12)), (found[1], (0.1, 0.5))):
        (number,) = (k for k in range(4) if breathes(modes, k))
        assert modes.squares[number] == pytest.approx(
            breathing_with_kept_polarisation(*known), rel=1e-4
        )
    with pytest.raises(dea.InputError, match="where charge leaks"):
        dea.modes(run, 2, response="relaxed")


def test_a_branch_with_a_flow_law():
    """Its viscous strains stay as they are, and its spring stiffens each mode by 1 + g."""
    law = dea.KumarLopezPamies(1.0, 0.2, 2.0, 0.5, 0.3)
    run = at_rest(sphere(viscous=[dea.ViscousBranch(dea.NeoHookean(1.5), flow=law)]))
    plain = dea.modes(at_rest(sphere()), 3)
    assert dea.modes(run, 3).squares == pytest.approx(2.5 * plain.squares, rel=1e-9)
    with pytest.raises(dea.InputError, match="not symmetric"):
        dea.modes(run, 3, response="relaxed")


def test_shapes_for_paraview(tmp_path):
    modes = dea.modes(at_rest(strip(supports=CLAMPED)), 2, out=tmp_path)
    assert (tmp_path / "modes.xdmf").exists()
    with h5py.File(tmp_path / "modes.h5") as h5:
        shape = h5["mode_001/node/mode"][:]
        assert np.linalg.norm(shape, axis=1).max() == pytest.approx(1.0)
        assert h5["mode_001/node/frequency_Hz"][0] == modes.frequencies[1]
    assert modes.share("y", 0) + modes.share("x", 0) == pytest.approx(1.0)
    assert modes.share("y", 0) > 0.9
    # the kinetic energy of a motion with the amplitude 1 m at omega is at most half of its mass
    assert 0 < modes.masses[0] < 10.0


def test_what_is_refused():
    run = at_rest(strip(supports=CLAMPED, cells=(2, 1)))
    for wrong, words in ((0, "whole number"), (10**6, "free unknowns only"), (13, "volume")):
        with pytest.raises(dea.InputError, match=words):
            dea.modes(run, wrong)
    with pytest.raises(dea.InputError, match="response"):
        dea.modes(run, 1, response="slow")
    with pytest.raises(dea.InputError, match="needs a Run"):
        dea.modes("folder")
    massless = {"film": rubber(density=None)}
    light = at_rest(strip(supports=CLAMPED, cells=(2, 1), materials=massless))
    with pytest.raises(dea.InputError, match="no density"):
        dea.modes(light, 1)
    with pytest.raises(dea.InputError, match="density is -1"):
        strip(materials={"film": rubber(density=-1.0)})


def on_some(comm):
    scene = sphere(0.05, part="whole", comm=comm, cells=(1, 2))
    run = dea.solve(scene, dea.Ramp("voltage", steps=2), quiet=True)
    modes = dea.modes(run, 3)
    return [*modes.squares, *modes.masses]


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_on_several_ranks(ranks, on_ranks):
    assert on_ranks("test_modes", "on_some", ranks) == pytest.approx(
        on_some(MPI.COMM_SELF), rel=1e-8
    )
