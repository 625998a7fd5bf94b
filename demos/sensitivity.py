"""Derivatives of a bender's tip by its constants, its voltage and its thicknesses, all at once.

A soft film with electrodes is bonded to a stiffer film without.  Under voltage the film grows
longer, and the strip bends.  One linear solve with the transpose of the tangent gives the
derivatives of the tip's displacement by all variables.  They are compared with differences of two
neighbours each, which are solved anew on their own meshes.  The voltage of pull-in of the free film
is derived too, and compared with its closed form.

Run it with `mpirun -n 2 python demos/sensitivity.py`.
"""

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer

VARIABLES = {
    "mu": "active.elastic.mu",
    "eps_r": "active.electric.eps_r",
    "passive_mu": "passive.elastic.mu",
    "volts": "voltage",
    "thickness": "thickness:active:y",
    "passive_thickness": "thickness:passive:y",
}
UNITS = ("m_per_Pa", "m", "m_per_Pa", "m_per_V", "m_per_m", "m_per_m")
STEP = 1e-3
"""Relative step of the differences; their error is of the size of its square."""

TIGHT = dea.NewtonOptions(tolerance=1e-12)


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/sensitivity")
    parser.number("--mu", 50e3, "Pa", "shear modulus of the active film")
    parser.number("--eps-r", 3.0, "-", "relative permittivity of the active film")
    parser.number("--passive-mu", 200e3, "Pa", "shear modulus of the passive film")
    parser.number("--volts", 3e3, "V", "voltage")
    parser.number("--thickness", 0.2e-3, "m", "thickness of the active film")
    parser.number("--passive-thickness", 0.1e-3, "m", "thickness of the passive film")
    parser.number("--length", 4e-3, "m", "length of the strip")
    parser.count("--cells", 12, "cells along the strip")
    return parser, parser.parse_args()


def bender(args, comm, **changed):
    """The strip as a section, clamped at its left end."""
    at = {name: changed.get(name, getattr(args, name)) for name in VARIABLES}
    layers = [Layer("active", at["thickness"]), Layer("passive", at["passive_thickness"])]
    device = dea.device(BoxStack(args.length, None, layers, divisions=args.cells), comm)
    film = dea.IdealDielectric(at["eps_r"])
    return dea.Scene(
        device,
        {
            "active": dea.Material(dea.NeoHookean(at["mu"]), film),
            "passive": dea.Material(dea.NeoHookean(at["passive_mu"]), dea.IdealDielectric(3.0)),
        },
        electrodes=[dea.Electrode("bottom", at["volts"]), dea.Ground("interface_1")],
        supports=[dea.Clamp("x_min")],
        kinematics=dea.PlaneStrain(1e-2),
    )


def solved(scene, **options):
    record = {"tip": dea.MeanDisplacement("x_max", "y")}
    return dea.solve(scene, dea.Ramp(steps=2), record, options=TIGHT, **options)


def free_film(args, comm):
    """The pull-in of the free film, traced by arc length, and the largest error of its derivatives.

    V = 0.687 H sqrt(mu/eps), so that dV/dmu = V/(2 mu), dV/deps = -V/(2 eps) and dV/dH = V/H.
    """
    H, to = args.thickness, ["film.elastic.mu", "film.electric.eps_r", "thickness:film:z"]
    device = dea.device(BoxStack(1e-3, 1e-3, [Layer("film", H)], divisions=(1, 1)), comm)
    unit = H * float(np.sqrt(args.mu / (args.eps_r * dea.materials.EPSILON_0)))
    scene = dea.Scene(
        device,
        {"film": dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(args.eps_r))},
        electrodes=[dea.Electrode("top", unit), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
    )
    record = {"thin": dea.MeanStretch(("bottom", "top"), "z")}
    path = dea.Trace("voltage", first=0.1, until=("thin", 0.55))
    run = dea.solve(scene, path, record, quiet=True, options=TIGHT)
    found = run.sensitivity("pull-in", to)
    volts = found.value
    exact = np.array([volts / (2 * args.mu), -volts / (2 * args.eps_r), volts / H])
    return float(volts), float(np.abs(np.array([found[n] for n in to]) / exact - 1).max())


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    run = solved(bender(args, comm), out=args.out, resume=args.resume, quiet=args.quiet,
                 settings=parser.settings(args))  # fmt: skip
    found = run.sensitivity("tip", to=list(VARIABLES.values()))
    errors, told = {}, {}
    for (name, variable), unit in zip(VARIABLES.items(), UNITS, strict=True):
        value = getattr(args, name)
        ends = [
            solved(bender(args, comm, **{name: value * (1 + sign * STEP)}), quiet=True)["tip_m"]
            for sign in (1, -1)
        ]
        difference = (ends[0] - ends[1]) / (2 * STEP * value)
        told[f"tip_by_{name}_{unit}"] = found[variable]
        errors[f"tip_by_{name}_error"] = float(abs(found[variable] / difference - 1))
    volts, error = free_film(args, comm)
    run.add(**told, **errors, pull_in_voltage_V=volts, pull_in_error=error,
            adjoint_residual=found.residual)  # fmt: skip
    if comm.rank == 0:
        relative = {name: found[v] * getattr(args, name) / found.value
                    for name, v in VARIABLES.items()}  # fmt: skip
        draw(args, relative)
        if not args.quiet:
            print(f"tip {found.value * 1e3:.5g} mm; its change in % for 1 % of")
            for name, share in relative.items():
                error = errors[f"tip_by_{name}_error"]
                print(f"  {name:18s} {share:+.6f}   differences agree to {error:.1e}")
            print(f"pull-in of the free film at {volts:.6g} V; derivatives agree with the closed "
                  f"form to {run.summary['pull_in_error']:.1e}")  # fmt: skip


def draw(args, relative):
    """Bars: the change of the tip in per cent for one per cent of each variable."""
    table = dea.design.Sensitivity({n: getattr(args, n) for n in relative}, {"tip": relative})
    dea.design.draw_sensitivities(table, f"{args.out}/sensitivity.png")


if __name__ == "__main__":
    main()
