"""Pre-stretched circular membrane with an electrode in its middle, to 3 times its electrode area.

A Gent film is stretched 4 times, held at its rim, and put under voltage; arc length follows it
until the electrode covers 3 times the area that it had after the pre-stretch.  Half of the film's
thickness is modelled, the middle plane being the ground.

A sharp electrode edge makes a step in the film's thickness and a singular field.  Meshes that
resolve it end at the edge, each at another voltage, so the edge is given a length: the potential
falls off over a ring (--taper).  --study shows what converges and what does not.
"""

from pathlib import Path

import numpy as np
from mpi4py import MPI
from scipy.interpolate import CubicSpline

import dea_fenicsx as dea
from dea_fenicsx.geometry import MembraneDisc
from dea_fenicsx.materials import EPSILON_0


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/membrane_disc")
    parser.number("--mu", 50e3, "Pa", "shear modulus")
    parser.number("--jm", 120.0, "-", "Gent's limit of I1 - 3")
    parser.number("--eps-r", 4.7, "-", "relative permittivity")
    parser.number("--thickness", 1e-3, "m", "thickness before the pre-stretch")
    parser.number("--radius", 12e-3, "m", "radius before the pre-stretch")
    parser.number("--electrode", 4e-3, "m", "radius of the electrode before the pre-stretch")
    parser.number("--taper", 3e-3, "m", "width of the ring over which the potential falls off")
    parser.number("--stretch", 4.0, "-", "pre-stretch")
    parser.number("--area", 3.0, "-", "electrode area at which the trace ends, over that at 0 V")
    parser.count("--mesh", 2, "refinement of the mesh")
    parser.add_argument("--field", choices=("full", "thin"), default="full",
                        help="full potential, or V/T through the film")  # fmt: skip
    parser.add_argument("--solid", action="store_true", help="three dimensions, not a section")
    parser.add_argument("--study", action="store_true", help="sharp and tapered edges, four meshes")
    return parser, parser.parse_args()


def membrane(args, mesh, taper, field):
    """The scene; ramp factor 1 is the voltage T sqrt(mu/eps)."""
    half = args.thickness / 2
    disc = MembraneDisc(args.radius, args.electrode, half, taper=taper,
                        cells=(6 * mesh, 3 * mesh, 6 * mesh) if not args.solid else (3, 2, 4),
                        layers=mesh if not args.solid else 1, grading=4.0,
                        angular=8 * mesh if args.solid else 0)  # fmt: skip
    device = dea.device(disc, MPI.COMM_WORLD)
    elastic = dea.Gent(args.mu, args.jm)
    film = dea.Material(elastic, dea.IdealDielectric(args.eps_r))
    volts = args.thickness * np.sqrt(args.mu / (args.eps_r * EPSILON_0)) / 2
    edge = dea.Taper(args.electrode, args.electrode + taper) if taper else ()
    materials = dict.fromkeys(device.regions, film)
    if field == "thin":
        live = tuple(name for name in device.regions if name != "passive")
        materials["passive"] = dea.Material(elastic)
        electrodes = [dea.ThinFilm(live, volts, taper=edge, start=0.0, end=half)]
    else:
        tops = ("top_active", "top_edge") if taper else "top_active"
        electrodes = [dea.Electrode(tops, volts, taper=edge), dea.Ground("bottom")]
    middle = [] if args.solid else [dea.Fix("axis", "r")]
    return dea.Scene(
        device,
        materials,
        electrodes=electrodes,
        supports=[dea.Fix("bottom", "z"), *middle],
        prescribed=[dea.Stretch("rim", "xy" if args.solid else "r", args.stretch)],
        kinematics=dea.ThreeD() if args.solid else dea.Axisymmetric(),
    )


class FilmVoltage:
    """Voltage through the whole film: twice that of the half that is modelled."""

    unit = "V"

    def __init__(self, scene):
        self.volts = 2 * scene.reference_voltage("voltage")

    def bind(self, problem):
        return lambda: self.volts * problem.factors["voltage"]


def follow(args, mesh, taper, field, **options):
    """Pre-stretch, then trace the voltage until the electrode has the wanted area."""
    grown = args.area * np.pi * (args.electrode * args.stretch) ** 2
    scene = membrane(args, mesh, taper, field)
    return dea.solve(
        scene,
        [dea.Ramp("stretch", steps=4),
         dea.Trace("voltage", until=("electrode_area_m2", grown), steps=100, longest=2.0)],
        {"electrode_area": dea.Area("top_active"), "film_voltage": FilmVoltage(scene)},
        **options,
    )  # fmt: skip


def area_of(args, run):
    """Electrode area over that after the pre-stretch, and the film's voltage, per step."""
    kept = [r for r in run.history if r["ramp"] == "voltage" or r["stretch_factor"] == 1]
    area = np.array([r["electrode_area_m2"] for r in kept])
    return area / area[0], np.array([r["film_voltage_V"] for r in kept])


def voltage_at(args, run, wanted):
    """Voltage in V at an area, by a spline through the steps; NaN if it is not reached."""
    area, volts = area_of(args, run)
    # events and turning points apart: the steps on which the area grows
    grows = np.concatenate([[True], area[1:] > np.maximum.accumulate(area)[:-1]])
    area, volts = area[grows], volts[grows]
    if area[-1] < wanted:
        return float("nan")
    # the square of the voltage is the smooth one
    return float(np.sqrt(CubicSpline(area, volts**2)(wanted)))


def main():
    parser, args = parse()
    run = follow(args, args.mesh, args.taper, args.field, out=args.out, resume=args.resume,
                 quiet=args.quiet, failures=[dea.LossOfTension("z")],
                 settings=parser.settings(args))  # fmt: skip
    area, volts = area_of(args, run)
    run.add(
        area_ratio=area[-1],
        largest_voltage_V=volts.max(),
        **{f"voltage_at_area_{a:g}_V": voltage_at(args, run, a) for a in (1.5, 2.0, args.area)},
    )
    if args.study:
        run.add(study=study(args))
    if MPI.COMM_WORLD.rank == 0:
        dea.pictures.curve(args.out, x="electrode_area_m2", y="film_voltage_V")
        dea.pictures.deformed(args.out)
        if not args.quiet:
            report(args, run)


def study(args):
    """Voltages at three areas for edges of several kinds and meshes."""
    rows = []
    for field in ("full", "thin"):
        for taper in (0.0, 0.5 * args.taper, args.taper, 1.5 * args.taper):
            for mesh in (1, 2, 3, 4):
                try:
                    run = follow(args, mesh, taper, field, quiet=True, stability="never")
                except dea.EquilibriumLost as error:
                    run = error.run
                rows.append({
                    "field": field, "taper_m": taper, "mesh": mesh,
                    "area_reached": float(area_of(args, run)[0].max()),
                    **{f"voltage_at_area_{a:g}_V": voltage_at(args, run, a)
                       for a in (1.5, 2.0, args.area)},
                })  # fmt: skip
    return rows


def report(args, run):
    s = run.summary
    print(f"\narea ratio {s['area_ratio']:.4f}; largest voltage {s['largest_voltage_V']:.2f} V")
    for a in (1.5, 2.0, args.area):
        print(f"voltage at {a:g} times the area: {s[f'voltage_at_area_{a:g}_V']:.2f} V")
    for failure in s["failures"]:
        print(f"{failure['mode']} at {2 * failure['voltage_V']:.2f} V in {failure['region']!r}")
    for row in s.get("study", ()):
        print(f"{row['field']:5} taper {1e3 * row['taper_m']:4.1f} mm  mesh {row['mesh']}  "
              f"to area {row['area_reached']:.3f}  "
              + "  ".join(f"{v:9.2f} V" for k, v in row.items()
                          if k.startswith("volt")))  # fmt: skip
    print(f"\nresults: {Path(args.out)}/history.csv, fields.xdmf "
          "(film_voltage_V is the film's; voltage_V and potentials are the half's)")  # fmt: skip


if __name__ == "__main__":
    main()
