"""The flow of a viscous branch at one point: strain, stress, moduli; bad constants of branches."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import block

import dea_fenicsx as dea
from dea_fenicsx.exact import Film, pull_in_map
from dea_fenicsx.materials import RateData, rate_stress
from dea_fenicsx.model.local_flow import flowed
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.model.spring_frames import MANDEL_WEIGHTS, matrices, six_of
from dea_fenicsx.model.viscous_history import Rule, determinant, inverse, unimodular
from dea_fenicsx.solvers.tangent import Tangent
from dea_fenicsx.support.errors import InputError

pytestmark = pytest.mark.usefixtures("quick_compile")

MU = 2e4
SPRINGS = {
    "neo-Hookean": dea.NeoHookean(MU),
    "Gent": dea.Gent(MU, 30.0),
    "Ogden": dea.Ogden((1e4, -3e3), (2.5, -2.0)),
    "Mooney-Rivlin": dea.MooneyRivlin(7e3, 3e3),
    "Yeoh": dea.Yeoh(1e4, -100.0, 3.0),
    "Arruda-Boyce": dea.ArrudaBoyce(MU, 3.5, form="pade"),
}
LAW = dea.KumarLopezPamies(3e4, 1e3, K1=1e4, K2=1e-7, beta1=1.5, beta2=0.8)
VHB = dea.KumarLopezPamies(7014e3, 100.0, K1=3507e3, K2=1e-6, beta1=1.852, beta2=0.26)
BRANCHES = {name: dea.ViscousBranch(spring, 1.0) for name, spring in SPRINGS.items()} | {
    f"{name}, law": dea.ViscousBranch(spring, flow=LAW) for name, spring in SPRINGS.items()
}
LENGTHS = (0.0, 0.1, 3.0, 1e6, 1e30)


def tensors(count, spread, seed):
    """Positive tensors of determinant 1, shape (count, 6)."""
    F = np.eye(3) + spread * np.random.default_rng(seed).standard_normal((count, 3, 3))
    F /= np.cbrt(np.abs(np.linalg.det(F)))[:, None, None]
    return six_of(np.swapaxes(F, 1, 2) @ F)


@pytest.mark.parametrize("span", LENGTHS)
def test_a_neo_hookean_spring_has_the_closed_form(span):
    C, H = tensors(50, 0.3, 1), tensors(50, 0.3, 2)
    found = flowed(BRANCHES["neo-Hookean"], span, C, H)
    due = unimodular(span * C + H)
    assert found.strain == pytest.approx(due, abs=1e-12)
    assert found.stress == pytest.approx(MU * inverse(due), abs=1e-11 * MU)


@pytest.mark.parametrize("name", BRANCHES)
def test_the_flow_obeys_its_equation(name):
    """dev(H C_v^-1) + h/eta dev S = 0 at determinant 1, with eta of the end of the step."""
    branch = BRANCHES[name]
    C, H = tensors(60, 0.25, 3), tensors(60, 0.2, 4)
    for span in LENGTHS:
        found = flowed(branch, span, C, H)
        assert determinant(found.strain) == pytest.approx(1.0, abs=1e-13)
        assert np.all(found.power >= 0)
        v = matrices(found.strain)
        stress = matrices(found.stress) @ matrices(C)  # similar to S, so its deviator's size is too
        deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] * np.eye(3) / 3
        J2 = np.maximum(np.einsum("nij,nji->n", deviator, deviator) / 2, 0)
        rate = branch.rate(np.trace(v, axis1=1, axis2=2), J2)[0]
        assert found.power == pytest.approx(rate * J2 / branch.mu, rel=1e-6, abs=1e-9 * MU)
        flow = np.linalg.solve(np.swapaxes(v, 1, 2), matrices(H))  # C_v^-1 H
        flow = flow - np.trace(flow, axis1=1, axis2=2)[:, None, None] * np.eye(3) / 3
        total = flow + (span * rate / branch.mu)[:, None, None] * deviator
        assert np.abs(total).max() < 1e-10 * (1 + span)


@pytest.mark.parametrize("name", BRANCHES)
def test_moduli_are_the_derivative_of_the_stress(name):
    branch = BRANCHES[name]
    C, H = tensors(20, 0.2, 5), tensors(20, 0.1, 6)
    C[0], H[0] = H[1], H[1]  # no elastic strain at all, and two equal stretches
    C[2], H[2] = (2.0, 2.0, 0.25, 0, 0, 0), (1.0, 1.0, 1.0, 0, 0, 0)
    for span in LENGTHS:
        moduli = flowed(branch, span, C, H).moduli
        small, found = 1e-6, np.empty((len(C), 6, 6))
        for j in range(6):
            move = np.zeros(6)
            move[j] = small / MANDEL_WEIGHTS[j]
            up, down = (flowed(branch, span, C + s * move, H).stress for s in (1, -1))
            found[:, :, j] = (up - down) * MANDEL_WEIGHTS / small
        assert found == pytest.approx(moduli, abs=3e-7 * np.abs(moduli).max() + 1e-4 * MU)
        if branch.is_variational:
            assert moduli == pytest.approx(np.swapaxes(moduli, 1, 2), abs=1e-12 * MU)


def test_extreme_steps_end_at_positive_strains():
    """Stretches of 20, spans of any length, spring beyond its lock-up before it flows."""
    C, H = tensors(100, 3.0, 7), tensors(100, 0.5, 8)
    for spring in (SPRINGS["Gent"], SPRINGS["Arruda-Boyce"]):
        for branch in (dea.ViscousBranch(spring, 1.0), dea.ViscousBranch(spring, flow=VHB)):
            for span in (1e-6, 1e-2, 1.0, 1e3, 1e12):
                found = flowed(branch, span, C, H)
                assert np.all(np.isfinite(found.strain)) and np.all(np.isfinite(found.energy))
                assert np.all(found.margin > 0)
                assert determinant(found.strain) == pytest.approx(1.0, abs=1e-8)


def test_what_has_no_end_is_told_by_nan():
    C = np.array([
        [1, 1, 1, 0, 0, 0], [np.nan] * 6, [1, 1, -1, 0, 0, 0], [400, 0.05, 0.05, 0, 0, 0],
    ])  # fmt: skip
    H = np.tile([1.0, 1, 1, 0, 0, 0], (4, 1))
    found = flowed(BRANCHES["Gent"], 0.0, C, H)
    assert np.isfinite(found.stress).all(axis=1).tolist() == [True, False, False, False]
    assert found.stress[0] == pytest.approx(MU * np.array([1, 1, 1, 0, 0, 0]))


def test_the_viscosity_of_kumar_and_lopez_pamies():
    eta, by_strain, by_stress = LAW.viscosity(np.array([3.0, 4.0, 4.0]), np.array([0, 2e7, 1e30]))
    assert eta[0] == LAW.eta_0
    assert eta[1] == pytest.approx(
        1e3 + (2.9e4 + 1e4 * (4**1.5 - 3**1.5)) / (1 + (1e-7 * 2e7) ** 0.8)
    )
    assert eta[2] == pytest.approx(LAW.eta_inf)
    up, down = (LAW.viscosity(np.array(4.0 + d), np.array(2e7))[0] for d in (1e-5, -1e-5))
    assert by_strain[1] == pytest.approx((up - down) / 2e-5, rel=1e-7)
    up, down = (LAW.viscosity(np.array(4.0), np.array(2e7 + d))[0] for d in (1e2, -1e2))
    assert by_stress[1] == pytest.approx((up - down) / 2e2, rel=1e-7)
    assert by_stress[0] == 0


# ---------------------------------------------------------------- in a body


def rough_problem(branch, kappa=None, **more):
    """A problem within a step of time, away from equilibrium."""
    material = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(3.0), kappa, viscous=[branch])
    scene = dea.Scene(
        block((2, 1)), {"film": material},
        [dea.Electrode("top", 2000.0), dea.Ground("bottom")],
        supports=[dea.Clamp("x_min")], kinematics=dea.PlaneStrain(), **more,
    )  # fmt: skip
    problem, rng = Problem(scene), np.random.default_rng(7)
    problem.commit(problem.imposed(problem.under(problem.state, dict.fromkeys(scene.ramps, 1.0))))
    problem.commit(problem.moved(problem.state, 0.05 * rng.standard_normal(len(problem.free))))
    history = problem.history.ahead(0.7, Rule.EULER)
    state = problem.state
    problem.commit(type(state)(state.values, state.factors, 0.7, history={"viscous": history}))
    return problem, rng


@pytest.mark.parametrize("name", ["Gent", "Gent, law"])
@pytest.mark.parametrize("kappa", [None, 5e5])
def test_the_tangent_is_the_derivative_of_the_residual(name, kappa):
    problem, rng = rough_problem(BRANCHES[name], kappa)
    tangent, start = Tangent(problem), problem.state
    assert tangent.is_symmetric == (name == "Gent")
    x, y = rng.standard_normal((2, len(problem.free)))
    product = tangent.times(x)
    small = 1e-6
    ends = []
    for sign in (1, -1):
        with problem.at(problem.moved(start, sign * small * x)):
            ends.append(problem.restrict(problem.residual()))
    assert (ends[0] - ends[1]) / (2 * small) == pytest.approx(
        product, abs=1e-6 * np.abs(product).max()
    )
    assert y @ product == pytest.approx(x @ tangent.times_transposed(y), rel=1e-10)
    matrix = tangent.matrix()
    assert matrix.isSymmetric(1e-11 * matrix.norm()) == (name == "Gent")


def test_a_pre_stretch_moves_the_branches_too():
    """The derivative by a pre-stretch's factor is that of the residual."""
    problem, _ = rough_problem(
        BRANCHES["Gent, law"], prescribed=[dea.PreStretch("film", x=1.2, y=0.9)]
    )
    found, start, small = Tangent(problem).by_load("prestretch"), problem.state, 1e-6
    ends = []
    for sign in (1, -1):
        factors = dict(start.factors) | {"prestretch": 1.0 + sign * small}
        with problem.at(start.with_factors(factors)):
            ends.append(problem.restrict(problem.residual()))
    assert (ends[0] - ends[1]) / (2 * small) == pytest.approx(
        found, abs=1e-6 * np.abs(found).max()
    )


def test_constants_by_name():
    problem, _ = rough_problem(BRANCHES["Gent, law"])
    constants = problem.parameters
    assert constants["film.viscous[0].spring.Jm"] == 30.0
    before = problem.residual()
    constants["film.viscous[0].flow.eta_0"] = 6e4
    constants["film.viscous[0].spring.mu"] = 1e4
    problem.commit(problem.state)
    law = dea.KumarLopezPamies(6e4, 1e3, K1=1e4, K2=1e-7, beta1=1.5, beta2=0.8)
    other, _ = rough_problem(dea.ViscousBranch(dea.Gent(1e4, 30.0), flow=law))
    assert problem.residual() == pytest.approx(other.residual(), rel=1e-9, abs=1e-12)
    assert np.abs(problem.residual() - before).max() > 1e-3 * np.abs(before).max()
    with pytest.raises(InputError, match="eta_inf is"):
        constants["film.viscous[0].flow.eta_0"] = 1.0
    assert "film.viscous[0].tau" not in list(constants)
    simple, _ = rough_problem(BRANCHES["Gent"])
    assert simple.parameters["film.viscous[0].tau"] == 1.0


# ---------------------------------------------------------------- bad input

Branch, Law = dea.ViscousBranch, dea.KumarLopezPamies


@pytest.mark.parametrize(("make", "words"), [
    (lambda: Branch(dea.Gent(-1.0, 9.0), 1.0), "spring of a viscous branch, Gent: mu is -1.0"),
    (lambda: Branch(dea.MooneyRivlin(1e4, -2e4), 1.0), "spring of a viscous branch, MooneyRivlin"),
    (lambda: Branch(5.0, 1.0), "spring is 5.0, but must be an Elastic"),
    (lambda: Branch(dea.NeoHookean(1e4)), "neither tau nor flow"),
    (lambda: Branch(dea.NeoHookean(1e4), 1.0, LAW), "both tau and flow"),
    (lambda: Branch(dea.NeoHookean(1e4), -1.0), "tau of a viscous branch is -1.0"),
    (lambda: Branch(dea.NeoHookean(1e4), math.nan), "tau of a viscous branch is nan"),
    (lambda: Branch(dea.NeoHookean(1e4), flow=3.0), "flow is 3.0"),
    (lambda: Branch(dea.NeoHookean(1e4), flow=Law(-1.0, 0.0)), "eta_0 is -1.0"),
    (lambda: Branch(dea.NeoHookean(1e4), flow=Law(1.0, 2.0)), "at most eta_0"),
    (lambda: Branch(dea.NeoHookean(1e4), flow=Law(1.0, 0.5, K1=-1.0)), "K1 is -1.0"),
    (lambda: Branch(dea.NeoHookean(1e4), flow=Law(1.0, 0.5, beta2=math.inf)), "beta2 is inf"),
    (lambda: dea.NeoHookean(1e4), "viscous is"),
])  # fmt: skip
def test_bad_branches_get_one_sentence(make, words):
    material = dea.Material(dea.NeoHookean(1e4), dea.IdealDielectric(3.0), viscous=[make()])
    with pytest.raises(InputError, match=words):
        dea.Scene(
            block((1, 1)), {"film": material}, supports=[dea.Clamp("bottom")],
            kinematics=dea.PlaneStrain(),
        )  # fmt: skip


def test_closed_forms_say_that_they_are_for_maxwell_branches():
    material = dea.Material(
        dea.NeoHookean(1e4), dea.IdealDielectric(3.0), viscous=[BRANCHES["Gent"]]
    )
    with pytest.raises(InputError, match="map of pull-in takes Maxwell branches alone"):
        pull_in_map(Film(material, 1e-3), 1e6, seconds=1.0)
    data = RateData("uniaxial", [0.0, 1.0], [1.0, 1.2], [0.0, 1.0])
    with pytest.raises(InputError, match="rate_stress takes Maxwell branches alone"):
        rate_stress(material, data)
