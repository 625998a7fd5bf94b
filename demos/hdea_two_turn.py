"""Two-turn helical dielectric elastomer actuator under voltage (Park 2019, 4.3.3).

Two compliant electrodes wind as a double helix through a ring of rubber.  A voltage between them
squeezes every layer, and the actuator contracts.  The field is solved in full, with its fringes.

Run it with `mpirun -n 2 python demos/hdea_two_turn.py`; --trend adds the linear benchmark.
"""

import csv

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import HDEA
from dea_fenicsx.materials import EPSILON_0

# cells per turn, over the electrode's width, over each rim, through each elastomer layer
MESHES = {
    1: {"angular": 12, "radial": 4, "rim": 1, "through": 1},
    2: {"angular": 16, "radial": 8, "rim": 2, "through": 2},
    3: {"angular": 24, "radial": 12, "rim": 4, "through": 3},
}
LINEAR_SHARE = 0.800  # electrode area over ring area, times elastomer over pitch


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/hdea_two_turn")
    parser.number("--voltage", 6e3, "V", "voltage between the electrodes at the end of the ramp")
    parser.count("--steps", 12, "voltage steps")
    parser.count("--turns", 2, "turns of the helix")
    parser.number("--mu", 73.7e3, "Pa", "shear modulus of the elastomer (Park 2019, Table 5.2, G)")
    parser.number("--electrode-mu", None, "Pa", "shear modulus of the electrodes; default: --mu")
    parser.number("--eps-r", 4.7, "-", "relative permittivity (Park 2019, Table 5.2)")
    parser.count("--mesh", 2, f"mesh density, {min(MESHES)} (coarse) to {max(MESHES)} (fine)",
                 MESHES)  # fmt: skip
    parser.add_argument("--no-check", action="store_true", help="skip the coarser run that states "
                        "the mesh error")  # fmt: skip
    parser.add_argument("--trend", action="store_true", help="also run the linear benchmark for "
                        "1, 2, 4 and 8 turns (trend.csv)")  # fmt: skip
    return parser, parser.parse_args()


def materials(args):
    electrode_mu = args.mu if args.electrode_mu is None else args.electrode_mu
    electrode = dea.Material(dea.NeoHookean(electrode_mu), dea.Conductor())
    rubber = dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(args.eps_r))
    return {"elastomer": rubber, "electrode_a": electrode, "electrode_b": electrode}


def driven(args, device):
    """The actuator floating free, one electrode driven and the other grounded."""
    return dea.Scene(
        device,
        materials(args),
        electrodes=[dea.Electrode("electrode_a", args.voltage), dea.Ground("electrode_b")],
        supports=[dea.FreeBody()],
    )


def record():
    return {
        "contraction": dea.Contraction(("bottom", "top"), "z"),
        "charge": dea.Charge("electrode_a"),
        "capacitance": dea.Capacitance("electrode_a"),
        "top": dea.MeanDisplacement("top", "z"),
    }


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    geometry = HDEA(turns=args.turns, **MESHES[args.mesh])
    device = dea.device(geometry, comm)
    run = dea.solve(
        driven(args, device),
        dea.Ramp("voltage", steps=args.steps),
        record=record(),
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        settings=parser.settings(args),
    )
    height = geometry.height
    run.add(
        height_m=height,
        stroke_m=run["contraction"] * (height - geometry.pitch),
        exact_volume_m3=geometry.volume,
    )
    say = print if comm.rank == 0 and not args.quiet else lambda *a, **k: None
    if not args.no_check and args.mesh > 1:
        check_mesh(args, run, comm, say)
    if args.trend:
        trend(args, comm, run, say)

    pictures = {}
    if comm.rank == 0:
        pictures["curve"] = dea.pictures.curve(args.out, x="voltage_V", y="contraction")[0]
        pictures["picture"] = dea.pictures.deformed(args.out, warp=10.0, say=say)
    say(f"\nvolume {run.summary['volume_m3'] * 1e9:.4f} mm^3 (exact {geometry.volume * 1e9:.4f}), "
        f"height {height * 1e3:.2f} mm")  # fmt: skip
    say(f"contraction at {args.voltage:g} V: {run['contraction']:.6f}")
    say(f"\nfields:  {run.out / 'fields.xdmf'}\nhistory: {run.out / 'history.csv'}")
    for name, path in pictures.items():
        say(f"{name + ':':9}{path}")


def check_mesh(args, run, comm, say):
    """State the mesh error: the same ramp on the next coarser mesh, at half and full voltage."""
    say("\nthe same on a coarser mesh, to state the mesh error ...")
    device = dea.device(HDEA(turns=args.turns, **MESHES[args.mesh - 1]), comm)
    ramp = dea.Ramp("voltage", steps=max(args.steps // 3, 2), at=(0.5,))
    coarse = dea.solve(driven(args, device), ramp, record(), quiet=True, stability="never")
    found = {}
    for factor in (0.5, 1.0):
        volts = factor * args.voltage
        here = np.isclose(run.column("voltage_V"), volts, rtol=1e-12)
        there = np.isclose(coarse.column("voltage_V"), volts, rtol=1e-12)
        if not here.any():
            continue
        fine = float(run.column("contraction")[here][0])
        change = abs(fine - float(coarse.column("contraction")[there][0])) / abs(fine)
        say(f"  {volts:6g} V: contraction {fine:.6f}, changed by {change:.2%} from the coarser "
            f"mesh ({coarse.summary['unknowns']} unknowns)")  # fmt: skip
        found[f"{volts:g}_V"] = {"contraction": fine, "relative_mesh_change": change}
    run.add(mesh_check=found)


def trend(args, comm, run, say):
    """Mean axial strain at a small load, by given pressure and by the full field.

    With a given pressure p on the active faces of the electrodes and one modulus E everywhere,
    Betti's theorem gives -0.800 p/E times the share of layers that are active, (2n - 1)/2n.
    """
    strain = 1e-3
    p = strain * 3 * args.mu
    film = materials(args)["elastomer"].electric
    volts = 0.5e-3 * float(np.sqrt(p / (film.eps_r * EPSILON_0)))
    rows = []
    say("\nturns  unknowns  given pressure  exact -0.8 (2n-1)/2n    full field   (strain E/p)")
    for turns in (1, 2, 4, 8):
        device = dea.device(HDEA(turns=turns, **MESHES[1]), comm)
        pressed = dea.Scene(
            device,
            materials(args),
            supports=[dea.FreeBody()],
            loads=[dea.DeadPressure(f"electrode_{e}_active", p) for e in "ab"],
        )
        by_voltage = dea.Ramp("voltage", to=volts / args.voltage, steps=1)
        cases = ((pressed, dea.Ramp("load", steps=1)), (driven(args, device), by_voltage))
        height = {"c": record()["contraction"]}
        given, field = (
            dea.solve(scene, ramp, height, quiet=True, stability="never") for scene, ramp in cases
        )
        exact = -LINEAR_SHARE * (2 * turns - 1) / (2 * turns)
        row = (turns, given.summary["unknowns"], -given["c"] / strain, exact, -field["c"] / strain)
        rows.append(row)
        say(f"{row[0]:5d}{row[1]:10d}{row[2]:16.4f}{row[3]:22.4f}{row[4]:14.4f}")
    if comm.rank == 0:
        with open(run.out / "trend.csv", "w", newline="") as f:
            writer = csv.writer(f)
            writer.writerow(["turns", "unknowns", "given_pressure", "exact", "full_field"])
            writer.writerows(rows)
    run.add(linear_trend=[dict(zip(("turns", "unknowns", "given_pressure", "exact", "full_field"),
                                   r, strict=True)) for r in rows])  # fmt: skip


if __name__ == "__main__":
    main()
