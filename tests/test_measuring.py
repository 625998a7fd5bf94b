"""What is measured over regions and along lines, against deformations known in closed form.

The displacement is written into the nodes, so that nothing is solved but where a test says so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import ufl
from conftest import block
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.terms import EnergyTerm
from dea_fenicsx.scene.condition import Extension
from dea_fenicsx.scene.declarations import AddedPhysics

pytestmark = pytest.mark.usefixtures("quick_compile")
MU, L = 5e4, 1e-3
SOFT = dea.Material(dea.NeoHookean(MU))
FILM = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(3.0))
SPONGE = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(3.0), bulk_modulus=2e5)


def stack(comm=MPI.COMM_SELF, names=("low", "high"), width=None):
    """Two layers of half a millimetre each, along the last axis, 1 mm long."""
    layers = [Layer(name, L / 2) for name in names]
    divisions = (3,) if width is None else (3, 1)
    return dea.read_gmsh(BoxStack(L, width, layers, divisions=divisions), comm)


def moved(device, displacement, kinematics=None, materials=None, volts=None, supports=()):
    """A problem whose displacement in m is a function of the positions in m, shape (n, 3)."""
    kinematics = kinematics or dea.PlaneStrain(2 * L)
    materials = materials or {"low": SPONGE, "high": SPONGE}
    electrodes = [dea.Electrode("bottom", 10.0), dea.Ground("top")] if volts else []
    supports = [dea.Clamp("bottom"), *supports]
    problem = Problem(
        dea.Scene(device, materials, electrodes, supports, kinematics=kinematics)
    )
    for a, part in enumerate(problem.displacement):
        x = part.space.tabulate_dof_coordinates() * L
        problem.w.x.array[part.dofs] = displacement(x)[a] / L
    if volts:
        x = problem.potential.space.tabulate_dof_coordinates() * L
        problem.w.x.array[problem.potential.dofs] = volts(x) / problem.scales.potential
    return problem


def sheared(x):
    """u_x = y^2/L, u_y = x y/(2 L): F = [[1, 2 y/L], [y/(2 L), 1 + x/(2 L)]]."""
    return x[:, 1] ** 2 / L, x[:, 0] * x[:, 1] / (2 * L)


def J_of_sheared(x, y):
    return 1 + x / (2 * L) - (y / L) ** 2


# ----------------------------------------------------------------------------------- over regions


@pytest.fixture(scope="module")
def uneven():
    return moved(stack(), sheared, volts=lambda x: 30 * x[:, 1] ** 2 / L**2)


def over(problem, *given, **named):
    return dea.OverRegion(*given, **named).bind(problem)()


def test_means_and_integrals_are_exact(uneven):
    """The mean of J = 1 + x/(2 L) - (y/L)^2 is 5/4 - 1/12 in the lower half, 5/4 - 7/12 above."""
    assert over(uneven, "J") == pytest.approx(5 / 4 - 1 / 3, rel=1e-12)
    assert over(uneven, "J", regions="low") == pytest.approx(5 / 4 - 1 / 12, rel=1e-12)
    assert over(uneven, "J", regions=("high", "low", "high")) == over(uneven, "J")
    whole = L * L * 2 * L * (5 / 4 - 1 / 3)
    assert over(uneven, "J", "integral") == pytest.approx(whole, rel=1e-12)
    assert over(uneven, "displacement", axis="x") == pytest.approx(L / 3, rel=1e-12)
    assert dea.OverRegion("J", "integral").unit == "m3"
    assert dea.OverRegion("stress", "integral", "xx").unit == "Pa_m3"


def test_extremes_are_those_of_the_quadrature_points(uneven):
    """They lie within the exact range, and close to its ends on three cells in a row."""
    low, high = over(uneven, "J", "min", regions="low"), over(uneven, "J", "max", regions="low")
    assert J_of_sheared(0, L / 2) < low < J_of_sheared(0, L / 2) + 0.1
    assert J_of_sheared(L, 0) - 0.1 < high < J_of_sheared(L, 0)
    assert over(uneven, "displacement", "max", "x") < L
    assert over(uneven, "displacement", "max") < np.hypot(L, L / 2)


def test_field_and_principal_stretch():
    """F = diag(1.2, 0.9, 1) turned by 30 degrees; E = F^-T (0, -50 V/L, 0)."""
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    F = np.array([[c, -s], [s, c]]) @ np.diag([1.2, 0.9])
    problem = moved(
        stack(), lambda x: (F - np.eye(2)) @ x[:, :2].T, volts=lambda x: 50 * x[:, 1] / L
    )
    field = np.linalg.inv(F).T @ [0, -50 / L]
    for take in ("mean", "max", "min"):
        assert over(problem, "field", take) == pytest.approx(np.linalg.norm(field), rel=1e-9)
        assert over(problem, "field", take, "y") == pytest.approx(field[1], rel=1e-9)
        assert over(problem, "stretch", take) == pytest.approx(1.2, rel=1e-9)
        assert over(problem, "stretch", take, "y") == pytest.approx(0.9, rel=1e-9)
    point = dea.AtPoint((L / 3, L / 3), "stress", "xy").bind(problem)()
    assert over(problem, "stress", axis="xy") == pytest.approx(point, rel=1e-9)
    point = dea.AtPoint((L / 3, L / 3), "pressure").bind(problem)()
    assert over(problem, "pressure") == pytest.approx(point, rel=1e-9)


def test_a_field_is_that_of_the_dielectrics():
    """The conducting half neither counts nor dilutes the mean."""
    carbon = dea.Material(dea.NeoHookean(MU), dea.Conductor(), bulk_modulus=2e5)
    problem = Problem(dea.Scene(
        stack(), {"low": SPONGE, "high": carbon},
        [dea.Electrode("high", 10.0), dea.Ground("bottom")], [dea.Clamp("bottom")],
        kinematics=dea.PlaneStrain(),
    ))  # fmt: skip
    x = problem.potential.space.tabulate_dof_coordinates()
    problem.w.x.array[problem.potential.dofs] = (
        10 * np.minimum(x[:, 1], 0.5) / 0.5 / problem.scales.potential
    )
    assert over(problem, "field") == pytest.approx(10 / (L / 2), rel=1e-9)
    assert over(problem, "field", regions="low") == pytest.approx(10 / (L / 2), rel=1e-9)
    with pytest.raises(dea.InputError, match="region 'high' has no dielectric"):
        over(problem, "field", regions=("low", "high"))


def test_round_bodies_count_by_their_rings():
    """The mean of u_r = r^2/(3 L) over a disc of radius L is int r^3 dr/int r dr/(3 L) = L/6."""
    problem = moved(
        stack(), lambda x: (x[:, 0] ** 2 / (3 * L), 0 * x[:, 0]), kinematics=dea.Axisymmetric()
    )
    assert over(problem, "displacement", axis="r") == pytest.approx(L / 6, rel=1e-12)
    # u_r/r = r/(3 L), on the axis 0
    hoop = dea.AlongLine((0.0, L / 2), (L, L / 2), "stretch", "t", points=5)
    assert hoop.profile(problem)[1] == pytest.approx(1 + np.linspace(0, 1, 5) / 3, abs=1e-6)
    axis = dea.AtPoint((0.0, L / 4), "stretch", "t").bind(problem)()
    assert axis == pytest.approx(1, abs=1e-6)


# ------------------------------------------------------------------------------ own expressions


def test_an_expression_in_one_line(uneven):
    """Each quantity of its own by name, and one that has no name."""

    def of(value, *given, **named):
        return dea.Expression(value, *given, **named).bind(uneven)()

    assert of(lambda at: at.J) == pytest.approx(over(uneven, "J"), rel=1e-12)
    assert of(lambda at: at.u[0], "max") == pytest.approx(
        over(uneven, "displacement", "max", "x"), rel=1e-12
    )
    assert of(lambda at: ufl.sqrt(ufl.dot(at.E, at.E)), "max", "low") == pytest.approx(
        over(uneven, "field", "max", regions="low"), rel=1e-12
    )
    # the normal stresses nearly cancel in their trace, but not their rounding errors
    size = max(over(uneven, "stress", "max", axes) for axes in ("xx", "yy", "zz"))
    assert of(lambda at: -ufl.tr(at.stress) / 3) == pytest.approx(
        over(uneven, "pressure"), rel=1e-12, abs=1e-16 * size
    )
    assert of(lambda at: at.potential) == pytest.approx(10.0, rel=1e-12)  # the mean of 30 y^2
    assert of(lambda at: at.X[1] ** 2) == pytest.approx(L**2 / 3, rel=1e-12)
    assert of(lambda at: 1.0, "integral") == pytest.approx(2 * L**3, rel=1e-12)
    assert of(lambda at: at.strain_energy, "integral") == pytest.approx(
        dea.Energy("elastic").bind(uneven)(), rel=1e-9
    )
    assert dea.Expression(lambda at: at.J, unit="1").unit == "1"


@pytest.mark.parametrize(("value", "words"), [
    (lambda at: at.F, r"has the shape \(3, 3\)"),
    (lambda at: at.nothing, "cannot be formed"),
    (lambda at: None, "cannot be formed"),
    (lambda at: "J", "cannot be formed"),
])  # fmt: skip
def test_what_is_no_expression_is_refused(uneven, value, words):
    with pytest.raises(dea.InputError, match=words):
        dea.Expression(value).bind(uneven)


def test_no_potential_without_electrodes():
    still = moved(stack(), sheared)
    with pytest.raises(dea.InputError, match="needs a scene with electrodes"):
        dea.Expression(lambda at: at.potential).bind(still)
    with pytest.raises(dea.InputError, match="the scene has no electrodes"):
        over(still, "field")


@dataclass(frozen=True)
class Ground(Extension):
    """An elastic foundation in the volume, 1/2 k u_y^2, stored as the energy of springs."""

    stiffness: float

    def declarations(self, scene):
        class Spring(EnergyTerm):
            name = "foundation"
            stored_as = "springs"

            def density(self, at):
                k = at.constant(outer.stiffness * L**2) * at.per_stress
                return k * at.fields["u"][1] ** 2 / 2

        outer = self
        return [AddedPhysics(terms=(Spring(),))]


def test_energies_of_added_terms_are_found_by_their_kind():
    """u_y = y/10 stores k/2 L^2/100/3 in each volume."""
    k = 1e9
    problem = moved(stack(), lambda x: (0 * x[:, 0], x[:, 1] / 10), supports=[Ground(k)])
    exact = k / 2 * L**2 / 300 * 2 * L**3
    for name in ("springs", "foundation"):
        assert dea.Energy(name).bind(problem)() == pytest.approx(exact, rel=1e-10)


# ------------------------------------------------------------------------------- centre of mass


def test_centre_of_mass(uneven):
    """The mean of x + y^2/L is L/2 + L/3; densities 1 and 3 weigh the halves."""
    assert dea.CentreOfMass("x").bind(uneven)() == pytest.approx(5 / 6 * L, rel=1e-12)
    halves = [dea.CentreOfMass("x", name).bind(uneven)() for name in ("low", "high")]
    assert halves == pytest.approx([L * (1 / 2 + 1 / 12), L * (1 / 2 + 7 / 12)], rel=1e-12)
    heavy = dea.CentreOfMass("x", densities={"high": 3000.0, "low": 1000.0}).bind(uneven)()
    assert heavy == pytest.approx((halves[0] + 3 * halves[1]) / 4, rel=1e-12)
    with pytest.raises(dea.InputError, match="densities give None for the region 'high'"):
        dea.CentreOfMass("x", densities={"low": 1e3}).bind(uneven)
    with pytest.raises(dea.InputError, match="The axis of CentreOfMass"):
        dea.CentreOfMass("r").bind(uneven)


# ------------------------------------------------------------------------------------ along lines


def test_values_along_a_line(uneven):
    line = dea.AlongLine((0.0, L), (L, L), "displacement", "y", points=11)
    s, values = line.profile(uneven)
    assert s == pytest.approx(np.linspace(0, L, 11), rel=1e-12)
    assert values == pytest.approx(s / 2, abs=1e-12 * L)
    assert line.bind(uneven)() == pytest.approx(L / 4, rel=1e-12)
    across = dea.AlongLine((0.4 * L, 0.1 * L), (0.4 * L, 0.9 * L), "J", take="min", points=9)
    y = np.linspace(0.1, 0.9, 9)
    assert across.profile(uneven)[1] == pytest.approx(1.2 - y**2, rel=1e-9)
    assert across.bind(uneven)() == pytest.approx(1.2 - 0.81, rel=1e-9)
    field = dea.AlongLine((0.4 * L, 0.1 * L), (0.4 * L, 0.9 * L), "field", "y", points=3)
    for place, value in zip((0.1, 0.5, 0.9), field.profile(uneven)[1], strict=True):
        at = dea.AtPoint((0.4 * L, place * L), "field", "y").bind(uneven)()
        assert value == pytest.approx(at, rel=1e-9)


def test_a_column_for_each_point(uneven):
    line = dea.AlongLine((0.0, L), (L, L), "displacement", "y", points=3)
    columns = line.columns("w")
    assert list(columns) == ["w_000", "w_001", "w_002"]
    found = [one.bind(uneven)() for one in columns.values()]
    assert found == pytest.approx([0, L / 4, L / 2], abs=1e-12 * L)
    with pytest.raises(dea.InputError, match="no columns of 'displacement' without an axis"):
        dea.AlongLine((0.0, L), (L, L), "displacement").columns("w")


@pytest.mark.parametrize(("change", "words"), [
    ({"end": (2 * L, L)}, r"outside of the mesh"),
    ({"end": (0.0, L)}, "are one point"),
    ({"end": (L, L, L)}, "The end of AlongLine"),
    ({"points": 1}, "at least 2"),
    ({"axis": "z"}, "The axis of AlongLine"),
    ({"what": "colour"}, "What AlongLine measures"),
    ({"take": "sum"}, "What AlongLine takes"),
    ({"region": "middle"}, "no region named 'middle'"),
    ({"region": "low"}, "outside of the region 'low'"),
])  # fmt: skip
def test_bad_lines_are_refused(uneven, change, words):
    given = dict(start=(0.0, L), end=(L, L), what="displacement", axis="y") | change
    with pytest.raises(dea.InputError, match=words):
        dea.AlongLine(**given).bind(uneven)


def bent(x):
    """The line y = 0 becomes an arc of radius 2 L that turns counter-clockwise."""
    R = 2 * L
    radius = R - x[:, 1]
    angle = x[:, 0] / R
    return radius * np.sin(angle) - x[:, 0], R - radius * np.cos(angle) - x[:, 1]


def test_curvature_of_an_arc():
    """Quadratic elements, three in a row, bend the line with an error of their order."""
    problem = moved(stack(), bent)
    ends = (0.0, 0.0), (L, 0.0)
    found = dea.Curvature(*ends).bind(problem)()
    assert found == pytest.approx(1 / (2 * L), rel=2e-3)
    # points at nodes lie on the circle itself, and the value is exact
    assert dea.Curvature(*ends, points=7).bind(problem)() == pytest.approx(1 / (2 * L), rel=1e-9)
    assert dea.Curvature(*ends[::-1], points=7).bind(problem)() == pytest.approx(
        -1 / (2 * L), rel=1e-9
    )
    still = moved(stack(), lambda x: (x[:, 0] / 7, 0 * x[:, 0]))
    assert dea.Curvature(*ends).bind(still)() == pytest.approx(0, abs=1e-6 / L)
    with pytest.raises(dea.InputError, match="leave about= out"):
        dea.Curvature(*ends, about="z").bind(problem)


def test_curvature_in_space_is_about_an_axis():
    """The same arc in the plane of x and z turns about -y."""

    def arc(x):
        u, w = bent(x[:, [0, 2, 1]])
        return u, 0 * u, w

    problem = moved(stack(width=L / 4), arc, dea.ThreeD())
    ends = (0.0, 0.0, 0.0), (L, 0.0, 0.0)
    for about, factor in ((None, 1), ("y", -1), ("x", 0), ("z", 0)):
        found = dea.Curvature(*ends, about=about, points=7).bind(problem)()
        assert found == pytest.approx(factor / (2 * L), abs=1e-6 / L)


# ------------------------------------------------------------------ ranks, units, orders, materials


def all_values(comm, names=("low", "high"), unit=None):
    problem = moved(stack(comm, names), sheared, materials=dict.fromkeys(names, SPONGE),
                    volts=lambda x: 30 * x[:, 1] ** 2 / L**2)  # fmt: skip
    line = (0.0, 0.3 * L), (L, 0.9 * L)
    record = [
        dea.OverRegion("J"), dea.OverRegion("field", "max"), dea.OverRegion("stress", "min", "xy"),
        dea.OverRegion("pressure", "integral", regions=names[0]), dea.CentreOfMass("y"),
        dea.Expression(lambda at: at.u[0] * at.J, "max"), dea.Curvature(*line),
        dea.AlongLine(*line, "stress", "yy"), dea.AlongLine(*line, "displacement", take="max"),
    ]  # fmt: skip
    return [float(one.bind(problem)()) for one in record]


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_values_do_not_depend_on_ranks(on_ranks, ranks):
    found = on_ranks("test_measuring", "all_values", ranks)
    assert found == pytest.approx(all_values(MPI.COMM_SELF), rel=1e-9)


def test_values_of_a_viscous_body():
    """The history lives at the quadrature points, where regions are evaluated."""
    film = dea.Material(dea.NeoHookean(MU), viscous=[dea.Maxwell(MU, 1.0)])
    sides = [dea.Fix("x_min", "x"), dea.Fix("bottom", "y")]
    scene = dea.Scene(
        block((2, 2)), {"film": film}, supports=sides, kinematics=dea.PlaneStrain(L),
        prescribed=[dea.Stretch("x_max", "x", 1.5)],
    )  # fmt: skip
    record = {"mean": dea.OverRegion("stress", "mean", "xx"),
              "line": dea.AlongLine((0.0, L / 2), (L, L / 2), "stress", "xx"),
              "point": dea.AtPoint((L / 3, L / 3), "stress", "xx"),
              "force": dea.Reaction("x_max", "x")}  # fmt: skip
    run = dea.solve(scene, dea.March(1.0, {"stretch": dea.Rise(1.0)}, steps=4), record, quiet=True)
    area = L * L / 1.5  # the deformed end: incompressible in the plane
    for name in ("mean_Pa", "line_Pa", "point_Pa"):
        assert run[name] == pytest.approx(run["force_N"] / area, rel=1e-6)
