"""Folding and zipping: parts that move freely at first, and then meet something.

``--case storey``: a storey of a Kresling box with three sides, whose upper polygon is pushed down
and turns freely.  Its panels fold inwards until they meet a rod that stands on the axis, and are
pushed on past that.  It is solved with the rod and without it: the difference of the forces is what
the contact changes.  The rod is rigid and without friction.  At a
stroke of 7.5 mm the state with all three creases on the rod is not stable any more.

``--case panels``: a storey with four sides, whose polygons are rigid; one turns and moves against
the other.  Here each valley crease meets both of its neighbours, and nothing stands on the axis.
The storey has two-fold axes: a half turn about one of them takes a crease to its neighbour.  So the
two meet on that axis, at a surface which the half turn takes to itself: a plane through the axis.
Its tilt about the axis is not known before.  Each plane is a thin rigid sheet, which turns freely
about its axis; its weak spring holds it only while nothing touches it.  Sheets act on the short
piece of each crease where the two meet.  The sheet is flat, and so it keeps apart what is bent
around it; with shorter pieces (``--piece``) the force past the meeting falls towards that of the
two creases alone.  This is the symmetric state: it is solved with the sheets and without them.

With 1, 2, 3 and 4 cells across half a hinge (``--across``) the force at a stroke of 6.8 mm is
57.97, 53.24, 52.50 and 52.27 N, which tends to 52.0 N.  Before the creases meet, the force
converges in the same way: what counts is the bending of the hinges, and not the contact.

``--case zip``: a film with an electrode below hangs over a grounded electrode with a layer of
insulator on it; the air between is meshed.  Half of it is modelled: it is clamped at x = 0, the
plane of symmetry is at x = L.  Three things are found:

  - the voltage at which the free film is lost to the electrode (pull-in);
  - the film pressed down, held by the full voltage and left alone: how far it is zipped.  The
    charge is compared with that of a beam with the free length s that makes
    6 D g^2/s^3 - V^2 C(s)/2 smallest, D = mu h^3/3, where C counts the gap, too;
  - the voltage at which it lets go again, far below pull-in.

No search for contact is made there: the air is squeezed to almost nothing and carries the pressure.

Run it with `mpirun -n 2 python demos/zipping_or_folding.py`.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from mpi4py import MPI
from scipy.integrate import quad

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, KreslingCell, Layer
from dea_fenicsx.materials import EPSILON_0, bulk_modulus_of

MU, EPS_R, DEPTH = 1e6, 3.0, 1e-3  # Pa, -, m
LENGTH, FILM, INSULATOR = 1e-3, 60e-6, 20e-6  # m

SIDES, SIDE, HEIGHT, TWIST = 3, 54e-3, 30e-3, np.radians(42.0)  # of the storey; m and rad
PANEL, HINGE = 0.5e-3, 2e-3  # thickness of the panels, width of the hinges, m
PETG, NU, RUBBER = 2.1e9, 0.38, 100e6  # Young's moduli of panels and hinges in Pa
MESH = {"along": 2, "tip": 1, "strip": 1, "through": 1, "relief": 0.2}

FOUR = dict(side=44e-3, height=30e-3, twist=np.radians(75.0), sides=4, along=3, relief=0.3)
MEET, TILT = 3.6e-3, np.radians(20.9)  # from the middle of a crease, m; tilt of the sheets, rad
WEAK = 1e-3  # N m/rad, of the springs that hold the polygons against turning together
LIGHT = 1e-3  # N m/rad, of the springs that hold the sheets


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/zipping_or_folding")
    parser.add_argument(
        "--case", choices=("storey", "panels", "zip"), default="storey", help="what to solve"
    )
    parser.number("--stroke", 7e-3, "m", "storey, panels: how far the polygons move together")
    parser.number("--piece", 1e-3, "m", "panels: half the length of crease that a sheet acts on")
    parser.number("--tolerance", 1e-5, "m", "panels: tolerance of the gap to the sheets")
    parser.number("--rod", 3.6e-3, "m", "storey: radius of the rod on its axis")
    parser.count("--steps", 10, "storey, panels: steps of the stroke")
    parser.count("--across", 3, "panels: cells across half a hinge")
    parser.count("--refine", 1, "panels: factor of all divisions of the mesh")
    parser.number("--voltage", 100.0, "V", "zip: voltage that holds the film")
    parser.number("--gap", 30e-6, "m", "zip: thickness of the air between film and insulator")
    parser.number("--push", 150.0, "Pa", "zip: pressure that brings the film down before")
    parser.number("--stiffness", 1e-9, "-",
                  "zip: shear modulus of the air over that of the film")  # fmt: skip
    parser.count("--mesh", 12, "zip: cells along the film")
    return parser, parser.parse_args()


def make_scene(args, comm, volts):
    layers = [Layer("insulator", INSULATOR), Layer("gap", args.gap, 2), Layer("film", FILM)]
    strip = BoxStack(LENGTH, None, layers, divisions=args.mesh, order=1)
    rubber = dea.NeoHookean(MU)
    return dea.Scene(
        dea.device(strip, comm),
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


def storey(args, rod, comm):
    """The storey, its lower polygon clamped and the upper one pushed down; with a rod or not."""
    cell = KreslingCell(SIDE, HEIGHT, TWIST, PANEL, HINGE, sides=SIDES, **MESH)
    mu = PETG / (2 * (1 + NU))
    petg = dea.Material(dea.NeoHookean(mu), bulk_modulus=bulk_modulus_of(mu, NU))
    rubber = dea.Material(dea.NeoHookean(RUBBER / 3))
    axis = dea.Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), args.rod)
    return dea.Scene(
        dea.device(cell, comm),
        {"panel": petg, "side": rubber, "edge": rubber, "diagonal": rubber},
        supports=[dea.Clamp("bottom"), *([dea.Obstacle("inner", axis)] if rod else [])],
        prescribed=[dea.Displacement("top", "z", -args.stroke)],
    )


def fold(args, comm, settings):
    """Force over stroke, with the rod and without it."""
    record = {
        "stroke": dea.MeanDisplacement("top", "z"),
        "force": dea.Reaction("top", "z"),
        "twist": dea.Rotation("top", "z"),
    }
    met = {"gap": dea.ContactGap("inner"), "pressure": dea.ContactPressure("inner")}
    path = dea.Ramp("stretch", steps=args.steps, at=np.linspace(0, 1, args.steps + 1)[1:-1])
    runs = [
        dea.solve(storey(args, rod, comm), path, record | (met if rod else {}), out=out,
                  resume=args.resume, quiet=args.quiet, settings=settings)
        for rod, out in ((True, args.out), (False, Path(args.out) / "without_rod"))
    ]  # fmt: skip
    run, free = runs
    # Of the strokes asked for alone: which others a run takes on its way depends on rounding.
    mine = at_strokes(run, args)
    stroke, gap = -run.column("stroke_m")[mine], run.column("gap_m")[mine]
    closed = np.flatnonzero(run.column("pressure_Pa")[mine] > 0)
    meet = None
    if len(closed):  # the gap before is continued to 0
        k = max(int(closed[0]) - 1, 1)
        meet = stroke[k] + gap[k] * (stroke[k] - stroke[k - 1]) / (gap[k - 1] - gap[k])
    loose = -np.interp(stroke[-1], -free.column("stroke_m"), free.column("force_N"))
    run.add(
        case="storey",
        panels_meet_at_stroke_m=meet,
        stroke_reached_m=stroke[-1],
        force_at_stroke_N=-run["force_N"],
        force_without_contact_N=loose,
        contact_changes_force_by=-run["force_N"] / loose - 1,
        twist_at_stroke_deg=float(np.degrees(run["twist_rad"])),
        twist_without_contact_deg=float(np.degrees(free["twist_rad"])),
        **dict.fromkeys(ZIP_KEYS),
    )
    if comm.rank == 0 and not args.quiet:
        told = "do not meet the rod" if meet is None else f"meet the rod at {meet * 1e3:.2f} mm"
        print(
            f"\nthe panels {told}; at {stroke[-1] * 1e3:.2f} mm the force is "
            f"{-run['force_N']:.2f} N, without the rod {loose:.2f} N"
        )
        print(f"results: {run.out}/history.csv, without_rod/history.csv, fields.xdmf")  # fmt: skip


class Meeting(KreslingCell):
    """A storey about the origin whose two-fold axes through the edges are x and y.

    Facet groups ``low_k`` and ``up_k`` are the pieces of valley k that meet its neighbours, on half
    the length `piece`; region ``sheet_k`` stands for the sheet between ``up_k`` and ``low_(k+1)``.
    """

    piece = 1e-3

    def _panel(self):
        """The panel with cells that end where the pieces do."""
        panel = super()._panel()
        half = (0.5 - self.relief) * self._crease
        ends = [0, 1 - (MEET + self.piece) / half, 1 - (MEET - self.piece) / half, 1]
        at = np.interp(np.linspace(0, 1, self.along + 1), [0, 1 / 3, 2 / 3, 1], ends)
        return replace(panel, hinge=self.relief + (0.5 - self.relief) * at)

    @property
    def _crease(self):
        a, _, b = self._panels[0]
        return float(np.linalg.norm(b - a))

    def mesh(self):
        mesh = super().mesh()
        inner = mesh.facets.pop("inner")
        panel, cell = np.divmod(np.arange(len(inner)), len(inner) // (2 * self.sides))
        start, end = self._panels[panel][:, 2], self._panels[panel][:, 0]
        arm = mesh.points[inner].mean(axis=(1, 2)) - (start + end) / 2
        along = np.sum(arm * (end - start), axis=1) / self._crease
        width = 2 * self.along * self.strip
        meets = (cell // width == 2) & (np.abs(np.abs(along) - MEET) < self.piece)
        mesh.facets["inner"] = inner[~meets]
        for k in range(self.sides):
            for name, sign in (("low", -1), ("up", 1)):
                mesh.facets[f"{name}_{k}"] = inner[
                    meets & (panel // 2 == k) & (sign * arm[:, 2] > 0)
                ]
        turn = np.pi / self.sides + self.twist / 2 + np.pi / self.sides
        c, s = np.cos(turn), np.sin(turn)
        mesh.points = mesh.points @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        mesh.points[:, 2] -= self.height / 2
        self._add_sheets(mesh)
        return mesh

    def _add_sheets(self, mesh):
        """One cell each, beside the storey: a rigid part needs nodes, wherever they are."""
        edge = np.linspace(-1e-3, 1e-3, 3)
        cube = np.stack(np.meshgrid(edge, edge, edge, indexing="ij"), axis=-1).reshape(-1, 3)
        for k in range(self.sides):
            place = 2 * self.side * np.array([np.cos(k * np.pi / 2), np.sin(k * np.pi / 2), 0])
            numbers = len(mesh.points) + np.arange(27).reshape(1, 3, 3, 3)
            mesh.points = np.concatenate([mesh.points, cube + place])
            mesh.add_region(f"sheet_{k}", [len(mesh.cells)])
            mesh.cells = np.concatenate([mesh.cells, numbers])

    def measures(self):
        """Sizes of the groups; those of the pieces and of what is left are about right."""
        k = range(self.sides)
        piece = self.hinge * 2 * self.piece
        return (super().measures() | {f"sheet_{i}": 8e-9 for i in k}
                | {f"{name}_{i}": piece for name in ("low", "up") for i in k})  # fmt: skip


def sheets(args):
    """The planes between neighbouring valleys, and what holds them."""
    found = []
    for k in range(FOUR["sides"]):
        angle, axis, name = k * np.pi / 2, "xy"[k % 2], f"sheet_{k}"
        normal = np.array([np.sin(TILT) * np.sin(angle), -np.sin(TILT) * np.cos(angle),
                           np.cos(TILT)])  # fmt: skip
        for surface, sign in ((f"up_{k}", 1), (f"low_{(k + 1) % FOUR['sides']}", -1)):
            plane = dea.Plane((0.0, 0.0, 0.0), tuple(sign * normal), between=True)
            found.append(
                dea.Obstacle(surface, plane, carried_by=name, tolerance=args.tolerance)
            )
        found.append(dea.Rigid(name, held="xyz", turns=axis, centre=(0.0, 0.0, 0.0)))
        found.append(dea.TorsionSpring(name, LIGHT, about=axis))
    return found


def four_sides(args, meets, comm):
    """The storey of four sides between rigid polygons that turn against each other."""
    Meeting.piece = args.piece
    cell = Meeting(**FOUR, strip=args.across, thickness=PANEL, hinge=HINGE).refine(args.refine)
    mu = PETG / (2 * (1 + NU))
    petg = dea.Material(dea.NeoHookean(mu), bulk_modulus=bulk_modulus_of(mu, NU))
    rubber = dea.Material(dea.NeoHookean(RUBBER / 3))
    names = [f"sheet_{k}" for k in range(FOUR["sides"])]
    ends = ("bottom", "top")
    supports = [
        *(dea.Rigid(end, held="xy", turns="z") for end in ends),
        *(dea.TorsionSpring(end, WEAK) for end in ends),
        *(sheets(args) if meets else [dea.Rigid(n, held="xyz", turns="") for n in names]),
    ]
    return dea.Scene(
        dea.device(cell, comm),
        {"panel": petg, "side": rubber, "edge": rubber, "diagonal": rubber}
        | dict.fromkeys(names, rubber),
        supports=supports,
        prescribed=[dea.Displacement("top", "z", -args.stroke / 2),
                    dea.Displacement("bottom", "z", args.stroke / 2)],
    )  # fmt: skip


def at_strokes(run, args):
    """Which rows of a run's history are strokes that were asked for."""
    share = run.column("stretch_factor")
    return np.abs(share * args.steps - np.round(share * args.steps)) < 1e-9 * args.steps


def asked(run, args):
    """Stroke in m and force in N of the strokes that were asked for, as far as a run came."""
    chosen = at_strokes(run, args)
    return args.stroke * run.column("stretch_factor")[chosen], run.column("force_N")[chosen]


def meet(args, comm, settings):
    """Force over stroke of the storey of four sides, with the sheets and without them."""
    record = {"force": dea.PartForce("top", "z"), "twist": dea.PartRotation("top", "z")}
    more = {"pressure": dea.ContactPressure("up_0"), "gap": dea.ContactGap("up_0"),
            "sheet": dea.PartRotation("sheet_0", "x")}  # fmt: skip
    path = dea.Ramp("stretch", steps=args.steps, at=np.linspace(0, 1, args.steps + 1)[1:-1])
    run, free = [
        dea.solve(four_sides(args, meets, comm), path, record | (more if meets else {}), out=out,
                  resume=args.resume, quiet=args.quiet, settings=settings)
        for meets, out in ((True, args.out), (False, Path(args.out) / "without_contact"))
    ]  # fmt: skip
    # Of the strokes asked for alone: which others a run takes on its way depends on rounding.
    stroke, force = asked(run, args)
    loose = np.interp(stroke, *asked(free, args))
    more_force = loose - force
    closed = np.flatnonzero(more_force > 0.01 * np.abs(loose).max())
    met = None
    if len(closed) > 1:  # the additional force is continued to 0
        i, j = closed[:2]
        met = stroke[i] - more_force[i] * (stroke[j] - stroke[i]) / (more_force[j] - more_force[i])
    run.add(
        case="panels",
        panels_meet_at_stroke_m=met,
        stroke_reached_m=stroke[-1],
        force_at_stroke_N=-run["force_N"],
        force_without_contact_N=-loose[-1],
        contact_changes_force_by=run["force_N"] / loose[-1] - 1,
        twist_at_stroke_deg=float(np.degrees(2 * run["twist_rad"])),
        twist_without_contact_deg=float(np.degrees(2 * free["twist_rad"])),
        **dict.fromkeys(ZIP_KEYS),
    )
    if comm.rank == 0 and not args.quiet:
        told = "do not meet" if met is None else f"meet at {met * 1e3:.2f} mm"
        print(f"\nthe panels {told}; at {stroke[-1] * 1e3:.2f} mm the force is "
              f"{-run['force_N']:.2f} N, without contact {-loose[-1]:.2f} N")  # fmt: skip


ZIP_KEYS = ("pull_in_voltage_V", "release_voltage_V", "gap_closed", "charge_when_zipped_C",
            "beam_charge_C", "beam_zipped_length_m", "air_energy_share")  # fmt: skip


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    solve = {"storey": fold, "panels": meet, "zip": zip_down}[args.case]
    solve(args, comm, parser.settings(args))


def zip_down(args, comm, settings):
    """The film pressed down and left alone, its pull-in and its release."""
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
        settings=settings,
    )  # fmt: skip
    pull_in = lost_at(scene, dea.Ramp("voltage", steps=3))
    release = lost_at(scene, dea.Ramp("voltage", to=0.0, steps=3), start=run)
    zipped, charge = beam(args)
    run.add(
        case="zip",
        pull_in_voltage_V=pull_in,
        release_voltage_V=release,
        gap_closed=-run["deflection_m"] / args.gap,
        charge_when_zipped_C=run["charge_C"],
        beam_charge_C=charge,
        beam_zipped_length_m=zipped,
        air_energy_share=run["air_J"] / run["elastic_J"],
    )
    if comm.rank == 0 and not args.quiet:
        print(
            f"\nzipped at {args.voltage:g} V: charge {run['charge_C']:.4e} C, of a beam "
            f"{charge:.4e} C, zipped over {zipped * 1e3:.2f} mm of {LENGTH * 1e3:g} mm"
        )
        print(
            f"pull-in at {pull_in if pull_in is None else round(pull_in, 2)} V, release at "
            f"{release if release is None else round(release, 2)} V"
        )
        print(f"the air takes {run['air_J'] / run['elastic_J']:.1%} of the elastic energy")
        print(f"results: {run.out}/history.csv")  # fmt: skip


if __name__ == "__main__":
    main()
