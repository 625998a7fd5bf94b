"""VHB 4905 from -20 to 80 degrees: shift factors, permittivity, and temperatures left out.

Cyclic tests at six temperatures (Liao et al. 2020) give a spectrum of viscous branches at 20
degrees and the factors by which their relaxation times change, each by itself and by the law of
Williams, Landel and Ferry (WLF).  Moduli are entropic.  Then temperatures are left out in turn: the
fit to all others predicts the tests there.  The permittivity up to 10 Hz gets a straight line, and
is predicted likewise.  At last the material predicts a cycle at 50 degrees, where nothing is
fitted.

Stretches are exact; nothing here needs a mesh.
"""

import csv
import json
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.materials import RateData, fit_temperatures, rate_stress, read_cycles

HERE = Path(__file__).resolve().parent
DATA, OTHERS = HERE / "vhb_temperatures_data", HERE / "calibrate_vhb_data"
CELSIUS, REFERENCE, FIFTY = 273.15, 293.15, 323.15
LARGEST = 5.0  # two tests at 20 degrees go to stretch 9, which no other temperature does
SLOW = 10.0  # Hz
EQUILIBRIUM = dea.Gent(1e4, 100.0)
TIMES = np.logspace(-7, 4, 12)  # s
COLUMNS = (
    "temperature_K", "log10_shift", "log10_shift_wlf", "relative_rms_error",
    "predicted_relative_rms_error", "eps_r", "eps_r_line", "predicted_eps_r",
)  # fmt: skip


def table(path):
    return np.genfromtxt(path, delimiter=",", comments="#", skip_header=2)


def tests_by_temperature():
    """Cyclic tests at each temperature in K."""
    rows = table(DATA / "vhb4905_cyclic_temperatures_liao2020.csv")
    at_20 = read_cycles(OTHERS / "vhb4905_cyclic_liao2020.csv", "uniaxial", (0, 1, 2, 3))
    found = {REFERENCE: at_20}
    for name in np.unique(rows[:, 0]):
        one = rows[rows[:, 0] == name]
        test = RateData.at_rate("uniaxial", one[0, 2], one[:, 3], one[:, 4], f"{name:.0f}")
        found.setdefault(float(one[0, 1]), []).append(test)
    some = {k: [t for t in tests if t.stretch.max() < LARGEST] for k, tests in found.items()}
    return dict(sorted(some.items()))


def permittivities():
    """Mean relative permittivity up to 10 Hz at each temperature in K."""
    rows = table(DATA / "vhb4905_permittivity.csv")
    rows = rows[rows[:, 1] <= SLOW]
    return {float(k): float(rows[rows[:, 0] == k, 2].mean()) for k in np.unique(rows[:, 0])}


def line(values):
    """Permittivity at 20 degrees, and its change per K over it."""
    slope, at_20 = np.polyfit(np.array(list(values)) - REFERENCE, list(values.values()), 1)
    return at_20, slope / at_20


def fitted(tests):
    return fit_temperatures(tests, REFERENCE, EQUILIBRIUM, TIMES)


def at_fifty(material):
    """Stretches, measured stresses and those of the material in the cycle at 50 degrees, in Pa."""
    rows = table(OTHERS / "vhb4905_coupled_50C.csv")
    rows = rows[rows[:, 1] == 0]  # without voltage
    test = RateData.at_rate("uniaxial", rows[0, 2], rows[:, 3], rows[:, 4])
    return test.stretch, test.stress, rate_stress(material, test)[0]


def relative(found, measured):
    return float(np.sqrt(np.mean((found - measured) ** 2) / np.mean(measured**2)))


def main():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/vhb_temperatures")
    parser.add_argument("--left-out", nargs="*", type=float, default=[0.0, 40.0, 60.0],
                        metavar="DEGREES", help="temperatures in degrees Celsius that are "
                        "predicted (default: 0 40 60)")  # fmt: skip
    args = parser.parse_args()
    if MPI.COMM_WORLD.rank != 0:
        return  # nothing here is shared work
    tests, eps = tests_by_temperature(), permittivities()
    left_out = [round(degrees + CELSIUS, 2) for degrees in args.left_out]
    for kelvin in left_out:
        if kelvin not in sorted(tests)[1:-1] or kelvin == REFERENCE:
            parser.error("--left-out needs temperatures of 0, 40 or 60 degrees Celsius")
    fit, (eps_20, per_kelvin) = fitted(tests), line(eps)
    partial = {
        left: fitted({k: some for k, some in tests.items() if k != left}) for left in left_out
    }
    predicted = {left: one.predicted(left, tests[left]) for left, one in partial.items()}
    lines = {left: line({k: e for k, e in eps.items() if k != left}) for left in left_out}
    eps_predicted = {k: e * (1 + a * (k - REFERENCE)) for k, (e, a) in lines.items()}
    thermal = dea.Thermal(
        REFERENCE, min(tests), max(tests), modulus=fit.material.thermal.modulus,
        shift=fit.shift, permittivity=dea.LinearChange(per_kelvin),
    )  # fmt: skip
    material = dea.Material(
        fit.material.elastic, dea.IdealDielectric(eps_20), viscous=fit.material.viscous,
        thermal=thermal,
    )  # fmt: skip
    stretch, measured, found = at_fifty(material.at(FIFTY))
    rows = [
        (k, fit.shifts[k], float(np.log10(fit.shift.factor(k, REFERENCE))), fit.errors[k],
         predicted.get(k), eps.get(k), eps_20 * (1 + per_kelvin * (k - REFERENCE)),
         eps_predicted.get(k))
        for k in tests
    ]  # fmt: skip
    summary = {
        "WLF_C1": fit.shift.C1, "WLF_C2_K": fit.shift.C2, "reference_K": REFERENCE,
        "eps_r_at_20": eps_20, "permittivity_per_kelvin": per_kelvin,
        "equilibrium_modulus_Pa": fit.material.elastic.shear_modulus(),
        "branches": [{"mu_Pa": b.mu, "tau_s": b.tau} for b in fit.material.viscous],
        "log10_shift": {f"{k:g}": a for k, a in fit.shifts.items()},
        "relative_rms_error": {f"{k:g}": e for k, e in fit.errors.items()},
        "predicted_relative_rms_error": {f"{k:g}": e for k, e in predicted.items()},
        "predicted_eps_r_relative_error": {
            f"{k:g}": e / eps[k] - 1 for k, e in eps_predicted.items()
        },
        "at_50_degrees_relative_rms_error": relative(found, measured),
    }  # fmt: skip
    out = Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    (out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", "utf-8")
    with (out / "temperatures.csv").open("w", newline="", encoding="utf-8") as f:
        writer = csv.writer(f)
        writer.writerow(COLUMNS)
        writer.writerows([["" if v is None else v for v in row] for row in rows])
    draw(out / "temperatures.png", tests, fit, partial, rows, (stretch, measured, found))
    if not args.quiet:
        report(fit, rows, summary)
        print(f"\nresults: {out}/summary.json, temperatures.csv, temperatures.png")


def report(fit, rows, summary):
    print(f"{fit.shift} about 20 degrees, {len(fit.material.viscous)} branches")
    print("degrees  log10 a   by WLF   error %   predicted %   eps_r   by the line   predicted")

    def told(value, form):
        return "-" if value is None else format(value, form)

    for k, a, wlf, error, left, eps, straight, guessed in rows:
        print(f"{k - CELSIUS:7.0f}  {a:7.2f}  {wlf:7.2f}  {100 * error:8.1f}  "
              f"{told(left and 100 * left, '.1f'):>12}  {told(eps, '.3f'):>6}  {straight:12.3f}  "
              f"{told(guessed, '.3f'):>10}")  # fmt: skip
    error = summary["at_50_degrees_relative_rms_error"]
    print(f"cycle at 50 degrees, where nothing is fitted: {100 * error:.1f} %")


def draw(path, tests, fit, partial, rows, cycle):
    """Shift factors, permittivity, a cycle at each temperature, and that at 50 degrees."""
    figure = Figure(figsize=(10.0, 7.6), layout="constrained")
    (shift, eps), (stress, fifty) = figure.subplots(2, 2)
    columns = dict(zip(COLUMNS, zip(*rows, strict=True), strict=True))
    degrees = np.array(columns["temperature_K"]) - CELSIUS
    fine = np.linspace(degrees[0], degrees[-1], 200)
    shift.plot(degrees, columns["log10_shift"], "o", label="each by itself")
    shift.plot(fine, np.log10(fit.shift.factor(fine + CELSIUS, REFERENCE)), label="WLF")
    for left, one in partial.items():
        value = np.log10(one.shift.factor(left, REFERENCE))
        shift.plot(left - CELSIUS, value, "kx", label="left out" if left == min(partial) else None)
    shift.set(xlabel="Temperature (degrees Celsius)", ylabel="log10 of the shift factor (-)")
    eps.plot(degrees, [np.nan if e is None else e for e in columns["eps_r"]], "o", label="measured")
    eps.plot(degrees[1:], columns["eps_r_line"][1:], label="straight line")
    guessed = [np.nan if e is None else e for e in columns["predicted_eps_r"]]
    eps.plot(degrees, guessed, "kx", label="left out")
    eps.set(xlabel="Temperature (degrees Celsius)", ylabel="Relative permittivity (-)")
    colours = dict(zip(tests, ("C4", "C0", "C2", "C8", "C1", "C3"), strict=True))
    for kelvin, some in tests.items():
        test = min(some, key=lambda t: abs(t.stretch.max() - 3.0))
        label = f"{kelvin - CELSIUS:.0f} degrees"
        stress.semilogy(test.stretch[::3], np.maximum(test.stress[::3], 1.0) / 1e3, "o", ms=2.5,
                        color=colours[kelvin], label=label)  # fmt: skip
        for style, one in (("-", fit), ("--", partial.get(kelvin))):
            if one is not None:
                found = rate_stress(one.material.at(kelvin), test)[0]
                stress.semilogy(test.stretch, np.where(found > 0, found, np.nan) / 1e3, style, lw=1,
                                color=colours[kelvin])  # fmt: skip
    stress.set(xlabel="Stretch (-)", ylabel="Nominal stress (kPa)", ylim=(5.0, 5e3),
               title="solid: fitted to all; dashed: left out")  # fmt: skip
    stretch, measured, found = cycle
    fifty.plot(stretch, measured / 1e3, "o", ms=2.5, label="measured")
    fifty.plot(stretch, found / 1e3, lw=1, label="predicted")
    fifty.set(xlabel="Stretch (-)", ylabel="Nominal stress (kPa)", title="50 degrees, not fitted")
    for axes in (shift, eps, stress, fifty):
        axes.legend(fontsize=7, frameon=False)
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main()
