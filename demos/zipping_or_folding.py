"""Zipping: a film meets an insulated electrode through air, and stays there on less voltage.

A film with an electrode below hangs over a grounded electrode with a layer of insulator on it; the
air between is meshed.  Half of it is modelled: it is clamped at x = 0, the plane of symmetry is at
x = L.  Three things are found:

  - the voltage at which the free film is lost to the electrode (pull-in);
  - the film pressed down, held by the full voltage and left alone: how far it is zipped.  The
    charge is compared with that of a beam with the free length s that makes
    6 D g^2/s^3 - V^2 C(s)/2 smallest, D = mu h^3/3, where C counts the gap, too;
  - the voltage at which it lets go again, far below pull-in.

No search for contact is made: the air is squeezed to almost nothing and carries the pressure.

Run it with `mpirun -n 2 python demos/zipping_or_folding.py`.
"""

from mpi4py import MPI
from scipy.integrate import quad

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0

MU, EPS_R, DEPTH = 1e6, 3.0, 1e-3  # Pa, -, m
LENGTH, FILM, INSULATOR = 1e-3, 60e-6, 20e-6  # m


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/zipping")
    parser.number("--voltage", 100.0, "V", "voltage that holds the film")
    parser.number("--gap", 30e-6, "m", "thickness of the air between film and insulator")
    parser.number("--push", 150.0, "Pa", "pressure that brings the film down before")
    parser.number("--stiffness", 1e-9, "-", "shear modulus of the air over that of the film")
    parser.count("--mesh", 12, "cells along the film")
    return parser, parser.parse_args()


def make_scene(args, comm, volts):
    layers = [Layer("insulator", INSULATOR), Layer("gap", args.gap, 2), Layer("film", FILM)]
    strip = BoxStack(LENGTH, None, layers, divisions=args.mesh, order=1)
    rubber = dea.NeoHookean(MU)
    return dea.Scene(
        dea.read_gmsh(strip, comm),
        materials={
            "insulator": dea.Material(rubber, dea.IdealDielectric(EPS_R)),
            "gap": dea.Air(stiffness=args.stiffness),
            "film": dea.Material(rubber),
        },
        electrodes=[dea.Ground("bottom"), dea.Electrode("interface_2", volts)],
        supports=[dea.Clamp("bottom"), dea.Clamp("x_min"), dea.Fix("x_max", "x")],
        loads=[dea.DeadLoad("top", (0.0, -args.push), ramp="push")],
        kinematics=dea.PlaneStrain(DEPTH),
    )


def lost_at(scene, path, **options):
    """The voltage at which a ramp loses its equilibrium, or None if it does not."""
    try:
        dea.solve(scene, path, quiet=True, **options)
    except dea.EquilibriumLost as lost:
        return lost.reached["voltage"] * scene.reference_voltage("voltage")
    return None


def beam(args):
    """Zipped length in m and charge in C of the beam on its clamped support."""
    ratio = EPS_R * args.gap / INSULATOR
    share = quad(lambda x: 1 / (1 + ratio * (3 * x**2 - 2 * x**3)), 0, 1)[0]
    areal = EPS_R * EPSILON_0 / INSULATOR  # F/m^2
    bending = MU * FILM**3 / 3  # plane strain, incompressible
    free = (36 * bending * args.gap**2 / (args.voltage**2 * areal * (1 - share))) ** 0.25
    free = min(free, LENGTH)
    return LENGTH - free, areal * args.voltage * DEPTH * (LENGTH - free * (1 - share))


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    scene = make_scene(args, comm, args.voltage)
    run = dea.solve(
        scene,
        [dea.Ramp("push", steps=5), dea.Ramp("voltage", steps=3),
         dea.Ramp("push", to=0.0, steps=2)],
        record={
            "deflection": dea.LargestDisplacement("interface_2", "y"),
            "charge": dea.Charge("interface_2"),
            "air": dea.Energy("air"),
            "elastic": dea.Energy("elastic"),
        },
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        settings=parser.settings(args),
    )  # fmt: skip
    pull_in = lost_at(scene, dea.Ramp("voltage", steps=3))
    release = lost_at(scene, dea.Ramp("voltage", to=0.0, steps=3), start=run)
    zipped, charge = beam(args)
    run.add(
        pull_in_voltage_V=pull_in,
        release_voltage_V=release,
        gap_closed=-run["deflection_m"] / args.gap,
        charge_when_zipped_C=run["charge_C"],
        beam_charge_C=charge,
        beam_zipped_length_m=zipped,
        air_energy_share=run["air_J"] / run["elastic_J"],
    )
    if comm.rank == 0 and not args.quiet:
        print(f"\nzipped at {args.voltage:g} V: charge {run['charge_C']:.4e} C, of a beam "
              f"{charge:.4e} C, zipped over {zipped * 1e3:.2f} mm of {LENGTH * 1e3:g} mm")
        print(f"pull-in at {pull_in if pull_in is None else round(pull_in, 2)} V, release at "
              f"{release if release is None else round(release, 2)} V")
        print(f"the air takes {run['air_J'] / run['elastic_J']:.1%} of the elastic energy")
        print(f"results: {run.out}/history.csv")  # fmt: skip


if __name__ == "__main__":
    main()
