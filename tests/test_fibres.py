"""Rubber with fibres: films against the exact state, tubes against closed forms, bad input."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI
from scipy.optimize import brentq, root
from test_homogeneous_all_models import KERNELS, run

import dea_fenicsx as dea
from dea_fenicsx.exact import Dead, Film, Held, trace
from dea_fenicsx.geometry import Layer, Tube
from dea_fenicsx.materials import (
    EPSILON_0,
    Cylindrical,
    Helix,
    HolzapfelFibres,
    IdealDielectric,
    Material,
    NeoHookean,
    Reinforced,
    StandardReinforcing,
    TransverselyIsotropic,
    Wound,
)
from dea_fenicsx.materials.stretches import nominal_stress
from dea_fenicsx.scene.kinematics import Axisymmetric, PlaneStrain, ThreeD
from dea_fenicsx.solvers.tangent import Tangent

pytestmark = pytest.mark.usefixtures("quick_compile")
MU = 5e4


def everything(alike=False):
    """One rubber with all kinds of families, at angles too; `alike` along 1 and 2."""
    fan = [StandardReinforcing(1e4, (1, s, 0)) for s in (1, -1)]
    ways = [(2, 0, 0), (0, 1, 0)] if alike else [(2, 0, 0)]
    fibres = [HolzapfelFibres(3e4, 0.5, way, 0.1) for way in ways]
    fibres += [TransverselyIsotropic(1e4, 2e3, way) for way in ways]
    return Reinforced(NeoHookean(MU), [*fibres, *fan, StandardReinforcing(2e4, (0, 0, 1),
                                                                          "tension")])  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("kinematics, cell", KERNELS)
def test_homogeneous_state(kinematics, cell):
    """Elements are the exact film to 1e-8; the field is along the last axis of the mesh."""
    law = everything(alike=isinstance(kinematics, Axisymmetric))
    three = isinstance(kinematics, ThreeD)
    second = 1e4 if three else 2e4
    flat = law
    if not three:  # the film lies in the first and third component, its thickness along the second
        turned = [replace(f, direction=_turned(f, kinematics)) for f in law.fibres]
        flat = Reinforced(law.matrix, turned)
    stretches, charge, problem = run(kinematics, cell, flat, 2e4, second, 5e3)
    held = isinstance(kinematics, PlaneStrain)
    film = Film(
        Material(law, IdealDielectric(4.7)), 1e-3, Dead(2e4), Held(1.0) if held else Dead(second)
    )
    exact = next(s for s, stable in trace(film).states_at(5e3) if stable)
    expected = exact.stretches if three else exact.stretches[[0, 2]]
    assert abs(expected[0] - 1) > 0.02
    assert np.abs(stretches - expected).max() < 1e-8
    area = np.pi * 1e-6 if isinstance(kinematics, Axisymmetric) else 1e-6
    assert charge == pytest.approx(exact.charge * area, rel=1e-8)
    order, small = taylor_order(problem)
    assert order == pytest.approx(2, abs=0.1) and small < 0.05


def _turned(family, kinematics):
    """The direction in the mesh of a family that is given along a film's axes."""
    a = family.direction.vector
    return (a[0], a[2], a[1]) if isinstance(kinematics, PlaneStrain) else (a[0], a[1], a[2])


def taylor_order(problem):
    """Order of the tangent's remainder, and the remainder over the linear part."""
    state, free = problem.state, problem.free
    d = np.random.default_rng(7).uniform(-0.02, 0.02, len(free))
    tangent = Tangent(problem).matrix()
    x, y = tangent.createVecs()
    x.array[:] = d
    tangent.mult(x, y)
    before, linear, left = problem.residual()[free], y.array_r.copy(), []
    for h in (0.0625, 0.03125):
        problem.commit(state)
        problem.commit(problem.moved(problem.state, h * d))
        left.append(np.linalg.norm(problem.residual()[free] - before - h * linear))
    return np.log2(left[0] / left[1]), left[1] / np.linalg.norm(h * linear)


def test_film_with_one_family_expands_across_it():
    """Stiff fibres along x: y bears mu (l^2 - l^-2) = eps E^2 as in pure shear, and x stays."""
    k, volts, T = 1e6 * MU, 15e3, 1e-3
    law = Reinforced(NeoHookean(MU), StandardReinforcing(k, (1, 0, 0)))
    film = Film(Material(law, IdealDielectric(4.7)), T)
    exact = next(s for s, ok in trace(film).states_at(volts) if ok)
    pull = 4.7 * EPSILON_0 * (volts / T) ** 2
    closed = brentq(lambda l: MU * (l**2 - l**-2) - pull * l**2, 1.0, 1.5)
    assert closed > 1.02
    assert exact.stretches[0] == pytest.approx(1, abs=1e-6)
    assert exact.stretches[1] == pytest.approx(closed, abs=1e-6)


def exact_tube(families, P, A, B):
    """(a, stretch, twist) of a long closed tube: stationary energy less P pi a^2 lam.

    r^2 = a^2 + (R^2 - A^2)/lam, and in cylindrical components C_rr = (R/(lam r))^2,
    C_tt = (r/R)^2, C_zz = lam^2 + (k r)^2, C_tz = k r^2/R; families as (k, angle in radians).
    """
    x, w = np.polynomial.legendre.leggauss(24)
    R = (A + B) / 2 + (B - A) / 2 * x
    w = w * (B - A) / 2

    def slope(q):
        found = []
        for i in range(3):
            z = np.array([q[0] * A, q[1], q[2] / A], dtype=complex)
            z[i] += 1e-30j
            a, lam, k = z
            r2 = a * a + (R * R - A * A) / lam
            tt, zz, tz = r2 / R**2, lam**2 + k * k * r2, k * r2 / R
            W = MU / 2 * (R**2 / (lam**2 * r2) + tt + zz - 3)
            for size, angle in families:
                s, c = math.sin(angle), math.cos(angle)
                W = W + size / 2 * (s * s * tt + c * c * zz + 2 * s * c * tz - 1) ** 2
            total = 2 * np.pi * (w * R * W).sum() - P * np.pi * a * a * lam
            found.append(total.imag / 1e-30 / (np.pi * A * A * MU) * (A, 1, 1 / A)[i])
        return found

    found = root(slope, [1.0, 1.0, 0.0], tol=1e-13)
    assert found.success
    return found.x * [A, 1, 1 / A]


A, WALL = 5e-3, 1e-4
WHOLE = {"stretch": dea.OverallStretch(), "twist": dea.OverallTwist()}


def tube(law, P, a, lam):
    """A closed tube, wall 1:50, under pressure; the force on its ends is P pi a^2.

    A dead pressure P a lam/A is the pressure P on the deformed inner surface.
    """
    shape = Tube(A, 1e-4, [Layer("wall", WALL, 2)], axial=1)
    return dea.Scene(
        dea.read_gmsh(shape, MPI.COMM_SELF), {"wall": Material(law)},
        supports=[dea.FreeBody()], kinematics=dea.Helical(0.0),
        loads=[dea.DeadPressure("inner", P * a * lam / A), dea.AxialForce(P * np.pi * a * a)],
    )  # fmt: skip


def wound(degrees, second=1.0):
    """Two mirrored families, 1000 times stiffer than the matrix; the second one times a factor."""
    sizes = (1e3 * MU, second * 1e3 * MU)
    ways = (Wound(degrees), Wound(-degrees))
    return Reinforced(NeoHookean(MU), list(map(StandardReinforcing, sizes, ways)))


def test_closed_tube_keeps_its_length_at_the_netting_angle():
    """At arctan(sqrt 2) = 54.736 degrees, within half a degree; and as the exact tube says."""
    P, netting = 4 * MU * WALL / A, math.degrees(math.atan(math.sqrt(2)))

    def change(degrees):
        angle = math.radians(degrees)
        a, lam, _ = exact_tube([(1e3 * MU, angle), (1e3 * MU, -angle)], P, A, A + WALL)
        run = dea.solve(tube(wound(degrees), P, a, lam), dea.Ramp(steps=2), WHOLE, quiet=True)
        assert float(run["stretch"]) == pytest.approx(lam, abs=1e-8)
        assert abs(float(run["twist_rad_per_m"])) * A < 1e-8
        return float(run["stretch"]) - 1

    low, high = 54.0, 55.5
    first, last = change(low), change(high)
    assert first < 0 < last
    neutral = low - first * (high - low) / (last - first)
    assert abs(neutral - netting) < 0.5


def test_closed_tube_with_one_family_twists():
    """The twist of the exact tube, to 1e-8."""
    P = 0.3 * MU * WALL / A
    a, lam, k = exact_tube([(1e3 * MU, math.radians(40.0))], P, A, A + WALL)
    # A second family of no stiffness shares the forms of the test above.
    run = dea.solve(tube(wound(40.0, 1e-13), P, a, lam), dea.Ramp(steps=2), WHOLE, quiet=True)
    assert abs(k) * A > 0.02
    assert float(run["twist_rad_per_m"]) * A == pytest.approx(k * A, abs=1e-8)
    assert float(run["stretch"]) == pytest.approx(lam, abs=1e-8)


def test_directions_about_an_axis():
    """At (3, 4, 7) the radius is 5; about the axis x through (0, 1, 0) another one."""
    place = (3.0, 4.0, 7.0)
    c, s = math.cos(math.radians(30)), math.sin(math.radians(30))
    assert Wound(30.0).at(place) == pytest.approx((-0.8 * s, 0.6 * s, c))
    assert Helix(10.0 * math.pi).at(place) == pytest.approx((-0.8, 0.6, 1.0))
    assert Cylindrical((1, 0, 2)).at(place) == pytest.approx((0.6, 0.8, 2.0))
    arm = np.array([3.0, 7.0]) / math.hypot(3, 7)
    found = Cylindrical((1, 0, 0), (2, 0, 0), (0, 1, 0)).at(place)
    assert found == pytest.approx((0.0, *arm))


def test_moduli_of_an_electrode():
    """Young's modulus 3 mu + 4 (k + c) along the fibres, and the film's small-strain stiffness."""
    young, shear = 2e6, 3e5
    law = Reinforced(NeoHookean(MU), TransverselyIsotropic.from_moduli(young, shear, MU, (1, 0, 0)))
    film = Film(Material(law, IdealDielectric(3.0)), 1e-3, Dead(young * 1e-6))
    exact = next(s for s, ok in trace(film).states_at(1.0) if ok)
    assert exact.stretches[0] - 1 == pytest.approx(1e-6, rel=1e-3)


OBLIQUE = Reinforced(NeoHookean(MU), StandardReinforcing(1e4, (1, 1, 0)))
RUBBER = NeoHookean(MU)
BAD = {
    "length 0": lambda: scene_of(StandardReinforcing(1e4, (0, 0, 0))),
    "axis of the fibres has the length 0": lambda: scene_of(
        StandardReinforcing(1e4, Wound(3.0, (0, 0, 0)))),
    "is \\(1, 0\\), but must be three numbers": lambda: scene_of(StandardReinforcing(1e4, (1, 0))),
    "must be three numbers, Along": lambda: scene_of(StandardReinforcing(1e4, "x")),
    "k is -1": lambda: scene_of(StandardReinforcing(-1.0, (1, 0, 0))),
    'must be "tension" or "both"': lambda: scene_of(StandardReinforcing(1.0, (1, 0, 0), "push")),
    "between 0": lambda: scene_of(HolzapfelFibres(1.0, 1.0, (1, 0, 0), 0.5)),
    "pitch of Helix is 0": lambda: scene_of(StandardReinforcing(1e4, Helix(0.0))),
    "along its axes": lambda: Film(Material(OBLIQUE, IdealDielectric(3.0)), 1e-3),
    "along one vector": lambda: Film(
        Material(wound(30.0), IdealDielectric(3.0)), 1e-3),
    "is that of an isotropic rubber": lambda: nominal_stress(OBLIQUE, "uniaxial", 1.1),
    "oblique to the symmetry": lambda: scene_of(StandardReinforcing(1e4, Wound(30.0)),
                                                dea.Axisymmetric()),
    "axis of their own": lambda: scene_of(StandardReinforcing(1e4, Wound(30.0, (1, 0, 0))),
                                          dea.Axisymmetric()),
}  # fmt: skip


def scene_of(fibres, kinematics=None):
    device = block() if kinematics is None else dea.read_gmsh(
        Tube(A, 1e-4, [Layer("film", WALL)], axial=1), MPI.COMM_SELF)  # fmt: skip
    more = {} if kinematics is None else {"kinematics": kinematics}
    return dea.Scene(device, {"film": Material(Reinforced(RUBBER, fibres))},
                     supports=[dea.Clamp("bottom")], **more)  # fmt: skip


@pytest.mark.parametrize("words", BAD)
def test_bad_input(words):
    with pytest.raises(dea.InputError, match=words) as told:
        BAD[words]()
    assert len(str(told.value)) <= 400
