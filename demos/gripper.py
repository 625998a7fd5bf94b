"""A finger bends by voltage and closes on a rigid cylinder, in plane strain.

The finger is a unimorph: a driven film on a passive layer of the same size, clamped at its root.
The film stretches along the finger, which so bends towards its passive side, where the cylinder
lies.  A second finger, mirrored at the plane through the cylinder's axis, holds it from the other
side; each pushes with the grip force.  Contact is without friction, so the cylinder is held across
the fingers alone, and a finger that bends on slides around it.

As a check the force of the cylinder on the finger is compared with what holds the root, and the gap
with its tolerance.

    python demos/gripper.py
    python demos/gripper.py --radius 3e-3 --volts 15e3
"""

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/gripper")
    parser.number("--length", 15e-3, "m", "length of the finger")
    parser.number("--thickness", 0.4e-3, "m", "thickness of the film, and of the passive layer")
    parser.number("--width", 10e-3, "m", "width of the finger")
    parser.number("--mu", 0.4e6, "Pa", "shear modulus of both layers")
    parser.number("--eps-r", 3.0, "-", "relative permittivity of the film")
    parser.number("--volts", 18e3, "V", "largest voltage")
    parser.number("--radius", 4e-3, "m", "radius of the cylinder")
    parser.number("--gap", 0.5e-3, "m", "gap between the straight finger and the cylinder")
    parser.number("--at", 11e-3, "m", "distance of the cylinder's axis from the root")
    parser.count("--steps", 10, "steps of the voltage")
    parser.count("--mesh", 1, "refinement of the mesh")
    return parser, parser.parse_args()


def scene(args):
    """The finger along x; the cylinder lies below it."""
    layers = [Layer(name, args.thickness, args.mesh) for name in ("passive", "film")]
    device = dea.device(BoxStack(args.length, None, layers, (40 * args.mesh,)), MPI.COMM_WORLD)
    rubber = dea.NeoHookean(args.mu)
    cylinder = dea.Cylinder((args.at, -args.radius - args.gap), None, args.radius)
    return dea.Scene(
        device,
        {"passive": dea.Material(rubber), "film": dea.Material(
            rubber, dea.IdealDielectric(args.eps_r))},
        electrodes=[dea.Electrode("top", args.volts), dea.Ground("interface_1")],
        supports=[dea.Clamp("x_min"), dea.Obstacle("bottom", cylinder)],
        kinematics=dea.PlaneStrain(args.width),
    )  # fmt: skip


RECORD = {
    "grip": dea.ContactForce("bottom", "y"),
    "along": dea.ContactForce("bottom", "x"),
    "area": dea.ContactArea("bottom"),
    "pressure": dea.ContactPressure("bottom"),
    "gap": dea.ContactGap("bottom"),
    "root_x": dea.Reaction("x_min", "x"),
    "root_y": dea.Reaction("x_min", "y"),
    "tip": dea.MeanDisplacement("x_max", "y"),
}


def main():
    parser, args = parse()
    run = dea.solve(
        scene(args), dea.Ramp("voltage", steps=args.steps), RECORD, out=args.out,
        resume=args.resume, quiet=args.quiet, settings=parser.settings(args),
    )  # fmt: skip
    volts, grip = run.column("voltage_V"), run.column("grip_N")
    touching = np.flatnonzero(grip > 0)
    force = float(np.hypot(run["grip_N"], run["along_N"]))
    left = float(np.hypot(run["grip_N"] + run["root_y_N"], run["along_N"] + run["root_x_N"]))
    run.add(
        grip_force_N=float(grip[-1]), contact_area_m2=run["area_m2"],
        contact_pressure_Pa=run["pressure_Pa"], contact_gap_m=run["gap_m"],
        last_open_voltage_V=float(volts[touching[0] - 1]) if len(touching) else None,
        first_closed_voltage_V=float(volts[touching[0]]) if len(touching) else None,
        force_balance_error=left / force if force else None, tip_m=run["tip_m"],
    )  # fmt: skip
    if MPI.COMM_WORLD.rank == 0:
        dea.pictures.curve(args.out, x="voltage_V", y="grip_N")
        if not args.quiet:
            report(run)


def report(run):
    s = run.summary
    print(f"\nat {run['voltage_V']:.0f} V each finger pushes with {1e3 * s['grip_force_N']:.4g} mN "
          f"on {1e6 * s['contact_area_m2']:.3g} mm2")  # fmt: skip
    if s["force_balance_error"] is not None:
        print(f"it touches between {s['last_open_voltage_V']:.0f} and "
              f"{s['first_closed_voltage_V']:.0f} V; forces balance to "
              f"{s['force_balance_error']:.1e}")  # fmt: skip
    print(f"\nresults: {run.out}/history.csv, grip_voltage.png, fields.xdmf")


if __name__ == "__main__":
    main()
