"""Fit every elastic model to Treloar's 1944 data: uniaxial, planar and equi-biaxial at once.

This is the standard test of a rubber model: can one set of constants describe three kinds of
loading?  In the uniaxial test a strip is pulled.  In the planar test a wide strip is pulled, whose
width stays.  In the equi-biaxial test a sheet is pulled equally in two directions.  The rubber is a
vulcanised natural rubber.  The data are those of Treloar, Trans. Faraday Soc. 40 (1944) 59, as
digitised in the folder fit_rubber_data.  The tutorial fits six elastic models.  It prints their
constants and how well they fit: R^2 (1 is perfect) and the relative residual (0 is perfect).

Read your own data with `dea.materials.read_data`, or put arrays of stretch and nominal stress into
`dea.materials.TestData`.  Run this script with `python demos/fit_rubber.py`.
"""

import json
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.materials import TestData, fit, read_data
from dea_fenicsx.materials.stretches import nominal_stress

FILES = {"uniaxial": "UT", "planar": "PS", "equibiaxial": "ET"}
DATA = Path(__file__).resolve().parent / "fit_rubber_data"
THREE_TERMS = dea.Ogden.from_eq76((4e5, 3e3, -1e4), (1.5, 5.0, -2.0))  # where the search starts
MODELS = (dea.NeoHookean, dea.MooneyRivlin, dea.Yeoh, dea.Gent, dea.ArrudaBoyce, THREE_TERMS)


def main():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/fit_rubber")
    parser.number("--largest-stretch", 8.0, "-", "use the data up to this stretch (stress in Pa)")
    args = parser.parse_args()
    curves = []
    for test, name in FILES.items():
        file = DATA / f"treloar1944_{name}.txt"
        read = read_data(file, test, stretch=1, stress=0, unit=1e6)
        kept = read.stretch <= args.largest_stretch
        curves.append(TestData(test, read.stretch[kept], read.stress[kept]))
    if MPI.COMM_WORLD.rank != 0:
        return  # nothing here is shared work
    out = Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    fits = {type(m).__name__ if not isinstance(m, type) else m.__name__: fit(m, curves)
            for m in MODELS}  # fmt: skip
    summary = {
        name: {
            "constants": {k: np.asarray(v).tolist() for k, v in vars(f.model).items()},
            "standard_deviation": {k: np.asarray(v).tolist() for k, v in f.uncertainty.items()},
            "relative_residual": f.residual,
            "r_squared": f.r_squared,
            "stable": bool(f.stable),
        }
        for name, f in fits.items()
    }
    (out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", "utf-8")
    draw(curves, fits, out)
    if not args.quiet:
        for f in fits.values():
            print(f)
        print(f"\nresults: {out}/summary.json, fits.png")


def draw(curves, fits, out):
    figure = Figure(figsize=(7.0, 2.6), layout="constrained")
    for axes, curve in zip(figure.subplots(1, 3), curves, strict=True):
        stretch = np.linspace(1, curve.stretch.max(), 200)
        axes.plot(curve.stretch, curve.stress / 1e6, "ko", ms=3, label="Treloar 1944")
        for name, found in fits.items():
            stress = nominal_stress(found.model, curve.test, stretch) / 1e6
            axes.plot(stretch, stress, lw=1, label=name)
        axes.set(title=curve.test, xlabel="Stretch (-)", ylabel="Nominal stress (MPa)",
                 ylim=(0, 1.15 * curve.stress.max() / 1e6))  # fmt: skip
    axes.legend(fontsize=6, frameon=False)
    figure.savefig(out / "fits.png", dpi=300)


if __name__ == "__main__":
    main()
