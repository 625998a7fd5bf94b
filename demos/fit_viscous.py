"""Fit viscous branches of VHB 4910 to cyclic tests, and predict a test that was not fitted.

The data in fit_viscous_data are those of Hossain et al. 2012: uniaxial loading and unloading at
0.01, 0.03 and 0.05 /s.  The demo prints and draws the errors of three sets of constants.  The first
set is that of Wang et al. 2016 (the preset `vhb4910-wang2016-viscous`).  The second set is fitted
to all tests.  The third set is fitted to the tests at 0.01 and 0.05 /s, and predicts the one at
0.03 /s.  For your own data use `dea.materials.RateData`: it takes relaxation and any test of known
stretch.
"""

import json
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.materials import fit_rates, rate_errors, rate_stress, read_cycles

DATA = Path(__file__).resolve().parent / "fit_viscous_data" / "vhb4910_cyclic_hossain2012.csv"
MODELS = {"neo-hookean": dea.NeoHookean, "yeoh": dea.Yeoh}


def main():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/fit_viscous")
    parser.add_argument("--model", choices=sorted(MODELS), default="yeoh",
                        help="elastic model of the equilibrium; moduli are fitted in Pa "
                        "(default: %(default)s)")  # fmt: skip
    args = parser.parse_args()
    if MPI.COMM_WORLD.rank != 0:
        return  # nothing here is shared work
    tests = read_cycles(DATA, "uniaxial", columns=(0, 1, 2, 3))
    rates = [rate_of(test) for test in tests]
    some = [t for t, rate in zip(tests, rates, strict=True) if abs(rate - 0.03) > 0.005]
    chosen, partial = fit_rates(MODELS[args.model], tests), fit_rates(MODELS[args.model], some)
    sets = {
        "Wang et al. 2016": dea.materials.get("vhb4910-wang2016-viscous"),
        "fitted to all": chosen.material,
        "fitted without 0.03 /s": partial.material,
    }
    errors = {name: rate_errors(material, tests) for name, material in sets.items()}
    size = np.array([np.sqrt(np.mean(t.stress**2)) for t in tests])
    summary = {
        "tests": [
            {"name": t.name, "rate_per_s": rate, "largest_stretch": float(t.stretch.max())}
            for t, rate in zip(tests, rates, strict=True)
        ],
        "rms_error_Pa": {name: e.tolist() for name, e in errors.items()},
        "relative_rms_error": {name: (e / size).tolist() for name, e in errors.items()},
        "predicted_rms_error_Pa": [
            float(e) for e, rate in zip(errors["fitted without 0.03 /s"], rates, strict=True)
            if abs(rate - 0.03) <= 0.005
        ],
        "criterion": {str(k): float(v) for k, v in chosen.criterion.items()},
        "constants": chosen.material.parameters(),
        "branches": [{"mu_Pa": b.mu, "tau_s": b.tau} for b in chosen.branches],
        "standard_deviations": [{"mu_Pa": m, "tau_s": t} for m, t in chosen.branch_uncertainty],
    }  # fmt: skip
    out = Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    (out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", "utf-8")
    draw(tests, rates, sets, out)
    if not args.quiet:
        report(tests, rates, errors, chosen, partial)
        print(f"\nresults: {out}/summary.json, cycles.png")


def rate_of(test):
    """Rate of the stretch in 1/s."""
    return float(np.median(np.abs(np.diff(test.stretch)) / np.diff(test.time)))


def report(tests, rates, errors, chosen, partial):
    print(f"fitted to all:          {chosen}")
    print(f"fitted without 0.03 /s: {partial}\n")
    print("root mean square errors in kPa")
    print("test  rate 1/s  to stretch  " + "  ".join(f"{name:>22}" for name in errors))
    for k, (test, rate) in enumerate(zip(tests, rates, strict=True)):
        row = "  ".join(f"{e[k] / 1e3:22.2f}" for e in errors.values())
        predicted = "  (predicted)" if abs(rate - 0.03) <= 0.005 else ""
        print(f"{test.name:>4}  {rate:8.2f}  {test.stretch.max():10.2f}  {row}{predicted}")


def draw(tests, rates, sets, out):
    """A panel for each largest stretch; measured points, and the curves of each set."""
    tops = sorted({round(float(t.stretch.max()), 1) for t in tests})
    colours = {0.01: "tab:blue", 0.03: "tab:green", 0.05: "tab:red"}
    styles = dict(zip(sets, (":", "-", "--"), strict=True))
    figure = Figure(figsize=(9.0, 6.4), layout="constrained")
    for axes, top in zip(figure.subplots(2, 2).flat, tops, strict=True):
        for k, (test, rate) in enumerate(zip(tests, rates, strict=True)):
            if round(float(test.stretch.max()), 1) != top:
                continue
            colour = colours[round(rate, 2)]
            axes.plot(test.stretch[::3], test.stress[::3] / 1e3, "o", ms=2.5, color=colour,
                      label=f"measured, {rate:.2f} /s")  # fmt: skip
            for name, material in sets.items():
                stress = rate_stress(material, test)[0] / 1e3
                label = name if k == 0 else None
                axes.plot(test.stretch, stress, styles[name], lw=1, color=colour, label=label)
        axes.set(title=f"to stretch {top:g}", xlabel="Stretch (-)", ylabel="Nominal stress (kPa)")
        axes.legend(fontsize=6, frameon=False)
    figure.savefig(out / "cycles.png", dpi=200)


if __name__ == "__main__":
    main()
