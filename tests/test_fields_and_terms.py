"""New fields and terms: what declares them is all that is touched."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import basix.ufl
import numpy as np
import pytest
from conftest import block
from mpi4py import MPI
from scipy.optimize import fsolve
from test_helical import UNIT, ring

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.model import forms
from dea_fenicsx.model import problem as problem_module
from dea_fenicsx.model.fields import Field, Role, declared_fields
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.terms import EnergyTerm, WorkTerm, terms_of
from dea_fenicsx.scene import declarations
from dea_fenicsx.scene.condition import Extension, Load, OnSurface
from dea_fenicsx.solvers.newton import NewtonSolver

SPONGE = dea.Material(dea.NeoHookean(50e3), dea.IdealDielectric(3.0), bulk_modulus=2e5)
TIGHT = dea.NewtonOptions(tolerance=1e-12)
RECORD = {"width": dea.MeanDisplacement("x_max", "x")}


class Follows(EnergyTerm):
    """c/2 (q - J)^2: q becomes J, and nothing else changes.

    With c = -1 the body would not be stable: it would gain by any J that is not uniform.
    """

    name = "q follows J"
    fields = ("q",)

    def __init__(self, c=1.0):
        self.c = c

    def density(self, at):
        return self.c * (at.fields["q"] - at.J) ** 2 / 2


class Ties(EnergyTerm):
    """l (s - J): the multiplier l makes s follow J, with 1/2 (s - J)^2 to make s determined."""

    name = "s is tied to J"
    fields = ("l", "s")

    def density(self, at):
        s, multiplier = at.fields["s"], at.fields["l"]
        return multiplier * (s - at.J) + (s - at.J) ** 2 / 2


def scalar(name, scene, degree=0, **more):
    """An internal field; at rest J = 1, and a multiplier is 0."""
    more.setdefault("at_rest", 0.0 if name == "l" else 1.0)
    cell = scene.device.mesh.topology.cell_name()
    family = "DG" if degree == 0 else "Lagrange"
    return Field(name, basix.ufl.element(family, cell, degree), Role.INTERNAL, **more)


@pytest.fixture
def with_fields(monkeypatch):
    """Add fields and terms at the two places that declare them, behind or before the others."""

    def add(make, *terms, first=False):
        def fields(scene):
            known, new = declared_fields(scene), make(scene)
            return [*new, *known] if first else [*known, *new]

        monkeypatch.setattr(problem_module, "declared_fields", fields)
        monkeypatch.setattr(forms, "terms_of", lambda scene: [*terms_of(scene), *terms])

    return add


def film(device=None, volts=8e3, materials=None):
    """A unit cell of film, held by planes of symmetry; its state is homogeneous."""
    device = device or block((1, 1, 1))
    return dea.Scene(
        device, materials or {"film": SPONGE},
        [dea.Electrode("top", volts), dea.Ground("bottom")],
        [dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
    )  # fmt: skip


def values_of(problem, name):
    """All values of a scalar field on this rank."""
    return problem.w.x.array[problem.space.parts[name][name].dofs]


def volume_ratio(problem):
    return 1 + problem.forms.swelling().sum() / problem.forms.cell_volumes.sum()


@pytest.fixture(scope="module")
def plain():
    return dea.solve(film(), dea.Ramp(steps=3), RECORD, quiet=True, options=TIGHT)


CASES = {
    "in cells": (lambda s: [scalar("q", s)], [Follows()], False, "q"),
    "continuous": (lambda s: [scalar("q", s, 1)], [Follows()], False, "q"),
    "before the others": (lambda s: [scalar("q", s, 1)], [Follows()], True, "q"),
    "negative": (lambda s: [scalar("q", s, negative=True)], [Follows(-0.01)], False, "q"),
    "multiplier": (
        lambda s: [scalar("l", s, negative=True), scalar("s", s)], [Ties()], False, "s",
    ),
}  # fmt: skip


@pytest.mark.parametrize("factor", ["whole", "split"])
@pytest.mark.parametrize("case", CASES)
def test_a_new_field(case, factor, with_fields, plain):
    """It converges to its closed form, is named in the summary, and changes nothing else."""
    make, terms, first, name = CASES[case]
    with_fields(make, *terms, first=first)
    options = replace(TIGHT, factor=factor)
    run = dea.solve(film(), dea.Ramp(steps=3), RECORD, quiet=True, options=options)
    J = volume_ratio(run.problem)
    assert abs(J - 1) > 1e-3
    assert np.allclose(values_of(run.problem, name), J, rtol=1e-9)
    assert np.allclose(run.history["width_m"], plain.history["width_m"], rtol=1e-9, atol=0)
    assert run.summary["unknowns_by_field"][name] == len(values_of(run.problem, name))
    assert run.summary["inertia"] == 0 and run.summary["stable"]


class FollowsTwice(EnergyTerm):
    """Both parts of q become J."""

    name = "parts of q follow J"
    fields = ("q",)

    def density(self, at):
        return sum((at.fields["q"][k] - at.J) ** 2 / 2 for k in range(2))


def test_a_field_with_parts(with_fields):
    element = basix.ufl.element("DG", "hexahedron", 0, shape=(2,))
    field = Field("q", element, Role.INTERNAL, ("one", "two"), at_rest=1.0)
    with_fields(lambda s: [field], FollowsTwice())
    run = dea.solve(film(), dea.Ramp(steps=2), quiet=True, options=TIGHT)
    found = [run.problem.w.x.array[part.dofs] for part in run.problem.space.parts["q"].values()]
    assert np.allclose(found, volume_ratio(run.problem), rtol=1e-9)
    assert run.summary["unknowns_by_field"]["q"] == 2


def test_which_elements_share_degrees_of_freedom():
    element, cell = basix.ufl.element, "triangle"
    shared = [element("P", cell, 1), element("P", cell, 2, shape=(2,)), element("CR", cell, 1)]
    own = [element("DG", cell, 0), element("DG", cell, 1, shape=(2,)),
           element("bubble", cell, 3), basix.ufl.quadrature_element(cell, degree=2)]  # fmt: skip
    for elements, continuous in ((shared, True), (own, False)):
        for each in elements:
            assert Field("q", each, Role.INTERNAL).is_continuous is continuous


@pytest.mark.usefixtures("quick_compile")
def test_a_continuous_field_is_tied_at_periodic_ends(with_fields):
    with_fields(lambda s: [scalar("q", s, 1)], Follows())
    run = dea.solve(ring(volts=0.3 * UNIT), dea.Ramp(steps=1), quiet=True)
    problem = run.problem
    nodes, tied = len(values_of(problem, "q")), problem.conditions.pairs.counts[-1]
    assert run.summary["unknowns_by_field"]["q"] == nodes - tied < nodes
    assert np.allclose(values_of(problem, "q"), 1, rtol=1e-8)
    assert run.summary["inertia"] == 0


# --------------------------------------------------------------------- fields on some regions


def two_layers(comm=MPI.COMM_SELF):
    """A film below a pad of the same material; both lie between the electrodes."""
    layers = [Layer("film", 1e-3), Layer("pad", 1e-3)]
    device = dea.read_gmsh(BoxStack(1e-3, 1e-3, layers), comm)
    return film(device, 16e3, {"film": SPONGE, "pad": SPONGE})


@pytest.mark.parametrize("degree", [0, 1])
def test_a_field_on_one_region(degree, with_fields):
    """Both regions share an integral without the field, but only one of them has it."""
    plain = dea.solve(two_layers(), dea.Ramp(steps=2), RECORD, quiet=True, options=TIGHT)
    with_fields(lambda s: [scalar("q", s, degree, regions=("film",))], Follows())
    run = dea.solve(two_layers(), dea.Ramp(steps=2), RECORD, quiet=True, options=TIGHT)
    problem = run.problem
    J, q = volume_ratio(problem), values_of(problem, "q")
    (part,) = problem.space.parts["q"].values()
    inside = part.on(3, problem.scene.device.cells_of("film"))
    outside = np.setdiff1d(np.arange(len(q)), inside)
    assert len(outside) == (1 if degree == 0 else 4)
    assert np.allclose(q[inside], J, rtol=1e-9) and not q[outside].any()
    assert run.summary["unknowns_by_field"]["q"] == len(inside)
    assert np.allclose(run.history["width_m"], plain.history["width_m"], rtol=1e-9, atol=0)
    assert run.summary["inertia"] == 0
    assert len(problem.kernels) == 2 and len(plain.problem.kernels) == 1


def test_a_run_with_a_new_field_is_resumed(with_fields, tmp_path):
    with_fields(lambda s: [scalar("q", s)], Follows())
    whole = dea.solve(film(), dea.Ramp(steps=3), RECORD, quiet=True, options=TIGHT)
    arguments = (film(), dea.Ramp(steps=3), RECORD, tmp_path / "run")
    dea.solve(*arguments, quiet=True, options=TIGHT)
    again = dea.solve(*arguments, quiet=True, options=TIGHT, resume=True)
    assert again.summary["unknowns_by_field"]["q"] == 1
    assert np.allclose(values_of(again.problem, "q"), values_of(whole.problem, "q"), rtol=1e-12)


# ----------------------------------------------------------------- tangents without symmetry

STRENGTH = 0.3


class CrossStress(WorkTerm):
    """A stress along x that the stretch along z brings, without the reverse: no energy has it."""

    name = "cross stress"

    def work(self, at, virtual):
        return STRENGTH * (at.F[2, 2] - 1) * virtual(at.F[0, 0])


@dataclass(frozen=True)
class CrossPull(OnSurface, Load):
    """A traction along x that the displacement along z brings."""

    where: str
    ramp: str = "load"

    def declarations(self, scene):
        @dataclass(frozen=True)
        class Work(declarations.SurfaceWork):
            follows: ClassVar[bool] = True
            symmetric: ClassVar[bool] = False

            def density(self, at):
                return at.stress(2e4) * at.displacement[2] * at.virtual[0]

        return [Work(self.where, self.ramp)]


def stretches_in_closed_form(volts, height):
    """Stretches of the film with the cross stress, from its three equations of equilibrium."""
    mu, kappa = 50e3, SPONGE.bulk_modulus
    charge = SPONGE.dielectric.permittivity() * (volts / height) ** 2

    def unbalanced(stretches):
        a, b, c = stretches
        J, squares = a * b * c, a * a + b * b + c * c
        first = mu * J ** (-2 / 3)
        s = np.array(stretches)
        found = first * (s - squares / (3 * s)) + kappa * (J - 1) * J / s
        found -= charge / 2 * np.array([b / c, a / c, -a * b / c**2])
        return (found + np.array([STRENGTH * mu * (c - 1), 0, 0])) / mu

    return fsolve(unbalanced, np.ones(3), xtol=1e-14)


def test_a_virtual_work_without_energy(with_fields, tmp_path):
    """The closed form is met; nothing is counted, and the log says so."""
    with_fields(lambda s: [], CrossStress())
    record = {axis: dea.MeanDisplacement(f"{axis}_max", axis) for axis in "xy"}
    path = [dea.Ramp(steps=2), dea.Trace("voltage", first=0.05, steps=2, at=(1.03,))]
    run = dea.solve(
        film(), path, record, tmp_path, quiet=True, options=TIGHT, stability="every"
    )
    row = next(row for row in run.history if row["time"] == 1.0)
    a, b, _ = stretches_in_closed_form(8e3, 1e-3)
    assert abs(a - b) > 1e-3
    assert np.allclose([1 + row["x_m"] / 1e-3, 1 + row["y_m"] / 1e-3], [a, b], rtol=1e-9, atol=0)
    assert run.summary["stable"] is None and run.summary["inertia"] is None
    assert "cross stress is not symmetric" in (tmp_path / "run.log").read_text()


UNSYMMETRIC = {"term": ([CrossStress()], []), "load": ([], [CrossPull("x_max")])}


@pytest.mark.parametrize("kind", UNSYMMETRIC)
def test_the_tangent_without_symmetry(kind, with_fields):
    """Taylor's test, the convergence of Newton's method, and the transpose."""
    terms, loads = UNSYMMETRIC[kind]
    with_fields(lambda s: [], *terms)
    problem = Problem(replace(film(block((2, 1, 1))), loads=loads))
    solver = NewtonSolver(problem)
    factors = dict.fromkeys(problem.factors, 1.0)
    attempt = solver.solve(problem.state, factors)
    assert attempt.converged and not problem.forms.is_symmetric
    problem.commit(attempt.found)
    matrix = solver.tangent.matrix(0.0)
    assert not matrix.isSymmetric(1e-6)

    rng = np.random.default_rng(0)
    a, b, way = (rng.standard_normal(len(problem.free)) for _ in range(3))
    errors = []
    here, slope = problem.residual(), solver.tangent.times(way)
    for step in (1e-3, 5e-4):
        with problem.at(problem.moved(problem.state, step * way)):
            there = problem.residual()
        errors.append(np.linalg.norm(problem.restrict(there - here) - step * slope))
    assert 3.8 < errors[0] / errors[1] < 4.2

    sizes = []
    with problem.at(problem.moved(problem.state, 1e-2 * way)):
        for _ in range(5):
            rest = problem.unbalanced(problem.residual())
            sizes.append(np.linalg.norm(rest))
            increment = solver.linear_solve(-rest, 1e-12)
            problem.show(problem.moved(problem.state, increment))
    good = [k for k in range(len(sizes) - 1) if sizes[k] < 0.1 and sizes[k + 1] > 1e-13]
    assert len(good) >= 2 and all(sizes[k + 1] < 10 * sizes[k] ** 2 for k in good)

    x, y = solver.solve_transposed(a, 1e-12), solver.linear_solve(b, 1e-12)
    assert x.residual <= 1e-12
    assert np.allclose(solver.tangent.times_transposed(x.values), a, atol=1e-11)
    assert abs(x.values @ b - a @ y) < 1e-10 * np.linalg.norm(x.values) * np.linalg.norm(b)
    solver.refresh_inertia()
    assert solver.inertia.excess is None and not solver.inertia.settled


def test_a_symmetric_tangent_is_its_own_transpose():
    problem = Problem(film())
    solver = NewtonSolver(problem)
    b = np.random.default_rng(1).standard_normal(len(problem.free))
    found = solver.solve_transposed(b, 1e-12)
    assert found.residual <= 1e-12
    assert np.allclose(solver.tangent.times(found.values), b, atol=1e-11)
    assert solver.solve_transposed(0 * b).residual == 0


def test_the_transpose_under_a_follower_pressure():
    """Its surface has a free edge, so that the tangent is not symmetric, though the factor is."""
    loads = [dea.FollowerPressure("x_max", 2e4)]
    problem = Problem(replace(film(), loads=loads))
    solver = NewtonSolver(problem)
    problem.commit(solver.solve(problem.state, dict.fromkeys(problem.factors, 1.0)).found)
    rng = np.random.default_rng(2)
    a, b = (rng.standard_normal(len(problem.free)) for _ in range(2))
    lack = solver.tangent.times_transposed(a) - solver.tangent.times(a)
    assert np.linalg.norm(lack) > 1e-3
    x, y = solver.solve_transposed(a, 1e-12), solver.linear_solve(b, 1e-12)
    assert x.residual <= 1e-12
    assert abs(x.values @ b - a @ y) < 1e-10 * np.linalg.norm(x.values) * np.linalg.norm(b)
    solver.refresh_inertia()
    assert solver.inertia.excess == 0


def test_no_split_factor_without_symmetry(with_fields):
    with_fields(lambda s: [], CrossStress())
    with pytest.raises(dea.InputError, match="needs a symmetric tangent"):
        NewtonSolver(Problem(film()), dea.NewtonOptions(factor="split"))


def transposed_on_ranks(comm):
    """Largest error of the closed form and of (K^-T a).b = a.(K^-1 b) on some ranks."""
    old = forms.terms_of
    forms.terms_of = lambda scene: [*terms_of(scene), CrossStress()]
    try:
        device = dea.read_gmsh(BoxStack(1e-3, 1e-3, [Layer("film", 1e-3)]), comm)
        problem = Problem(film(device))
        solver = NewtonSolver(problem)
        attempt = solver.solve(problem.state, {"voltage": 1.0})
        problem.commit(attempt.found)
        rng = np.random.default_rng(comm.rank)
        a, b = (rng.standard_normal(len(problem.free)) for _ in range(2))
        x, y = solver.solve_transposed(a, 1e-12), solver.linear_solve(b, 1e-12)
        sums = comm.allreduce(np.array([x.values @ b, a @ y, x.values @ x.values, b @ b]))
        return abs(sums[0] - sums[1]) / np.sqrt(sums[2] * sums[3]), x.residual
    finally:
        forms.terms_of = old


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_the_transpose_on_several_ranks(ranks, on_ranks):
    error, residual = on_ranks("test_fields_and_terms", "transposed_on_ranks", ranks)
    assert error < 1e-10 and residual <= 1e-12


@dataclass(frozen=True)
class Bearing(Extension):
    """Brings a field of its own, of a name that the test chooses, and the term for it."""

    field: str
    regions: tuple[str, ...] | None = None

    def declarations(self, scene):
        new = scalar(self.field, scene, regions=self.regions)
        return [declarations.AddedPhysics((new,), (Follows(),))]


def test_a_condition_brings_a_field():
    """The field q = J = 1 is an unknown of the problem, and no two fields share a name."""
    rubber, held = {"film": dea.Material(dea.NeoHookean(5e4))}, dea.Clamp("bottom")
    scene = dea.Scene(block(), rubber, supports=[held, Bearing("q")])
    problem = Problem(scene)
    assert [field.name for field in problem.space.fields] == ["u", "p", "q"]
    assert any(isinstance(term, Follows) for term in problem.forms.terms)
    twice = dea.Scene(block(), rubber, supports=[held, Bearing("p")])
    with pytest.raises(dea.InputError, match="two fields of the name 'p'"):
        Problem(twice)


def test_a_field_on_an_unknown_region():
    supports = [dea.Clamp("bottom"), Bearing("q", regions=("fim",))]
    with pytest.raises(dea.InputError, match=r"region of the field 'q' named 'fim'.*film"):
        dea.Scene(block(), {"film": dea.Material(dea.NeoHookean(5e4))}, supports=supports)
