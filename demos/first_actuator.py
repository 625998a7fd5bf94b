"""Tutorial: the first actuator, a strip of two layers that bends under voltage.

A strip has two layers of silicone and is clamped at one end.  One layer lies between electrodes.
The electric field makes this active layer thinner, so that it grows longer.  The passive layer does
not grow, so the strip bends towards the passive side.  For small voltages, beam theory gives the
curvature of two equal layers, each with the thickness h:

    curvature = 3/4 e/h,     e = eps (V/h)^2 / (4 mu).

V is the voltage, eps the permittivity, and mu the shear modulus.  e is the strain along the strip
that the active layer would have without the passive one.  The strip is modelled in plane strain:
nothing moves across its width.

Run it with `mpirun -n 2 python demos/first_actuator.py`.
"""

from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/first_actuator")
    parser.number("--mu", 80e3, "Pa", "shear modulus")
    parser.number("--voltage", 8e3, "V", "end of the ramp")
    parser.count("--cells", 20, "cells along the strip")
    return parser, parser.parse_args()


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    L, h, mu, eps_r = 20e-3, 0.5e-3, args.mu, 2.8  # m, m, Pa, -

    # 1. Geometry.  A flat strip, layers from the bottom up.  Each layer is a named region, and the
    #    surfaces have names: x_min, x_max, bottom, interface_1, top.
    strip = BoxStack(L, None, [Layer("passive", h), Layer("active", h)], divisions=args.cells)
    device = dea.device(strip, comm)

    # 2. Scene: which material where, electrodes, supports.  Plane strain: a wide strip, of which
    #    5 mm count for forces and charges.
    scene = dea.Scene(
        device,
        materials={
            "active": dea.Material(dea.NeoHookean(mu), dea.IdealDielectric(eps_r)),
            "passive": dea.Material(dea.NeoHookean(mu)),  # no field is modelled here
        },
        electrodes=[dea.Electrode("top", args.voltage), dea.Ground("interface_1")],
        supports=[dea.Clamp("x_min")],
        kinematics=dea.PlaneStrain(depth=5e-3),
    )

    # 3. Path: the voltage from 0 up, landing on these shares of it.  What is recorded at each step
    #    goes to history.csv, its unit appended to the name.
    run = dea.solve(
        scene,
        dea.Ramp("voltage", steps=8, at=(0.05, 0.25, 0.5, 0.75, 1.0)),
        record={"tip": dea.MeanDisplacement("x_max", "y"), "charge": dea.Charge("top")},
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        settings=parser.settings(args),
    )

    # 4. Check against theory before believing anything: the first step is small.
    volts, tip = run.column("voltage_V"), run.column("tip_m")
    e = eps_r * EPSILON_0 * (volts[1] / h) ** 2 / (4 * mu)
    beam = -0.75 * e / h * L**2 / 2
    run.add(small_voltage_V=volts[1], small_tip_m=tip[1], beam_tip_m=beam)
    if comm.rank == 0:
        picture = dea.pictures.curve(args.out, x="voltage_V", y="tip_m")[0]
        if not args.quiet:
            print(f"\ntip at {volts[1]:g} V: {tip[1] * 1e6:.3f} um, "
                  f"beam theory {beam * 1e6:.3f} um")  # fmt: skip
            print(f"tip at {volts[-1]:g} V: {tip[-1] * 1e3:.3f} mm")
            print(f"results: {run.out}/fields.xdmf, {picture}")


if __name__ == "__main__":
    main()
