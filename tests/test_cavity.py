"""Gas, liquid and given pressure in a cavity: a thick sphere against its closed form.

With A = mu = eps = 1, inner radius a, outer b with b^3 = a^3 + B^3 - 1, B = 1.2:

    P(a, V) = g(a) - g(b/B) - V^2/2 (a^-4 - b^-4)/(1/a - 1/b)^2,    g(l) = -2/l - 1/(2 l^4).
"""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from scipy.optimize import brentq, minimize_scalar
from test_cavity_closed import PLANES, Pipe, moved_volume

import dea_fenicsx as dea
from dea_fenicsx.geometry import HollowSphere
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.solvers.newton import NewtonSolver

MU, A, B = 1e5, 1e-2, 1.2
UNIT = A * np.sqrt(MU / (3 * EPSILON_0))
FILLED = 0.183928709  # the pressure at a = 1.2 without voltage
RUBBER = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(3.0))
SHARE = {"half": 1 / 2, "whole": 1.0, "octant": 1 / 8}
RECORD = {"P": dea.CavityPressure("inner"), "cavity": dea.CavityVolume("inner")}


def pressure(a, volts=0.0):
    b = (a**3 + B**3 - 1) ** (1 / 3)
    g = lambda x: -2 / x - 1 / (2 * x**4)  # noqa: E731
    return g(a) - g(b / B) - volts**2 / 2 * (a**-4 - b**-4) / (1 / a - 1 / b) ** 2


def rest_volume(part):
    return SHARE[part] * 4 / 3 * np.pi * A**3


def balloon(part="half", cells=8, layers=2, comm=MPI.COMM_SELF, **given):
    device = dea.read_gmsh(HollowSphere(A, B * A, part, layers, cells), comm)
    return dea.Scene(
        device, {"wall": RUBBER}, [dea.Electrode("inner", UNIT), dea.Ground("outer")],
        supports=PLANES[part], loads=[dea.Cavity("inner", **({"ramp": "fill"} | given))],
        kinematics=dea.ThreeD() if part == "octant" else dea.Axisymmetric(),
    )  # fmt: skip


def gas_to(p0, part="half", a=1.2):
    """Gas that fills the cavity from the undeformed body to an inner radius, in Pa m^3."""
    return ((p0 + pressure(a)) * a**3 - p0) * rest_volume(part) * MU


def radii(run, part="half"):
    """Inner radius over A at each step."""
    return (run.column("cavity_m3") / rest_volume(part)) ** (1 / 3)


def solve(scene, path, **options):
    return dea.solve(scene, path, RECORD, quiet=True, **options)


# ------------------------------------------------------------- the table of the closed gas


@pytest.mark.parametrize("p0, first, second", [
    (10, 1.20102909, 1.20414665), (1, 1.20803375, 1.23435221), (0, 1.23391690, 1.47705704),
])  # fmt: skip
def test_closed_gas_under_voltage(p0, first, second):
    """To 1e-6, on 16 x 4 quadratic cells of the half section."""
    scene = balloon(cells=16, layers=4, gas=gas_to(p0), outside=p0 * MU)
    run = solve(scene, [dea.Ramp("fill", steps=4), dea.Ramp("voltage", to=0.1, steps=2)])
    a = radii(run)
    assert a[4] == pytest.approx(1.2, rel=1e-6)
    assert run.column("P_Pa")[4] == pytest.approx(FILLED * MU, rel=3e-6)
    assert a[5:] == pytest.approx([first, second], rel=1e-6)
    assert run.summary["inertia"] == 0
    assert run.summary["unknowns_by_field"]["pressure in inner"] == 1


@pytest.mark.slow
def test_closed_gas_in_space():
    """To 1e-6, on 12 cells along each edge of an octant and 3 through the wall."""
    scene = balloon("octant", 12, 3, gas=gas_to(1, "octant"), outside=MU)
    run = solve(scene, [dea.Ramp("fill", steps=3), dea.Ramp("voltage", to=0.1, steps=2)])
    assert radii(run, "octant")[-2:] == pytest.approx([1.20803375, 1.23435221], rel=1e-6)


@pytest.mark.parametrize("factor", ["whole", "split"])
def test_closed_gas_on_a_coarse_octant(factor):
    """The planes of symmetry close the cavity, and a split factor takes its unknowns."""
    scene = balloon("octant", 4, 1, gas=gas_to(1, "octant"), outside=MU)
    run = solve(scene, [dea.Ramp("fill", steps=2), dea.Ramp("voltage", to=0.1, steps=1)],
                options=dea.NewtonOptions(factor=factor))  # fmt: skip
    assert radii(run, "octant")[-1] == pytest.approx(1.23435221, rel=2e-4)
    assert run.summary["inertia"] == 0


def test_the_inner_face_off_the_centre():
    """From a = 1.45522, V = 0.098827 on the round state has one negative eigenvalue."""
    scene = balloon("whole", 8, 2, gas=gas_to(0, "whole"), outside=0.0)
    run = solve(scene, [dea.Ramp("fill", steps=4), dea.Ramp("voltage", to=0.1, steps=2)],
                stability="every")  # fmt: skip
    split = next(row for row in run.history if row["event"] == "bifurcation")
    assert split["voltage_V"] / UNIT == pytest.approx(0.098827, rel=2e-5)
    ratio = (split["cavity_m3"] / rest_volume("whole")) ** (1 / 3)
    assert ratio == pytest.approx(1.45522, rel=2e-5)
    assert radii(run, "whole")[-1] == pytest.approx(1.47705704, rel=1e-5)
    assert run.summary["inertia"] == 1


def test_closed_at_a_pressure():
    """A trace of the amount ends at a pressure; then the cavity is closed under its gas law."""
    path = [dea.Trace("fill", until=("P_Pa", 0.1 * MU)), dea.Ramp("voltage", 0.1, 2)]
    run = solve(balloon(gas=gas_to(1, a=1.4), outside=MU), path)
    product = (run.column("P_Pa") + MU) * run.column("cavity_m3")
    closed = int(np.argmax(np.isclose(run.column("P_Pa"), 0.1 * MU, rtol=1e-8)))
    assert closed > 0
    assert product[closed:] == pytest.approx(product[closed], rel=1e-9)
    a = brentq(lambda a: pressure(a) - 0.1, 1.0, 1.2)
    assert radii(run)[closed] == pytest.approx(a, rel=1e-5)


# ---------------------------------------------------------------- amount against pressure


def highest_pressure():
    top = minimize_scalar(lambda a: -pressure(a), bounds=(1.2, 3), method="bounded",
                          options={"xatol": 1e-10})  # fmt: skip
    return top.x, -top.fun


def test_a_given_pressure_has_a_limit_point_and_a_given_amount_has_none():
    a, most = highest_pressure()
    pressed = solve(balloon(pressure=1.2 * most * MU),
                    dea.Trace("fill", until=("cavity_m3", 2**3 * rest_volume("half"))),
                    stability="every")  # fmt: skip
    top = next(row for row in pressed.history if row["event"] == "maximum")
    assert top["P_Pa"] == pytest.approx(most * MU, rel=1e-5)
    assert (top["cavity_m3"] / rest_volume("half")) ** (1 / 3) == pytest.approx(a, rel=1e-3)
    assert pressed.summary["inertia"] == 1
    # the same states under a given amount are stable
    filled = solve(balloon(gas=gas_to(0, a=2.0), outside=0.0), dea.Ramp("fill", steps=8),
                   stability="every")  # fmt: skip
    assert filled.summary["inertia"] == 0
    assert not [row for row in filled.history if row["event"]]
    assert radii(filled)[-1] == pytest.approx(2.0, rel=3e-5)
    assert np.max(filled.column("P_Pa")) > filled["P_Pa"] * 1.02
    last = filled["P_Pa"] / MU
    assert last == pytest.approx(pressure(2.0), rel=1e-4)


def test_a_ramp_of_a_given_pressure_ends_at_its_limit():
    _, most = highest_pressure()
    with pytest.raises(dea.EquilibriumLost) as lost:
        solve(balloon(pressure=1.2 * most * MU), dea.Ramp("fill", steps=6))
    low, high = lost.value.reached["fill"], lost.value.failed["fill"]
    assert low < 1 / 1.2 < high * (1 + 1e-5)


def test_a_given_pressure_is_the_follower_pressure_of_a_closed_surface():
    p = 0.1 * MU
    device = dea.read_gmsh(HollowSphere(A, B * A, "half", 1, 4), MPI.COMM_SELF)
    found = []
    for load in (dea.Cavity("inner", pressure=p), dea.FollowerPressure("inner", p)):
        scene = dea.Scene(device, {"wall": RUBBER}, supports=PLANES["half"], loads=[load],
                          kinematics=dea.Axisymmetric())  # fmt: skip
        run = dea.solve(scene, dea.Ramp(steps=2), {"u": dea.MeanDisplacement("inner", "z")},
                        quiet=True, options=dea.NewtonOptions(tolerance=1e-11))  # fmt: skip
        found.append(run["u_m"])
    assert found[0] == pytest.approx(found[1], rel=1e-6)


def test_the_limit_voltage_depends_on_what_is_given():
    """At a given pressure the voltage has a lower limit than with the gas closed in."""
    limits = []
    for given in ({"gas": gas_to(0), "outside": 0.0}, {"pressure": FILLED * MU}):
        trace = dea.Trace("voltage", until=("cavity_m3", 1.75**3 * rest_volume("half")))
        run = solve(balloon(**given), [dea.Ramp("fill", steps=4), trace], stability="never")
        limits.append(max(row["voltage_V"] for row in run.history if row["event"] == "maximum"))

    def volts(a, closed):
        inside = FILLED * (1.2 / a) ** 3 if closed else FILLED
        b = (a**3 + B**3 - 1) ** (1 / 3)
        gap = pressure(a) - inside
        return np.sqrt(max(gap, 0) * 2 / (a**-4 - b**-4)) * (1 / a - 1 / b)

    def most(closed):
        return -minimize_scalar(lambda a: -volts(a, closed), bounds=(1.2, 2.5), method="bounded",
                                options={"xatol": 1e-10}).fun  # fmt: skip

    exact = [most(True), most(False)]
    assert np.array(limits) / UNIT == pytest.approx(exact, rel=2e-5)
    assert limits[1] < 0.6 * limits[0]


# ------------------------------------------------------------------------ other contents


def test_liquid_keeps_its_volume():
    added = 0.5 * rest_volume("half")
    run = solve(balloon(liquid=added), [dea.Ramp("fill", steps=2), dea.Ramp("voltage", 0.1, 2)],
                options=dea.NewtonOptions(tolerance=1e-12))  # fmt: skip
    gained = run.column("cavity_m3") - run.column("cavity_m3")[0]
    assert gained[2:] == pytest.approx(added, rel=1e-11)
    a = 1.5 ** (1 / 3)
    wanted = [pressure(a) * MU, pressure(a, 0.05) * MU, pressure(a, 0.1) * MU]
    assert run.column("P_Pa")[2:] == pytest.approx(wanted, rel=1e-4)
    assert run.summary["inertia"] == 0


@pytest.mark.parametrize("reference", [None, 2.0])
def test_adiabatic_gas_with_a_reservoir(reference):
    """P + p0 = (n/V_r)(V_r/V)^k with the reservoir in all volumes."""
    rest, p0, k, more = rest_volume("half"), 2.0, 1.4, 0.5
    given = None if reference is None else reference * rest
    v_r = (1 + more) if reference is None else reference
    n_rest, added = p0 * (1 + more) ** k / v_r ** (k - 1), 1.3
    scene = balloon(gas=added * rest * MU, outside=p0 * MU, exponent=k, reservoir=more * rest,
                    reference_volume=given)  # fmt: skip
    run = solve(scene, [dea.Ramp("fill", steps=2), dea.Ramp("voltage", 0.1, 1)])

    def exact(volts):
        law = lambda a: (n_rest + added) / v_r * (v_r / (a**3 + more)) ** k - p0  # noqa: E731
        return brentq(lambda a: law(a) - pressure(a, volts), 1.0, 1.6)

    assert run["P_Pa"] == pytest.approx(pressure(exact(0.1), 0.1) * MU, rel=1e-4)
    assert radii(run)[-2:] == pytest.approx([exact(0.0), exact(0.1)], rel=2e-5)


def test_all_gas_leaks_out():
    """Down to no gas at all: the rest, where nothing is outside, and else a vacuum."""
    run = solve(balloon(gas=gas_to(0), outside=0.0), [dea.Ramp("fill", 1.0, 3),
                                                       dea.Ramp("fill", 0.0, 3)])  # fmt: skip
    assert radii(run)[-1] == pytest.approx(radii(run)[0], rel=1e-9)
    assert run["P_Pa"] == pytest.approx(0, abs=1e-6 * MU)
    p0 = 0.1
    run = solve(balloon(gas=-p0 * MU * rest_of_mesh(), outside=p0 * MU), dea.Ramp("fill", steps=4))
    assert run["P_Pa"] == pytest.approx(-p0 * MU, rel=1e-8)
    a = brentq(lambda a: pressure(a) + p0, 0.5, 1.0)
    assert radii(run)[-1] == pytest.approx(a, rel=1e-4)


def rest_of_mesh():
    """The undeformed volume of the meshed cavity."""
    return dea.CavityVolume("inner").bind(Problem(balloon(gas=1.0)))()


def test_more_gas_let_out_than_there_is():
    """A vacuum cannot be emptied: this is refused before anything is solved."""
    p0 = 0.1
    all_of_it = p0 * MU * rest_volume("half")
    emptied = balloon(gas=-1.5 * all_of_it, outside=p0 * MU)
    for path in (dea.Ramp("fill"), dea.March(2.0, {"fill": dea.Sine(hertz=1)})):
        with pytest.raises(dea.InputError, match="more gas than the"):
            solve(emptied, path)
    with pytest.raises(dea.InputError, match="more gas than the"):
        solve(balloon(gas=all_of_it, outside=p0 * MU), dea.Ramp("fill", to=-1.01))
    with pytest.raises(dea.InputError, match="more liquid than the"):
        solve(balloon(liquid=-1.01 * rest_volume("half")), dea.Ramp("fill"))


def test_energy_of_the_gas_balances():
    """Elastic minus electric energy plus that of the gas falls by Q dV along a closed path."""
    record = RECORD | {
        "Q": dea.Charge("inner"), "elastic": dea.Energy("elastic"),
        "field": dea.Energy("electric"), "gas": dea.CavityEnergy("inner"),
    }  # fmt: skip
    run = dea.solve(
        balloon(gas=gas_to(1), outside=MU),
        [dea.Ramp("fill", steps=2), dea.Ramp("voltage", 0.1, 40)], record, quiet=True,
        stability="never", options=dea.NewtonOptions(tolerance=1e-11),
    )  # fmt: skip
    gain = run.column("elastic_J") - run.column("field_J") + run.column("gas_J")
    voltage, charge = run.column("voltage_V"), run.column("Q_C")
    start = np.flatnonzero(run.column("fill_factor") > 1 - 1e-12)[0]
    v, q = voltage[start:], charge[start:]
    # Simpson's rule in the voltage over equal steps
    assert len(v) % 2 == 1
    work = np.sum((v[2::2] - v[:-2:2]) / 6 * (q[:-2:2] + 4 * q[1::2] + q[2::2]))
    assert gain[-1] - gain[start] == pytest.approx(-work, rel=1e-6)


# -------------------------------------------------------------------- the solver's machinery


@pytest.mark.parametrize("given", [
    dict(gas=gas_to(1), outside=MU), dict(liquid=1e-6), dict(pressure=0.1 * MU),
], ids=["gas", "liquid", "pressure"])  # fmt: skip
def test_the_tangent_is_the_derivative_of_the_residual(given):
    """By central differences along a random direction, and by each ramp's factor."""
    problem = Problem(balloon(cells=2, layers=1, **given))
    solver = NewtonSolver(problem)
    state = solver.solve(problem.rest, {"fill": 0.5, "voltage": 0.03}).state
    problem.commit(state)
    rng = np.random.default_rng(3)
    along = rng.normal(size=len(problem.free)) * 1e-2
    h = 1e-4
    values = []
    for sign in (1, -1):
        with problem.at(problem.moved(state, sign * h * along)):
            values.append(problem.unbalanced(problem.residual()))
    slope = (values[0] - values[1]) / (2 * h)
    found = solver.tangent.times(along)
    assert found == pytest.approx(slope, abs=1e-6 * np.abs(slope).max())
    assert solver.tangent.is_symmetric
    other = rng.normal(size=len(problem.free))
    assert other @ found == pytest.approx(along @ solver.tangent.times(other), rel=1e-10)
    by_factor = solver.tangent.by_load("fill")
    values = []
    for sign in (1, -1):
        moved = problem.imposed(problem.under(state, {"fill": 0.5 + sign * h}))
        with problem.at(moved):
            values.append(problem.unbalanced(problem.residual()))
    slope = (values[0] - values[1]) / (2 * h)
    assert by_factor == pytest.approx(slope, abs=1e-6 * np.abs(slope).max())


def test_a_ramp_shared_with_a_load_drives_both():
    """Each keeps a constant for the factor of the same ramp."""
    device = dea.read_gmsh(Pipe(), MPI.COMM_SELF)
    scene = dea.Scene(
        device, {"wall": RUBBER}, supports=[dea.Fix("foot", "y"), dea.Fix("left", "x")],
        loads=[dea.Cavity("hole", gas=1e-4, ramp="all"), dea.DeadLoad("top", (0, 10.0), "all")],
        kinematics=dea.PlaneStrain(1e-3),
    )  # fmt: skip
    problem = Problem(scene)
    problem.commit(problem.under(problem.rest, {"all": 0.25}))
    constants = [c for _, c in (*problem.loads.factors.items(), *problem.loads.further)]
    assert len({id(c) for c in constants}) == 2
    assert {float(c.value) for c in constants} == {0.25}


def test_amount_and_voltage_in_plane_strain():
    """The pipe's gas is per depth: twice the depth takes twice the gas."""
    found = []
    for depth in (1e-3, 2e-3):
        device = dea.read_gmsh(Pipe(), MPI.COMM_SELF)
        scene = dea.Scene(
            device, {"wall": RUBBER}, supports=[dea.Fix("foot", "y"), dea.Fix("left", "x")],
            loads=[dea.Cavity("hole", gas=depth * 1e-6 * 0.1 * MU, outside=MU)],
            kinematics=dea.PlaneStrain(depth),
        )  # fmt: skip
        record = {"P": dea.CavityPressure("hole"), "cavity": dea.CavityVolume("hole")}
        run = dea.solve(scene, dea.Ramp(steps=1), record, quiet=True)
        ideal = (1.0 * 2e-6 + 0.1e-6) * depth * MU / run["cavity_m3"] - MU
        assert run["P_Pa"] == pytest.approx(ideal, rel=1e-7)
        found.append(run["P_Pa"])
    assert found[0] == pytest.approx(found[1], rel=1e-7)


def test_resumed_and_started_from(tmp_path):
    """A run goes on from its checkpoint, and another modulus from its last state."""
    path = [dea.Ramp("fill", steps=2), dea.Ramp("voltage", 0.1, 2)]

    def scene(share=1.0):
        return balloon(cells=4, layers=1, gas=share * gas_to(1), outside=MU)

    whole = solve(scene(), path)
    first = solve(scene(), path[:1], out=tmp_path / "a")
    assert first["P_Pa"] > 0
    with pytest.raises(RuntimeError, match="stopped"):
        dea.solve(scene(), path, RECORD | {"stop": Stop(4)}, out=tmp_path / "b", quiet=True)
    run = dea.solve(scene(), path, RECORD | {"stop": Stop(99)}, out=tmp_path / "b", quiet=True,
                    resume=True)  # fmt: skip
    assert run["P_Pa"] == pytest.approx(whole["P_Pa"], rel=1e-7)
    # Half as much gas at factor 1: the same state is at factor 2.
    again = solve(scene(0.5), dea.Ramp("voltage", 0.1, 2), start=tmp_path / "a")
    assert again.column("fill_factor")[0] == pytest.approx(2.0)
    assert again["P_Pa"] == pytest.approx(whole["P_Pa"], rel=1e-6)


class Stop:
    """Raises at a call, and measures nothing before."""

    unit = ""

    def __init__(self, at):
        self.left = at

    def bind(self, problem):
        def value():
            self.left -= 1
            if self.left == 0:
                raise RuntimeError("stopped")
            return 0.0

        return value


def on_any_ranks(comm):
    scene = balloon(cells=4, layers=1, comm=comm, gas=gas_to(1), outside=MU)
    path = [dea.Ramp("fill", steps=1), dea.Ramp("voltage", 0.1, 1)]
    run = solve(scene, path, stability="never")
    # one cell: all ranks but one have none
    alone = balloon(cells=1, layers=1, comm=comm, gas=gas_to(1), outside=MU)
    found = solve(alone, path, stability="never")["P_Pa"]
    return [run["P_Pa"], run["cavity_m3"], found, run.summary["newton_iterations"]]


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_any_number_of_ranks(ranks, on_ranks):
    one, many = on_any_ranks(MPI.COMM_SELF), on_ranks("test_cavity", "on_any_ranks", ranks)
    assert many[:3] == pytest.approx(one[:3], rel=1e-9)
    assert many[3] == one[3]


def test_the_outer_face_encloses_no_cavity():
    """Its facets look outwards; the inner one has a volume."""
    device = dea.read_gmsh(HollowSphere(A, B * A, "half", 1, 4), MPI.COMM_SELF)
    with pytest.raises(dea.InputError, match="encloses the material and no cavity"):
        dea.Scene(device, {"wall": RUBBER}, supports=PLANES["half"], kinematics=dea.Axisymmetric(),
                  loads=[dea.Cavity("outer", pressure=1.0)])  # fmt: skip
    assert moved_volume(Problem(balloon(cells=4, layers=1, liquid=1e-7)), np.zeros((2, 2))) > 0
