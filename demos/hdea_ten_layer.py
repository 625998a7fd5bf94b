"""Ten-layer helical actuator under voltage (Park 2019, 4.3.3), beside its helically periodic cell.

Park (2019) prints ten layers and a height of 16.5 mm, and these do not agree.  Ten turns of 1.1 mm
are 12.1 mm high, with the end of the last one.  A height of 16.5 mm means 15 pitches, --turns 14.

Run it with `mpirun -n 2 python demos/hdea_ten_layer.py`.  --reach continues to the 13 % of
Park (2019) or to pull-in.  --blocked adds the blocked force and the stiffness.  --table, without
mpirun, measures how the cost grows with turns and ranks.
"""

import csv
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import HDEA, HelicalCell
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.results.per_turn import per_turn
from dea_fenicsx.results.reading import read_frame, read_summary
from dea_fenicsx.support.subprocesses import environment, mpirun

# cells per turn, over the electrode's width, over each rim, through each elastomer layer
MESHES = {
    1: {"angular": 8, "radial": 3, "rim": 1, "through": 1},
    2: {"angular": 12, "radial": 4, "rim": 1, "through": 1},
    3: {"angular": 16, "radial": 8, "rim": 2, "through": 2},
}
ENDS = ("bottom", "top")
THESIS = {"contraction": 0.133, "voltage_V": 56.6e3, "stroke_m": 2.2e-3, "height_m": 16.5e-3}


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/hdea_ten_layer")
    parser.count("--turns", 10, "turns of the helix")
    parser.number("--voltage", 6e3, "V", "voltage between the electrodes at the end of the ramp")
    parser.count("--steps", 12, "voltage steps")
    parser.number("--mu", 73.7e3, "Pa", "shear modulus of the elastomer (Park 2019, Table 5.2, G)")
    parser.number("--electrode-mu", None, "Pa", "shear modulus of the electrodes; default: --mu")
    parser.number("--eps-r", 4.7, "-", "relative permittivity (Park 2019, Table 5.2)")
    parser.count("--mesh", 2, f"mesh density, {min(MESHES)} (coarse) to {max(MESHES)} (fine, "
                 "42 000 unknowns a turn)", MESHES)  # fmt: skip
    parser.number("--taper", 0.0, "m", "width over which the driven electrode's potential falls to "
                  "zero at its edges")
    parser.add_argument("--reach", action="store_true", help="on to 13 %% or to pull-in")
    parser.add_argument("--blocked", action="store_true", help="also the force between two rigid "
                        "plates, and the axial stiffness")  # fmt: skip
    parser.number("--cap", None, "m", "flat ends with passive discs of this thickness")
    parser.add_argument("--no-cell", action="store_true", help="skip the helically periodic cell")
    parser.add_argument("--no-count", action="store_true", help="do not count negative eigenvalues "
                        "at the end: at ten turns of mesh 3 that takes a quarter of the time, "
                        "and 8 GB instead of 5")  # fmt: skip
    parser.add_argument("--no-pictures", action="store_true", help="draw nothing")
    parser.add_argument("--table", nargs="*", type=int, metavar="TURNS", help="run these turns "
                        "(1 2 5 10 if none is named), each by an mpirun of its own, and write "
                        "unknowns, time and memory to growth.csv")  # fmt: skip
    parser.add_argument("--ranks", nargs="+", type=int, default=[2], metavar="N",
                        help="numbers of ranks in the table; with 1 and another one the time on 64 "
                        "ranks is extrapolated")  # fmt: skip
    args = parser.parse_args()
    if min([*(args.table or []), *args.ranks]) < 1:
        raise dea.InputError("--table and --ranks must hold whole numbers of at least 1.")
    if args.table is not None and MPI.COMM_WORLD.size > 1:
        raise dea.InputError("--table starts mpirun by itself; run it as plain python.")
    return parser, args


def materials(args, regions):
    electrode_mu = args.mu if args.electrode_mu is None else args.electrode_mu
    rubber = dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(args.eps_r))
    electrode = dea.Material(dea.NeoHookean(electrode_mu), dea.Conductor())
    given = {"elastomer": rubber, "caps": rubber, "electrode_a": electrode,
             "electrode_b": electrode}  # fmt: skip
    return {name: given[name] for name in regions}


def driven(args, device, supports=None, **more):
    tapers = ()
    if args.taper:
        r1, r2 = HDEA().electrode_radii
        tapers = (dea.Taper(r1 + args.taper, r1), dea.Taper(r2 - args.taper, r2))
    return dea.Scene(
        device,
        materials(args, device.regions),
        electrodes=[
            dea.Electrode("electrode_a", args.voltage, taper=tapers),
            dea.Ground("electrode_b"),
        ],
        supports=supports or [dea.FreeBody()],
        **more,
    )


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    if args.table is not None:
        growth(args)
        return
    flat = {} if args.cap is None else {"ends": "flat", "cap": args.cap}
    geometry = HDEA(turns=args.turns, **MESHES[args.mesh], **flat)
    device = dea.device(geometry, comm)
    path = [dea.Ramp("voltage", steps=args.steps)]
    if args.reach:
        until = ("contraction", THESIS["contraction"])
        path.append(dea.Trace("voltage", first=0.2, steps=60, until=until, longest=2.0))
    lost = ""
    try:
        run = dea.solve(
            driven(args, device),
            path,
            record={
                "contraction": dea.Contraction(ENDS, "z"),
                "bending_angle": dea.BendingAngle(ENDS),
                "twist": dea.Rotation(ENDS, "z"),
            },
            out=args.out,
            resume=args.resume,
            quiet=args.quiet,
            stability="never" if args.no_count else "last",
            settings=parser.settings(args),
        )
    except dea.EquilibriumLost as error:
        if not args.reach:
            raise
        run, lost = error.run, str(error)
    run.add(
        height_m=geometry.height,
        stroke_m=run["contraction"] * (geometry.height - (geometry.pitch if not flat else 0)),
        bending_angle_deg=float(np.degrees(run["bending_angle_rad"])),
        exact_volume_m3=geometry.volume,
    )
    say = print if comm.rank == 0 and not args.quiet else lambda *a, **k: None
    if args.reach:
        reach(run, lost)
    report(args, run, say)
    if args.blocked:
        blocked(args, device, run, geometry, say)
    if not args.no_cell and args.turns > 1:
        cell(args, comm, run, geometry, say)
    if comm.rank == 0 and not args.no_pictures:
        curve = dea.pictures.curve(args.out, x="voltage_V", y="contraction")[0]
        picture = dea.pictures.deformed(args.out, warp=5.0, say=say)
        say(f"\ncurve:   {curve}\npicture: {picture}")
    say(f"fields:  {run.out / 'fields.xdmf'}\nhistory: {run.out / 'history.csv'}")


def reach(run, lost):
    """The voltage for 13.3 %, on which the trace ends."""
    run.add(largest_voltage_V=float(np.max(run.column("voltage_V"))), lost=lost)
    if np.isclose(run["contraction"], THESIS["contraction"]):
        run.add(voltage_for_13_3_percent_V=run["voltage_V"])


def blocked(args, device, run, geometry, say):
    """Force between two rigid plates bonded to the ends, and the stiffness with one plate moved."""
    force = {"force": dea.Reaction("top", "z")}
    plates = [dea.Clamp("bottom"), dea.Clamp("top")]
    quiet = {"quiet": True, "stability": "never"}
    held = dea.solve(driven(args, device, plates), dea.Ramp("voltage", steps=args.steps), force,
                     **quiet)["force_N"]  # fmt: skip
    span = geometry.height - (geometry.pitch if geometry.ends == "ramp" else 0.0)
    push = dea.Displacement("top", "z", -1e-4 * span)
    pushed = dea.Scene(device, materials(args, device.regions), supports=[dea.Clamp("bottom"),
                       dea.Fix("top", "xy")], prescribed=[push])  # fmt: skip
    stiffness = dea.solve(pushed, dea.Ramp("stretch", steps=1), force, **quiet)["force_N"]
    stiffness /= push.metres
    p = args.eps_r * EPSILON_0 * (args.voltage / geometry.elastomer) ** 2
    linear = p * geometry.flat_area * geometry.elastomer / (geometry.elastomer + geometry.electrode)
    area = np.pi * (geometry.outer_radius**2 - geometry.inner_radius**2)
    run.add(blocked_force_N=held, linear_blocked_force_N=float(linear),
            stiffness_N_per_m=stiffness,
            linear_stiffness_N_per_m=float(3 * args.mu * area / span))  # fmt: skip
    say(f"\nbetween rigid plates, bonded: blocked force {held:.4f} N at {args.voltage:g} V "
        f"(linear, without ends and fringes: {linear:.4f} N);\nstiffness {stiffness:.1f} N/m "
        f"(E A/height: {3 * args.mu * area / span:.1f} N/m)")  # fmt: skip


def report(args, run, say):
    """The run beside what Park (2019) prints, and what is wrong with that."""
    s = run.summary
    pressure = args.eps_r * EPSILON_0 * (THESIS["voltage_V"] / 0.5e-3) ** 2
    say(f"\n{'':34}{'Park':>10}{'here':>12}")
    for name, thesis, here in (
        ("height, mm", "16.5", f"{1e3 * s['height_m']:.1f}"),
        ("voltage, kV", "56.6", f"{run['voltage_V'] / 1e3:.1f}"),
        ("contraction, %", "13.3", f"{100 * s['contraction']:.4f}"),
        ("voltage for 13.3 %, kV", "56.6",
         f"{s.get('voltage_for_13_3_percent_V', float('nan')) / 1e3:.4f}"),
        ("stroke, mm", "2.2", f"{1e3 * s['stroke_m']:.4f}"),
        ("twist between the ends, rad", "-", f"{s['twist_rad']:.5f}"),
        ("bending angle, deg", "-", f"{s['bending_angle_deg']:.4f}"),
    ):
        say(f"{name:34}{thesis:>10}{'-' if here == 'nan' else here:>12}")
    if s.get("lost"):
        say(f"the path ends: {s['lost']}")
    say(
        f"56.6 kV over 0.5 mm are {THESIS['voltage_V'] / 0.5e-3 / 1e6:.0f} MV/m and "
        f"{pressure / 1e3:.0f} kPa on the undeformed thickness.  13.3 % follows from them\nwith "
        "stiff electrodes and a compressible elastomer only (C10, D1 of Table 5.2, nu = 0.406: "
        "13.5 to 15.2 %);\nsoft electrodes, which Park (2019) needs for its disk stack, pull in at "
        "38 kV with these constants.  The forces\n1000 to 3000 N and the voltages 5.4 to 56.6 kV "
        "of Figure 4.7 contradict each other: V goes as the root of F."
    )
    say(f"{s['unknowns']} unknowns, {s['ranks']} ranks: {s['wall_s']:.1f} s, "
        f"{s['peak_memory_GB']:.2f} GB")  # fmt: skip


def cell(args, comm, run, geometry, say):
    """The middle turns beside one pitch of the same cross-section, at the end of the ramp."""
    at = next(i for i, r in enumerate(run.history) if np.isclose(r["voltage_V"], args.voltage))
    mesh = dict(MESHES[args.mesh])
    del mesh["angular"]
    section = HelicalCell(grading=2.0, grading_rim=1.0, grading_through=1.0, **mesh)
    begin = time.perf_counter()
    alone = dea.solve(
        driven(args, dea.device(section, comm), kinematics=dea.Helical(section.pitch)),
        dea.Ramp("voltage", steps=args.steps),
        record={"contraction": dea.OverallContraction(), "twist": dea.OverallTwist()},
        out=run.out / "cell",
        quiet=True,
    )
    spent = time.perf_counter() - begin
    found = None
    if comm.rank == 0:
        turns = per_turn(run.out, geometry.pitch, at)
        field = read_frame(run.out / "cell", -1).grid.cell_data["field_strength_V_per_m"]
        peak = turns.peak_field_V_per_m
        found = (*turns.middle, float(peak[len(peak) // 2]), float(np.max(field)))
    contraction, twist, peak, peak_of_cell = comm.bcast(found)
    rows = {
        "contraction": (contraction, alone["contraction"]),
        "twist_rad": (twist, alone["twist_rad_per_m"] * section.pitch),
        "peak_field_V_per_m": (peak, peak_of_cell),
    }
    s = run.summary
    run.add(
        middle_turn={name: three for name, (three, _) in rows.items()},
        helical_cell={name: one for name, (_, one) in rows.items()}
        | {"unknowns": alone.summary["unknowns"], "wall_s": spent},
    )
    say(f"\n{f'middle turn at {args.voltage:g} V':22}{args.turns:>6d} turns{'helical cell':>16}"
        f"{'difference':>12}")  # fmt: skip
    for name, (three, one) in rows.items():
        say(f"{name:22}{three:12.6g}{one:16.6g}{three / one - 1:12.2%}")
    say(f"{'unknowns':22}{s['unknowns']:12d}{alone.summary['unknowns']:16d}")
    say(f"{'wall time, s':22}{s['wall_s']:12.1f}{spent:16.1f}{spent / s['wall_s']:12.2%}")
    say("The effect of the ends fades over about the radius, 7 mm or six turns, from either side: "
        "the middle of\nten turns still feels them (1.9 % of contraction; 0.7 % at twenty, with "
        "twist and peak field within\n0.1 %).  The peak is that at the middles of cells, near a "
        "sharp edge: it depends on the mesh, which both share.")  # fmt: skip


COLUMNS = ("turns", "ranks", "unknowns", "wall_s", "assembly_s", "factor_s", "krylov_s",
           "factorisations", "newton_iterations", "krylov_iterations", "peak_memory_GB",
           "contraction")  # fmt: skip


def growth(args):
    """Run every number of turns on every number of ranks, each in processes of its own."""
    out = Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    rows = []
    print(" turns ranks  unknowns   wall s  factor s  Krylov s  memory GB  contraction")
    for ranks in args.ranks:
        for turns in args.table or (1, 2, 5, 10):
            folder = out / f"turns_{turns}_ranks_{ranks}"
            alone(args, ranks, turns, folder)
            row = {"turns": turns, **read_summary(folder)}
            rows.append({name: row[name] for name in COLUMNS})
            print(f"{turns:6d}{ranks:6d}{row['unknowns']:10d}{row['wall_s']:9.1f}"
                  f"{row['factor_s']:10.1f}{row['krylov_s']:10.1f}{row['peak_memory_GB']:11.2f}"
                  f"{row['contraction']:13.6f}", flush=True)  # fmt: skip
            with open(out / "growth.csv", "w", newline="") as f:
                writer = csv.DictWriter(f, COLUMNS)
                writer.writeheader()
                writer.writerows(rows)
    extrapolate(rows)
    print(f"\ntable: {out / 'growth.csv'}")


def alone(args, ranks, turns, folder):
    """This script, under an mpirun of its own: the memory of one run is not that of another."""
    command = [sys.executable, __file__, "--turns", turns, "--voltage", args.voltage, "--steps",
               args.steps, "--mu", args.mu, "--eps-r", args.eps_r, "--mesh", args.mesh,
               "--no-cell", "--no-pictures", "--quiet", "--out", folder]  # fmt: skip
    for name in ("electrode_mu", "taper", "cap"):
        if (value := getattr(args, name)) is not None:
            command += ["--" + name.replace("_", "-"), value]
    if args.no_count:
        command += ["--no-count"]
    if ranks > 1:
        command = [mpirun(), "-n", ranks, *command]
    done = subprocess.run(list(map(str, command)), env=environment(), stdin=subprocess.DEVNULL,
                          check=False)  # fmt: skip
    if done.returncode:
        raise dea.SolverError(f"{turns} turns on {ranks} ranks ended with {done.returncode}.")


def extrapolate(rows):
    """Powers of the unknowns, efficiency of the ranks, and 100 turns on 64 ranks."""
    by_ranks = {n: [r for r in rows if r["ranks"] == n] for n in {r["ranks"] for r in rows}}
    at_100 = {}
    for ranks, mine in sorted(by_ranks.items()):
        N = np.array([r["unknowns"] for r in mine])
        turns = np.array([r["turns"] for r in mine])
        if len(set(N)) < 2:
            continue
        many = np.polyval(np.polyfit(turns, N, 1), 100)
        fits = {name: np.polyfit(np.log(N), np.log([r[name] for r in mine]), 1)
                for name in ("wall_s", "peak_memory_GB")}  # fmt: skip
        at_100[ranks] = {n: float(np.exp(np.polyval(fit, np.log(many)))) for n, fit in fits.items()}
        print(f"\n{ranks} ranks: wall time grows with unknowns to the power "
              f"{fits['wall_s'][0]:.2f}, memory to {fits['peak_memory_GB'][0]:.2f}; 100 turns: "
              f"{many / 1e6:.2f} million unknowns, {at_100[ranks]['wall_s']:.0f} s, "
              f"{at_100[ranks]['peak_memory_GB']:.0f} GB in all")  # fmt: skip
    if 1 not in by_ranks or len(by_ranks) < 2:
        return
    n = max(by_ranks)
    largest = max(r["turns"] for r in rows)
    one, more = (next(r["wall_s"] for r in by_ranks[k] if r["turns"] == largest) for k in (1, n))
    serial = min(max((n * more / one - 1) / (n - 1), 0.0), 1.0)  # Amdahl's share
    print(f"{largest} turns: {one:.1f} s on 1 rank, {more:.1f} s on {n}: efficiency "
          f"{one / (n * more):.2f}, serial share {serial:.3f}")  # fmt: skip
    if 1 in at_100:
        wall = at_100[1]["wall_s"]
        print(f"100 turns on 64 ranks: {wall * (serial + (1 - serial) / 64):.0f} s by Amdahl's "
              f"law, {wall / 64:.0f} s if all were parallel; {at_100[n]['peak_memory_GB']:.0f} GB "
              f"in all, {at_100[n]['peak_memory_GB'] / 64:.2f} GB a rank")  # fmt: skip


if __name__ == "__main__":
    main()
