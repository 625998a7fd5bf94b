"""Charge in time: leakage, sources behind resistors, switches, currents and losses."""

import math
import textwrap

import numpy as np
import pytest
from conftest import block
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.support.errors import InputError

MU, EPS_R, SIDE = 20e3, 4.0, 1e-3
EPS = EPS_R * 8.8541878188e-12
UNIT = SIDE * math.sqrt(MU / EPS)
"""Voltage in V of the nominal field 1, in units of sqrt(mu/eps)."""

OMEGA = 0.1
"""Rate of leakage g/eps in 1/s."""

def two_layers():
    """Two layers of thickness SIDE/2."""
    layers = [Layer(name, SIDE / 2) for name in ("lower", "upper")]
    return dea.read_gmsh(BoxStack(SIDE, SIDE, layers, divisions=(1, 1)), MPI.COMM_SELF)


ROLLERS = [dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")]
RECORD = {
    "u": dea.MeanDisplacement("x_max", "x"), "q": dea.Charge("top"), "v": dea.Potential("top"),
}  # fmt: skip


def leaky(omega=OMEGA, mu=MU, **more):
    return dea.Material(
        dea.NeoHookean(mu), dea.IdealDielectric(EPS_R, conductivity=omega * EPS), **more
    )


def scene(electrode, material, supports=ROLLERS, **more):
    return dea.Scene(
        block((1, 1, 1)), {"film": material}, [electrode, dea.Ground("bottom")],
        supports=supports, **more,
    )  # fmt: skip


def solve(scene, path, record=RECORD, **more):
    return dea.solve(scene, path, record, quiet=True, **{"stability": "never"} | more)


def columns(run, *names):
    return [np.array(run.column(name), dtype=float) for name in names]


# ---------------------------------------------------------------- leakage


@pytest.mark.parametrize("steps", [3, 40])
def test_a_disconnected_film_leaks_exponentially_however_it_deforms(steps):
    """Q = Q0 exp(-g t/eps), exactly for any step, while the film thickens again."""
    electrode = dea.ChargedElectrode("top", 2 * EPS * SIDE * 0.6 * UNIT)
    run = solve(
        scene(electrode, leaky()), [dea.Ramp(steps=4), dea.March(20.0, steps=steps)]
    )
    time, q, u = columns(run, "time_s", "q_C", "u_m")
    began = run.column("time_s").index(0.0) if isinstance(run.column("time_s"), list) else 4
    assert u[began] > 1.01 * u[-1] > 0
    assert q[began:] == pytest.approx(q[began] * np.exp(-OMEGA * time[began:]), rel=1e-8)


def test_leakage_with_one_ratio_keeps_the_tangent_symmetric():
    run = solve(scene(dea.Electrode("top", 0.3 * UNIT), leaky()), [
        dea.Ramp(steps=2), dea.March(5.0, steps=4)
    ], RECORD | {"i": dea.Current("top"), "loss": dea.ChargeLoss()}, stability="every")  # fmt: skip
    q, current, loss = columns(run, "q_C", "i_A", "loss_W")
    assert run.history[-1]["inertia"] == 0
    assert q[-1] == pytest.approx(q[2], rel=1e-10)  # the source replaces what leaks
    assert current[-1] == pytest.approx(OMEGA * q[-1], rel=1e-8)
    assert loss[-1] == pytest.approx(OMEGA * q[-1] * 0.3 * UNIT, rel=1e-8)
    assert current[2] == pytest.approx(OMEGA * q[2], rel=1e-8)


def test_two_layers_share_the_voltage_by_their_conductivities():
    """Two layers that cannot deform, at a voltage: an exact exponential to the ratio of 1/g.

    With layers of equal thickness H/2, eps and g1, g2 the field of the first goes from V/H to
    2 V g2/((g1 + g2) H) with the rate (g1 + g2)/(2 eps).
    """
    rates = {"lower": 0.3, "upper": 0.1}
    device = two_layers()
    materials = {name: leaky(omega, mu=1e9) for name, omega in rates.items()}
    layers = dea.Scene(
        device, materials, [dea.Electrode("top", 100.0), dea.Ground("bottom")], supports=ROLLERS
    )
    errors = []
    for steps in (10, 20, 40):
        run = solve(
            layers, [dea.Ramp(steps=1), dea.March(10.0, steps=steps)],
            {"v": dea.AtPoint((SIDE / 2,) * 3, "potential"), "i": dea.Current("top")},
        )  # fmt: skip
        time, v = columns(run, "time_s", "v_V")
        decay = np.exp(-0.2 * time[1:])
        errors.append(np.max(np.abs(v[1:] - (25.0 + 25.0 * decay))))
    assert errors[-1] < 0.01
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(2.0, abs=0.2)
    # at last the current is V/H over the sum of the resistivities
    series = 2 * SIDE * 100.0 * EPS / (1 / 0.3 + 1 / 0.1)
    assert run.history[-1]["i_A"] == pytest.approx(series, rel=0.1)


def test_conduction_that_grows_with_the_field():
    """A disconnected film that cannot deform: dE/dt = -(g/eps) exp(E/E0) E."""
    from scipy.integrate import solve_ivp

    field, scale = 1e5, 5e4
    law = dea.Conductivity(OMEGA * EPS, field=scale)
    material = dea.Material(dea.NeoHookean(1e9), dea.IdealDielectric(EPS_R, conductivity=law))
    exact = solve_ivp(
        lambda t, E: -OMEGA * np.exp(E / scale) * E, (0, 5.0), [field], rtol=1e-11, atol=1e-6
    ).y[0, -1]
    errors = []
    for steps in (16, 32, 64):
        run = solve(
            scene(dea.Source("top", field * SIDE), material),
            [dea.Ramp(steps=1), dea.Open("top"), dea.March(5.0, steps=steps)],
        )  # fmt: skip
        errors.append(abs(run.history[-1]["v_V"] / SIDE - exact) / exact)
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(2.0, abs=0.3)
    assert errors[-1] < 1e-3


def test_voltage_of_a_charged_film_of_fixed_shape():
    """A film that cannot deform holds V0 exp(-omega t) after its switch has opened."""
    stiff = leaky(mu=1e9)
    run = solve(scene(dea.Source("top", 100.0), stiff), [
        dea.Ramp(steps=1), dea.Open("top"), dea.March(30.0, steps=7)
    ])
    time, v = columns(run, "time_s", "v_V")
    assert v[1:] == pytest.approx(100.0 * np.exp(-OMEGA * time[1:]), rel=1e-7)


# ---------------------------------------------------------------- dielectric relaxation


def relaxing(mu, *terms, omega=0.0):
    electric = dea.IdealDielectric(EPS_R, conductivity=omega * EPS, relaxation=list(terms))
    return dea.Material(dea.NeoHookean(mu), electric)


def test_charge_of_a_relaxing_dielectric_of_fixed_shape():
    """At a constant voltage q = C V [1 + 1/2 (1 - exp(-t/tau))], exactly for any step."""
    run = solve(
        scene(dea.Electrode("top", 100.0), relaxing(1e9, dea.Debye(EPS_R / 2, 2.0))),
        [dea.Ramp(steps=1), dea.March(6.0, steps=5)],
        RECORD | {"energy": dea.Energy("electric"), "loss": dea.ChargeLoss()},
    )  # fmt: skip
    time, q, energy, loss = columns(run, "time_s", "q_C", "energy_J", "loss_W")
    late = 0.5 * (1 - np.exp(-time[1:] / 2))
    whole = EPS * SIDE * 100.0
    assert q[1:] == pytest.approx(whole * (1 + late), rel=1e-7)
    assert energy[1:] == pytest.approx(whole * 50.0 * (1 + late**2 / 0.5), rel=1e-7)
    assert loss[1:] == pytest.approx(whole * 100.0 * (0.5 - late) ** 2 / 0.5 / 2.0, rel=1e-6)


def test_voltage_of_a_disconnected_relaxing_dielectric_with_leakage():
    """D' = -P' - omega D, P' = (D/2 - P)/tau: two rates, second order."""
    from scipy.integrate import solve_ivp

    omega, tau = 0.1, 2.0

    def rate(t, y):
        late = (y[0] / 2 - y[1]) / tau
        return [-late - omega * y[0], late]

    exact = solve_ivp(rate, (0, 6.0), [1.0, 0.0], rtol=1e-11, atol=1e-13).y[0, -1]
    errors = []
    for steps in (10, 20, 40):
        run = solve(
            scene(dea.Source("top", 100.0), relaxing(1e9, dea.Debye(EPS_R / 2, tau), omega=omega)),
            [dea.Ramp(steps=1), dea.Open("top"), dea.March(6.0, steps=steps)],
        )  # fmt: skip
        errors.append(abs(run.history[-1]["v_V"] / 100.0 - exact))
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(2.0, abs=0.2)
    assert errors[-1] < 2e-4


def test_a_relaxing_film_goes_on_to_deform():
    """Equal-biaxial: mu (l^2 - l^-4) = eps E^2 l^4 + P^2 l^-4/eps_P, P' = (eps_P l^4 E - P)/tau."""
    from scipy.integrate import solve_ivp
    from scipy.optimize import brentq

    e, tau, ratio = 0.4, 1.0, 0.5

    def stretch(p):
        return brentq(
            lambda x: x**2 - x**-4 - e**2 * x**4 - p**2 * x**-4 / ratio, 1.0, 1.25, xtol=1e-14
        )

    def rate(t, p):
        return [(ratio * stretch(p[0]) ** 4 * e - p[0]) / tau]

    p = solve_ivp(rate, (0, 2.0), [0.0], rtol=1e-11, atol=1e-13).y[0, -1]
    film = relaxing(MU, dea.Debye(ratio * EPS_R, tau))
    errors = []
    for steps in (8, 16, 32):
        run = solve(
            scene(dea.Electrode("top", e * UNIT), film), [dea.Ramp(), dea.March(2.0, steps=steps)]
        )
        errors.append(abs(run.history[-1]["u_m"] / SIDE + 1 - stretch(p)))
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(2.0, abs=0.2)
    assert errors[-1] < 1e-4


# ---------------------------------------------------------------- sources and switches


def rc_scene(**more):
    stiff = dea.Material(dea.NeoHookean(1e9), dea.IdealDielectric(EPS_R))
    return scene(dea.Source("top", 100.0, ohms=1.0 / (EPS * SIDE), **more), stiff)


def rc_error(run):
    time, v = columns(run, "time_s", "v_V")
    return np.max(np.abs(v / 100.0 - (1 - np.exp(-time))))


def test_charging_through_a_resistor_has_second_order():
    """V = V_source (1 - exp(-t/(R C))) with R C = 1 s."""
    errors = [
        rc_error(solve(rc_scene(), dea.March(2.0, {"voltage": 1.0}, steps=n))) for n in (20, 40, 80)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx(2.0, abs=0.15)
    assert errors[-1] < 1e-4


def test_adaptive_charging_meets_its_tolerance():
    run = solve(rc_scene(), dea.March(3.0, {"voltage": 1.0}, tolerance=1e-8))
    assert rc_error(run) < 1e-6


def test_a_source_at_its_limit_charges_at_constant_current():
    capacitance = EPS * SIDE
    most = 20.0 * capacitance  # 20 V/s, where the resistor alone would let 100 V/s pass
    run = solve(
        rc_scene(amperes=most), dea.March(1.0, {"voltage": 1.0}, steps=10),
        RECORD | {"i": dea.Current("top")},
    )  # fmt: skip
    v, current = columns(run, "v_V", "i_A")
    assert v[-1] == pytest.approx(20.0, rel=1e-6)
    assert current[-1] == pytest.approx(most, rel=1e-9)


def test_an_ideal_source_is_an_electrode_until_its_switch_opens():
    """The same states as with Electrode; then as with a given charge, and discharged at last."""
    free = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))
    fixed = solve(scene(dea.Electrode("top", 0.5 * UNIT), free), [dea.Ramp(steps=3)])
    path = [
        dea.Ramp("voltage", steps=3), dea.Open("top"), dea.Ramp("load", steps=3),
        dea.Close("top", to=0.0, steps=3),
    ]  # fmt: skip
    load = [dea.DeadLoad("x_max", (0.4 * MU, 0.0, 0.0))]
    run = solve(scene(dea.Source("top", 0.5 * UNIT), free, loads=load), path, stability="every")
    u, q, v = columns(run, "u_m", "q_C", "v_V")
    assert u[3] == pytest.approx(fixed.history[-1]["u_m"], rel=1e-9)
    assert q[3] == pytest.approx(fixed.history[-1]["q_C"], rel=1e-9)
    assert q[4:7] == pytest.approx(q[3], rel=1e-10)
    assert v[6] < 0.9 * v[3]
    assert v[-1] == pytest.approx(0.0, abs=1e-9 * UNIT)
    elastic = solve(
        scene(dea.Electrode("top", 1.0), free, loads=load), [dea.Ramp("load", steps=3)]
    )
    assert u[-1] == pytest.approx(elastic.history[-1]["u_m"], rel=1e-9)
    assert all(row["inertia"] == 0 for row in run.history)


def test_a_harvesting_cycle_gains_its_closed_form():
    """Charged at stretch 3, released to 1.5, discharged there; see `dea.exact`."""
    material = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS_R))
    high, low, field = 3.0, 1.5, 0.05 * UNIT / SIDE
    stretches = [dea.Stretch(f"{a}_max", a, high, ramp="stretch") for a in "xy"]
    cycle = dea.Scene(
        block((1, 1, 1)), {"film": material},
        [dea.Source("top", field * SIDE), dea.Ground("bottom")], supports=ROLLERS,
        prescribed=stretches,
    )  # fmt: skip
    part = (low - 1) / (high - 1)
    run = solve(cycle, [
        dea.Open("top"), dea.Ramp("stretch", steps=4), dea.Close("top", steps=2), dea.Open("top"),
        dea.Ramp("stretch", to=part, steps=4), dea.Close("top", to=0.0, steps=2),
    ])  # fmt: skip
    q, v = columns(run, "q_C", "v_V")
    gained = -np.sum((v[1:] + v[:-1]) / 2 * np.diff(q)) / SIDE**3
    exact = dea.exact.harvesting_cycle(material, low, high, field).energy
    assert gained == pytest.approx(exact, rel=1e-8)


# ---------------------------------------------------------------- sheet resistance


def strip_scene(ohms=None, omega=0.0, **more):
    """A strip ten times as long as thick that cannot deform; its top is fed at one end.

    With D = H/(R eps) its slowest rate is D (pi/(2 L))^2, which is 1/s.
    """
    length, height = 10 * SIDE, SIDE / 10
    ohms = height / EPS * (math.pi / (2 * length)) ** 2 if ohms is None else ohms
    strip = BoxStack(length, None, [Layer("film", height)], divisions=(20,))
    return dea.Scene(
        dea.read_gmsh(strip, MPI.COMM_SELF), {"film": leaky(omega, mu=1e9)},
        [dea.Electrode("top", 100.0, ohms_per_square=ohms, fed_at="x_min"), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("bottom", "y")],
        kinematics=dea.PlaneStrain(SIDE), **more,
    )  # fmt: skip


def far_end(time):
    """Potential over the fed one at the far end: the series of a line of resistors."""
    k = 2 * np.arange(40)[:, None] + 1
    return 1 - np.sum(4 / (k * np.pi) * np.sin(k * np.pi / 2) * np.exp(-(k**2) * time), axis=0)


SHEET = {
    "v": dea.AtPoint((10 * SIDE, SIDE / 10), "potential"), "q": dea.Charge("top"),
    "i": dea.Current("top"), "loss": dea.ChargeLoss(),
}  # fmt: skip


def test_charge_diffuses_along_an_electrode():
    run = solve(strip_scene(), dea.March(2.0, {"voltage": 1.0}, tolerance=1e-4), SHEET)
    time, v, loss = columns(run, "time_s", "v_V", "loss_W")
    late = time > 0.05
    assert v[late] / 100 == pytest.approx(far_end(time[late]), abs=1e-3)
    assert v[-1] == pytest.approx(100 * (1 - 4 / math.pi * math.exp(-2.0)), rel=2e-3)
    assert np.all(loss >= 0)


def test_diffusion_along_an_electrode_has_second_order():
    rise = {"voltage": dea.Rise(1.0)}
    ends = [
        solve(strip_scene(), dea.March(1.0, rise, steps=n), SHEET).history[-1]["v_V"]
        for n in (10, 20, 40)
    ]
    assert math.log2((ends[1] - ends[0]) / (ends[2] - ends[1])) == pytest.approx(2.0, abs=0.25)


def test_heat_of_a_sheet_is_what_the_source_gives_and_the_film_does_not_keep():
    """int V I dt = energy of the film + heat, by the trapezoidal rule over short steps."""
    rise = {"voltage": dea.Rise(1.0)}
    run = solve(
        strip_scene(), dea.March(1.0, rise, steps=80),
        SHEET | {"pad": dea.Potential("top"), "kept": dea.Energy("electric")},
    )  # fmt: skip
    time, pad, q, loss, kept = columns(run, "time_s", "pad_V", "q_C", "loss_W", "kept_J")
    heat = np.sum((loss[1:] + loss[:-1]) / 2 * np.diff(time))
    work = np.sum((pad[1:] + pad[:-1]) / 2 * np.diff(q))
    assert work == pytest.approx(kept[-1] + heat, rel=1e-3)


def test_an_electrode_of_little_resistance_is_ideal():
    run = solve(strip_scene(ohms=1.0), dea.March(1.0, {"voltage": dea.Rise(1.0)}, steps=4), SHEET)
    assert run.history[-1]["v_V"] == pytest.approx(100.0, rel=1e-6)


# ---------------------------------------------------------------- ranks and resuming

CYCLE = """
    import math, sys
    import dea_fenicsx as dea
    from dea_fenicsx.geometry import BoxStack, Layer
    MU, SIDE, EPS = 20e3, 1e-3, 4 * 8.8541878188e-12
    UNIT = SIDE * math.sqrt(MU / EPS)
    def film(omega):
        electric = dea.IdealDielectric(4.0, conductivity=omega * EPS)
        return dea.Material(dea.NeoHookean(MU), electric, viscous=[dea.Maxwell(MU, 1.0)])
    device = dea.read_gmsh(
        BoxStack(SIDE, None, [Layer("a", SIDE / 2), Layer("b", SIDE / 2)], divisions=(2,)))
    scene = dea.Scene(
        device, {"a": film(0.3), "b": film(0.1)},
        [dea.Source("top", 0.5 * UNIT, ohms=0.5 / (EPS * SIDE)), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("bottom", "y")],
        kinematics=dea.PlaneStrain(SIDE))
    class Stopper:
        unit, of_the_state, count = "", False, 0
        def bind(self, problem):
            def value():
                self.count += 1
                if self.count == int(sys.argv[2]):
                    raise KeyboardInterrupt
                return 0.0
            return value
    path = [
        dea.March(1.0, {"voltage": 1.0}, tolerance=1e-2), dea.Open("top"), dea.March(2.0, steps=4),
        dea.Close("top", to=0.0), dea.March(1.0, steps=3)]
    record = {"u": dea.MeanDisplacement("x_max", "x"), "v": dea.Potential("top"),
              "i": dea.Current("top"), "loss": dea.ChargeLoss(), "stop": Stopper()}
    dea.solve(scene, path, record, out=sys.argv[1], resume=True, quiet=True, stability="never")
"""


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_a_cycle_goes_on_after_a_kill_on_other_ranks(start, tmp_path, ranks):
    """Killed while it charges, with the switch open, and while it discharges."""
    script = tmp_path / "cycle.py"
    script.write_text(textwrap.dedent(CYCLE))
    start(script, tmp_path / "whole", 0, check=True)
    for last, number in ((9, 1), (8, ranks), (4, 1)):
        start(script, tmp_path / "parts", last, ranks=number)
    start(script, tmp_path / "parts", 0, ranks=ranks, check=True)
    whole, parts = (dea.read_history(tmp_path / name) for name in ("whole", "parts"))
    for name in ("time_s", "u_m", "v_V", "i_A", "loss_W"):
        assert parts[name] == pytest.approx(whole[name], rel=1e-9, abs=1e-20)


# ---------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: scene(dea.Source("top", 1.0, ohms=-1.0), leaky()), "must be >= 0"),
        (lambda: scene(dea.Source("top", 1.0, amperes=1.0), leaky()), "but no resistance"),
        (lambda: scene(dea.Electrode("top", 1.0), leaky(omega=-1.0)), "conductivity is"),
        (lambda: solve(scene(dea.Electrode("top", 1.0), leaky()), dea.Open("top")), "no source"),
        (lambda: solve(rc_scene(), dea.Ramp("voltage")), "takes no time"),
        (lambda: solve(strip_scene(), dea.Ramp("voltage")), "takes no time"),
        (lambda: scene(dea.Electrode("top", 1.0, ohms_per_square=1e3), leaky()), "where it is fed"),
        (lambda: scene(dea.Electrode("top", 1.0, fed_at="x_min"), leaky()), "but is ideal"),
        (lambda: solve(scene(dea.Electrode("top", 1.0, ohms_per_square=1e3, fed_at="bottom"),
                             leaky()), dea.March(1.0)), "does not touch it"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(make, words):
    with pytest.raises(InputError, match=words):
        make()
