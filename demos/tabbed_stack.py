"""Stack with tabs: the capacitance and the contraction that margins and connections cost.

The electrodes of a stack keep a margin off its sides, and every second one reaches the same side by
a tab.  Where they overlap, the voltage presses the films together.  The margins are not pressed,
and they hold the stack back.  So do the covers at both ends.

Two closed forms stand beside it, both without the field at the edges.  The capacitance of n films
is n eps A/t, with the area A in which electrodes overlap.  At a small voltage, Betti's theorem
gives the mean strain along the stack: that of a free film, eps E^2/(3 mu), times the share of the
volume that lies between electrodes.

    python demos/tabbed_stack.py
    python demos/tabbed_stack.py --films 8 --margin 0.0005
"""

from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import Layer, TabbedStack
from dea_fenicsx.materials import EPSILON_0


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/tabbed_stack")
    parser.number("--mu", 100e3, "Pa", "shear modulus")
    parser.number("--permittivity", 3.0, "-", "relative permittivity")
    parser.number("--length", 12e-3, "m", "length, with both margins")
    parser.number("--width", 8e-3, "m", "width, with both margins")
    parser.number("--margin", 1e-3, "m", "margin between the electrodes and the sides")
    parser.number("--tab", 2e-3, "m", "width of the tabs")
    parser.number("--film", 0.5e-3, "m", "thickness of each film and of both covers")
    parser.count("--films", 4, "films between electrodes")
    parser.number("--voltage", 3e3, "V", "voltage between the electrodes")
    parser.count("--steps", 2, "steps of the voltage")
    parser.count("--mesh", 1, "refinement of the mesh")
    return parser, parser.parse_args()


def shape(args):
    layers = [Layer("film", args.film)] * (args.films + 2)
    return TabbedStack(
        args.length, layers, args.margin, width=args.width, tab=args.tab,
        divisions=(1, 4, 1, 1, 1),
    ).refine(args.mesh)  # fmt: skip


def scene(args, device):
    """The whole stack, whose lower face is not held; ramp factor 1 is the whole voltage."""
    film = dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(args.permittivity))
    return dea.Scene(
        device, {"film": film}, supports=[dea.FreeBody()],
        electrodes=[dea.Electrode("electrode_b", args.voltage), dea.Ground("electrode_a")],
    )  # fmt: skip


def main():
    parser, args = parse()
    stack = shape(args)
    record = {"stretch": dea.MeanStretch(("bottom", "top"), "z"),
              "capacitance": dea.Capacitance("electrode_b")}  # fmt: skip
    run = dea.solve(
        scene(args, dea.device(stack, MPI.COMM_WORLD)), dea.Ramp("voltage", steps=args.steps),
        record, out=args.out, resume=args.resume, quiet=args.quiet, settings=parser.settings(args),
    )  # fmt: skip
    eps = args.permittivity * EPSILON_0
    share = args.films * args.film * stack.active_area / (
        stack.height * args.length * args.width
    )  # fmt: skip
    film = eps * (args.voltage / args.film) ** 2 / (3 * args.mu)
    plates = args.films * eps * stack.active_area / args.film
    run.add(
        contraction=1 - run["stretch"], linear_contraction=share * film,
        linear_contraction_of_a_film=film, active_share_of_volume=share,
        capacitance_at_rest_F=run.column("capacitance_F")[0], plates_capacitance_F=plates,
    )  # fmt: skip
    if MPI.COMM_WORLD.rank == 0:
        say = (lambda text: None) if args.quiet else print
        s = run.summary
        say(f"contraction {100 * s['contraction']:.3f} %; {100 * share:.1f} % of the volume "
            f"works, which by Betti's theorem gives {100 * share * film:.3f} %")  # fmt: skip
        say(f"capacitance at rest {1e12 * s['capacitance_at_rest_F']:.3f} pF, of plates "
            f"{1e12 * plates:.3f} pF")  # fmt: skip
        dea.pictures.curve(run.out, "voltage_V", "stretch")
        dea.pictures.deformed(run.out, say=say)


if __name__ == "__main__":
    main()
