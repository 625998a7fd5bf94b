"""Fit a viscous material to all tests of VHB 4905 at once, and predict a test under voltage.

The tests at 20 degrees are relaxation from 900 s on, cycles at several rates, slow loading, and the
permittivity up to 10 Hz (Liao et al. 2020).  Several models of the equilibrium with several numbers
of branches are fitted, and Akaike's corrected criterion chooses.  Then the chosen model is refitted
to a cycle at 50 degrees without voltage.  There the constants at 20 degrees are known within a
factor of about 1.6, and the relaxation times within a factor of e.  With the permittivity measured
at 40 and 60 degrees the model predicts the cycle at 6000 V, which is not fitted.

Stretches are exact; nothing here needs a mesh.
"""

import csv
import json
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx import exact
from dea_fenicsx.calibration import FilmTest, FunctionTest, RateTests, select
from dea_fenicsx.materials import RateData, read_cycles
from dea_fenicsx.materials.stretches import nominal_stress

DATA = Path(__file__).resolve().parent / "calibrate_vhb_data"
THICKNESS = 0.5e-3  # m
SLOW = 10.0  # Hz: permittivities up to there are those of these tests
KELVIN = 293.15, 313.15, 333.15
SPREAD_MODULI, SPREAD_TIMES = 0.5, 1.0
"""Standard deviations of the logarithms of constants at 50 degrees about those at 20 degrees."""

P = dea.Parameter
MODELS = {
    "yeoh": (
        dea.Yeoh(1e4, -50.0, 0.5),
        [P("elastic.C10", 1e4), P("elastic.C20", -50.0, positive=False), P("elastic.C30", 0.5)],
    ),
    "gent": (dea.Gent(1.5e4, 400.0), [P("elastic.mu", 1.5e4), P("elastic.Jm", 400.0, 80.0)]),
    "ogden": (
        dea.Ogden((2.7e4, 75.0), (1.2, 4.6)),
        [P("elastic.mu[0]", 2.7e4), P("elastic.mu[1]", 75.0), P("elastic.alpha[0]", 1.2),
         P("elastic.alpha[1]", 4.6)],
    ),
}  # fmt: skip


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/calibrate_vhb")
    parser.add_argument("--models", nargs="+", choices=sorted(MODELS), default=["yeoh", "ogden"],
                        help="models of the equilibrium; moduli are fitted in Pa")  # fmt: skip
    parser.add_argument("--branches", nargs="+", type=int, default=[2, 3], metavar="N",
                        help="numbers of viscous branches")  # fmt: skip
    parser.number("--volts", 6000.0, "V", "voltage of the predicted test (measured: 6000)")
    parser.add_argument("--no-band", action="store_true", help="predict without a band")
    return parser, parser.parse_args()


def table(name):
    return np.genfromtxt(DATA / name, delimiter=",", comments="#", skip_header=2)


def permittivities(kelvin):
    """Frequencies in Hz up to `SLOW`, and relative permittivities."""
    rows = table("vhb4905_permittivity.csv")
    rows = rows[(rows[:, 0] == kelvin) & (rows[:, 1] <= SLOW)]
    return rows[:, 1], rows[:, 2]


def tests_at_20():
    rows = table("vhb4905_relaxation_liao2020.csv")
    held = [
        RateData.relaxation("uniaxial", stretch, *rows[rows[:, 1] == stretch][:, 2:].T,
                            f"held at {stretch:g}")
        for stretch in np.unique(rows[:, 1])
    ]  # fmt: skip
    cycles = read_cycles(DATA / "vhb4905_cyclic_liao2020.csv", "uniaxial", (0, 1, 2, 3))
    slow = table("vhb4905_quasistatic_liao2020.csv")
    frequencies, eps_r = permittivities(KELVIN[0])
    return [
        RateTests("relaxation", held, x_name="time_s"),
        RateTests("cycles", cycles),
        FunctionTest("slow", lambda t, x: nominal_stress(t.material.elastic, "uniaxial", x),
                     slow[:, 1], {"nominal_stress_Pa": slow[:, 2]}, x_name="stretch"),
        FunctionTest("permittivity", lambda trial, x: np.full(len(x), trial["electric.eps_r"]),
                     frequencies, {"eps_r": eps_r}, x_name="frequency_Hz"),
    ]  # fmt: skip


def candidate(model, branches):
    """A material to start from, and what is fitted of it."""
    elastic, parameters = MODELS[model]
    times = np.geomspace(2, 1000, branches)
    viscous = [dea.Maxwell(2e4, float(tau)) for tau in times]
    own = [
        one for k, tau in enumerate(times)
        for one in (P(f"viscous[{k}].mu", 2e4, 10.0, 1e7),
                    P(f"viscous[{k}].tau", float(tau), 0.01, 1e6))
    ]  # fmt: skip
    material = dea.Material(elastic, dea.IdealDielectric(4.7), viscous=viscous)
    return material, [*parameters, *own, P("electric.eps_r", 4.7)]


def coupled(volts):
    """Times in s, stretches and nominal stresses in Pa of the test at 50 degrees."""
    rows = table("vhb4905_coupled_50C.csv")
    rows = rows[rows[:, 1] == volts]
    time = np.append(0.0, np.cumsum(np.abs(np.diff(rows[:, 3])))) / rows[0, 2]
    return time, rows[:, 3], rows[:, 4]


def refit(found):
    """The constants at 50 degrees, from the test without voltage and those at 20 degrees."""
    time, stretch, stress = coupled(0)
    parameters = []
    for one in found.parameters:
        if one.name == "electric.eps_r":
            continue
        value = found.values[one.name]
        spread = SPREAD_TIMES if one.name.endswith("tau") else SPREAD_MODULI
        spread = 0.1 if "alpha" in one.name else spread
        prior = (value, spread if one.positive else SPREAD_MODULI * abs(value))
        parameters.append(P(one.name, value, prior=prior, positive=one.positive))
    eps_r = float(np.mean([permittivities(kelvin)[1].mean() for kelvin in KELVIN[1:]]))
    start = found.material
    material = dea.Material(start.elastic, dea.IdealDielectric(eps_r), viscous=start.viscous)
    data = [RateData("uniaxial", time, stretch, stress, "0 V")]
    test = RateTests("at 50 degrees", data)
    return dea.calibrate(test, parameters, material, comm=MPI.COMM_SELF), eps_r


def predicted_test(volts):
    """The test under voltage: a strip that is stretched along, free across, slack if pressed."""
    time, stretch, stress = coupled(6000)
    top = int(np.argmax(stretch))
    course = dea.Table([0.0, time[top], time[-1]], [stretch[0], stretch[top], stretch[-1]])
    return stretch, FilmTest(
        "under voltage",
        lambda trial: exact.Film(trial.material, THICKNESS, exact.Held(1.0), exact.FREE),
        time, {"stress_Pa": stress}, drives={"voltage": volts, "sides": (course, None)},
        slack=True,
    )  # fmt: skip


def main():
    parser, args = parse()
    if MPI.COMM_WORLD.rank != 0:
        return  # nothing here is shared work
    alone = {"comm": MPI.COMM_SELF}
    candidates = {f"{m}, {n} branches": candidate(m, n) for m in args.models for n in args.branches}
    chosen = select(candidates, tests_at_20(), "AICc", **alone)
    found = chosen.best
    warm, eps_r = refit(found)
    stretch, test = predicted_test(args.volts)
    if args.no_band:
        value = test.predict(warm.trial())["stress_Pa"]
        low = high = value
    else:
        band = warm.predict(test)["stress_Pa"]
        value, low, high = band.value, band.low, band.high
    measured = test.measured["stress_Pa"]
    rms = float(np.sqrt(np.mean((value - measured) ** 2)))
    taut = measured > 0
    size = float(np.sqrt(np.mean(measured**2)))
    out = found.write(args.out)
    told = {
        "status": "completed", "model": chosen.best_name, "criterion": chosen.criterion,
        "scores": chosen.scores,
        "rms": {one.name: one.rms for one in found.columns},
        "relative_rms": {one.name: one.relative for one in found.columns},
        "constants": found.values, "loose": [str(d) for d in found.loose],
        "constants_50C": warm.values, "eps_r_50C": eps_r,
        "refit_rms_Pa": warm.columns[0].rms, "refit_relative_rms": warm.columns[0].relative,
        "predicted_rms_Pa": rms, "predicted_relative_rms": rms / size,
        "predicted_taut_rms_Pa": float(np.sqrt(np.mean((value - measured)[taut] ** 2))),
        "without_voltage_rms_Pa": without_voltage(warm, test, stretch),
        "settings": parser.settings(args),
    }  # fmt: skip
    (out / "summary.json").write_text(json.dumps(told, indent=1) + "\n", "utf-8")
    curves = (stretch, measured, value, low, high)
    history(out, args.volts, curves)
    draw(out, warm, args.volts, curves)
    if not args.quiet:
        print(f"{chosen}\n\n{chosen.best_name}\n{found}\n\nat 50 degrees, 0 V\n{warm}\n")
        print(f"at 50 degrees, {args.volts:g} V, predicted with eps_r {eps_r:.3f}: root mean "
              f"square error {rms:.0f} Pa ({100 * rms / size:.1f} %); with the prediction for 0 V "
              f"in its place {told['without_voltage_rms_Pa']:.0f} Pa")  # fmt: skip
        print(f"results: {out}/summary.json, calibration.png, coupled.png")


def without_voltage(warm, test, stretch):
    """The error if the voltage changed nothing: what the prediction has to do better than."""
    data = RateData("uniaxial", test.x, stretch, test.measured["stress_Pa"])
    stress = np.maximum(dea.materials.rate_stress(warm.material, data)[0], 0.0)
    return float(np.sqrt(np.mean((stress - data.stress) ** 2)))


def history(out, volts, curves):
    with (out / "history.csv").open("w", newline="", encoding="utf-8") as f:
        writer = csv.writer(f)
        writer.writerow(["step", "voltage_V", "stretch", "measured_Pa", "predicted_Pa",
                         "predicted_low_Pa", "predicted_high_Pa"])  # fmt: skip
        rows = zip(*curves, strict=True)
        writer.writerows([k + 1, volts, *map(float, row)] for k, row in enumerate(rows))


def draw(out, warm, volts, curves):
    stretch, measured, value, low, high = curves
    figure = Figure(figsize=(4.2, 3.2), layout="constrained")
    axes = figure.subplots()
    cold = warm.columns[0]
    axes.plot(cold.column.x, cold.column.measured / 1e3, "o", ms=2.5, mfc="none", color="C0",
              label="measured, 0 V")  # fmt: skip
    axes.plot(cold.column.x, cold.predicted / 1e3, color="C0", lw=1, label="fitted, 0 V")
    axes.plot(stretch, measured / 1e3, "s", ms=2.5, mfc="none", color="C1",
              label="measured, 6000 V")  # fmt: skip
    axes.plot(stretch, value / 1e3, color="C1", lw=1, label=f"predicted, {volts:g} V")
    for end in (low, high):
        axes.plot(stretch, end / 1e3, ":", color="C1", lw=0.6)
    axes.set(xlabel="Stretch (-)", ylabel="Nominal stress (kPa)", title="VHB 4905, 50 °C, 0.2 /s")
    axes.legend(fontsize=7, frameon=False)
    figure.savefig(out / "coupled.png", dpi=200)


if __name__ == "__main__":
    main()
