"""Periodic faces: homogeneous films and laminates in closed form, on any number of ranks."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI
from scipy.optimize import brentq

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.support.compat import dolfinx

pytestmark = pytest.mark.usefixtures("quick_compile")
MU, EPS_R, L = 5e4, 3.0, 1e-3
FILM = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))
STIFF = dea.Material(dea.NeoHookean(4 * MU), dea.IdealDielectric(2 * EPS_R))
TIGHT = dea.NewtonOptions(tolerance=1e-12)
FREE = (dea.FreeBody(),)
SIDES = dea.Periodic("x_min", "x_max"), dea.Periodic("y_min", "y_max")
X, Y = ("x_min", "x_max"), ("y_min", "y_max")


def solved(scene, record=None, what=(), steps=1):
    return dea.solve(scene, dea.Ramp(what, steps=steps), record, quiet=True, options=TIGHT)


def stack(materials, comm=MPI.COMM_SELF, divisions=(2, 2), width=L):
    """A block of layers of equal thickness, L wide and half as high."""
    names = [f"layer_{k}" for k in range(len(materials))]
    layers = [Layer(name, L / 2 / len(names)) for name in names]
    device = dea.read_gmsh(BoxStack(L, width, layers, divisions=divisions), comm)
    return device, dict(zip(names, materials, strict=True))


# ------------------------------------------------------------------------------ homogeneous films


def film(comm, supports=FREE):
    """A film that is free to spread in its plane, under a voltage; returns its three stretches."""
    device, materials = stack([FILM], comm)
    scene = dea.Scene(
        device, materials, [dea.Electrode("top", 8e3), dea.Ground("bottom")], [*SIDES, *supports]
    )
    stretches = {a: dea.MeanStretch((f"{a}_min", f"{a}_max"), a) for a in "xy"}
    run = solved(scene, {**stretches, "fx": dea.PeriodicForce(X, "x"),
                         "j": dea.OverRegion("J")})  # fmt: skip
    assert abs(run["fx_N"]) < 1e-9 * MU * L**2 and run["j"] == pytest.approx(1, rel=1e-9)
    return [float(run["x"]), float(run["y"])]


def spread(volts, thickness, eps_r=EPS_R, mu=MU):
    """Equal-biaxial stretch of a free film: mu (l^2 - l^-4) = eps (V/H)^2 l^4."""
    e = eps_r * EPSILON_0 * (volts / thickness) ** 2 / mu
    return brentq(lambda s: s**2 - s**-4 - e * s**4, 1, 1.25)


@pytest.mark.parametrize("supports", [
    FREE,
    (dea.Fix("bottom", "z"), dea.FreeBody()),
    (dea.Fix("x_min", "x"), dea.Fix("y_max", "y"), dea.Fix("bottom", "z")),
])  # fmt: skip
def test_a_free_film_spreads(supports):
    """Held by nothing, at its bottom, or on one face of each pair, it is the same film."""
    exact = spread(8e3, L / 2)
    assert exact > 1.02
    assert film(MPI.COMM_SELF, supports) == pytest.approx([exact, exact], rel=1e-9)


def plane(comm, kinematics=None, **means):
    """A stretched and sheared film in the plane; returns stretch, shear and both forces."""
    device = dea.read_gmsh(BoxStack(L, None, [Layer("film", L)], divisions=(3,)), comm)
    scene = dea.Scene(
        device, {"film": FILM}, supports=[dea.FreeBody(), dea.Periodic(*X, free="xy")],
        prescribed=[dea.MeanStrain(X, axis, strain) for axis, strain in means.items()],
        kinematics=kinematics or dea.PlaneStrain(2 * L),
    )  # fmt: skip
    record = {"x": dea.MeanStretch(X, "x"), "fx": dea.PeriodicForce(X, "x"),
              "fy": dea.PeriodicForce(X, "y"), "u": dea.MeanDisplacement("x_max", "y"),
              "v": dea.MeanDisplacement("x_min", "y")}  # fmt: skip
    run = solved(scene, record, steps=2)
    return [float(run["x"]), float(run["u_m"] - run["v_m"]) / L,
            *(float(run[f"{f}_N"]) / (2 * L**2 * MU) for f in ("fx", "fy"))]  # fmt: skip


def test_a_given_mean_strain():
    """Pure shear: P = mu (lam - lam^-3), the top and the bottom free, no shear."""
    lam = 1.3
    found = plane(MPI.COMM_SELF, x=lam - 1, y=0.0)
    assert found == pytest.approx([lam, 0, lam - lam**-3, 0], abs=1e-9)


def test_a_given_mean_shear():
    """With free top and bottom a sheared film turns instead: its length is all that strains it."""
    lam, shear = 1.2, 0.5
    found = plane(MPI.COMM_SELF, x=lam - 1, y=shear)
    length = np.hypot(lam, shear)
    pull = (length - length**-3) / length
    assert found == pytest.approx([lam, shear, pull * lam, pull * shear], abs=1e-9)


def test_generalised_plane_strain_is_a_bar():
    """Free along its depth, the film is in uniaxial tension: mu (lam - lam^-2)."""
    lam = 1.3
    found = plane(MPI.COMM_SELF, dea.GeneralisedPlaneStrain(2 * L), x=lam - 1, y=0.0)
    assert found[2] == pytest.approx(lam - lam**-2, rel=1e-9)


def test_a_load_on_both_faces_pulls_the_mean_strain():
    """Tractions on the two faces that balance are a mean stress."""
    device = block((2, 2))
    loads = [dea.DeadLoad("x_max", (2e4, 0.0)), dea.DeadLoad("x_min", (-2e4, 0.0))]
    scene = dea.Scene(device, {"film": FILM}, supports=[dea.FreeBody(), SIDES[0]], loads=loads,
                      kinematics=dea.PlaneStrain(L))  # fmt: skip
    lam = solved(scene, {"x": dea.MeanStretch(X, "x")}, steps=2)["x"]
    assert MU * (lam - lam**-3) == pytest.approx(2e4, rel=1e-9)


def test_an_axisymmetric_rod():
    """One period of a rod under tension: mu (lam - lam^-2) on its area."""
    device = block((2, 2))
    ends = ("bottom", "top")
    scene = dea.Scene(
        device, {"film": FILM}, kinematics=dea.Axisymmetric(),
        supports=[dea.Fix("x_min", "r"), dea.Periodic(*ends), dea.FreeBody()],
        prescribed=[dea.MeanStrain(ends, "z", 0.5)],
    )  # fmt: skip
    run = solved(scene, {"f": dea.PeriodicForce(ends, "z")}, steps=2)
    assert run["f_N"] == pytest.approx(MU * (1.5 - 1.5**-2) * np.pi * L**2, rel=1e-9)


# ------------------------------------------------------------------------------------- laminates


def laminate(comm):
    """Two layers of other stiffness and permittivity in series, each under its share of a voltage.

    The period goes along all three axes: bottom and top are one electrode, the middle is ground.
    """
    device, materials = stack([FILM, STIFF], comm, divisions=(1, 1))
    scene = dea.Scene(
        device, materials,
        [dea.Electrode("bottom", 3e3), dea.Ground("interface_1")],
        [*SIDES, dea.Periodic("bottom", "top"), dea.FreeBody()],
    )  # fmt: skip
    record = {"x": dea.MeanStretch(X, "x"), "y": dea.MeanStretch(Y, "y"),
              "z": dea.MeanStretch(("bottom", "top"), "z"), "q": dea.Charge("bottom"),
              "v": dea.AtPoint((L / 3, L / 3, L / 2), "potential")}  # fmt: skip
    run = solved(scene, record)
    return [float(run[name]) for name in ("x", "y", "z", "q_C", "v_V")]


def exact_laminate(volts=3e3, h=L / 4):
    """Both spread by one stretch: sum mu_i h (s - s^-5) = sum eps_i V^2/h s^3."""
    mus, epss = (MU, 4 * MU), (EPS_R * EPSILON_0, 2 * EPS_R * EPSILON_0)
    s = brentq(
        lambda s: sum(mus) * h * (s - s**-5) - sum(epss) * volts**2 / h * s**3, 1, 1.25
    )
    charge = sum(epss) * volts * L**2 * s**4 / h
    return [s, s, s**-2, charge, volts]


def test_a_laminate_that_repeats_along_all_axes():
    found = laminate(MPI.COMM_SELF)
    exact = exact_laminate()
    assert exact[0] > 1.005
    assert found == pytest.approx(exact, rel=1e-8)


def test_a_laminate_in_shear():
    """Layers in series share the stress: the mean shear is its sum over their moduli.

    The period along y is not allowed to change; shear is along x, of layers stacked along y.
    """
    device = dea.read_gmsh(
        BoxStack(L, None, [Layer("soft", L / 4), Layer("hard", L / 4)], divisions=(2,)),
        MPI.COMM_SELF,
    )
    ends, shear = ("bottom", "top"), 0.4
    scene = dea.Scene(
        device, {"soft": FILM, "hard": STIFF}, kinematics=dea.PlaneStrain(L),
        supports=[dea.Periodic(*X, free=""), dea.Periodic(*ends, free=""), dea.FreeBody()],
        prescribed=[dea.MeanStrain(ends, "x", shear)],
    )  # fmt: skip
    record = {"f": dea.PeriodicForce(ends, "x"), "u": dea.OverRegion("J"),
              "fx": dea.PeriodicForce(X, "y")}  # fmt: skip
    run = solved(scene, record, steps=2)
    modulus = 2 / (1 / MU + 1 / (4 * MU))
    assert run["f_N"] == pytest.approx(modulus * shear * L**2, rel=1e-9)


@pytest.mark.parametrize("driven", ["volts", "coulombs", "source"])
def test_conductors_that_repeat(driven):
    """Two films between two conducting layers; one film touches its upper one by the period alone.

    4 mu h (s - s^-5) = 2 eps V^2/h s^3, with all layers alike.
    """
    h, volts = L / 4, 2e3
    carbon = dea.Material(dea.NeoHookean(MU), dea.Conductor())
    names = ("first", "plus", "second", "minus")
    device = dea.read_gmsh(
        BoxStack(L, L, [Layer(name, h) for name in names], divisions=(1, 1)), MPI.COMM_SELF
    )
    push = 2 * EPS_R * EPSILON_0 * volts**2 / h
    exact = brentq(lambda s: 4 * MU * h * (s - s**-5) - push * s**3, 1, 1.2)
    charge = push / volts * L**2 * exact**4
    plus = {"volts": dea.Electrode("plus", volts), "source": dea.Source("plus", volts),
            "coulombs": dea.ChargedElectrode("plus", charge)}[driven]  # fmt: skip
    scene = dea.Scene(
        device, dict(zip(names, (FILM, carbon, FILM, carbon), strict=True)),
        [plus, dea.Ground("minus")], [*SIDES, dea.Periodic("bottom", "top"), dea.FreeBody()],
    )  # fmt: skip
    run = solved(scene, {"x": dea.MeanStretch(X, "x"), "v": dea.Potential("plus"),
                         "q": dea.Charge("plus"), "r": dea.Charge("minus")})  # fmt: skip
    found = [run["x"], run["v_V"], run["q_C"], run["r_C"]]
    assert found == pytest.approx([exact, volts, charge, -charge], rel=1e-9)


def test_a_charged_film_repeats():
    """A floating electrode on both ends of the period holds its charge once."""
    device, materials = stack([FILM, FILM], divisions=(1, 1))
    charge = 2 * EPS_R * EPSILON_0 * L**2 / (L / 4) * 2e3
    scene = dea.Scene(
        device, materials,
        [dea.ChargedElectrode("bottom", charge), dea.Ground("interface_1")],
        [*(dea.Periodic(*pair, free="") for pair in (X, Y)),
         dea.Periodic("bottom", "top", free=""), dea.FreeBody()],
    )  # fmt: skip
    run = solved(scene, {"v": dea.Potential("bottom"),
                         "q": dea.Charge("bottom")})  # fmt: skip
    assert run["v_V"] == pytest.approx(2e3, rel=1e-9)
    assert run["q_C"] == pytest.approx(charge, rel=1e-9)


# ------------------------------------------------------------------------- reactions and volumes


def test_reactions_hold_the_whole_load():
    """Nodes that follow bear their part: the bottom bears the top's load, the left the right's."""
    device, p = block((2, 2)), 1e4
    scene = dea.Scene(
        device, {"film": FILM}, kinematics=dea.PlaneStrain(L),
        supports=[SIDES[0], dea.Fix("bottom", "y"), dea.Fix("x_min", "x")],
        loads=[dea.DeadLoad("top", (0.0, -p)), dea.DeadLoad("x_max", (2 * p, 0.0))],
    )  # fmt: skip
    run = solved(scene, {"y": dea.Reaction("bottom", "y"), "x": dea.Reaction("x_min", "x"),
                         "far": dea.Reaction("x_max", "x")}, steps=2)  # fmt: skip
    assert run["y_N"] == pytest.approx(p * L**2, rel=1e-9)
    assert run["x_N"] == run["far_N"] == pytest.approx(-2 * p * L**2, rel=1e-9)


def test_a_volume_that_cannot_be_kept_is_refused():
    """An incompressible body without free surfaces cannot be stretched along one axis."""
    scene = dea.Scene(
        block((2, 2)), {"film": FILM}, kinematics=dea.PlaneStrain(L),
        supports=[dea.Periodic(*X, free=""), dea.Periodic("bottom", "top", free=""),
                  dea.FreeBody()],
        prescribed=[dea.MeanStrain(X, "x", 0.1)],
    )  # fmt: skip
    with pytest.raises(dea.InputError, match=r"1\.1 times its volume"):
        solved(scene)


@pytest.mark.parametrize("kind", ["triangle", "tetrahedron"])
def test_other_elements(kind):
    """A free film of simplices, whose pressure is continuous and tied as well."""
    cells = getattr(dolfinx.mesh.CellType, kind)
    if kind == "triangle":
        mesh = dolfinx.mesh.create_rectangle(MPI.COMM_SELF, [[0, 0], [1, 1]], [2, 2], cells)
        kinematics, axes, power = dea.PlaneStrain(L), "xy", 3
    else:
        mesh = dolfinx.mesh.create_box(MPI.COMM_SELF, [[0] * 3, [1] * 3], [1, 1, 1], cells)
        kinematics, axes, power = dea.ThreeD(), "xyz", 5
    faces = {f"{a}_{k}": dea.OnPlane(a, k * L) for a in axes for k in (0, 1)}
    device = dea.from_dolfinx(mesh, regions="film", surfaces=faces, unit=L)
    lam, last = 1.05, axes[-1]
    volts = L * np.sqrt(MU * (lam - lam**-power) / (EPS_R * EPSILON_0 * lam ** (power - 2)))
    scene = dea.Scene(
        device, {"film": FILM}, [dea.Electrode(f"{last}_1", volts), dea.Ground(f"{last}_0")],
        [*(dea.Periodic(f"{a}_0", f"{a}_1") for a in axes[:-1]), dea.FreeBody()], (), (),
        kinematics,
    )  # fmt: skip
    run = solved(scene, {"x": dea.MeanStretch(("x_0", "x_1"), "x")})
    assert run["x"] == pytest.approx(lam, rel=1e-9)


# --------------------------------------------------------------------------------- paths and ranks


def test_pull_in_of_a_free_film():
    """A trace passes the limit point of a free film, s^6 = 4 of the neo-Hookean one."""
    device, materials = stack([FILM], divisions=(1, 1))
    scene = dea.Scene(device, materials, [dea.Electrode("top", 2e4), dea.Ground("bottom")],
                      [*SIDES, dea.Fix("bottom", "z"), dea.FreeBody()])  # fmt: skip
    trace = dea.Trace("voltage", first=0.2, until=("x", 1.5))
    run = dea.solve(scene, trace, {"x": dea.MeanStretch(X, "x")}, quiet=True)
    exact = 0.687365 * L / 2 * np.sqrt(MU / (EPS_R * EPSILON_0))
    assert np.max(run.column("voltage_V")) == pytest.approx(exact, rel=1e-5)
    assert run["inertia"] == 1


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_values_do_not_depend_on_ranks(on_ranks, ranks):
    assert on_ranks("test_periodic", "film", ranks) == pytest.approx([spread(8e3, L / 2)] * 2)
    found = on_ranks("test_periodic", "laminate", ranks)
    assert found == pytest.approx(exact_laminate(), rel=1e-8)


# --------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(("changes", "words"), [
    ({"supports": [dea.Periodic("x_min", "x_min")]}, "names 'x_min' twice"),
    ({"supports": [dea.Periodic("x_min", "right")]}, "no facet group named 'right'"),
    ({"supports": [dea.Periodic("x_min", "top")]}, "have different extents"),
    ({"supports": [dea.Periodic("x_min", "x_max", free="z")]}, "free is 'z'"),
    ({"supports": [SIDES[0], dea.Periodic("x_max", "top")]}, "shares a face with another"),
    ({"supports": [SIDES[0]]}, "can move freely: translation along x and translation along y"),
    ({"supports": [SIDES[0], dea.Fix("x_min", "x"), dea.Fix("x_max", "x"), dea.Fix("bottom", "y")]},
     "held along x at both ends"),
    ({"prescribed": [dea.MeanStrain(("x_min", "x_max"), "x", 0.1)], "supports": [
        SIDES[0], dea.Fix("x_min", "x"), dea.Fix("x_max", "x"), dea.Fix("bottom", "y")]},
     "held along x at different values"),
    ({"supports": [dea.Periodic(*X, free=""), dea.Rigid("top"), dea.Fix("bottom", "xy")]},
     "share nodes with a rigid part"),
    ({"prescribed": [dea.MeanStrain(("x_max", "x_min"), "x", 0.1)]}, "which are no periodic faces"),
    ({"prescribed": 2 * [dea.MeanStrain(("x_min", "x_max"), "x", 0.1)]}, "prescribed twice"),
    ({"prescribed": [dea.MeanStrain(("x_min", "x_max"), "z", 0.1)]}, "axis of MeanStrain"),
    ({"prescribed": [dea.MeanStrain(("x_min", "x_max"), "x", np.nan)]}, "strain between"),
])  # fmt: skip
def test_what_does_not_go_together_is_refused(changes, words):
    given = dict(
        device=block((2, 2)), materials={"film": FILM}, kinematics=dea.PlaneStrain(L),
        supports=[dea.FreeBody(), SIDES[0]],
        loads=[dea.DeadPressure("top", 1.0), dea.DeadPressure("bottom", 1.0)],
    ) | changes  # fmt: skip
    with pytest.raises(dea.InputError, match=words):
        dea.solve(dea.Scene(**given), dea.Ramp(steps=1), quiet=True)


def test_faces_that_are_meshed_otherwise_are_refused():
    device = block((2, 2))
    x = device.mesh.geometry.x
    x[:, 1] += 0.1 * x[:, 0] * x[:, 1] * (1 - x[:, 1])
    scene = dea.Scene(device, {"film": FILM}, supports=[SIDES[0], dea.FreeBody()],
                      prescribed=[dea.MeanStrain(X, "x", 0.1)],
                      kinematics=dea.PlaneStrain(L))  # fmt: skip
    with pytest.raises(dea.InputError, match="mesh both alike"):
        dea.solve(scene, dea.Ramp(steps=1), quiet=True)


def test_electrodes_of_other_potentials_on_one_place_are_refused():
    device, materials = stack([FILM], divisions=(1, 1))
    scene = dea.Scene(device, materials, [dea.Electrode("top", 1e3), dea.Ground("bottom")],
                      [*SIDES, dea.Periodic("bottom", "top"), dea.FreeBody()])  # fmt: skip
    with pytest.raises(dea.InputError, match="held at different values"):
        dea.solve(scene, dea.Ramp(steps=1), quiet=True)
