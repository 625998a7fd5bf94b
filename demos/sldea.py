"""One layer under a given live pressure on its electrodes (SLDEA, Park 2019, 4.3.2 and 4.3.3).

A round layer with full electrodes is pressed by the true pressure p = eps E^2, and it is free at
its rim.  Its state is homogeneous and known exactly.  Park (2019) prints pressures in N/m^2, but
they are in kN/m^2.

Run it with `mpirun -n 2 python demos/sldea.py`.
"""

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import Film, trace
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0

THESIS = {160e3: 0.12, 700e3: 0.40}  # contraction at a pressure in Pa


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/sldea")
    parser.number("--mu", 0.5e6, "Pa", "shear modulus (Park 2019, Table 5.2, 2 C10)")
    parser.number("--bulk", 2.5e6, "Pa", "bulk modulus (Park 2019, Table 5.2, 2/D1)")
    parser.number("--eps-r", 4.7, "-", "relative permittivity (Park 2019, Table 5.2)")
    parser.number("--thickness", 50e-6, "m", "thickness of the layer (not printed)")
    parser.number("--radius", 7e-3, "m", "radius of the layer (not printed)")
    parser.count("--steps", 14, "steps to 700 kPa")
    return parser, parser.parse_args()


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    film = dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(args.eps_r),
                        bulk_modulus=args.bulk)  # fmt: skip
    layer = BoxStack(args.radius, None, [Layer("film", args.thickness)], divisions=4)
    top = max(THESIS)
    scene = dea.Scene(
        dea.device(layer, comm),
        {"film": film},
        supports=[dea.Fix("bottom", "z"), dea.Fix("x_min", "r")],
        loads=[dea.FollowerPressure("top", top)],
        kinematics=dea.Axisymmetric(),
    )
    branch = trace(Film(film, args.thickness, stress="pressure"))
    run = dea.solve(
        scene,
        dea.Ramp("load", steps=args.steps, at=tuple(p / top for p in THESIS if p < top)),
        record={"contraction": dea.Contraction(("bottom", "top"), "z")},
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        options=dea.NewtonOptions(tolerance=1e-12),
        settings=parser.settings(args),
    )
    pressure, found = top * run.column("load_factor"), run.column("contraction")
    exact = np.array([0.0, *(contraction(branch, p) for p in pressure[1:])])
    (at40,) = branch.at_stretch(0.6, axis=2)
    eps = args.eps_r * EPSILON_0
    run.add(
        max_error=float(np.max(np.abs(found - exact))),
        exact_pressure_for_40_percent_Pa=at40.maxwell,
        voltages_V={f"{p:g}_Pa": args.thickness * (1 - contraction(branch, p)) * (p / eps) ** 0.5
                    for p in THESIS},
        **{f"contraction_{p / 1e3:g}_kPa": float(found[np.argmin(np.abs(pressure - p))])
           for p in THESIS},
    )  # fmt: skip
    if comm.rank == 0:
        draw(run.out / "contraction_pressure.png", branch, pressure, found)
        if not args.quiet:
            report(args, run, branch)


def contraction(branch, pressure):
    """Exact contraction of the layer in the first state at a live pressure."""
    return float(1 - branch.states_at(pressure, "pressure")[0][0].stretches[2])


def draw(path, branch, pressure, found):
    fine = np.linspace(0, pressure[-1], 101)
    figure = Figure(figsize=(3.35, 2.5), layout="constrained")
    axes = figure.subplots()
    axes.plot(fine / 1e3, [0, *(100 * contraction(branch, p) for p in fine[1:])], label="exact")
    axes.plot(pressure / 1e3, 100 * found, "o", label="finite elements")
    axes.plot([p / 1e3 for p in THESIS], [100 * c for c in THESIS.values()], "x", label="Park")
    axes.set(xlabel="Pressure (kPa)", ylabel="Contraction (%)")
    axes.legend(frameon=False)
    figure.savefig(path, dpi=200)


def report(args, run, branch):
    s = run.summary
    print(f"\n{'contraction at':20}{'Park':>10}{'exact':>14}{'finite elements':>20}")
    for p, printed in THESIS.items():
        print(f"{f'{p / 1e3:g} kPa':20}{100 * printed:8.0f} %{100 * contraction(branch, p):12.6f} %"
              f"{100 * s[f'contraction_{p / 1e3:g}_kPa']:18.6f} %")  # fmt: skip
    wrong = 100 * contraction(branch, 700.0)
    volts = s["voltages_V"]["160000_Pa"]
    full = args.thickness * (160e3 / (args.eps_r * EPSILON_0)) ** 0.5
    print(
        f"largest difference along the ramp: {s['max_error']:.1e}; 40 % takes "
        f"{s['exact_pressure_for_40_percent_Pa'] / 1e3:.1f} kPa\n\nThe printed 700 and 160 N/m^2 "
        f"must be kN/m^2: 700 Pa contract this layer by {wrong:.3f} %.\nThe printed 3 kV fit "
        f"160 kPa and {args.thickness * 1e6:g} um: {full / 1e3:.2f} kV with the undeformed "
        f"thickness in the field,\n{volts / 1e3:.2f} kV with what is left of it."
    )
    print(f"\nresults: {run.out}/history.csv, contraction_pressure.png, fields.xdmf")


if __name__ == "__main__":
    main()
