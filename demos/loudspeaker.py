"""A membrane as a loudspeaker: its answer to a small voltage over frequency, about a bias.

A round film is stretched equal-biaxially, clamped at its rim, blown up a little by air behind it,
and put under a bias voltage.  A small voltage beside the bias then moves it at its own frequency,
since the film is curved and the electric force goes with the square of the whole voltage.  The demo
computes amplitude and phase of the middle, the volume velocity (the rate of the displaced volume,
which makes the sound), and the electric impedance.  One viscous branch is all that takes energy
from the film: the air has no mass, and the sound that leaves is not accounted for.
"""

import csv

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/loudspeaker")
    parser.number("--radius", 20e-3, "m", "radius of the frame")
    parser.number("--thickness", 0.5e-3, "m", "thickness of the film before it is stretched")
    parser.number("--stretch", 2.0, "-", "equal-biaxial stretch")
    parser.number("--pressure", 100.0, "Pa", "pressure of the air behind the film")
    parser.number("--bias", 2000.0, "V", "bias voltage")
    parser.number("--signal", 100.0, "V", "amplitude of the small voltage")
    parser.number("--lowest", 20.0, "Hz", "lowest frequency")
    parser.number("--highest", 1000.0, "Hz", "highest frequency")
    parser.count("--frequencies", 60, "frequencies, at equal ratios")
    parser.count("--cells", 24, "cells from the middle to the rim")
    return parser, parser.parse_args()


def scene(args):
    """A section of the stretched film."""
    film = dea.Material(
        dea.NeoHookean(25e3), dea.IdealDielectric(4.7), density=960.0,
        viscous=[dea.Maxwell(10e3, 1e-3)],
    )  # fmt: skip
    mesh = BoxStack(args.radius, None, [Layer("film", args.thickness / args.stretch**2)],
                    divisions=args.cells, grading=4.0)  # fmt: skip
    return dea.Scene(
        dea.device(mesh, MPI.COMM_WORLD),
        {"film": film},
        electrodes=[dea.Electrode("top", args.bias), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "r"), dea.Clamp("x_max")],
        prescribed=[dea.PreStretch("film", r=args.stretch)],
        loads=[dea.FollowerPressure("bottom", args.pressure)],
        kinematics=dea.Axisymmetric(),
    )


RECORD = {
    "centre": dea.AtPoint((0.0, 0.0), "displacement", "z"),
    "mean": dea.MeanDisplacement("bottom", "z"),
    "charge": dea.Charge("top"),
}


def main():
    parser, args = parse()
    path = [
        dea.Ramp(name, steps=4, response="relaxed") for name in ("prestretch", "load", "voltage")
    ]
    run = dea.solve(
        scene(args), path, RECORD, out=args.out, resume=args.resume, quiet=args.quiet,
        settings=parser.settings(args),
    )  # fmt: skip
    hertz = np.geomspace(args.lowest, args.highest, args.frequencies)
    found = dea.frequency_response(run, hertz, "voltage", RECORD, args.signal / args.bias)
    area = np.pi * args.radius**2
    velocity = 2j * np.pi * hertz * found["mean_m"] * area
    impedance = found.impedance_ohm("charge_C")
    peak = int(np.argmax(found.modulus("centre_m")))
    run.add(
        resonance_Hz=float(hertz[peak]),
        centre_at_resonance_m=float(found.modulus("centre_m")[peak]),
        centre_phase_at_resonance_deg=float(found.phase_deg("centre_m")[peak]),
        volume_velocity_at_resonance_m3_per_s=float(abs(velocity[peak])),
        impedance_at_resonance_ohm=float(abs(impedance[peak])),
        centre_at_lowest_m=float(found.modulus("centre_m")[0]),
    )
    if MPI.COMM_WORLD.rank == 0:
        found.write(run.out / "response.csv")
        draw(run.out / "response.png", hertz, found, args.signal)
        head = ["frequency_Hz", "volume_velocity_m3_per_s", "volume_velocity_phase_deg",
                "impedance_ohm", "impedance_phase_deg"]  # fmt: skip
        with open(run.out / "sound.csv", "w", newline="") as file:
            table = csv.writer(file)
            table.writerow(head)
            table.writerows(
                [f, abs(v), np.degrees(np.angle(v)), abs(z), np.degrees(np.angle(z))]
                for f, v, z in zip(hertz, velocity, impedance, strict=True)
            )
        if not args.quiet:
            moved = 1e6 * found.modulus("centre_m")[peak]
            print(f"\nresonance at {hertz[peak]:.1f} Hz: the centre moves by {moved:.2f} um at "
                  f"{args.signal:g} V")  # fmt: skip
            print(f"results: {run.out}/response.csv and sound.csv")


def draw(path, hertz, found, signal):
    """Amplitude of the middle and of the mean displacement over the frequency."""
    figure = Figure(figsize=(4.2, 3.2), layout="constrained")
    axes = figure.subplots()
    for column, label in (("centre_m", "middle"), ("mean_m", "mean")):
        axes.loglog(hertz, 1e6 * found.modulus(column), ".-", lw=0.8, ms=3, label=label)
    axes.set(xlabel="Frequency (Hz)", ylabel=f"Amplitude at {signal:g} V (µm)")
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=200)


if __name__ == "__main__":
    main()
