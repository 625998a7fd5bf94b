"""Compiled code is found by the kind of a form, and only by it."""

from __future__ import annotations

import gc
import os
import time
import weakref

import dolfinx
import numpy as np
import pytest
import ufl
from conftest import block, on_demand
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.run import reuse
from dea_fenicsx.support import compat, form_kinds

pytestmark = pytest.mark.usefixtures("quick_compile")


def given(cells=(2, 2)):
    """Two functions, a constant and a test function on a mesh of their own."""
    mesh = block(cells, 1.0).mesh
    space = dolfinx.fem.functionspace(mesh, ("Lagrange", 2))
    first, second = dolfinx.fem.Function(space), dolfinx.fem.Function(space)
    first.interpolate(lambda x: 1 + x[0])
    second.interpolate(lambda x: x[1] ** 2)
    return mesh, first, second, dolfinx.fem.Constant(mesh, 3.0), ufl.TestFunction(space)


def form(a, b, c, v, power=2, degree=4, mark=0):
    """An integral with an index, a label and derivatives that UFL has not expanded."""
    i, s = ufl.Index(), ufl.variable(a)
    energy = c * ufl.diff(s**power, s) * ufl.grad(a)[i] * ufl.grad(b)[i] + b * ufl.sin(a)
    return ufl.derivative(energy * ufl.dx(mark, metadata={"quadrature_degree": degree}), a, v)


def key(of):
    return form_kinds.kind_of_form(of).key


def test_what_makes_the_code_makes_the_kind():
    (_, a, b, c, v), (_, x, y, z, w) = given(), given((3, 1))
    same = key(form(a, b, c, v))
    assert same == key(form(x, y, z, w))  # another mesh with other numbers
    others = [
        form(b, a, c, v), form(a, a, c, v), form(a, b, 3.0, v), form(a, b, c, v, power=3),
        form(a, b, c, v, degree=3), form(a, b, c, v, mark=1), form(a, b, c, v) + form(b, a, c, v),
    ]  # fmt: skip
    assert all(key(other) != same for other in others)
    assert len(set(map(key, others))) == len(others)


def test_code_that_is_found_gives_what_dolfinx_gives():
    """The second form takes the code of the first; DOLFINx's own form is the reference."""
    form_kinds.clear()
    for k, cells in enumerate([(2, 2), (3, 1)]):
        mesh, a, b, c, v = given(cells)
        c.value = 1.0 + k
        made = form(a, b, c, v)
        told = dolfinx.fem.assemble_vector(dolfinx.fem.form(made)).array
        assert (form_kinds.kept(form_kinds.kind_of_form(made), _options()) is None) == (k == 0)
        assert dolfinx.fem.assemble_vector(compat.compile_form(made)).array == pytest.approx(told)
        points = np.array([[0.2, 0.3], [0.5, 0.5]])
        evaluate = compat.expression(ufl.as_vector([a * c, b]), points)
        cells = np.arange(2, dtype=np.int32)
        expression = dolfinx.fem.Expression(ufl.as_vector([a * c, b]), points)
        assert evaluate(mesh, cells) == pytest.approx(expression.eval(mesh, cells).reshape(2, 2, 2))


def test_a_derivative_follows_from_the_kind_of_its_form():
    """The second one is made without its expression; DOLFINx's own is the reference."""
    form_kinds.clear()
    made = []
    for cells in ((2, 2), (3, 1)):
        mesh, a, b, c, v = given(cells)
        first = form(a, b, c, v)
        along, trial = dolfinx.fem.Function(a.function_space), ufl.TrialFunction(a.function_space)
        along.interpolate(lambda x: x[0] * x[1])
        for by in (a, b):
            def product(first=first, by=by, along=along):
                made.append(by)
                return ufl.derivative(first, by, along)

            told = dolfinx.fem.assemble_vector(dolfinx.fem.form(ufl.derivative(first, by, along)))
            found = compat.compile_derived(first, "product", by, product, [along])
            assert dolfinx.fem.assemble_vector(found).array == pytest.approx(told.array)

            def matrix(first=first, by=by, trial=trial):
                made.append(by)
                return ufl.derivative(first, by, trial)

            told = dolfinx.fem.assemble_matrix(dolfinx.fem.form(matrix())).to_dense()
            made.pop()
            found = compat.compile_derived(first, "matrix", by, matrix)
            assert dolfinx.fem.assemble_matrix(found).to_dense() == pytest.approx(told)
    assert len(made) == 4


def test_what_follows_from_other_functions_is_made_each_time():
    form_kinds.clear()
    made = []
    for _ in range(2):
        _, a, b, c, v = given()
        first, other = form(a, b, c, v), dolfinx.fem.Function(a.function_space)

        def product(first=first, a=a, other=other):
            made.append(other)
            return ufl.derivative(first, a, other)

        compat.compile_derived(first, "product", a, product)
    assert len(made) == 2


def _options():
    return compat._plain(compat.jit_options())


def test_what_is_kept_holds_no_mesh():
    mesh, a, b, c, v = given()
    compat.compile_form(form(a, b, c, v))
    gone = weakref.ref(mesh)
    del mesh, a, b, c, v
    gc.collect()
    assert gone() is None


def test_the_number_of_constants_before_does_not_matter():
    """UFL sorts constants by what is printed of them, where 10 comes before 9."""
    found = set()
    for count in range(12):
        mesh, a, b, c, v = given()
        other = dolfinx.fem.Constant(mesh, 1.0)
        found.add(form(a, other * b, c, v).signature())
        for _ in range(count % 3):
            dolfinx.fem.Constant(mesh, 1.0)
    assert len(found) == 1


def bender(volts=8e3, length=20e-3):
    """The bender of the page of short scripts, on a mesh of its own."""
    layers = [Layer("passive", 0.5e-3), Layer("active", 0.5e-3)]
    strip = BoxStack(length, None, layers, divisions=20, grading=4, ends="start")
    rubber = dea.NeoHookean(80e3)
    scene = dea.Scene(
        dea.device(strip, MPI.COMM_SELF),
        {"active": dea.Material(rubber, dea.IdealDielectric(2.8)), "passive": dea.Material(rubber)},
        [dea.Electrode("top", volts), dea.Ground("interface_1")], [dea.Clamp("x_min")],
        kinematics=dea.PlaneStrain(5e-3),
    )  # fmt: skip
    tip = {"tip": dea.MeanDisplacement("x_max", "y")}
    return dea.solve(scene, dea.Ramp(steps=4), tip, quiet=True)


def test_a_loop_that_meshes_anew():
    """It gives what it gives when nothing is kept; other lengths differ."""
    reuse.clear()
    alone = float(bender()["tip_m"])
    found = [float(bender()["tip_m"]) for _ in range(3)]
    assert found == pytest.approx([alone] * 3, rel=1e-10)
    longer = float(bender(length=21e-3)["tip_m"])
    reuse.clear()
    assert longer == pytest.approx(float(bender(length=21e-3)["tip_m"]), rel=1e-10)
    assert abs(longer / alone - 1) > 0.05


@on_demand
def test_a_loop_over_a_small_bender():
    """100 solves of 561 unknowns in 4 steps: the milliseconds of CPU time are printed."""
    os.environ.pop("DEA_FENICSX_CFLAGS", None)
    bender()
    spent = []
    for _ in range(100):
        start = time.process_time()
        tip = float(bender()["tip_m"])
        spent.append(1e3 * (time.process_time() - start))
    print(f"{np.mean(spent):.1f} ms a solve, {np.median(spent):.1f} ms the median")
    assert tip == pytest.approx(-6.0812440965e-3, rel=1e-8)
    assert np.median(spent) < 100
