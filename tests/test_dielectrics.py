"""Dielectrics that change with stretch and field: elements, exact states and closed forms agree."""

from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
from conftest import block, on_demand
from membrane_scenes import STRETCHES as FLAT
from membrane_scenes import film as flat_film
from scipy.optimize import brentq
from test_homogeneous_all_models import device

import dea_fenicsx as dea
from dea_fenicsx import exact, materials
from dea_fenicsx.design.helical import HelicalModel
from dea_fenicsx.materials.base import EPSILON_0
from dea_fenicsx.materials.dielectric_series import FilmPoint
from dea_fenicsx.materials.electric import Dielectric
from dea_fenicsx.materials.polarisation import Mixing
from dea_fenicsx.solvers.tangent import Tangent

MU, H, EPS = 5e4, 1e-3, 4.7
STRAINED = {
    "linear": materials.LinearPermittivity(EPS, -0.04, 2.5),
    "polynomial": materials.PolynomialPermittivity(EPS, (-0.06, 4e-3), 2.5),
    "table": materials.TabulatedPermittivity((1.0, 1.1, 1.3, 2.0), (4.7, 4.6, 4.3, 3.9)),
    "electrostriction": materials.Electrostriction(EPS, -1.5, 0.7),
}
SATURATING = {
    "ln cosh": materials.SaturatingDielectric(EPS, 1e-3),
    "Langevin": materials.LangevinDielectric(EPS, 8e-4, 1.5),
}
LAWS = STRAINED | SATURATING


def film(law: Dielectric, elastic: Any = None, **sides: Any) -> exact.Film:
    return exact.Film(dea.Material(elastic or dea.NeoHookean(MU), law), H, **sides)


def voltage(l: Any, eps: Any, slope: Any, mu: float = MU) -> Any:
    """Of a free neo-Hookean film at equal stretches, from its closed form; slope is d eps/dl."""
    stress = mu * (l**2 - l**-4)
    return H * np.sqrt(stress / (EPSILON_0 * (eps * l**4 + slope * l**5 / 4)))


def test_pull_in_moves_as_the_closed_form_says():
    law = materials.LinearPermittivity(EPS, -0.04, 2.5)

    def of(l: Any) -> Any:
        eps = EPS * (1 - 0.04 * (2 * l**2 + l**-4 - 3))
        return voltage(l, eps, -EPS * 0.04 * (4 * l - 4 * l**-5))

    peak = brentq(lambda l: (of(l + 1e-5) - of(l - 1e-5)) / 2e-5, 1.1, 1.6, xtol=1e-12)
    found = exact.trace(film(law)).event("pull-in")
    ideal = exact.trace(film(dea.IdealDielectric(EPS))).event("pull-in")
    assert found.voltage == pytest.approx(of(peak), rel=1e-10)
    assert found.stretches[0] == pytest.approx(peak, abs=1e-6)
    assert found.voltage > 1.02 * ideal.voltage and found.stretches[0] > ideal.stretches[0] + 0.02


def test_a_film_whose_permittivity_falls_fast_enough_has_no_pull_in():
    stiffening = dea.Gent(MU, 10.0)
    falling = materials.LinearPermittivity(12.0, -0.1, 2.0)
    assert falling.faults() == []
    ideal = exact.trace(film(dea.IdealDielectric(12.0), stiffening))
    branch = exact.trace(film(falling, stiffening), max_stretch=2.0)
    assert ideal.event("pull-in") is not None
    assert branch.event("pull-in") is None and branch.stretches[0, -1] > 1.9
    assert np.all(np.diff(branch.voltage) > 0)
    assert np.all(branch.stability()[1:] > 0)


def test_electrostriction_scales_the_stress_by_eps_minus_half_a1():
    """Landau and Lifshitz: an incompressible film acts as one of eps_r - a1/2."""
    branch = exact.trace(film(materials.Electrostriction(EPS, -1.5, 9.0)))
    same = exact.trace(film(dea.IdealDielectric(EPS + 0.75)))
    assert np.isclose(branch.event("pull-in").voltage, same.event("pull-in").voltage, rtol=1e-12)
    e = np.log(np.array([1.3, 1.3, 1.3**-2]))
    eps = branch.film.electric.strain_part(e)[0] / EPSILON_0
    assert eps == pytest.approx(EPS - 1.5 * (1.3**-4 - 1) / 2, rel=1e-14)


def test_saturation_by_hand():
    """lam s = mu (lam^2 - lam^-4) - D E with D = D_s tanh(eps E/D_s), and Langevin's D."""
    tanh = exact.trace(film(SATURATING["ln cosh"]))
    langevin = exact.trace(film(SATURATING["Langevin"]))
    for branch in (tanh, langevin):
        for l in (1.01, 1.2, 1.8):
            state = branch.at_stretch(l)[0]
            E = state.field
            x = 3 * EPSILON_0 * (EPS - 1.5) * E / 8e-4
            by_hand = {
                id(tanh): 1e-3 * np.tanh(EPS * EPSILON_0 * E / 1e-3),
                id(langevin): 1.5 * EPSILON_0 * E + 8e-4 * (1 / np.tanh(x) - 1 / x),
            }[id(branch)]
            assert state.charge / l**2 == pytest.approx(by_hand, rel=1e-9)
            assert state.maxwell == pytest.approx(MU * (l**2 - l**-4), rel=1e-10)
            assert state.voltage == pytest.approx(E * H / l**2, rel=1e-12)


@pytest.mark.parametrize("name", LAWS)
def test_controls_and_stability_are_derivatives(name):
    """The tangent at a kept voltage or charge is that of the equations, by differences."""
    one = film(LAWS[name], first=exact.Dead(2e4), second=exact.Dead(1e4))
    e, M = np.log(np.array([1.3, 1.1, 1 / 1.43])), 3e4
    B = np.array([[1.0, 0], [0, 1], [-1, -1]])

    def force(e: np.ndarray, M: Any) -> np.ndarray:
        return one.elastic(e)[1] - one.applied(e)[0] - M * one.push(e)

    for control in ("voltage", "charge"):
        kept = one.load(control, e, M)

        def at(y: np.ndarray, kept: float = kept, control: str = control) -> np.ndarray:
            there = e + B @ y
            known = brentq(lambda M: one.load(control, there, M) - kept, 1e3, 1e6, xtol=1e-8)
            return B.T @ force(there, known)

        h = 1e-5
        slope = np.array([(at(d) - at(-d)) / (2 * h) for d in h * np.eye(2)]).T
        tangent = B.T @ one.tangent(e, M, control) @ B
        assert np.abs(tangent - slope).max() < 1e-6 * np.abs(slope).max()
        assert np.abs(tangent - tangent.T).max() < 1e-9 * np.abs(tangent).max()


@pytest.mark.parametrize("name", LAWS)
def test_maxwell_relation(name):
    """d D/d e at a kept field is the derivative of the field's stress by the field."""
    law = LAWS[name].in_si()
    e = np.log(np.array([1.3, 1.1, 1 / 1.43]))

    def J_u(e: np.ndarray, nominal: float) -> Any:
        return np.exp(e.sum()) * law.coenergy(FilmPoint(e, nominal * np.exp(-e[2]))).c[0]

    def D(e: np.ndarray, E: float) -> float:
        return (J_u(e, E * 1.0001) - J_u(e, E / 1.0001)) / (E * (1.0001 - 1 / 1.0001))

    def stress(e: np.ndarray, E: float) -> np.ndarray:
        """By the field's own theory: M J v, with M = D E and what a change of volume stores."""
        one = film(LAWS[name])
        u, M = J_u(e, E), one.electric.maxwell(e, E * np.exp(-e[2]))
        push = one.push(e) if law.is_linear else np.array([0.0, 0.0, -1.0])
        return M * push + (0.0 if law.is_linear else u)

    E, h = 3e7, 1e-4
    by_strain = [(D(e + d, E) - D(e - d, E)) / (2 * h) for d in h * np.eye(3)]
    by_field = (stress(e, E * (1 + h)) - stress(e, E * (1 - h))) / (2 * h * E)
    assert np.allclose(by_strain, by_field, rtol=2e-6, atol=2e-6 * np.abs(by_field).max())


def test_failure_map_agrees_with_the_branch():
    """On the map, instability of equal sides is where the branch pulls in or parts."""
    material = dea.Material(dea.NeoHookean(MU), replace(STRAINED["linear"], breakdown=40e6))
    branch = exact.trace(exact.Film(material, H))
    first = min((e for e in branch.events() if e.kind in ("pull-in", "bifurcation")),
                key=lambda e: e.state.place).state  # fmt: skip
    lam = float(first.stretches[0])
    found = exact.failure_map(material, H, np.array([lam, 1.5]))
    assert found.voltage("instability")[0] == pytest.approx(first.voltage, rel=1e-6)
    assert found.voltage("loss of tension")[0] == pytest.approx(first.voltage, rel=1e-6)
    eps = exact.maxwell_pressure(material, H, lam, lam, voltage=1.0) * (H / lam**2) ** 2 / 1.0
    assert found.maxwell["breakdown"][0] == pytest.approx(eps * 40e6**2, rel=1e-12)


def solved(law: Any, kinematics: Any, cell: str, pull: float, volts: float) -> tuple[Any, Any]:
    """A film under dead loads and voltage in elements; the run, and the exact state."""
    three, axes = isinstance(kinematics, dea.ThreeD), kinematics.axes
    last = "z" if three else "y"
    supports = [dea.Fix("x_min", axes[0]), dea.Fix(f"{last}_min", axes[-1])]
    loads = [dea.DeadLoad("x_max", (pull, 0.0, 0.0)[: len(axes)])]
    if three:
        supports.append(dea.Fix("y_min", "y"))
        loads.append(dea.DeadLoad("y_max", (0.0, pull, 0.0)))
    scene = dea.Scene(
        device(cell), {"film": dea.Material(dea.NeoHookean(MU), law)},
        electrodes=[dea.Electrode(f"{last}_max", volts), dea.Ground(f"{last}_min")],
        supports=supports, loads=loads, kinematics=kinematics,
    )  # fmt: skip
    seen = {"z": dea.MeanStretch((f"{last}_min", f"{last}_max"), axes[-1]),
            "Q": dea.Charge(f"{last}_max"), "C": dea.Capacitance(f"{last}_max"),
            "W": dea.Energy("electric")}  # fmt: skip
    run = dea.solve(
        scene, [dea.Ramp("load", steps=2), dea.Ramp("voltage", steps=4)], seen, quiet=True,
        options=dea.NewtonOptions(tolerance=1e-11),
    )  # fmt: skip
    second = exact.Held(1.0) if isinstance(kinematics, dea.PlaneStrain) else exact.Dead(pull)
    one = film(law, first=exact.Dead(pull), second=second)
    return run, next(s for s, ok in exact.trace(one).states_at(volts) if ok)


def agrees(law: Any, kinematics: Any, cell: str, pull: float = 1e4, volts: float = 15e3) -> Any:
    run, state = solved(law, kinematics, cell, pull, volts)
    area = np.pi * 1e-6 if isinstance(kinematics, dea.Axisymmetric) else 1e-6
    assert abs(state.stretches[0] - 1) > 0.02
    assert float(run["z"]) == pytest.approx(state.stretches[2], abs=1e-8)
    assert float(run["Q_C"]) == pytest.approx(state.charge * area, rel=1e-8)
    if law.is_linear:
        assert float(run["C_F"]) * volts == pytest.approx(state.charge * area, rel=1e-8)
        assert float(run["W_J"]) == pytest.approx(state.charge * area * volts / 2, rel=1e-8)
    return run, state


def of_order_two(problem: Any) -> None:
    """The tangent is the derivative of the residual, by a Taylor remainder."""
    state = problem.state
    d = np.random.default_rng(7).uniform(-0.02, 0.02, len(problem.free))
    tangent = Tangent(problem).matrix()
    x, y = tangent.createVecs()
    x.array[:] = d
    tangent.mult(x, y)
    start, linear, left = problem.residual()[problem.free], y.array_r.copy(), []
    for h in (2**-6, 2**-7, 2**-8):  # so small since hoop strains near the axis are large
        problem.commit(state)
        problem.commit(problem.moved(problem.state, h * d))
        left.append(np.linalg.norm(problem.residual()[problem.free] - start - h * linear))
    problem.commit(state)
    assert np.log2(left[-2] / left[-1]) == pytest.approx(2, abs=0.1)


PLANE = (dea.PlaneStrain(depth=1e-3), "quadrilateral")


@pytest.mark.parametrize("name", ["table", "electrostriction", "Langevin"])
def test_elements_are_the_exact_state(name, quick_compile):
    run, _ = agrees(LAWS[name], *PLANE)
    of_order_two(run.problem)


@on_demand
@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize(
    "kinematics, cell",
    [(dea.ThreeD(), "hexahedron"), (dea.ThreeD(), "tetrahedron"), PLANE,
     (dea.Axisymmetric(), "triangle")],
)  # fmt: skip
def test_all_kinematics(name, kinematics, cell, quick_compile):
    run, _ = agrees(LAWS[name], kinematics, cell)
    of_order_two(run.problem)


@on_demand
@pytest.mark.parametrize("name", LAWS)
def test_membrane(name):
    law = dea.Material(dea.NeoHookean(MU), LAWS[name])
    plate = [dea.Electrode("film", 12e3)]
    scene = flat_film(materials={"film": law}, electrodes=plate)
    run = dea.solve(scene, dea.Ramp(steps=4), FLAT, quiet=True)
    branch = exact.trace(exact.Film(law, H))
    state = next(s for s, ok in branch.states_at(12e3) if ok)
    assert float(run["x"]) == pytest.approx(state.stretches[0], abs=1e-8)
    assert float(run["Q_C"]) == pytest.approx(state.charge * 0.1 * 0.05, rel=1e-8)


@on_demand
@pytest.mark.parametrize("name", STRAINED)
def test_compressible_film(name, quick_compile):
    """With a bulk modulus of 10 mu the strain of the law is the volume-preserving part."""
    monitored = dea.Material(dea.NeoHookean(MU), STRAINED[name], bulk_modulus=10 * MU)
    sides = [dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")]
    plates = [dea.Electrode("top", 15e3), dea.Ground("bottom")]
    scene = dea.Scene(block(), {"film": monitored}, plates, sides)
    seen = {"x": dea.MeanStretch(("x_min", "x_max"), "x"), "Q": dea.Charge("top")}
    run = dea.solve(scene, dea.Ramp(steps=4), seen, quiet=True)
    states = exact.trace(exact.Film(monitored, H)).states_at(15e3)
    state = next(s for s, ok in states if ok)
    assert abs(np.prod(state.stretches) - 1) > 1e-3
    assert float(run["x"]) == pytest.approx(state.stretches[0], abs=1e-8)
    assert float(run["Q_C"]) == pytest.approx(state.charge * 1e-6, rel=1e-8)


def test_mixing_rules_lie_between_their_bounds():
    a, b, f = 3.0, 100.0, 0.2
    of = {r: materials.mixed_permittivity(a, b, f, r) for r in get_args(Mixing)}
    order = ["series", "maxwell-garnett", "bruggeman", "hashin-shtrikman upper", "parallel"]
    assert [of[r] for r in order] == sorted(of[r] for r in order)
    eps = of["bruggeman"]
    assert (1 - f) * (a - eps) / (a + 2 * eps) + f * (b - eps) / (b + 2 * eps) == pytest.approx(
        0, abs=1e-14
    )
    assert all(
        np.isclose(materials.mixed_permittivity(a, b, end, r), value, rtol=1e-14)
        for r in of for end, value in ((0.0, a), (1.0, b))
    )  # fmt: skip
    law = materials.CompositeDielectric(a, b, f)
    same = dea.IdealDielectric(of["maxwell-garnett"])
    peaks = [exact.trace(film(d)).event("pull-in").voltage for d in (law, same)]
    assert peaks[0] == pytest.approx(peaks[1], rel=1e-14)


def test_weibull_by_area_thickness_and_time():
    """A hundred areas: the field falls by 100^(1/m), and chances multiply (weakest link)."""
    law = dea.WeibullBreakdown(60e6, 0.5, modulus=10.0)
    assert law.at(1.0) == pytest.approx(60e6, rel=1e-14)
    large = replace(law, area_ratio=100.0)
    assert large.at(1.0) == pytest.approx(60e6 * 100 ** -0.1, rel=1e-14)
    one, hundred = law.probability_at(50e6, 1.44), large.probability_at(50e6, 1.44)
    assert 1 - hundred == pytest.approx((1 - one) ** 100, rel=1e-12)
    thick = replace(law, thickness_ratio=4.0, thickness_exponent=0.5, time_ratio=16.0,
                    time_exponent=0.25, probability=0.01)  # fmt: skip
    assert thick.at(1.44) == pytest.approx(60e6 * 1.2 / 4 * (-np.log(0.99)) ** 0.1, rel=1e-13)
    assert thick.probability_at(thick.at(1.44), 1.44) == pytest.approx(0.01, rel=1e-12)
    worn = film(replace(STRAINED["linear"], breakdown=replace(large, field=30e6)))
    state = exact.trace(worn).event("breakdown")
    lam = state.stretches[0]
    assert state.field == pytest.approx(30e6 * 100 ** -0.1 * lam**0.5, rel=1e-9)


BAD = {
    "falls to": materials.LinearPermittivity(4.7, -0.1, 3.0),
    "squeezed flat": materials.Electrostriction(4.7, 9.0),
    "D_s is": materials.SaturatingDielectric(4.7, -1.0),
    "below eps_r": materials.LangevinDielectric(4.7, 1e-3, 5.0),
    "volume fraction": materials.CompositeDielectric(3.0, 100.0, 2.0),
    "mixing rule": materials.CompositeDielectric(3.0, 100.0, 0.2, "x"),
    "rise from 1": materials.TabulatedPermittivity((1.1, 2.0), (3.0, 3.0)),
    "from 2 to 50": materials.TabulatedPermittivity((1.0, 2.0), (3.0,)),
    "coefficients is": materials.PolynomialPermittivity(3.0, ()),
}


@pytest.mark.parametrize("words", BAD)
def test_bad_input(words):
    with pytest.raises(dea.InputError, match=words) as told:
        film(BAD[words])
    assert len(str(told.value)) <= 400


def test_what_knows_no_saturation_says_so():
    with pytest.raises(dea.InputError, match=r"trace exact\.Film"):
        exact.failure_map(dea.Material(dea.NeoHookean(MU), SATURATING["ln cosh"]), H, 1.2)
    with pytest.raises(dea.InputError, match="changes with the field"):
        HelicalModel(dea.Material(dea.NeoHookean(MU), SATURATING["ln cosh"]))


def test_the_helical_model_refuses_fibres():
    fibres = dea.StandardReinforcing(1e5, (1, 0, 0))
    rubber = dea.Material(dea.Reinforced(dea.NeoHookean(MU), fibres), dea.IdealDielectric(4.7))
    with pytest.raises(dea.InputError, match="isotropic"):
        HelicalModel(rubber)
