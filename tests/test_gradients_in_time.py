"""Derivatives at steps of marches: against a recursion in closed form, and solved neighbours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import block, on_demand
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.results.kept_states import KeptStates

pytestmark = pytest.mark.usefixtures("quick_compile")
TIGHT = dea.NewtonOptions(tolerance=1e-12)
MU, MU_V, TAU, STRETCH, L = 15e3, 26e3, 0.6, 1.5, 1e-3


def solve(scene, path, record):
    return dea.solve(scene, path, record, quiet=True, options=TIGHT, stability="never")


# --------------------------------------------------------------------------------- closed forms


def held_force(mu, mu_v, tau, steps, seconds):
    """Force of a cube of edge L held at a stretch, by the backward Euler steps of its branch.

    C = (lam^2, 1/lam, 1/lam) and C_v = (c, c^-1/2, c^-1/2), so that a step is one of c.
    """
    a, b, c, r = STRETCH**2, 1 / STRETCH, 1.0, seconds / steps / tau
    for _ in range(steps):
        first, other = r * a + c, r * b + c**-0.5
        c = (first / other) ** (2 / 3)
    spring = mu_v * (a / c - b * c**0.5)
    return L**2 * (mu * (a - b) + spring) / STRETCH


def test_force_of_a_relaxing_cube():
    rubber = dea.Material(dea.NeoHookean(MU), viscous=[dea.Maxwell(MU_V, TAU)])
    held = [dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")]
    pull = [dea.Stretch("x_max", "x", STRETCH)]
    scene = dea.Scene(block((1, 1, 1), L, L), {"film": rubber}, supports=held, prescribed=pull)
    pulled = dea.Ramp("stretch", steps=1, response="instantaneous")
    path = [pulled, dea.March(0.9, steps=3, order=1)]
    run = solve(scene, path, {"force": dea.Reaction("x_max", "x")})
    to = ["film.elastic.mu", "film.viscous[0].mu", "film.viscous[0].tau"]
    constants = (MU, MU_V, TAU)
    for steps, row in ((3, -1), (1, -3), (0, 1)):
        found = run.sensitivity("force", to, step=row)
        times = max(steps, 1), 0.3 * steps
        due = held_force(*constants, *times)
        assert found.value == pytest.approx(due, rel=1e-9)
        assert found.method == ("direct" if steps else "adjoint")  # at no time there is no past
        for k, name in enumerate(to):
            shifted = [c + 1e-30j * (i == k) for i, c in enumerate(constants)]
            exact = held_force(*shifted, *times).imag / 1e-30
            assert found[name] == pytest.approx(exact, rel=1e-8, abs=1e-8 * due / constants[k])


# ------------------------------------------------------------------------- differences of runs


def scene(comm, kilovolts=3.0, tau=TAU, mu=MU, time=1.0, height=1.0, **more):
    """A clamped square in plane strain with two branches; times are in units of `time`.

    It may be higher than wide.
    """
    rubber = dea.Material(
        dea.NeoHookean(mu), dea.IdealDielectric(3.0), density=1000.0,
        viscous=[dea.Maxwell(MU_V, tau * time), dea.Maxwell(10e3, 5.0 * time)],
    )  # fmt: skip
    electrodes = [dea.Electrode("top", 1e3 * kilovolts), dea.Ground("bottom")]
    device = dea.read_gmsh(BoxStack(L, None, [Layer("film", height * L)], 1), comm)
    return dea.Scene(
        device, {"film": rubber}, electrodes,
        [dea.Clamp("x_min"), dea.Fix("bottom", "y")], kinematics=dea.PlaneStrain(L), **more,
    )  # fmt: skip


RECORD = {"up": dea.MeanDisplacement("top", "y"), "q": dea.Charge("top")}


def march(time=1.0, **more):
    """A march whose drive does not begin at zero, so that a body in motion is not at rest."""
    drive = {"voltage": lambda t: 0.3 + 0.7 * np.sin(1.3 * t / time + 0.2) ** 2}
    return dea.March(1.5 * time, drive, **more)


MARCHES = {
    "BDF2 after SDIRK2": (1.0, {"steps": 5}),
    "BDF3 in adapted steps": (1.0, {"tolerance": 1e-3, "order": 3}),
    "motion": (2e-3, {"steps": 5, "inertia": dea.Inertia(drag=20.0)}),
}
CHANGED = {"film.viscous[0].tau": "tau", "voltage": "kilovolts", "film.elastic.mu": "mu",
           "thickness:film:y": "height"}  # fmt: skip
VALUES = {"tau": TAU, "kilovolts": 3.0, "mu": MU, "height": 1.0}
UNITS = {"kilovolts": 1e3, "height": L}


@pytest.mark.parametrize("case", MARCHES)
def test_differences_converge_to_the_derivative_in_time(case):
    """A central difference is off by a term in the square of the step; no step changes length."""
    time, how = MARCHES[case]
    run = solve(scene(MPI.COMM_SELF, time=time), march(time, **how), RECORD)
    found = {name: run.sensitivity(name, list(CHANGED)) for name in RECORD}
    columns = {"up": "up_m", "q": "q_C"}
    for variable, key in CHANGED.items():
        unit = (UNITS | {"tau": time}).get(key, 1.0) * VALUES[key]
        errors = []
        for share in (1e-2, 5e-3):
            ends = [
                solve(
                    scene(MPI.COMM_SELF, time=time, **{key: VALUES[key] * (1 + s)}),
                    march(time, **how), RECORD,
                )
                for s in (share, -share)
            ]  # fmt: skip
            errors.append([
                (ends[0][columns[n]] - ends[1][columns[n]]) / (2 * share * unit) / g[variable] - 1
                for n, g in found.items()
            ])  # fmt: skip
        large, small = np.array(errors)
        assert np.all(np.abs(large) < 1e-3)
        assert large / small == pytest.approx(4, rel=0.02)


def test_scaling_all_stresses_changes_no_displacement():
    """Only ratios of moduli and of eps V^2 count, and a voltage counts by its square."""
    run = solve(scene(MPI.COMM_SELF), march(steps=5), RECORD)
    names = [f"film.{n}" for n in (
        "elastic.mu", "viscous[0].mu", "viscous[1].mu", "electric.eps_r"
    )]  # fmt: skip
    to = [*names, "voltage"]
    constants = run.problem.parameters
    up, q = (run.sensitivity(name, to, step=4) for name in RECORD)
    for found, degree in ((up, 0.0), (q, 1.0)):
        terms = [constants[name] * found[name] for name in names]
        assert sum(terms) == pytest.approx(
            degree * found.value, rel=1e-8, abs=1e-8 * max(map(abs, terms))
        )
        twice = 2 * constants[names[-1]] * found[names[-1]] - degree * found.value
        assert 3e3 * found["voltage"] == pytest.approx(twice, rel=1e-8)


# ------------------------------------------------------------------ marches gone over again


ONCE_MORE = {
    "energy-conserving": (
        lambda mu, comm: dea.Material(dea.NeoHookean(mu), dea.IdealDielectric(3.0), density=1e3),
        lambda: march(2e-3, steps=3, inertia=dea.Inertia(scheme="energy-conserving")),
    ),
    "flow law": (
        lambda mu, comm: dea.Material(
            dea.NeoHookean(mu), dea.IdealDielectric(3.0),
            viscous=[dea.ViscousBranch(
                dea.NeoHookean(MU_V), flow=dea.KumarLopezPamies(TAU * MU_V, 1e3, 2.0, 1.0, 10.0)
            )],
        ),
        lambda: march(tolerance=1e-2),
    ),
    "leak": (
        lambda mu, comm: dea.Material(
            dea.NeoHookean(mu), dea.IdealDielectric(3.0, conductivity=1e-11)
        ),
        lambda: march(steps=3),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", [
    "energy-conserving", *(pytest.param(name, marks=on_demand) for name in ("flow law", "leak")),
])  # fmt: skip
def test_differences_converge_to_the_derivative_of_a_march_gone_over_again(case):
    made, path = ONCE_MORE[case]

    def ends(height=1.0, mu=MU, kilovolts=1.0):
        device = dea.read_gmsh(BoxStack(L, None, [Layer("film", height * L)], 1), MPI.COMM_SELF)
        told = dea.Scene(
            device, {"film": made(mu, device.comm)},
            [dea.Electrode("top", 1e3 * kilovolts), dea.Ground("bottom")],
            [dea.Clamp("x_min"), dea.Fix("bottom", "y")], kinematics=dea.PlaneStrain(L),
        )  # fmt: skip
        return dea.solve(told, path(), RECORD, quiet=True, stability="never")

    run = ends()
    to = {"film.elastic.mu": ("mu", MU), "thickness:film:y": ("height", L)}
    found = run.sensitivity("up", to)
    assert found.method == "replay" and found.residual < 1e-9
    for variable, (key, value) in to.items():
        unit = value / {"mu": 1, "height": L}[key]
        errors = [
            (ends(**{key: unit * (1 + s)})["up_m"] - ends(**{key: unit * (1 - s)})["up_m"])
            / (2 * s * value) / found[variable] - 1
            for s in (2e-2, 1e-2)
        ]  # fmt: skip
        assert abs(errors[0]) < 2e-3
        assert errors[0] / errors[1] == pytest.approx(4, rel=0.02)
    assert run.problem.parameters["film.elastic.mu"] == MU
    assert run["up_m"] == pytest.approx(found.value, rel=1e-12)


@pytest.mark.parametrize("case", ["motion", "energy-conserving"])
def test_states_that_memory_has_no_room_for_come_back_from_disk(case, monkeypatch):
    if case in MARCHES:
        time, how = MARCHES[case]
        told, path = scene(MPI.COMM_SELF, time=time), march(time, **how | {"steps": 3})
    else:
        told = scene(MPI.COMM_SELF)
        made, given = ONCE_MORE[case]
        told, path = replace(told, materials={"film": made(MU, MPI.COMM_SELF)}), given()

    def found():
        run = dea.solve(told, path, RECORD, quiet=True, stability="never")
        return run, run.sensitivity("up", ["film.elastic.mu"])

    kept, due = found()
    monkeypatch.setattr(KeptStates.__init__, "__defaults__", (1, 1))  # room for one state
    run, told_again = found()
    assert len(run._states._states) == 1 < len(kept._states._states) == len(run.history)
    assert dict(told_again) == dict(due)


def warm(changed):
    rubber = dea.Material(
        dea.NeoHookean(changed.get("mu", MU)), dea.IdealDielectric(3.0),
        viscous=[dea.Maxwell(MU_V, TAU)],
        thermal=dea.Thermal(293.15, 273.15, 353.15, modulus=dea.Entropic(),
                            shift=dea.WLF(8.0, 100.0)),
    )  # fmt: skip
    heat = dea.Temperature("film", 293.15 + 20 * changed.get("heat", 1.0))
    return rubber, {"prescribed": [heat]}


def rubbed(changed):
    rubber = dea.Material(dea.NeoHookean(changed.get("mu", MU)), viscous=[dea.Maxwell(MU_V, TAU)])
    move = changed.get("move", 1.0)
    plate = dea.Obstacle("top", dea.Plane((0.0, L / 4), (0.0, -1.0)),
                         (0.02 * L * move, -0.03 * L * move), friction=0.3)  # fmt: skip
    return rubber, {"electrodes": [], "supports": [dea.Clamp("bottom"), plate]}


def fed(changed):
    rubber = dea.Material(dea.NeoHookean(changed.get("mu", MU)), dea.IdealDielectric(3.0))
    source = dea.Source("top", 800 * changed.get("kilovolts", 1.0), ohms=3e12)
    return rubber, {"electrodes": [source, dea.Ground("bottom")]}


REPLAYED = {
    "friction": (rubbed, {"obstacle": lambda t: t / 1.5}, {"obstacle": ("move", 1.0)}),
    "source": (fed, {"voltage": lambda t: 1.0}, {"voltage": ("kilovolts", 800.0)}),
    "temperature": (
        warm, {"voltage": lambda t: 0.3 + 0.5 * t, "temperature": lambda t: 0.4 * t},
        {"temperature": ("heat", 1.0)},
    ),
}  # fmt: skip


@on_demand
@pytest.mark.parametrize("case", REPLAYED)
def test_friction_sources_and_heat_are_gone_over_again(case):
    made, drives, to = REPLAYED[case]

    def ends(**changed):
        device = dea.read_gmsh(BoxStack(L, None, [Layer("film", L / 4)], 2), MPI.COMM_SELF)
        rubber, more = made(changed)
        given = {
            "electrodes": [dea.Electrode("top", 800.0), dea.Ground("bottom")],
            "supports": [dea.Clamp("x_min"), dea.Fix("bottom", "y")],
        }  # fmt: skip
        told = dea.Scene(device, {"film": rubber}, **(given | more), kinematics=dea.PlaneStrain(L))
        record = {"up": dea.MeanDisplacement("x_max", "y")}
        return solve(told, dea.March(1.5, drives, steps=3), record)

    to = {"film.elastic.mu": ("mu", MU), **to}
    found = ends().sensitivity("up", list(to))
    assert found.method == "replay"
    for variable, (key, value) in to.items():
        unit = MU if key == "mu" else 1.0
        errors = [
            (ends(**{key: unit * (1 + s)})["up_m"] - ends(**{key: unit * (1 - s)})["up_m"])
            / (2 * s * value) / found[variable] - 1
            for s in (1e-2, 5e-3)
        ]  # fmt: skip
        assert abs(errors[0]) < 1e-3
        assert errors[0] / errors[1] == pytest.approx(4, rel=0.01)


# ------------------------------------------------------------------------------- what is refused


def test_what_is_not_derived_in_time():
    record = RECORD | {
        "most": dea.LargestDisplacement("top", "y"), "at": dea.AtPoint((L, L), "displacement", "y"),
    }  # fmt: skip
    run = solve(scene(MPI.COMM_SELF), march(steps=2), record)
    with pytest.raises(dea.InputError, match="AtPoint has no derivative by 'thickness:film:y'"):
        run.sensitivity("at", ["thickness:film:y"])
    with pytest.raises(dea.InputError, match="jumps from one node to another"):
        run.sensitivity("most", ["voltage"])
    with pytest.raises(dea.InputError, match=r"did you mean 'film.viscous\[0\].tau'"):
        run.sensitivity("up", ["film.viscous[0].tao"])


# ---------------------------------------------------------------------------------------- ranks


def on_ranks_found(comm):
    time, how = MARCHES["motion"]  # of a viscous body
    run = solve(scene(comm, time=time), march(time, **how | {"steps": 2}), RECORD)
    return [list(run.sensitivity(name, list(CHANGED)).values()) for name in RECORD]


@pytest.mark.slow
@pytest.mark.mpi
def test_three_ranks_find_what_one_finds(on_ranks):
    alone = np.array(on_ranks_found(MPI.COMM_SELF))
    found = np.array(on_ranks("test_gradients_in_time", "on_ranks_found", 3))
    assert found == pytest.approx(alone, rel=1e-7)
