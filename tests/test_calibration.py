"""Fits to tests of all kinds: what they recover, how sure they are, and what they refuse."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from conftest import on_demand

import dea_fenicsx as dea
from dea_fenicsx import exact
from dea_fenicsx.calibration import FilmTest, FunctionTest, RateTests, Scatter, SceneTest, select
from dea_fenicsx.calibration.bands import slopes_of
from dea_fenicsx.calibration.constants import constants_of, with_constants
from dea_fenicsx.calibration.parameters import Coordinates, Trial
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0, RateData, rate_stress
from dea_fenicsx.materials.stretches import nominal_stress

P = dea.Parameter
TRUE = {"elastic.mu": 15e3, "viscous[0].mu": 20e3, "viscous[0].tau": 5.0}
RUBBER = dea.Material(
    dea.NeoHookean(15e3), dea.IdealDielectric(4.7), viscous=[dea.Maxwell(20e3, 5.0)]
)
START = [P("elastic.mu", 30e3), P("viscous[0].mu", 10e3), P("viscous[0].tau", 20.0)]
LOOP = np.concatenate([np.linspace(1.0, 2.0, 9), np.linspace(1.9, 1.4, 6)])


def cycles(noise, seed, loop=LOOP, rates=(0.1, 0.01)):
    """Tests at two rates of a material with one branch, with noise in Pa."""
    rng = np.random.default_rng(seed)
    made = [RateData.at_rate("uniaxial", r, loop, 0 * loop, f"{r:g} per s") for r in rates]
    return [
        RateData("uniaxial", d.time, d.stretch, s + rng.normal(0, noise, len(s)), d.name)
        for d, s in zip(made, rate_stress(RUBBER, made), strict=True)
    ]



def refused(words, *arguments, **options):
    with pytest.raises(dea.InputError) as caught:
        dea.calibrate(*arguments, **options)
    text = str(caught.value)
    assert words in text and text.endswith(".") and "\n" not in text and len(text) <= 400, text


# ------------------------------------------------------------------ values and their certainty


def test_a_straight_line_is_that_of_least_squares():
    """Values, covariance and interval of a linear fit with known errors, by the textbook."""
    x = np.linspace(0, 1, 12)
    y = 2 + 3 * x + np.random.default_rng(3).normal(0, 0.1, 12)
    test = FunctionTest("line", lambda t, x: t["a"] + t["b"] * x, x, {"y": y}, error=0.1)
    found = dea.calibrate(test, [P("a", 1.0, positive=False), P("b", 1.0, positive=False)])
    A = np.column_stack([np.ones(12), x]) / 0.1
    C = np.linalg.inv(A.T @ A)
    assert list(found.values.values()) == pytest.approx(C @ A.T @ (y / 0.1), rel=1e-7)
    assert found.covariance == pytest.approx(C, rel=1e-6)
    low, high = found.interval("b")
    assert (high - low) / 2 == pytest.approx(1.959964 * math.sqrt(C[1, 1]), rel=1e-6)
    band = found.predict(test)["y"]
    g = np.column_stack([np.ones(12), x])
    half = 1.959964 * np.sqrt(np.einsum("ij,jk,ik->i", g, C, g))
    assert band.high - band.value == pytest.approx(half, rel=1e-5)


def test_a_prior_counts_like_a_measurement():
    """A prior of deviation s on what one value of error s measures: the mean of both."""
    test = FunctionTest("one", lambda t, x: t["a"] + 0 * x, [0, 1], {"y": [4, 4]}, error=1.0)
    found = dea.calibrate(test, [P("a", 1.0, prior=(1.0, math.sqrt(0.5)), positive=False)])
    assert found.values["a"] == pytest.approx(2.5, rel=1e-8)
    assert found.deviations["a"] == pytest.approx(0.5, rel=1e-6)


def test_an_exact_fit_of_a_viscous_material():
    """Without noise the constants come back to the derivatives' accuracy, from any start."""
    found = dea.calibrate(RateTests("cycles", cycles(0, 0)), START, RUBBER, starts=3, seed=2)
    for name, value in TRUE.items():
        assert found.values[name] == pytest.approx(value, rel=1e-6)
    assert found.material.viscous[0].tau == found.values["viscous[0].tau"]


def regions_that_hold(error, loop):
    """How many of 100 seeds have the true constants in their region of 95 %."""
    return sum(
        dea.calibrate(
            RateTests("cycles", cycles(300.0, seed, loop), error=error), START, RUBBER,
            tolerance=1e-6,
        ).contains(TRUE)
        for seed in range(100)
    )  # fmt: skip


def test_recovery_from_noise_of_known_size():
    assert 89 <= regions_that_hold(300.0, LOOP) <= 99


@on_demand
def test_recovery_from_noise_of_unknown_size():
    """The errors come from the residuals, for which the region needs some number of them."""
    loop = np.concatenate([np.linspace(1.0, 2.0, 21), np.linspace(1.95, 1.3, 14)])
    assert 89 <= regions_that_hold(None, loop) <= 99


@on_demand
@pytest.mark.slow
def test_recovery_of_a_film_under_voltage():
    """The same by `exact.trace`: stretch and charge of a film under dead loads over the voltage."""
    true = {"elastic.mu": 15e3, "electric.eps_r": 4.7}
    volts = np.linspace(0, 2500, 8)

    def film(trial):
        return exact.Film(trial.material, 1e-3, exact.Dead(10e3), exact.Dead(10e3))

    elastic = dea.Material(dea.NeoHookean(15e3), dea.IdealDielectric(4.7))
    blank = {"stretch": volts, "charge_C_per_m2": volts}
    test = FilmTest("film", film, volts, blank, over="voltage")
    made = test.predict(dea.calibrate(
        FunctionTest("unit", lambda t, x: t.material.elastic.mu / 15e3 + 0 * x, [0, 1, 2],
                     {"y": [1.0, 1.0, 1.0]}, error=1.0),
        [P("elastic.mu", 15e3)], elastic).trial())  # fmt: skip
    errors, held = {"stretch": 0.01, "charge_C_per_m2": 2e-6}, 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        data = {n: made[n] + rng.normal(0, errors[n], len(volts)) for n in errors}
        test = FilmTest("film", film, volts, data, errors, over="voltage")
        start = [P("elastic.mu", 18e3), P("electric.eps_r", 4.0)]
        held += dea.calibrate(test, start, elastic).contains(true)
    assert 89 <= held <= 99


def test_what_the_data_do_not_fix_is_named():
    """The stretch of a free film over the voltage depends on eps_r/mu alone."""
    elastic = dea.Material(dea.NeoHookean(15e3), dea.IdealDielectric(4.7))
    volts = np.linspace(200, 700, 6)
    # mu (l^2 - l^-4) = eps (V/H)^2 l^4
    unit = 1e-3 * math.sqrt(15e3 / (4.7 * EPSILON_0))
    stretch = np.linspace(1.01, 1.15, 6)
    volts = unit * np.sqrt((stretch**2 - stretch**-4) / stretch**4)
    test = FilmTest("film", lambda t: exact.Film(t.material, 1e-3), volts, {"stretch": stretch},
                    0.001, over="voltage")  # fmt: skip
    found = dea.calibrate(test, [P("elastic.mu", 20e3), P("electric.eps_r", 4.0)], elastic)
    ratio = found.values["elastic.mu"] / found.values["electric.eps_r"]
    assert ratio == pytest.approx(15e3 / 4.7, rel=1e-6)
    (loose,) = found.loose
    assert loose.parts == pytest.approx({"elastic.mu": 1.0, "electric.eps_r": 1.0}, abs=1e-3)
    assert "the data do not fix elastic.mu^+1.00 · electric.eps_r^+1.00" in str(found)
    assert found.interval("elastic.mu") == (0.0, np.inf)
    # the ratio is known, so values with another ratio are outside of the region
    assert found.contains({"elastic.mu": 30e3, "electric.eps_r": 9.4})
    assert not found.contains({"elastic.mu": 30e3, "electric.eps_r": 4.7})


def test_the_right_model_is_chosen():
    """Data of a neo-Hookean film: Yeoh's model fits as well, and costs two more constants."""
    stretch = np.linspace(1.1, 2, 20)
    stress = nominal_stress(dea.NeoHookean(5e4), "uniaxial", stretch)
    noisy = stress + np.random.default_rng(1).normal(0, 1000.0, 20)

    def test(t, x):
        return nominal_stress(t.material.elastic, "uniaxial", x)

    data = FunctionTest("slow", test, stretch, {"stress_Pa": noisy}, error=1000.0)
    candidates = {
        "Yeoh": (dea.Material(dea.Yeoh(2e4, 10.0, 1.0)), [
            P("elastic.C10", 2e4), P("elastic.C20", 10.0, positive=False),
            P("elastic.C30", 1.0, positive=False)]),
        "neo-Hookean": (dea.Material(dea.NeoHookean(3e4)), [P("elastic.mu", 3e4)]),
    }  # fmt: skip
    for criterion in ("AICc", "BIC"):
        assert select(candidates, data, criterion).best_name == "neo-Hookean"


def in_time(**options):
    """The stretch at three times of a free film that creeps under a voltage; NaN after pull-in."""
    t = np.array([1.0, 4.0, 9.0])
    course = exact.march(exact.Film(RUBBER, 1e-3), 9.0, **options)
    stretch = np.full(3, np.nan)
    there = t <= course.end_time
    stretch[there] = course.at(t[there]).stretches[0]
    measured = {"stretch": np.nan_to_num(stretch)}
    film = FilmTest("free", lambda trial: exact.Film(trial.material, 1e-3), t, measured,
                    drives=options)  # fmt: skip
    return stretch, film


def test_a_film_in_time_is_that_of_a_march():
    stretch, test = in_time(voltage=dea.Rise(30e3, seconds=6))
    assert list(np.isnan(stretch)) == [False, True, True]
    found = test.predict(Trial({}, RUBBER))["stretch"]
    assert found == pytest.approx(stretch, rel=1e-7, nan_ok=True)


@on_demand
def test_a_fit_to_a_film_in_time():
    _, test = in_time(voltage=8e3)
    found = dea.calibrate(test, [P("viscous[0].tau", 6.0)], RUBBER, tolerance=1e-6)
    assert found.values["viscous[0].tau"] == pytest.approx(5.0, rel=1e-5)


# ------------------------------------------------------------------ devices by elements


def sheet(comm, trial):
    """A quarter of a free film under voltage; its stretch depends on eps_r/mu and thickness."""
    stack = BoxStack(1e-3, 1e-3, [Layer("film", trial.get("thickness", H))], divisions=(1, 1))
    return dea.Scene(
        dea.device(stack, comm), {"film": trial.material},
        electrodes=[dea.Electrode("top", 400.0), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
    )  # fmt: skip


MU, EPS, H = 2e4, 4.0, 1e-4
STRETCH = 1.05
VOLTS = H * math.sqrt(MU / (EPS * EPSILON_0) * (STRETCH**2 - STRETCH**-4) / STRETCH**4)


def sheet_test(**options):
    """Stretch and capacitance of the film at a voltage, from the closed form."""
    measured = {"capacitance_F": [EPS * EPSILON_0 * 1e-6 / H * STRETCH**4], "wide": [STRETCH]}
    record = {"capacitance": dea.Capacitance("top"),
              "wide": dea.MeanStretch(("x_min", "x_max"), "x")}  # fmt: skip
    return SceneTest("sheet", sheet, dea.Ramp(to=VOLTS / 400, steps=1), record, [VOLTS], measured,
                     variables={"thickness": "thickness:film:z"}, **options)  # fmt: skip


def test_slopes_of_elements_are_those_of_differences():
    """By the adjoint of the run, beside solutions of neighbours with a step of 0.1 %."""
    elastic = dea.Material(dea.NeoHookean(MU), dea.IdealDielectric(EPS))
    names = [P("elastic.mu", MU), P("electric.eps_r", EPS), P("thickness", H)]
    over = Coordinates(names, elastic)
    exact_ones, differences = (
        slopes_of(over, over.start, sheet_test(exact_slopes=kind)) for kind in (True, False)
    )
    for column, slopes in exact_ones.items():
        assert slopes == pytest.approx(differences[column], rel=1e-5)
    # the stretch depends on eps_r/(mu H^2), and the capacitance on that and on eps_r/H
    wide = exact_ones["wide"][0]
    assert wide / wide[1] == pytest.approx([-1.0, 1.0, -2.0], rel=1e-7)


def test_elements_give_the_constants_of_exact_states():
    elastic = dea.Material(dea.NeoHookean(1.8e4), dea.IdealDielectric(3.5))
    values = [P("elastic.mu", 1.8e4), P("electric.eps_r", 3.5, prior=(3.0, 10.0))]
    error = {"capacitance_F": 1e-15, "wide": 1e-5}
    found = dea.calibrate(sheet_test(exact_slopes=False, error=error), values, elastic)
    assert found.values["elastic.mu"] == pytest.approx(MU, rel=1e-4)
    assert found.values["electric.eps_r"] == pytest.approx(EPS, rel=1e-4)


# ------------------------------------------------------------------ bad input, and what is written


def test_bad_input_in_one_sentence():
    tests = RateTests("cycles", cycles(300.0, 0))
    refused("did you mean 'elastic.mu'?", tests, [P("elastic.mue", 1e4)], RUBBER)
    refused("did you mean 'viscous[0].tau'?", tests, [P("viscous[1].tau", 1e4)], RUBBER)
    refused("No test reads the parameter 'thickness'", tests, [P("thickness", 1e-3)], RUBBER)
    refused("'elastic.mu' is given twice", tests, [P("elastic.mu", 1e4)] * 2, RUBBER)
    refused("must be > 0", tests, [P("elastic.mu", -1e4)], RUBBER)
    refused("out of its bounds", tests, [P("elastic.mu", 1e4, low=2e4)], RUBBER)
    refused("no parameters", tests, [], RUBBER)
    refused("no tests", [], [P("elastic.mu", 1e4)], RUBBER)
    refused("must hold RateTests", [3], [P("elastic.mu", 1e4)], RUBBER)
    with pytest.raises(dea.InputError, match="no keyword 'start'; did you mean 'starts'"):
        dea.calibrate(tests, [P("elastic.mu", 1e4)], RUBBER, start=3)
    with pytest.raises(dea.InputError, match=r"reads the parameter 'a', .* did you mean 'aa'"):
        dea.calibrate(FunctionTest("x", lambda t, x: t["a"], [0, 1], {"y": [0, 1]}), [P("aa", 1.0)])
    refused("none is given", tests, [P("a", 1e4)])
    two = FunctionTest("two", lambda t, x: t["a"] + t["b"] * x, [0, 1], {"y": [0, 1]})
    refused("There are 2 measured values, but 2 parameters", two, [P("a", 1.0), P("b", 1.0)])
    refused("must be finite", FunctionTest("x", lambda t, x: t["a"], [0], {"y": [np.nan]}),
            [P("a", 1.0)])  # fmt: skip
    refused("has no 'y' at x = 1", FunctionTest(
        "x", lambda t, x: np.where(x > 0, np.nan, t["a"]), [0, 1], {"y": [1, 2]}), [P("a", 1.0)])
    refused("predicts no column 'y'", FunctionTest(
        "x", lambda t, x: {"z": t["a"]}, [0, 1], {"y": [1, 2]}), [P("a", 1.0)])  # fmt: skip
    film = FilmTest("film", lambda t: exact.Film(t.material, 1e-3), [1.0], {"strech": [1.0]})
    refused("did you mean 'stretch'?", film, [P("elastic.mu", 1e4)], RUBBER)


def test_a_wrong_unit_is_doubted():
    data = [RateData("uniaxial", d.time, d.stretch, d.stress / 1e3) for d in cycles(300.0, 0)]
    with pytest.warns(UserWarning, match="must be in SI units"):
        dea.calibrate(RateTests("in kPa", data), START, RUBBER)


def test_the_report_is_written(tmp_path):
    found = dea.calibrate(RateTests("cycles", cycles(300.0, 0)), START, RUBBER)
    found.write(tmp_path)
    told = json.loads((tmp_path / "calibration.json").read_text("utf-8"))
    assert told["parameters"]["elastic.mu"]["value"] == found.values["elastic.mu"]
    assert set(told["columns"]) == {"cycles: 0.1 per s", "cycles: 0.01 per s"}
    assert (tmp_path / "calibration.png").stat().st_size > 10_000
    assert "elastic.mu = " in (tmp_path / "calibration.txt").read_text("utf-8")


def test_constants_by_their_names():
    both = {"a": RUBBER, "b": dea.Material(dea.Ogden((1e4, 2e3), (1.3, 5.0)))}
    names = constants_of(both)
    assert names["a.viscous[0].tau"] == 5.0 and names["b.elastic.alpha[1]"] == 5.0
    changed = with_constants(both, {"a.viscous[0].tau": 7.0, "b.elastic.alpha[1]": 4.0})
    assert changed["a"].viscous[0] == dea.Maxwell(20e3, 7.0)
    assert changed["b"].elastic.alpha == (1.3, 4.0) and both["b"].elastic.alpha == (1.3, 5.0)


# ------------------------------------------------------------------ uncertainty forward


def free_film(mu, eps_r, H):
    """Stretch at a voltage far below pull-in, and the voltage of pull-in, in closed form."""
    pull_in = 0.6873648 * H * math.sqrt(mu / (eps_r * EPSILON_0))
    return {"pull_in_V": pull_in, "thinning": (500.0 / pull_in) ** 2}


def test_scatter_of_pull_in():
    """V = 0.687 H sqrt(mu/eps): relative variances 1, 1/4 and 1/4; sampling agrees."""
    scatter = {
        "mu": Scatter(5e4, 2.5e3), "eps_r": Scatter(3.0, 0.06, "lognormal"),
        "H": Scatter(1e-4, 3e-6),
    }  # fmt: skip
    found = dea.uncertainty(free_film, scatter, samples=400, failure={"pull_in_V": 2500.0})
    linear = math.sqrt(0.03**2 + 0.05**2 / 4 + 0.02**2 / 4)
    value = found.value["pull_in_V"]
    assert found.deviation["pull_in_V"] / value == pytest.approx(linear, rel=1e-5)
    assert found.shares["pull_in_V"]["H"] == pytest.approx(0.03**2 / linear**2, rel=1e-4)
    assert found.sampled_deviation["pull_in_V"] == pytest.approx(value * linear, rel=0.05)
    p = 0.5 * math.erfc((value - 2500) / (value * linear * math.sqrt(2)))
    assert found.failure["pull_in_V"] == pytest.approx(p, rel=1e-3)
    sampled, error = found.sampled_failure["pull_in_V"]
    assert abs(sampled - p) < 3 * error
    given = dea.uncertainty(
        free_film, scatter, samples=0,
        slopes=lambda mu, eps_r, H: {
            "pull_in_V": {"mu": value / (2 * mu), "eps_r": -value / (2 * eps_r), "H": value / H},
            "thinning": {"mu": 0.0, "eps_r": 0.0, "H": 0.0},
        },
    )  # fmt: skip
    assert given.deviation["pull_in_V"] == pytest.approx(found.deviation["pull_in_V"], rel=1e-4)


def test_uncertainty_refuses():
    for words, scatter, options in (
        ("at least one Scatter", {}, {}),
        ("must be a number > 0", {"mu": Scatter(1.0, -1.0)}, {}),
        ("must be Scatter", {"mu": 3}, {}),
        ("one of normal", {"mu": Scatter(1, 1, "x")}, {}),
        ("named 'strok'; did you mean 'stroke'?", {"mu": Scatter(1.0, 0.1)},
         {"failure": {"strok": 1.0}}),
    ):  # fmt: skip
        with pytest.raises(dea.InputError, match=r"[.]$") as caught:
            dea.uncertainty(lambda mu: {"stroke": mu}, scatter, **options)
        assert words in str(caught.value)
