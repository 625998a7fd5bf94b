"""A thin strip between clamps buckles under voltage: bifurcation, null vector, both branches.

Both ends of the strip are clamped, and the strip is in plane strain.  The flat strip cannot deform.
So the field puts it under the compressive stress eps E^2, and it buckles at Euler's load,

    eps E^2 = (4 pi^2/3) mu (h/L)^2,

for a slender strip (bending stiffness 4 mu h^3/12).  The strip is traced to the bifurcation and
then along the buckled branch.  A ramp follows the flat branch beyond it.
"""

from pathlib import Path

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/buckling_strip")
    parser.number("--mu", 50e3, "Pa", "shear modulus")
    parser.number("--eps-r", 4.7, "-", "relative permittivity")
    parser.number("--thickness", 0.1e-3, "m", "thickness h")
    parser.number("--slenderness", 50.0, "-", "length over thickness, L/h")
    parser.count("--cells", 48, "cells along the strip")
    parser.count("--layers", 2, "cells through the thickness")
    parser.add_argument("--study", action="store_true",
                        help="also the critical voltage over slenderness and mesh")  # fmt: skip
    return parser, parser.parse_args()


def closed_form(args, slenderness):
    """Euler's critical voltage in V."""
    field = np.sqrt(4 * np.pi**2 / 3 * args.mu / (args.eps_r * EPSILON_0)) / slenderness
    return field * args.thickness


def strip(args, slenderness, cells, layers):
    """The scene; at ramp factor 1 the voltage is Euler's."""
    h = args.thickness
    mesh = BoxStack(slenderness * h, None, [Layer("strip", h, divisions=layers)],
                    divisions=cells, grading=2.0)  # fmt: skip
    device = dea.device(mesh, MPI.COMM_WORLD)
    material = dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(args.eps_r))
    return dea.Scene(
        device,
        {"strip": material},
        electrodes=[dea.Electrode("top", closed_form(args, slenderness)), dea.Ground("bottom")],
        supports=[dea.Clamp("x_min"), dea.Clamp("x_max")],
        kinematics=dea.PlaneStrain(),
    )


RECORD = {"deflection": dea.LargestDisplacement("top", "y")}


def critical(args, slenderness, cells, layers):
    """Critical voltage on the flat branch in V."""
    run = dea.solve(
        strip(args, slenderness, cells, layers), dea.Ramp("voltage", to=1.2, steps=3), RECORD,
        quiet=True, stability="every",
    )  # fmt: skip
    return next(row["voltage_V"] for row in run.history if row["event"] == "bifurcation")


def main():
    parser, args = parse()
    scene = strip(args, args.slenderness, args.cells, args.layers)
    euler = closed_form(args, args.slenderness)
    flat = dea.solve(
        scene, dea.Ramp("voltage", to=1.3, steps=4), RECORD, out=Path(args.out) / "flat",
        quiet=True, stability="every", resume=args.resume,
    )  # fmt: skip
    run = dea.solve(
        scene,
        dea.Trace("voltage", first=0.4, switch=0.05, until=("voltage_V", 1.3 * euler),
                  at=(1.1, 1.2), steps=60),
        RECORD,
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        stability="every",
        settings=parser.settings(args),
    )  # fmt: skip
    found = next(r for r in run.history if r["event"] == "bifurcation")
    landed = [r for r in run.history if r["event"] == "landed"][-1]
    # its own bifurcation may lie above this one by rounding
    beyond = [r["inertia"] for r in flat.history
              if r["voltage_V"] > found["voltage_V"] and not r["event"]]  # fmt: skip
    run.add(
        critical_voltage_V=found["voltage_V"],
        closed_form_voltage_V=euler,
        relative_difference=found["voltage_V"] / euler - 1,
        buckled_voltage_V=landed["voltage_V"],
        buckled_deflection_m=abs(landed["deflection_m"]),
        buckled_branch_is_stable=run["inertia"] == 0,
        flat_branch_is_unstable=min(beyond) > 0,
    )
    if args.study:
        run.add(**study(args))
    if MPI.COMM_WORLD.rank == 0:
        dea.pictures.curve(args.out, x="voltage_V", y="deflection_m")
        dea.pictures.deformed(args.out)
        if not args.quiet:
            report(run)


def study(args):
    """Critical over Euler's voltage for several slendernesses, on two meshes each."""
    table = {}
    for slenderness in (5, 10, 20, 50, 100):
        ratios = [
            critical(args, slenderness, cells, layers) / closed_form(args, slenderness)
            for cells, layers in ((12, 1), (24, 2), (48, 4), (96, 8))
        ]
        table[f"ratio_at_{slenderness}"] = ratios
    return table


def report(run):
    s = run.summary
    print(f"\ncritical voltage {s['critical_voltage_V']:.4f} V, "
          f"Euler {s['closed_form_voltage_V']:.4f} V "
          f"({100 * s['relative_difference']:+.2f} %)")  # fmt: skip
    print(f"at {s['buckled_voltage_V']:.4g} V the buckled strip has moved "
          f"{1e6 * s['buckled_deflection_m']:.3g} um")  # fmt: skip
    for name, values in s.items():
        if name.startswith("ratio_at_"):
            print(f"L/h = {name[9:]:>4}: critical over Euler "
                  + "  ".join(f"{v:.5f}" for v in values))  # fmt: skip
    print(f"\nresults: {run.out}/history.csv, fields.xdmf, modes/; flat branch: {run.out}/flat")


if __name__ == "__main__":
    main()
