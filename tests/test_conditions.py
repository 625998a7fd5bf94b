"""Conditions know themselves: each checks itself, and declares what it means for a problem."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import ufl
from conftest import block
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0, Dielectric
from dea_fenicsx.scene import conditions, declarations
from dea_fenicsx.scene.condition import Condition, Driven, Load, OnSurface, Prescribed, Support
from dea_fenicsx.scene.electrodes import Conducting
from dea_fenicsx.scene.kinematics import Helical, Kinematics

PACKAGE = Path(dea.__file__).parent
MU, EDGE = 50e3, 1e-3
RUBBER = dea.Material(
    dea.NeoHookean(MU), dea.IdealDielectric(3.0), density=1e3,
    thermal=dea.Thermal(293.15, 273.15, 353.15),
)  # fmt: skip
TIGHT = dea.NewtonOptions(tolerance=1e-12)


# --------------------------------------------------------------------- made-up conditions


@dataclass(frozen=True)
class Roller(OnSurface, Support):
    """Holds the normal of a face of a box: ``roller = Roller("x_min", "x")``."""

    where: str
    normal: str

    def declarations(self, scene):
        return [declarations.FixedDisplacement(self.where, self.normal)]


@dataclass(frozen=True)
class EvenForce(OnSurface, Load):
    """A force in N, spread evenly over the undeformed area in m^2 of a surface."""

    where: str
    newtons: tuple[float, ...]
    area: float
    ramp: str = "load"

    def declarations(self, scene):
        traction = tuple(f / self.area for f in self.newtons)
        return [declarations.DeadTraction(self.where, self.ramp, traction)]


@dataclass(frozen=True)
class Suction(OnSurface, Load):
    """A pull along the undeformed normal; its virtual work is written here."""

    where: str
    pascal: float
    ramp: str = "load"

    def declarations(self, scene):
        @dataclass(frozen=True)
        class Work(declarations.SurfaceWork):
            pascal: float

            def density(self, at):
                return at.stress(self.pascal) * ufl.dot(at.normal, at.virtual)

        return [Work(self.where, self.ramp, self.pascal)]


@dataclass(frozen=True)
class Tilt(OnSurface, Prescribed):
    """A face is displaced along x by an angle times its height z."""

    where: str
    radians: float
    ramp: str = "stretch"

    def declarations(self, scene):
        return [
            declarations.FixedDisplacement(
                self.where, "x", lambda X: self.radians * X[:, 2], ramp=self.ramp
            ),
            *(declarations.FixedDisplacement(self.where, axis) for axis in "yz"),
        ]


@dataclass(frozen=True)
class Foam(Dielectric):
    """Rubber with air in it: the permittivity of a mixture in parallel."""

    eps_r: float
    air: float

    def permittivity(self):
        return EPSILON_0 * (self.air + (1 - self.air) * self.eps_r)

    def faults(self):
        return [] if 0 <= self.air < 1 else [f"air is {self.air}, but must lie in [0, 1)"]


ROLLERS = [Roller("x_min", "x"), Roller("y_min", "y"), Roller("bottom", "z")]


def pulled(cube, load):
    """Stretch of a cube under a load of 20 kPa on its face x_max."""
    scene = dea.Scene(cube, {"film": RUBBER}, supports=ROLLERS, loads=[load])
    record = {"x": dea.MeanStretch(("x_min", "x_max"), "x")}
    return dea.solve(scene, dea.Ramp("load", steps=2), record, quiet=True, options=TIGHT)["x"]


@pytest.mark.parametrize("load", [
    EvenForce("x_max", (20e3 * EDGE**2, 0, 0), EDGE**2),
    dea.DeadLoad("x_max", (20e3, 0, 0)),
])  # fmt: skip
def test_own_support_and_own_loads(cube, load):
    """Uniaxial tension of neo-Hookean rubber: P = mu (lam - lam^-2)."""
    lam = pulled(cube, load)
    assert MU * (lam - lam**-2) == pytest.approx(20e3, rel=1e-8)


def test_own_prescribed_motion_that_varies_in_space(cube):
    """All faces tilted alike: the face at x_max moves by half of what its upper edge does."""
    faces = ("x_min", "x_max", "y_min", "y_max", "bottom", "top")
    scene = dea.Scene(
        cube, {"film": RUBBER}, supports=[dea.Fix("bottom", "xyz")],
        prescribed=[Tilt(face, 0.2) for face in faces],
    )  # fmt: skip
    run = dea.solve(scene, dea.Ramp("stretch", steps=1),
                    {"u": dea.MeanDisplacement("x_max", "x")}, quiet=True)  # fmt: skip
    assert run["u_m"] == pytest.approx(0.1 * EDGE, rel=1e-10)


def tilted_on(comm):
    """Iterations, and displacements of two faces, of a block of two cells with a tilted side."""
    film = Layer("film", EDGE, divisions=1)
    device = dea.read_gmsh(BoxStack(EDGE, EDGE, [film], divisions=(2, 1)), comm)
    scene = dea.Scene(device, {"film": RUBBER}, prescribed=[Tilt("x_max", 0.2)],
                      supports=[Roller("x_min", "x"), Roller("bottom", "z"), dea.FreeBody()],
                      loads=[EvenForce("y_max", (0.0, 0.0, 0.0), EDGE**2)])  # fmt: skip
    run = dea.solve(scene, [dea.Ramp("load", steps=1), dea.Ramp("stretch", steps=1)],
                    {"u": dea.MeanDisplacement("x_max", "x"),
                     "w": dea.MeanDisplacement("top", "z")}, quiet=True)  # fmt: skip
    return [run["newton_iterations"], run["u_m"], run["w_m"]]


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_own_conditions_on_several_ranks(on_ranks, ranks):
    """Three ranks are more than there are cells."""
    alone = tilted_on(MPI.COMM_SELF)
    assert alone[1] == pytest.approx(0.1 * EDGE, rel=1e-10)
    found = on_ranks("test_conditions", "tilted_on", ranks)
    assert found[0] == alone[0]
    assert found[1:] == pytest.approx(alone[1:], rel=1e-8)


def test_own_dielectric(cube):
    """Charge of a film that is held all over: Q = eps A V/T."""
    foam = dea.Material(dea.NeoHookean(MU), Foam(3.0, 0.25))
    scene = dea.Scene(
        cube, {"film": foam}, supports=[dea.Clamp("bottom"), dea.Clamp("top")],
        electrodes=[dea.Electrode("top", 10.0), dea.Ground("bottom")],
    )  # fmt: skip
    run = dea.solve(scene, dea.Ramp("voltage", steps=1), {"Q": dea.Charge("top")}, quiet=True)
    eps = EPSILON_0 * (0.25 + 0.75 * 3.0)
    assert run["Q_C"] == pytest.approx(eps * EDGE * 10, rel=1e-3)  # the sides bulge a little


def test_own_conditions_are_checked(cube):
    with pytest.raises(dea.InputError, match="no facet group named 'x_mn'; did you mean 'x_min'"):
        dea.Scene(cube, {"film": RUBBER}, supports=[Roller("x_mn", "x")])
    with pytest.raises(dea.InputError, match="Roller on 'x_max' and Tilt on 'x_max' give the same"):
        scene = dea.Scene(cube, {"film": RUBBER}, prescribed=[Tilt("x_max", 0.2)],
                          supports=[Roller("x_max", "x"), dea.Clamp("bottom")])  # fmt: skip
        dea.solve(scene, dea.Ramp("stretch", steps=1), {}, quiet=True)


# --------------------------------------------------------------- all conditions of the package


def kinds(base: type) -> Iterator[type]:
    """All classes below a base that the package defines and that can be made."""
    for kind in base.__subclasses__():
        yield from kinds(kind)
        if kind.__module__.startswith("dea_fenicsx.") and kind.__name__ in dea.__all__:
            yield kind


PLANE = dea.Plane((2e-3, 0.0, 0.0), (-1.0, 0.0, 0.0))
EXAMPLES = {
    "Fix": ("x_min", "xy"), "Clamp": ("x_min",), "FreeBody": (),
    "Stretch": ("x_max", "x", 1.5), "Displacement": ("x_max", "x", 1e-4),
    "PreStretch": ("film", 1.5, 1.5), "AxialStretch": (1.1,), "Twist": (3.0,),
    "DeadLoad": ("x_max", (1.0, 2.0, 3.0)), "DeadPressure": ("x_max", 5.0),
    "FollowerPressure": ("x_max", 5.0), "AxialForce": (1.0,), "Torque": (1.0,),
    "Electrode": ("top", 5.0), "ThinFilm": ("film", 5.0, "voltage", (), 0.0, EDGE),
    "ChargedElectrode": ("top", 1e-9),
    "Source": ("top", 100.0),
    "Periodic": ("x_min", "x_max"), "MeanStrain": (("x_min", "x_max"), "x", 0.1),
    "Obstacle": ("x_max", PLANE),
    "Rigid": ("x_max",), "Turn": ("x_max", 1.0), "Moment": ("x_max", 1.0),
    "Cavity": ("top", None, 1e-9, None, 1e5, 1.0, None, 0.0, "", "z"),
    "Force": ("x_max", (1.0, 2.0)),
    "Spring": ("x_max", 10.0, "x"), "ElasticFoundation": ("x_max", 1e6),
    "TorsionSpring": ("x_max", 1e-3),
    "Gravity": ((0.0, 0.0, -9.81),), "Centrifugal": (10.0,),
    "BodyForce": ("film", (0.0, 0.0, 1.0)),
    "MembranePressure": ("film", 5.0, (0.0, 0.0, -1.0)),
    "Temperature": ("film", 310.0),
    "Graded": ("film", "elastic.mu", lambda X: 1 + X[:, 0]),
}  # fmt: skip


class Setting:
    """What a condition asks of a scene, without a scene."""

    def __init__(self, device, kinematics):
        self.device, self.kinematics, self.materials = device, kinematics, {"film": RUBBER}
        self.electrodes = self.supports = self.prescribed = self.loads = ()
        self.temperature = None


def test_every_condition_has_an_example():
    assert {kind.__name__ for kind in kinds(Condition)} == set(EXAMPLES)


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_condition_checks_and_declares_itself(cube, name):
    kind = getattr(conditions, name)
    item = kind(*EXAMPLES[name])
    needs_cell = name in ("AxialStretch", "Twist", "AxialForce", "Torque")
    scene = Setting(cube, Helical(0.0) if needs_cell else dea.ThreeD())
    if name == "MembranePressure":
        scene.kinematics = dea.SurfaceMembrane(1e-3)
    if name in ("Rigid", "Turn", "Moment", "Force"):
        scene.kinematics, scene.supports = dea.PlaneStrain(1e-3), (dea.Rigid("x_max"),)
    item.check(scene)
    told = item.declarations(scene)
    assert told
    assert all(isinstance(one, declarations.Declaration) for one in told)
    if isinstance(item, Driven):
        assert item.ramp
        assert all(one.ramp == item.ramp for one in told)


def test_what_conditions_declare(cube):
    """A few declarations word by word."""
    scene = Setting(cube, dea.ThreeD())
    fixed = declarations.FixedDisplacement
    assert dea.Fix("a", "xz").declarations(scene) == [fixed("a", "x"), fixed("a", "z")]
    assert dea.Clamp("a").declarations(Setting(cube, dea.Axisymmetric())) == [
        fixed("a", "r"), fixed("a", "z"),
    ]  # fmt: skip
    (told,) = dea.Stretch("a", "y", 1.25, about=2e-3).declarations(scene)
    assert told == fixed("a", "y", growth=0.25, about=2e-3, ramp="stretch")
    (told,) = dea.Twist(3.0, "turn").declarations(scene)
    assert told == declarations.FixedGlobal(declarations.TWIST, 3.0, "turn")
    (told,) = dea.Electrode("top", 5.0).declarations(scene)
    assert told.volts(np.zeros((2, 3))).tolist() == [5.0, 5.0]
    (told,) = dea.Ground("top").declarations(scene)
    assert told.ramp is None


def test_all_kinds_are_named_to_the_user(cube):
    """What may be given is told by name, though a base class stands for all of them."""
    with pytest.raises(dea.InputError) as told:
        dea.Scene(cube, {"film": RUBBER}, supports=["x_min"])
    assert "a Fix or a Clamp or a FreeBody" in str(told.value)
    with pytest.raises(dea.InputError, match="a ThreeD or a PlaneStrain or a GeneralisedPlane"):
        dea.Scene(cube, {"film": RUBBER}, kinematics="flat")
    with pytest.raises(dea.InputError, match="must be an IdealDielectric or"):
        dea.Scene(cube, {"film": dea.Material(dea.NeoHookean(MU), 3.0)}, supports=ROLLERS)


def test_a_region_is_not_told_to_be_a_missing_surface(cube):
    """Only what the mesh lacks is named, where a pre-stretch names a region that is there."""
    with pytest.raises(dea.InputError, match="The scene needs 'end', 'side', which the mesh lacks"):
        dea.Scene(cube, {"film": RUBBER}, prescribed=[dea.PreStretch("film", 1.2, 1.2)],
                  supports=[dea.Clamp("end"), dea.Clamp("side")])  # fmt: skip


# --------------------------------------------------------------------------- kinematics


@pytest.mark.parametrize("kinematics, name, motions, unknowns", [
    (dea.ThreeD(), "xyz", 6, ()), (dea.PlaneStrain(), "xy", 3, ()),
    (dea.GeneralisedPlaneStrain(), "xy", 3, ("elongation",)), (dea.Axisymmetric(), "rz", 1, ()),
    (Helical(0.0), "rtz", 2, ("elongation", "twist")),
])  # fmt: skip
def test_kinematics_say_their_motions_and_unknowns(kinematics, name, motions, unknowns):
    """A rigid motion strains nothing: rotations are linear in the place, translations constant."""
    assert kinematics.axes == name
    assert kinematics.overall == unknowns
    x = np.array([[1.0, 2.0, 0.0], [3.0, 5.0, 0.0]])
    table = [kinematics.rigid_motions(x, a, np.zeros(3), 1.0) for a in range(len(name))]
    assert {rows.shape for rows in table} == {(2, motions)}
    shifts = np.array(table)[:, :, kinematics.rotations :]
    assert np.allclose(shifts[:, 0], shifts[:, 1])
    turns = np.array(table)[:, :, : kinematics.rotations]
    if name != "rtz":  # about the axis the radius counts alone
        moved = turns[:, 1] - turns[:, 0]
        assert np.allclose(np.einsum("ik,i->k", moved, (x[1] - x[0])[: len(name)]), 0)
    motion = kinematics.global_motion(("e", "k") if len(unknowns) == 2 else "e", "c")
    assert (motion is None) == (not unknowns)
    if unknowns:
        assert motion.elongation == "e"
        assert motion[0::2] == (("c", "k") if len(unknowns) == 2 else (0, 0))


# ------------------------------------------------------------------------------ structure


def test_no_ladders_over_conditions():
    """No module asks a condition, a kinematics or a dielectric for its class."""
    classes = {kind.__name__ for base in (Condition, Kinematics, Dielectric, Conducting)
               for kind in kinds(base)}  # fmt: skip
    found = []
    for room in ("scene", "model", "measure", "exact"):
        for file in (PACKAGE / room).glob("*.py"):
            for node in ast.walk(ast.parse(file.read_text("utf-8"))):
                if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "isinstance":
                    asked = {n.id for n in ast.walk(node.args[1]) if isinstance(n, ast.Name)}
                    found += [f"{file.name}: {name}" for name in asked & classes]
    assert not found
    text = (PACKAGE / "scene" / "scene.py").read_text("utf-8")
    assert text.count("isinstance(") <= 5


@pytest.mark.parametrize("load", [
    EvenForce("x_max", (20e3 * EDGE * 2e-3, 0.0), EDGE * 2e-3), Suction("x_max", 20e3),
])  # fmt: skip
@pytest.mark.usefixtures("quick_compile")
def test_boxes_of_two_dimensions_take_own_conditions(load):
    """Plane strain: P = mu (lam - lam^-3) along x, at any depth."""
    plane = block((2, 2))
    scene = dea.Scene(
        plane, {"film": RUBBER}, kinematics=dea.PlaneStrain(depth=2e-3),
        supports=[Roller("x_min", "x"), Roller("bottom", "y")],
        loads=[load],
    )  # fmt: skip
    lam = dea.solve(scene, dea.Ramp("load", steps=2),
                    {"x": dea.MeanStretch(("x_min", "x_max"), "x")}, quiet=True,
                    options=TIGHT)["x"]  # fmt: skip
    assert MU * (lam - lam**-3) == pytest.approx(20e3, rel=1e-8)
