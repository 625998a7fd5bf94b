"""Air in three dimensions, the closed form of its variation, and air beside rigid parts."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import ufl
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.model.terms.air import change_of_stress, stress_of_shape
from dea_fenicsx.scene.strain import cofactor

MU, KAPPA = 1e5, 5e5
FOAM = dea.Material(dea.NeoHookean(MU), bulk_modulus=KAPPA)
H, SIDE = 1e-3, 1e-4  # height of a block and its width, m


def stress(stretch):
    """Nominal stress between walls: d/dl of mu/2 (l^(4/3) + 2 l^(-2/3)) + kappa/2 (l - 1)^2."""
    return MU * 2 / 3 * (stretch ** (1 / 3) - stretch ** (-5 / 3)) + KAPPA * (stretch - 1)


def numbers(F):
    F = ufl.as_matrix(F.tolist())
    A, J = cofactor(F)
    return SimpleNamespace(F=F, cofactor=A, J=J)


@pytest.mark.parametrize("size", [0.0, 0.2, 0.4])
def test_change_of_stress_is_the_derivative_of_the_stress(size):
    rng = np.random.default_rng(1)
    F, G = np.eye(3) + size * rng.uniform(-1, 1, (3, 3)), rng.uniform(-1, 1, (3, 3))
    found = change_of_stress(numbers(F), ufl.as_matrix(G.tolist()))
    more, less = (stress_of_shape(numbers(F + h * G)) for h in (1e-6, -1e-6))
    for k in np.ndindex(3, 3):
        assert found[k](()) == pytest.approx((more[k](()) - less[k](())) / 2e-6, abs=1e-7)


def column(layers, regions, volts, supports, prescribed=(), comm=MPI.COMM_SELF):
    """A column of layers between walls without friction, in space."""
    device = dea.read_gmsh(BoxStack(SIDE, SIDE, layers, divisions=(1, 1), order=1), comm)
    walls = [dea.Fix(f"{axis}_{end}", axis) for axis in "xy" for end in ("min", "max")]
    return dea.Scene(
        device, regions, supports=[dea.Fix("bottom", "z"), *walls, *supports],
        electrodes=[dea.Electrode("interface_1", volts),
                    dea.Ground("top" if len(layers) == 2 else "interface_2")],
        prescribed=prescribed,
    )  # fmt: skip


def test_two_blocks_meet(quick_compile):
    """A gap of a tenth is pressed by twice its height, so that each block shortens by 5 %."""
    scene = column(
        [Layer("lower", H), Layer("gap", H / 10), Layer("upper", H)],
        {"lower": FOAM, "gap": dea.Air(), "upper": FOAM}, 0.0, [],
        [dea.Stretch("top", "z", 1.9 / 2.1)],
    )  # fmt: skip
    run = dea.solve(scene, dea.Ramp("stretch", steps=2), quiet=True, stability="every", record={
        "force": dea.Reaction("top", "z"), "air": dea.Energy("air"),
        "all": dea.Energy("elastic"), "squeezed": dea.OverRegion("J", "min", regions="gap"),
    })  # fmt: skip
    exact = stress(0.95)
    left = (1e-11 * MU / 2 / -exact) ** (1 / 3)  # of the gap, by the stiffness of the air
    assert run["force_N"] / SIDE**2 == pytest.approx(exact, rel=1e-3)
    assert run["force_N"] / SIDE**2 / exact - 1 == pytest.approx(left, rel=0.1)
    assert run["squeezed"] == pytest.approx(left, rel=0.05)
    assert 0 < run["air_J"] < 1e-3 * run["all_J"]
    assert run["inertia"] == 0


def test_attraction_of_plates(quick_compile):
    """P(l) = eps0/2 (V/g')^2 with the gap g' = g - H (l - 1) of a block that a plate pulls."""
    stretch, g = 1.03, 2e-4
    volts = (g - H * (stretch - 1)) * np.sqrt(2 * stress(stretch) / EPSILON_0)
    scene = column(
        [Layer("block", H), Layer("gap", g)], {"block": FOAM, "gap": dea.Air()},
        volts, [dea.Clamp("top")],
    )  # fmt: skip
    run = dea.solve(scene, dea.Ramp("voltage", steps=2), quiet=True, stability="every", record={
        "stretch": dea.MeanStretch(("bottom", "interface_1"), "z"),
        "charge": dea.Charge("interface_1"),
    })  # fmt: skip
    assert run["stretch"] == pytest.approx(stretch, rel=1e-5)
    gap = g - H * (stretch - 1)
    assert run["charge_C"] == pytest.approx(EPSILON_0 * SIDE**2 * volts / gap, rel=1e-4)
    assert run["inertia"] == 0


# -------------------------------------------------------------------- rigid parts beside air


RUBBER = dea.Material(dea.NeoHookean(MU))


def turned(layers, regions, supports):
    device = dea.read_gmsh(BoxStack(H, None, layers, divisions=2, order=1), MPI.COMM_SELF)
    scene = dea.Scene(
        device, regions, supports=[dea.Clamp("bottom"), *supports],
        prescribed=[dea.Turn("interface_1" if len(layers) == 2 else "top", 0.1)],
        kinematics=dea.PlaneStrain(),
    )  # fmt: skip
    part = "interface_1" if len(layers) == 2 else "top"
    return dea.solve(scene, dea.Ramp("turn", steps=1), quiet=True, stability="every", record={
        "moment": dea.PartMoment(part), "rise": dea.PartDisplacement(part, "y"),
    })  # fmt: skip


def test_air_does_not_hinder_a_rigid_part():
    """Its nodes belong to solid and air; the moment is that of the film without the air."""
    film = Layer("film", H, 1)
    alone = turned([film], {"film": RUBBER}, [dea.Rigid("top")])
    beside = turned(
        [film, Layer("gap", H, 1)], {"film": RUBBER, "gap": dea.Air()},
        [dea.Rigid("interface_1"), dea.Clamp("top")],
    )  # fmt: skip
    assert abs(alone["moment_N_m"]) > 1e-3
    for name in ("moment_N_m", "rise_m"):
        assert beside[name] == pytest.approx(alone[name], rel=1e-6)
    assert beside["inertia"] == alone["inertia"] == 0


@pytest.mark.parametrize("support", [
    dea.Rigid("top"), dea.Rigid("gap"),
    dea.Obstacle("top", dea.Plane((0.0, 1.0), (0.0, -1.0))),
])  # fmt: skip
def test_what_acts_on_air_alone_is_refused(support):
    layers = [Layer("film", H, 1), Layer("gap", H, 1)]
    device = dea.read_gmsh(BoxStack(H, None, layers, divisions=1, order=1), MPI.COMM_SELF)
    with pytest.raises(dea.InputError, match="acts on air alone") as told:
        dea.Scene(
            device, {"film": RUBBER, "gap": dea.Air()},
            supports=[dea.Clamp("bottom"), support], kinematics=dea.PlaneStrain(),
        )  # fmt: skip
    assert len(str(told.value).split(". ")) == 1
