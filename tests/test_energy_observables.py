"""Energies of a device and values at a point, against closed forms and balances."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, HelicalCell, Layer, _gmsh
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.model import forms
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.terms import EnergyTerm, terms_of

pytestmark = pytest.mark.usefixtures("quick_compile")
MU, EPS_R, L, VOLTS = 5e4, 3.0, 1e-3, 1.2e4
SOFT = dea.Material(dea.NeoHookean(MU))
FILM = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))
SPONGE = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R), bulk_modulus=2e5)
ENERGIES = {name: dea.Energy(name) for name in ("elastic", "electric", "loads")}
CIRCLE = np.pi * L**2  # area of an axisymmetric block


def box(divisions=(1,), layers=("film",), comm=MPI.COMM_SELF):
    """A block of edge L: in space if there are two divisions, else in the plane."""
    stack = [Layer(name, L / len(layers)) for name in layers]
    return dea.read_gmsh(BoxStack(L, L if len(divisions) > 1 else None, stack, divisions), comm)


# ----------------------------------------------------------------------- closed forms of energies


def film(comm, kinematics):
    """A homogeneous film under a voltage and a nominal pressure; returns energies and exact ones.

    In the order: elastic, electric, 1/2 C V^2, work of the loads.
    """
    space = isinstance(kinematics, dea.ThreeD)
    round_ = isinstance(kinematics, dea.Axisymmetric)
    up, pascal = ("y" if isinstance(kinematics, dea.PlaneStrain) else "z"), 5e3
    supports = [dea.Fix("bottom", "z"), dea.Fix("x_min", "r")] if round_ else [dea.FreeBody()]
    scene = dea.Scene(
        box((1, 1) if space else (1,), comm=comm), {"film": FILM},
        [dea.Electrode("bottom", VOLTS), dea.Ground("top")], supports, kinematics=kinematics,
        loads=[dea.DeadPressure("top", pascal), dea.DeadPressure("bottom", pascal)],
    )  # fmt: skip
    record = {**ENERGIES, "C": dea.Capacitance("bottom"),
              "l": dea.MeanStretch(("bottom", "top"), up)}  # fmt: skip
    run = dea.solve(scene, dea.Ramp(steps=2), record, quiet=True)
    thin = run["l"]
    plane = type(kinematics) is dea.PlaneStrain
    area = CIRCLE if round_ else L * (L if space else kinematics.depth)
    strain = thin**2 + (1 + thin**-2 if plane else 2 / thin) - 3
    exact = [
        MU / 2 * strain * area * L,
        EPS_R * EPSILON_0 / 2 * (VOLTS / thin / L) ** 2 * area * L,
        run["C_F"] * VOLTS**2 / 2,
        pascal * (1 - thin) * L * area,
    ]
    assert thin < 0.99
    found = [run[f"{name}_J"] for name in ("elastic", "electric", "electric", "loads")]
    return [[float(v) for v in found], [float(v) for v in exact]]


KINEMATICS = (dea.ThreeD(), dea.PlaneStrain(2e-3), dea.GeneralisedPlaneStrain(2e-3),
              dea.Axisymmetric())  # fmt: skip


@pytest.mark.parametrize("kinematics", KINEMATICS, ids=lambda k: type(k).__name__)
def test_energies_of_a_homogeneous_film(kinematics):
    found, exact = film(MPI.COMM_SELF, kinematics)
    assert found == pytest.approx(exact, rel=1e-7)


def test_elastic_energy_with_a_bulk_modulus():
    """F = diag(1, 1, J): W = mu/2 (J^(-2/3) (2 + J^2) - 3) + kappa/2 (J - 1)^2."""
    J = 1.2
    sides = [dea.Fix(f"{a}_{end}", a) for a in "xy" for end in ("min", "max")]
    scene = dea.Scene(box((1, 1)), {"film": SPONGE}, supports=[*sides, dea.Fix("bottom", "z")],
                      prescribed=[dea.Displacement("top", "z", (J - 1) * L)])  # fmt: skip
    run = dea.solve(scene, dea.Ramp(steps=2), {"W": dea.Energy("elastic")}, quiet=True)
    exact = MU / 2 * (J ** (-2 / 3) * (2 + J**2) - 3) + 2e5 / 2 * (J - 1) ** 2
    assert run["W_J"] == pytest.approx(exact * L**3, rel=1e-9)


# ---------------------------------------------------------------------------------------- balances


def bent(kinematics):
    """A block clamped at one face, so that nothing is homogeneous, with dead loads."""
    if isinstance(kinematics, dea.Helical):
        geometry = HelicalCell(radial=2, rim=1, through=1)
        conductor = dea.Material(dea.NeoHookean(2 * MU), dea.Conductor())
        return dea.Scene(
            dea.read_gmsh(geometry, MPI.COMM_SELF),
            {"elastomer": FILM, "electrode_a": conductor, "electrode_b": conductor},
            [dea.Electrode("electrode_a", 3e3), dea.Ground("electrode_b")], [dea.FreeBody()],
            loads=[dea.AxialForce(5e-3), dea.Torque(2e-6), dea.DeadPressure("outer", 500.0)],
            kinematics=dea.Helical(geometry.pitch),
        )  # fmt: skip
    space = isinstance(kinematics, dea.ThreeD)
    whole = [dea.AxialForce(2e-3)] if kinematics.global_unknowns else []
    return dea.Scene(
        box((2, 1) if space else (2,)), {"film": FILM},
        [dea.Electrode("bottom", 6e3), dea.Ground("top")], [dea.Clamp("x_min")],
        loads=[dea.DeadLoad("x_max", (1e3, 200.0, 500.0) if space else (1e3, 500.0)), *whole],
        kinematics=kinematics,
    )  # fmt: skip


@pytest.mark.parametrize("kinematics", [*KINEMATICS, dea.Helical(0.0)],
                         ids=lambda k: type(k).__name__)  # fmt: skip
def test_energy_balance(kinematics):
    """d(elastic - electric - loads) is -Q dV at given loads, and -A df at given voltages.

    The central difference over 0.2 % of the path has an error of about 1e-7.
    """
    scene = bent(kinematics)
    driven = next(e.label for e in scene.electrodes if e.given_volts)
    record = {**ENERGIES, "Q": dea.Charge(driven)}
    near = (0.999, 1.0)
    path = [dea.Ramp("load", to=1.001, at=near), dea.Ramp("voltage", to=1.001, at=near),
            dea.Ramp("load", to=1.003, at=(1.002,))]  # fmt: skip
    run = dea.solve(scene, path, record, quiet=True)
    volts = scene.reference_voltage("voltage")
    total = run.column("elastic_J") - run.column("electric_J") - run.column("loads_J")
    load, voltage = run.column("load_factor"), run.column("voltage_V") / volts

    def at(f, v):
        return np.flatnonzero(np.isclose(load, f) & np.isclose(voltage, v))[0]

    low, mid, high = (at(1.001, v) for v in (0.999, 1.0, 1.001))
    slope = (total[high] - total[low]) / (0.002 * volts)
    assert slope == pytest.approx(-run.column("Q_C")[mid], rel=1e-6)
    for low, mid, high in [
        [at(f, 0.0) for f in (0.999, 1.0, 1.001)], [at(f, 1.001) for f in (1.001, 1.002, 1.003)],
    ]:  # fmt: skip
        slope = (total[high] - total[low]) / (load[high] - load[low])
        assert slope == pytest.approx(-run.column("loads_J")[mid] / load[mid], rel=1e-6)
    assert abs(run["loads_J"]) > 1e-3 * run["elastic_J"]


def test_energy_balance_of_a_charged_electrode():
    """d(elastic + electric) = V dQ where the charge is given and the potential is found."""
    Q = 1.5e-8
    scene = dea.Scene(
        box((2,)), {"film": FILM}, [dea.ChargedElectrode("bottom", Q), dea.Ground("top")],
        [dea.Clamp("x_min")], kinematics=dea.PlaneStrain(2e-3),
    )  # fmt: skip
    record = {**ENERGIES, "V": dea.Potential("bottom"), "Q": dea.Charge("bottom")}
    path = dea.Ramp(to=1.001, at=(0.999, 1.0))
    run = dea.solve(scene, path, record, quiet=True)
    low, mid, high = (
        np.flatnonzero(np.isclose(run.column("charge_factor"), f))[0]
        for f in (0.999, 1.0, 1.001)
    )
    total = run.column("elastic_J") + run.column("electric_J")
    slope = (total[high] - total[low]) / (0.002 * Q)
    assert slope == pytest.approx(run.column("V_V")[mid], rel=1e-6)
    assert run["loads_J"] == 0.0 and run["elastic_J"] > 1e-4 * run["electric_J"]


# --------------------------------------------------------------------------------- parts and names


@pytest.fixture(scope="module")
def layered():
    """Two layers, the upper one stiff and a conductor, stretched evenly to twice their height.

    They are held in the plane and are not incompressible.
    """
    stiff = dea.Material(dea.NeoHookean(3 * MU), dea.Conductor(), bulk_modulus=6e5)
    scene = dea.Scene(
        box(layers=("film", "plate")), {"film": SPONGE, "plate": stiff},
        [dea.Electrode("plate", 100.0), dea.Ground("bottom")],
        [dea.Fix("bottom", "y"), dea.Fix("x_min", "x")], kinematics=dea.PlaneStrain(L),
    )  # fmt: skip
    problem = Problem(scene)
    x = problem.displacement[1].space.tabulate_dof_coordinates()
    problem.w.x.array[problem.displacement[1].dofs] = x[:, 1]
    return problem


def test_energies_of_regions(layered):
    film, plate, both, every = (
        dea.Energy("elastic", regions).bind(layered)()
        for regions in ("film", "plate", ("film", "plate", "film"), None)
    )
    J = 2.0  # the pressure is 0 here, so that the energy is that of F J^(-1/3)
    exact = MU / 2 * (J ** (-2 / 3) * (2 + J**2) - 3) * L**3 / 2
    assert [film, plate] == pytest.approx([exact, 3 * exact], rel=1e-12)
    assert [both, every] == pytest.approx([film + plate] * 2, rel=1e-12)
    assert dea.Energy("electric", "plate").bind(layered)() == 0.0
    assert dea.Energy("dielectric", "film").bind(layered)() == -dea.Energy("electric").bind(
        layered
    )()


class Foundation(EnergyTerm):
    """An energy of 3 J per m^3 and Pa of the unit of stress."""

    name = "foundation"

    def density(self, at):
        return at.constant(3.0) * at.J


def test_a_new_term_has_its_energy(monkeypatch):
    monkeypatch.setattr(forms, "terms_of", lambda scene: [*terms_of(scene), Foundation()])
    problem = Problem(dea.Scene(box(), {"film": SOFT}, supports=[dea.Clamp("bottom")],
                                kinematics=dea.PlaneStrain(L)))  # fmt: skip
    assert dea.Energy("foundation").bind(problem)() == pytest.approx(3 * MU * L**3, rel=1e-12)
    assert dea.Energy("elastic").bind(problem)() == pytest.approx(0, abs=1e-20)
    with pytest.raises(dea.InputError, match="no energy named 'electric'"):
        dea.Energy("electric").bind(problem)


@pytest.mark.parametrize(("energy", "words"), [
    (dea.Energy("elastc"), "did you mean 'elastic'"), (dea.Energy("elastic", "core"), "'core'"),
    (dea.Energy("elastic", ()), "no group"), (dea.Energy("loads", "film"), "regions"),
])  # fmt: skip
def test_energies_that_are_not_there(layered, energy, words):
    with pytest.raises(dea.InputError, match=words):
        energy.bind(layered)


def test_work_of_a_follower_load_is_refused():
    scene = dea.Scene(
        box(), {"film": SOFT}, supports=[dea.Clamp("bottom")], kinematics=dea.PlaneStrain(L),
        loads=[dea.DeadPressure("x_max", 1e3), dea.FollowerPressure("top", 1e3)],
    )  # fmt: skip
    with pytest.raises(dea.InputError, match=r"FollowerPressure on 'top' depends on the path"):
        dea.Energy("loads").bind(Problem(scene))


# --------------------------------------------------------------------------------- values at points


A = np.array([[0.1, 0.3, 0.0], [0.0, -0.2, 0.1], [0.2, 0.0, 0.4]])


def stretched(device, kinematics, material=SPONGE):
    """A problem whose displacement is A x, with a potential that grows along the last axis."""
    electrodes = [dea.Electrode("bottom", 10.0), dea.Ground("top")]
    problem = Problem(dea.Scene(device, {"film": material}, electrodes, [dea.Clamp("bottom")],
                                kinematics=kinematics))  # fmt: skip
    last = device.dim - 1
    for a, part in enumerate(problem.displacement):
        x = part.space.tabulate_dof_coordinates()[:, : device.dim]
        problem.w.x.array[part.dofs] = x @ A[a, : device.dim]
    part = problem.potential
    x = part.space.tabulate_dof_coordinates()[:, last]
    problem.w.x.array[part.dofs] = 7 * x
    return problem


@pytest.mark.parametrize("kinematics", [dea.ThreeD(), dea.PlaneStrain(), dea.Axisymmetric()],
                         ids=lambda k: type(k).__name__)  # fmt: skip
def test_point_in_an_even_stretch(kinematics):
    dim = kinematics.dim
    problem = stretched(box((2, 1) if dim == 3 else (2,)), kinematics)
    scales = problem.scales
    point = (0.62e-3, 0.31e-3, 0.27e-3)[:dim]
    for a, axis in enumerate(kinematics.axes):
        found = dea.AtPoint(point, "displacement", axis).bind(problem)()
        assert found == pytest.approx(A[a, :dim] @ point, rel=1e-12)
    volts = 7 * point[-1] / L * scales.potential
    assert dea.AtPoint(point, "potential").bind(problem)() == pytest.approx(volts, rel=1e-12)
    F = np.eye(3)
    if isinstance(kinematics, dea.Axisymmetric):  # r, hoop, z
        F[np.ix_([0, 2], [0, 2])] += A[:2, :2]
        F[1, 1] = 1 + A[0, :2] @ point / point[0]
        names, field = "rtz", np.array([0, 0, -7.0])
    else:
        F[:dim, :dim] += A[:dim, :dim]
        names, field = "xyz", np.array([0, -7.0, 0]) if dim == 2 else np.array([0, 0, -7.0])
    e = np.linalg.inv(F).T @ field
    J = np.linalg.det(F)
    b = J ** (-5 / 3) * F @ F.T  # with p = 0 in a region with a bulk modulus
    # eps is 1 and mu is 1 in the units of the problem
    stress = b - np.trace(b) / 3 * np.eye(3) + np.outer(e, e) - e @ e / 2 * np.eye(3)
    for i, axis in enumerate(names):
        length = dea.AtPoint(point, "stretch", axis).bind(problem)()
        assert length == pytest.approx(np.linalg.norm(F[:, i]), rel=1e-12)
        found = dea.AtPoint(point, "field", axis).bind(problem)()
        assert found == pytest.approx(e[i] * scales.field, rel=1e-10, abs=1e-6 * scales.field)
    for i, j in ((0, 0), (2, 0), (1, 2)):
        found = dea.AtPoint(point, "stress", names[i] + names[j]).bind(problem)()
        assert found == pytest.approx(stress[i, j] * MU, rel=1e-10, abs=1e-8 * MU)
    pressure = dea.AtPoint(point, "pressure").bind(problem)()
    assert pressure == pytest.approx(-np.trace(stress) / 3 * MU, rel=1e-10)


@pytest.fixture(scope="module")
def curved():
    """A block of quadratic cells that is bent along a parabola, under an even stretch."""
    device = block((3, 1, 2), L, order=2)
    x = device.mesh.geometry.x
    x[:, 2] += 0.3 * x[:, 0] ** 2
    return stretched(device, dea.ThreeD())


def test_point_in_curved_cells(curved):
    rng = np.random.default_rng(1)
    for X in [*rng.random((12, 3)), np.zeros(3), np.ones(3), np.array([1 / 3, 0.5, 0.5])]:
        place = (X + np.array([0, 0, 0.3 * X[0] ** 2])) * L
        found = dea.AtPoint(tuple(place), "displacement", "x").bind(curved)()
        assert found == pytest.approx(A[0] @ place, rel=1e-9, abs=1e-15)
    assert dea.AtPoint(tuple(place), "stretch", "y").bind(curved)() == pytest.approx(
        np.linalg.norm((np.eye(3) + A)[:, 1]), rel=1e-10
    )


class Cylinder:
    """A cylinder along z of radius and height L, of curved tetrahedra."""

    def build(self):
        import gmsh

        _gmsh.start()
        gmsh.model.add("cylinder")
        gmsh.model.occ.addCylinder(0, 0, 0, 0, 0, L, L)
        gmsh.model.occ.synchronize()
        for (dim, tag), name in zip(
            [(3, 1), (2, 1), (2, 2), (2, 3)], ["film", "side", "top", "bottom"], strict=True
        ):
            gmsh.model.addPhysicalGroup(dim, [tag], name=name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.6 * L)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        return gmsh.model


@pytest.fixture(scope="module")
def cylinder():
    return stretched(dea.read_gmsh(Cylinder(), MPI.COMM_SELF), dea.ThreeD())


def test_point_in_curved_tetrahedra(cylinder):
    """Points up to 99.9 % of the radius, and the distance of one outside of the curved side."""
    for angle, r, z in [(0.3, 0.999, 0.2), (2.0, 0.99, 0.9), (4.0, 0.5, 0.0), (5.5, 0, 1)]:
        place = np.array([r * np.cos(angle), r * np.sin(angle), z]) * L
        found = dea.AtPoint(tuple(place), "displacement", "z").bind(cylinder)()
        assert found == pytest.approx(A[2] @ place, rel=1e-9)
    place = np.array([1.5 * np.cos(0.3), 1.5 * np.sin(0.3), 0.4]) * L
    with pytest.raises(dea.InputError, match="outside of the mesh") as error:
        dea.AtPoint(tuple(place), "stretch", "x").bind(cylinder)
    told = float(str(error.value).split(" m outside")[0].split()[-1])
    assert told == pytest.approx(0.5 * L, rel=0.02)  # the side is a circle but for 2 % of h


@pytest.mark.parametrize("kinematics", [dea.GeneralisedPlaneStrain(L), dea.Helical(0.0)],
                         ids=lambda k: type(k).__name__)  # fmt: skip
def test_point_where_the_stretch_is_one_unknown(kinematics):
    """A block or a ring that is pulled to 1.3: sides shrink, and the fibre along z is 1.3 long."""
    if isinstance(kinematics, dea.Helical):
        geometry = HelicalCell(electrode=0, inset=0, radial=2, through=2, grading=1,
                               grading_through=1)  # fmt: skip
        device = dea.read_gmsh(geometry, MPI.COMM_SELF)
        x = device.mesh.geometry.x
        point = tuple(float(c) for c in (x.min(0) + 0.4 * np.ptp(x, axis=0))[:2] * device.length)
    else:
        device, point = box(), (0.4 * L, 0.4 * L)
    scene = dea.Scene(device, dict.fromkeys(device.regions, SOFT), supports=[dea.FreeBody()],
                      prescribed=[dea.AxialStretch(1.3)], kinematics=kinematics)  # fmt: skip
    record = {a: dea.AtPoint(point, "stretch", a) for a in ("rtz" if kinematics.axis_of_rotation
              else "xyz")}  # fmt: skip
    run = dea.solve(scene, dea.Ramp(steps=1), record, quiet=True)
    found = [run[name] for name in record]
    assert found == pytest.approx([1.3**-0.5, 1.3**-0.5, 1.3], rel=1e-8)


def test_distance_from_curved_cells(curved):
    """Below the hollow side, where the corners' box holds the point; and on the surface."""
    point = (0.5 * L, 0.5 * L, 0.0)
    s = np.linspace(0, 1, 100001)
    exact = np.min(np.hypot(s - 0.5, 0.3 * s**2)) * L
    with pytest.raises(dea.InputError, match=rf"{exact:.3g} m outside of the mesh"):
        dea.AtPoint(point, "pressure").bind(curved)
    on = (0.5 * L, 0.5 * L, 0.075 * L * (1 - 1e-7))  # off by rounding
    assert dea.AtPoint(on, "displacement", "z").bind(curved)() == pytest.approx(
        A[2] @ on, rel=1e-6
    )


def test_point_between_two_regions(layered):
    """Without a region it is the cell that comes first in the mesh; the stiff one has 3 mu."""
    point = (0.3 * L, 0.5 * L)
    found = {
        region: dea.AtPoint(point, "stress", "xx", region).bind(layered)()
        for region in ("film", "plate", None)
    }
    assert found["film"] != pytest.approx(found["plate"], rel=0.1)
    assert found[None] in (found["film"], found["plate"])
    volts = dea.AtPoint(point, "potential", region="film").bind(layered)
    layered.commit(layered.imposed(layered.state.with_factors({"voltage": 1.0})))
    assert volts() == pytest.approx(100.0)


@pytest.mark.parametrize(("given", "words"), [
    (((0.5e-3, 0.5e-3, 0.0), "pressure"), "2 finite coordinates in m: x, y"),
    (((0.5e-3, float("nan")), "pressure"), "2 finite coordinates"),
    ((0.5e-3, "pressure"), "2 finite coordinates"),
    (((0.5e-3, 0.5e-3), "velocity"), "displacement, potential"),
    (((0.5e-3, 0.5e-3), "displacement", "z"), "one of x, y"),
    (((0.5e-3, 0.5e-3), "displacement"), "one of x, y"),
    (((0.5e-3, 0.5e-3), "potential", "x"), "left out"),
    (((0.5e-3, 0.5e-3), "stress", "x"), "two of x, y, z, such as 'xz'"),
    (((0.5e-3, 0.5e-3), "stretch", "x", "core"), "'core'"),
    (((0.5e-3, 1.5e-3), "stretch", "x"), "0.0005 m outside of the mesh"),
    (((0.5e-3, 0.7e-3), "stretch", "x", "film"), "0.0002 m outside of the region 'film'"),
    (((0.5e-3, 0.7e-3), "field", "y"), "0.0002 m outside of the dielectrics"),
    (((0.5e-3, 0.7e-3), "field", "y", "plate"), "no value"),
])  # fmt: skip
def test_points_that_are_refused(layered, given, words):
    with pytest.raises(dea.InputError, match=words):
        dea.AtPoint(*given).bind(layered)


def test_units_and_quantities():
    assert {w: dea.AtPoint((0, 0), w).unit for w in ("displacement", "potential", "field")} == {
        "displacement": "m", "potential": "V", "field": "V_per_m",
    }  # fmt: skip
    assert dea.AtPoint((0, 0), "stretch").unit == "" and dea.Energy("elastic").unit == "J"
    assert {dea.AtPoint((0, 0), w).unit for w in ("stress", "pressure")} == {"Pa"}


def shared_nodes(comm):
    """Values at nodes and faces that several cells share, whose pressures jump between them."""
    device = box((3, 2), comm=comm)
    scene = dea.Scene(device, {"film": FILM}, [dea.Electrode("bottom", 4e3), dea.Ground("top")],
                      [dea.Clamp("x_min")], loads=[dea.DeadLoad("x_max", (0, 0, 2e3))])  # fmt: skip
    points = [(L / 3, L / 2, 0.0), (2 * L / 3, L / 2, L / 2), (L / 3, 0.2e-3, 0.6e-3), (L, L, L)]
    record = {}
    for k, point in enumerate(points):
        record[f"p{k}"] = dea.AtPoint(point, "pressure")
        record[f"u{k}"] = dea.AtPoint(point, "displacement", "z")
        record[f"e{k}"] = dea.AtPoint(point, "field", "z")
    run = dea.solve(scene, dea.Ramp(steps=1), record, quiet=True)
    units = {"p": "Pa", "u": "m", "e": "V_per_m"}
    with pytest.raises(dea.InputError, match=r"0\.001 m outside"):
        dea.AtPoint((0, 0, -L), "pressure").bind(run.problem)
    return [float(run[f"{name}_{units[name[0]]}"]) for name in record]


def on_any_ranks(comm):
    """Energies of one cell, and values at nodes of several."""
    return [film(comm, dea.PlaneStrain(2e-3)), shared_nodes(comm)]


@pytest.fixture(scope="module")
def alone():
    return shared_nodes(MPI.COMM_SELF)


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_on_ranks(on_ranks, alone, ranks):
    """Also where there are more ranks than cells."""
    (energies, exact), values = on_ranks("test_energy_observables", "on_any_ranks", ranks)
    assert energies == pytest.approx(exact, rel=1e-7)
    assert values == pytest.approx(alone, rel=1e-7)
