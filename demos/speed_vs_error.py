"""Speed against error: the stroke of a long helical actuator by formula, as rings and as a helix.

One quantity is computed with several fidelities on several meshes.  Which choice reaches 1 %, 0.1 %
or 0.01 % first?  The analytic helicoid presses the area of the electrodes alone.  Rings leave the
pitch out.  The helically periodic cell is the reference.  The actuator is that of
`hdea_two_turn.py`, and it may have any length.

Run it with `python demos/speed_vs_error.py`; it writes speed_vs_error.csv and a picture of it.
"""

import json
from dataclasses import asdict
from pathlib import Path

from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import Helicoid
from dea_fenicsx.geometry import HelicalCell

COARSE = HelicalCell(radial=6, rim=2, through=2, grading=4, grading_rim=2, grading_through=2)


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/speed_vs_error")
    parser.number("--voltage", 6e3, "V", "voltage between the electrodes")
    parser.number("--mu", 73.7e3, "Pa", "shear modulus (Park 2019, Table 5.2, G)")
    parser.number("--eps-r", 4.7, "-", "relative permittivity (Park 2019, Table 5.2)")
    parser.add_argument("--levels", type=int, nargs="+", default=[1, 2, 4],
                        help="levels of the meshes, coarse to fine, three or more")  # fmt: skip
    return parser, parser.parse_args()


def rubber(args):
    return dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(args.eps_r))


def cell(args, level, pitch, **elements):
    """One pitch of the cross-section; pitch 0 makes rings of it."""
    plate = dea.Material(dea.NeoHookean(args.mu), dea.Conductor())
    return dea.Scene(
        dea.device(COARSE.refine(level), MPI.COMM_WORLD),
        {"elastomer": rubber(args), "electrode_a": plate, "electrode_b": plate},
        electrodes=[dea.Electrode("electrode_a", args.voltage), dea.Ground("electrode_b")],
        supports=[dea.FreeBody()],
        kinematics=dea.Helical(pitch),
        elements=dea.Discretisation(**elements),
    )


def formula(args):
    """Contraction by the analytic helicoid: of the elastomer's share of the pitch."""
    c = COARSE
    model = Helicoid(c.outer_radius, c.inner_radius, c.elastomer, c.electrode, c.inset)
    share = c.elastomer / (c.elastomer + c.electrode)
    return share * float(model.contraction(rubber(args), args.voltage))


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    say = print if comm.rank == 0 and not args.quiet else lambda *a, **k: None
    pitch = COARSE.pitch
    ladder = dea.speed_vs_error(
        {
            "analytic helicoid": lambda: formula(args),
            "rings": lambda level: cell(args, level, 0.0),
            "helix, Taylor-Hood": lambda level: cell(args, level, pitch, pressure="continuous"),
            "helix, linear potential": lambda level: cell(args, level, pitch, potential_degree=1),
            "helix": lambda level: cell(args, level, pitch),
        },
        dea.OverallContraction(),
        args.levels,
        path=dea.Ramp(steps=3),
        name="long helix at 6 kV" if args.voltage == 6e3 else "long helix",
        say=say,
    )
    say(f"\n{ladder.table()}")
    if comm.rank == 0:
        report(Path(args.out), ladder, parser.settings(args), say)


def report(out, ladder, settings, say):
    """Table, picture and summary."""
    out.mkdir(parents=True, exist_ok=True)
    table = out / "speed_vs_error.csv"
    ladder.write(table)
    summary = {
        "reference_contraction": ladder.reference,
        "orders": {name: order for name, order in ladder.orders.items() if order == order},
        "cheapest": {f"{e:g}": asdict(rung) for e, rung in ladder.choices().items() if rung},
        "settings": settings,
    }
    (out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", "utf-8")
    say(f"\ntable:   {table}\npicture: {dea.pictures.ladder(table)[0]}")


if __name__ == "__main__":
    main()
