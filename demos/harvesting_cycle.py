"""A generator: a film that is charged while it is stretched, released, and discharged.

The electrodes of a film are stretched to --high, brought to a voltage, and disconnected.  The film
is then released to --low.  Its charge stays, its capacitance falls as the fourth power of the
stretch, and so its voltage rises: work against the field has become electric energy, which the
source takes back when the film is discharged.  Then the cycle begins again.

Charging and discharging without loss, at fixed stretch, gains the energy per undeformed volume

    eps/2 (V/H)^2 high^4 [(high/low)^4 e^(-2 t/tau) - 1],

where t/tau is the time of the release over that of the leakage, eps/g; --leak gives it, and it is 0
for a film that does not leak.

    python demos/harvesting_cycle.py
    python demos/harvesting_cycle.py --low 1.2 --high 2.5 --field 0.1 --leak 0.2
"""

import math

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import harvesting_cycle, leaked_charge
from dea_fenicsx.geometry import BoxStack, Layer

MU, EPS_R, THICKNESS, SECONDS = 20e3, 3.2, 1e-3, 1.0
"""Usual modulus in Pa, permittivity, thickness in m, and length of the release in s."""


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/harvesting_cycle")
    parser.number("--low", 1.5, "-", "equal-biaxial stretch at which the film is discharged")
    parser.number("--high", 3.0, "-", "stretch at which it is charged")
    parser.number("--field", 0.05, "-", "nominal field V/H at charging over sqrt(mu/eps)")
    parser.number("--mu", MU, "Pa", "shear modulus of the film")
    parser.number("--leak", 0.0, "-", "time of the release over eps/g")
    parser.count("--steps", 10, "steps of the release")
    return parser, parser.parse_args()


def generator(args, film, volts):
    """One element of the film: its state is the same everywhere."""
    box = BoxStack(THICKNESS, THICKNESS, [Layer("film", THICKNESS)], divisions=(1, 1))
    return dea.Scene(
        dea.device(box, MPI.COMM_WORLD),
        {"film": film},
        electrodes=[dea.Source("top", volts, closed=False), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
        prescribed=[dea.Stretch(f"{axis}_max", axis, args.high, ramp="stretch") for axis in "xy"],
    )


def cycle(args):
    """Stretched, charged, released, discharged."""
    part = (args.low - 1) / (args.high - 1)  # of the stretch, as a factor of its ramp
    release = dea.Ramp("stretch", to=part, steps=args.steps)
    if args.leak:
        slope = dea.Table([0.0, SECONDS], [1.0, part])
        release = dea.March(SECONDS, {"stretch": slope}, steps=args.steps)
    return [
        dea.Ramp("stretch", steps=args.steps),
        dea.Close("top", steps=2),
        dea.Open("top"),
        release,
        dea.Close("top", to=0.0, steps=2),
    ]


def main():
    parser, args = parse()
    if not 1 < args.low < args.high:
        raise dea.InputError(
            f"The stretches are --low {args.low:g} and --high {args.high:g}, but must satisfy "
            "1 < low < high."
        )
    if not args.field > 0 or not args.leak >= 0:
        raise dea.InputError("--field must be > 0, and --leak must be >= 0.")
    eps = EPS_R * dea.materials.EPSILON_0
    unit = math.sqrt(args.mu / eps)
    film = dea.Material(
        dea.NeoHookean(args.mu), dea.IdealDielectric(EPS_R, conductivity=args.leak * eps / SECONDS)
    )
    run = dea.solve(
        generator(args, film, args.field * unit * THICKNESS),
        cycle(args),
        {
            "charge": dea.Charge("top"), "potential": dea.Potential("top"),
            "stretch": dea.MeanStretch(("x_min", "x_max"), "x"),
        },
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        stability="never",  # the state is homogeneous; a film that is pressed would wrinkle
        failures=[dea.LossOfTension(normal="z")],
        settings=parser.settings(args),
    )  # fmt: skip
    exact = harvesting_cycle(film, args.low, args.high, args.field * unit)
    kept = float(leaked_charge(1.0, args.leak, 1.0, 1.0))
    spent = eps / 2 * (args.field * unit) ** 2 * args.high**4
    closed_form = (exact.energy + spent) * kept**2 - spent
    gained = energy(run) / THICKNESS**3
    run.add(
        energy_density_over_mu=gained / args.mu,
        closed_form_over_mu=closed_form / args.mu,
        energy_density_J_per_m3=gained,
        largest_true_field_V_per_m=max(exact.true_fields),
        charge_kept=kept,
        stays_in_tension=not run.summary["failures"],
    )
    if MPI.COMM_WORLD.rank == 0:
        dea.pictures.curve(args.out, x="charge_C", y="potential_V")
        if not args.quiet:
            report(run)


def energy(run):
    """What the source gets back over the cycle: minus the integral of voltage over charge, in J.

    Charge flows at fixed stretch, where voltage is linear in it, so that trapezoids are exact.
    """
    volts, charge = run.column("potential_V"), run.column("charge_C")
    closed = np.diff(run.column("stretch")) == 0
    steps = (volts[1:] + volts[:-1]) / 2 * np.diff(charge)
    return -float(np.sum(steps[closed]))


def report(run):
    s = run.summary
    print(f"\nenergy gained in a cycle: {s['energy_density_J_per_m3']:.6g} J/m3 = "
          f"{s['energy_density_over_mu']:.9f} mu (closed form {s['closed_form_over_mu']:.9f} mu)")
    print(f"largest true field: {s['largest_true_field_V_per_m'] / 1e6:.3g} MV/m; charge kept: "
          f"{100 * s['charge_kept']:.1f} %")  # fmt: skip
    if not s["stays_in_tension"]:
        print("The released film is pressed by its field, so that a real one would wrinkle.")
    print(f"\nresults: {run.out}/history.csv, potential_charge.png, fields.xdmf")


if __name__ == "__main__":
    main()
