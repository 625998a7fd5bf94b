"""A pre-stretched disc on a voltage that is switched on: its area over an hour.

A film of VHB 4910 is stretched at once, glued to a stiff ring, and rests there.  Then its middle is
put under a voltage, all of a sudden.  It grows at once, and goes on to grow, because the branches
that carry the load relax one after another: within a second, some seconds, a minute.  In the end it
is where an elastic film without branches would be.

The passive part of the film around the electrode gives way as far as it is pulled.  A section of
the disc is solved, of half of the film's thickness; the potential is V/T through the film.

Constants: Wang, Decker, Henann, Chester, J. Mech. Phys. Solids 95 (2016) 213.

    python demos/creep_disc.py
    python demos/creep_disc.py --voltage 4000 --stretch 3.2
"""

from dataclasses import replace

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import MembraneDisc

BRANCHES = ((26.06e3, 0.6074), (26.53e3, 6.56), (10.83e3, 61.25))
"""Shear modulus in Pa and relaxation time in s of each branch."""

TOLD = (1.0, 10.0, 60.0, 600.0, 3600.0)
"""Times in s after the switch at which the area is told."""


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/creep_disc")
    parser.number("--mu", 15.36e3, "Pa", "equilibrium shear modulus")
    parser.number("--thickness", 1e-3, "m", "thickness before the pre-stretch")
    parser.number("--radius", 12e-3, "m", "radius before the pre-stretch")
    parser.number("--electrode", 4e-3, "m", "radius of the electrode before the pre-stretch")
    parser.number("--stretch", 3.0, "-", "pre-stretch")
    parser.number("--voltage", 3500.0, "V", "voltage that is switched on")
    parser.number("--rest", 600.0, "s", "time between the pre-stretch and the voltage")
    parser.number("--seconds", 3600.0, "s", "time under voltage")
    parser.number("--tolerance", 3e-3, "-", "largest error of a step in the viscous strains")
    parser.count("--mesh", 1, "refinement of the mesh")
    return parser, parser.parse_args()


def membrane(args, viscous):
    """The scene; ramp factor 1 is the whole voltage and the whole pre-stretch."""
    half, ring = args.thickness / 2, args.electrode / 2
    cells = (2 * args.mesh, 2 * args.mesh, 3 * args.mesh)
    disc = MembraneDisc(args.radius, args.electrode, half, taper=ring, cells=cells, grading=2.0)
    device = dea.device(disc, MPI.COMM_WORLD)
    film = dea.Material(dea.ArrudaBoyce(args.mu, 5.99, form="pade"), dea.IdealDielectric(4.8),
                        viscous=viscous)  # fmt: skip
    edge = dea.Taper(args.electrode, args.electrode + ring)
    live = ("active", "edge")
    return dea.Scene(
        device,
        dict.fromkeys(live, film) | {"passive": replace(film, electric=None)},
        electrodes=[dea.ThinFilm(live, args.voltage / 2, taper=edge, start=0.0, end=half)],
        supports=[dea.Fix("bottom", "z"), dea.Fix("axis", "r")],
        prescribed=[dea.Stretch("rim", "r", args.stretch)],
        kinematics=dea.Axisymmetric(),
    )


class FilmVoltage:
    """Voltage through the whole film: twice that of the half that is modelled."""

    unit = "V"

    def __init__(self, scene):
        self.volts = 2 * scene.reference_voltage("voltage")

    def bind(self, problem):
        return lambda: self.volts * problem.factors["voltage"]


def main():
    parser, args = parse()
    scene = membrane(args, [dea.Maxwell(mu, tau) for mu, tau in BRANCHES])
    record = {"electrode_area": dea.Area("top_active"), "film_voltage": FilmVoltage(scene)}
    told = [t for t in TOLD if t <= args.seconds]
    run = dea.solve(
        scene,
        [dea.Ramp("stretch", steps=6, response="instantaneous"),
         dea.March(args.rest, tolerance=args.tolerance),
         dea.March(args.seconds, {"voltage": 1.0}, tolerance=args.tolerance, at=told)],
        record,
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        stability="never",
        settings=parser.settings(args),
    )  # fmt: skip
    # Without branches the film is at once where it would come to in an infinite time.
    elastic = dea.solve(
        membrane(args, ()),
        [dea.Ramp("stretch", steps=6), dea.Ramp("voltage", steps=4)],
        record,
        quiet=True,
        stability="never",
    ).column("electrode_area_m2")
    time, area, ratio = area_over_time(args, run)
    at = [float(ratio[np.argmin(np.abs(time - t))]) for t in told]
    run.add(
        area_ratio_at_0=float(ratio[time == 0][-1]),
        area_ratio_at_end=float(ratio[-1]),
        relaxed_area_ratio=float(elastic[-1] / elastic[6]),
        area_ratios=dict(zip(map(str, told), at, strict=True)),
    )
    if MPI.COMM_WORLD.rank == 0:
        draw(args, run, time, ratio)
        if not args.quiet:
            report(run, told, at)


def area_over_time(args, run):
    """Times since the switch, the electrode's area, and this area over that before the switch."""
    time, area = run.column("time_s") - args.rest, run.column("electrode_area_m2")
    under = time >= -1e-9 * args.rest
    time, area = time[under], area[under]
    return np.where(np.abs(time) < 1e-9 * args.rest, 0.0, time), area, area / area[0]


def draw(args, run, time, ratio):
    """The area over the logarithm of the time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    late = time > 0
    axes.semilogx(time[late], ratio[late], "o-", markersize=3, label="creep")
    axes.axhline(ratio[time == 0][-1], color="tab:green", label="at once")
    axes.axhline(run.summary["relaxed_area_ratio"], color="tab:red", linestyle="--",
                 label="without branches")  # fmt: skip
    axes.set_xlim(1e-3)
    axes.set_xlabel("time since the switch, s")
    axes.set_ylabel("electrode area over that before")
    axes.legend()
    figure.savefig(f"{args.out}/area_time.png", dpi=150)


def report(run, told, at):
    s = run.summary
    print(f"\nat once the electrode grows to {s['area_ratio_at_0']:.4f} times its area")
    for t, ratio in zip(told, at, strict=True):
        print(f"after {t:6g} s: {ratio:.4f}")
    print(f"without branches: {s['relaxed_area_ratio']:.4f}")
    print(f"\nresults: {run.out}/history.csv, area_time.png, fields.xdmf "
          "(film_voltage_V is the film's; voltage_V and potentials are the half's)")  # fmt: skip


if __name__ == "__main__":
    main()
