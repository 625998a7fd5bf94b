"""Second derivatives of observables, against closed forms and solved neighbours."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from rank_scenes import ring
from test_gradients import (
    CASES,
    EPS_R,
    MU,
    STRETCH,
    TIGHT,
    L,
    T,
    neighbour,
    pulled_block,
)

import dea_fenicsx as dea
from dea_fenicsx.gradients.variables import LoadVariable, variables

pytestmark = pytest.mark.usefixtures("quick_compile")


@pytest.fixture(scope="module")
def pulled():
    return pulled_block()


def test_second_derivatives_of_a_force(pulled):
    """F = mu (lam - 1/lam^2) L T with lam = 1 + 0.5 f: by f and mu, by f and T, by f twice."""
    to = ["film.elastic.mu", "stretch", "thickness:film:z", "thickness:film:x"]
    found = pulled.hessian_product("force", to, {"stretch": 1.0})
    slope = MU * (1 + 2 * STRETCH**-3) * L * T * (STRETCH - 1)
    exact = [slope / MU, -6 * MU * STRETCH**-4 * L * T * (STRETCH - 1) ** 2, slope / T, 0.0]
    assert found.value == pytest.approx(slope, rel=1e-8)
    assert list(found.values()) == pytest.approx(exact, rel=1e-8, abs=1e-8 * slope / L)


def test_second_derivatives_of_a_capacitance(pulled):
    """C = eps lam L^2/T: along a direction with several parts."""
    to = ["film.electric.eps_r", "thickness:film:z", "stretch"]
    found = pulled.hessian_product("c", to, {"film.electric.eps_r": 2.0, "thickness:film:z": T})
    c = float(pulled["c_F"])
    per_factor = (STRETCH - 1) / STRETCH
    exact = [-c / EPS_R, (-2 / EPS_R + 2) * c / T, (2 / EPS_R - 1) * c * per_factor]
    assert found.value == pytest.approx((2 / EPS_R - 1) * c, rel=1e-7)
    assert list(found.values()) == pytest.approx(exact, rel=1e-7)


def test_a_displacement_that_is_given_by_load_and_shape(pulled):
    """It is (lam - 1) times the length, so that its mixed derivative is lam - 1."""
    wider = dea.ShapeChange("length", lambda X: np.array([[x / L, 0, 0] for x in X[:, 0]]))
    found = pulled.hessian_product("tip", ["stretch", wider], {"length": 1.0})
    exact = [STRETCH - 1, 0.0]
    assert list(found.values()) == pytest.approx(exact, rel=1e-8, abs=1e-8 / L)


@pytest.mark.parametrize("case", ["plane", "round", "helical"])
def test_the_taylor_series_is_right_to_the_second_term(case):
    """What is left is of third order, and the matrix of second derivatives is symmetric."""
    make, name, to = CASES[case]
    scene, path, record, _ = make(MPI.COMM_SELF)
    run = dea.solve(scene, path, record, quiet=True, options=TIGHT)
    found = run.sensitivity(name, to)
    ones = variables(run._problem, to)
    sizes = {
        o.name: o.unit if isinstance(o, LoadVariable) else getattr(o, "value", L) for o in ones
    }
    rows = [run.hessian_product(name, to, {q: sizes[q]}) for q in to]
    H = np.array([[row[p] * sizes[p] for p in to] for row in rows])
    assert np.allclose(H, H.T, rtol=0, atol=1e-8 * np.abs(H).max())
    for k, one in enumerate(ones):
        first, left = found[one.name] * sizes[one.name], []
        for h in (4e-2, 2e-2):
            there = neighbour(run, path, name, record[name], one, h * sizes[one.name])
            left.append(there - found.value - h * first - h * h / 2 * H[k, k])
        rounding = 1e-10 * abs(found.value)
        assert abs(left[1]) < rounding or left[0] / left[1] == pytest.approx(8, rel=0.05)


def found_on(comm):
    scene, path, record, _ = ring(comm)
    run = dea.solve(scene, path, record, quiet=True, options=TIGHT)
    to = ["film.elastic.mu", "load", "stretch", "thickness:film:r"]
    along = {"film.elastic.mu": 5e4, "stretch": 1.0, "thickness:film:r": 1e-3}
    found = run.hessian_product("out", to, along)
    return [found.value, *found.values()]


@pytest.mark.parametrize("name, to, along, words", [
    ("force", ["film.elastic.mu"], {"voltag": 1.0}, "did you mean 'voltage'"),
    ("force", ["film.elastic.mu"], {}, "must map names of variables"),
    ("force", ["film.elastic.mu"], {"voltage": 0.0}, "is no direction"),
    ("force", ["film.elastic.mu"], {"voltage": "1"}, "The part of 'voltage'"),
    ("at", ["film.elastic.mu"], {"voltage": 1.0}, "AtPoint has no second derivative"),
    ("most", ["film.elastic.mu"], {"voltage": 1.0}, "jumps from one node to another"),
    ("forse", ["film.elastic.mu"], {"voltage": 1.0}, "did you mean 'force'"),
])  # fmt: skip
def test_what_has_no_second_derivative_is_told(pulled, name, to, along, words):
    with pytest.raises(dea.InputError, match=words):
        pulled.hessian_product(name, to, along)
