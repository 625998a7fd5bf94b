"""Two discs in free space: their capacitance with all of its fringe, beside Love's equation.

Two equal coaxial discs without thickness, of radius a at distance D a, carry the charges +Q and
-Q.  The air around them is meshed, in a box without flux through its walls.  Nothing is solid, so
nothing moves.  The capacitance Q/V tends to that of Love's integral equation as the box and the
mesh grow; the walls, at the distance R, err by about 3.5 (a/R)^3 at D = 2.  Without fringes it
would be pi/D times eps0 a.

Run it with `mpirun -n 2 python demos/fringe_capacitor.py --gap 0.5`.
"""

from matplotlib.figure import Figure
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import disc_capacitance, plate_capacitance
from dea_fenicsx.geometry import DiscCapacitor
from dea_fenicsx.materials import EPSILON_0


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/fringe_capacitor")
    parser.number("--gap", 2.0, "radii", "distance of the discs, in radii")
    parser.number("--box", 0.0, "radii", "radius of the box of air, in radii; 0 for one that errs "
                  "by less than 1e-3")  # fmt: skip
    parser.number("--radius", 10e-3, "m", "radius of the discs")
    parser.count("--mesh", 1, "refinement of the mesh")
    return parser, parser.parse_args()


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    a, charge = args.radius, 1e-9  # m, C
    # The walls feel the dipole of the discs, whose square grows with that of a wide gap.
    box = args.box or 20 * max(1.0, args.gap / 2) ** (2 / 3)
    discs = DiscCapacitor(a, args.gap * a, box * a).refine(args.mesh)

    # The lower disc is at 0 V and the charge of the upper one is given.  Since no flux leaves the
    # box, the lower disc has the opposite charge.
    scene = dea.Scene(
        dea.device(discs, comm),
        materials={"air": dea.Air()},
        electrodes=[dea.Ground("lower_disc"), dea.ChargedElectrode("upper_disc", charge)],
        kinematics=dea.Axisymmetric(),
    )
    run = dea.solve(
        scene,
        dea.Ramp("charge", steps=1),
        record={
            "potential": dea.Potential("upper_disc"),
            "lower_charge": dea.Charge("lower_disc"),
        },
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        settings=parser.settings(args),
    )
    unit = EPSILON_0 * a
    found, exact = charge / run["potential_V"] / unit, disc_capacitance(args.gap)
    run.add(
        capacitance_over_eps0_a=found,
        closed_form=exact,
        relative_error=found / exact - 1,
        parallel_plates_over_eps0_a=plate_capacitance(args.gap),
        charge_balance=run["lower_charge_C"] / charge + 1,
    )
    middle = dea.AlongLine((0.0, 0.0), (min(3.0, box) * a, 0.0), "field", points=61)
    radius, field = middle.profile(run.problem)  # on all ranks
    if comm.rank == 0:
        draw(run.out / "field_radius.png", radius / a, field, run["potential_V"] / (args.gap * a))
    if comm.rank == 0 and not args.quiet:
        print(f"\ncapacitance {found:.5f} eps0 a, Love's equation {exact:.5f} "
              f"({found / exact - 1:+.1e}), plates without fringe "
              f"{plate_capacitance(args.gap):.5f}")  # fmt: skip
        print(f"results: {run.out}/summary.json")


def draw(path, radius, field, between_plates):
    """The field half-way between the discs over the radius, and that of plates without a fringe."""
    figure = Figure(figsize=(4.2, 3.2), layout="constrained")
    axes = figure.subplots()
    axes.plot(radius, field / 1e3, label="discs in free space")
    axes.step([0, 1, 3], [between_plates / 1e3, between_plates / 1e3, 0], "--", where="pre",
              color="0.5", label="parallel plates, no fringe")  # fmt: skip
    axes.set(xlabel="Radius over that of the discs", ylabel="Field in the middle plane (kV/m)",
             xlim=(0, 3), ylim=(0, None))  # fmt: skip
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=200)


if __name__ == "__main__":
    main()
