"""Tutorial: pull-in, what happens there and how to find it.

A free film becomes thinner under voltage.  So its field grows, and the film becomes thinner still.
Beyond the pull-in voltage there is no equilibrium.  For a free neo-Hookean film this voltage is
known (Zhao and Suo 2007):

    V = 0.687 T sqrt(mu/eps).

T is the undeformed thickness, mu the shear modulus, and eps the permittivity.  At this voltage the
film has the thickness 2^(-2/3) T = 0.63 T.

The tutorial shows three ways to go to pull-in:

1. The voltage is raised (ramped) until equilibrium is lost.
2. The branch, which is the curve of equilibria, is followed through pull-in by its arc length.
3. The charge is given instead of the voltage.  A film that stays uniform then has equilibria beyond
   pull-in.  But soon the uniform film is not stable: it becomes thin in one place, to which its
   charge flows.

Run it with `mpirun -n 2 python demos/pull_in.py`.  The demo snap_through.py is the next step: a
rubber that stiffens has a new stable state beyond pull-in.
"""

from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import Film, trace
from dea_fenicsx.geometry import BoxStack, Layer


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/pull_in")
    parser.number("--mu", 50e3, "Pa", "shear modulus")
    parser.number("--thickness", 0.5e-3, "m", "thickness of the film")
    return parser, parser.parse_args()


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    T = args.thickness
    film = dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(eps_r=2.8))
    device = dea.device(BoxStack(T, T, [Layer("film", T)], divisions=(1, 1)), comm)
    exact = trace(Film(film, T)).event("pull-in")
    thickness = dea.MeanStretch(("bottom", "top"), "z")
    record = {"thickness_stretch": thickness, "charge": dea.Charge("top")}

    def scene(electrode):
        return dea.Scene(
            device,
            materials={"film": film},
            electrodes=[electrode, dea.Ground("bottom")],
            supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
        )

    # 1. A ramp to 1.2 times that voltage.
    driven = scene(dea.Electrode("top", 1.2 * exact.voltage))
    told = ramped(driven, record)

    # 2. The same scene by arc length: over the maximum, and down the unstable branch to 0.4 of T.
    #    With stability="every" the run counts the negative eigenvalues of the tangent at each step
    #    and locates bifurcations: there the film can leave the uniform state.
    curve = dea.solve(
        driven,
        dea.Trace("voltage", until=("thickness_stretch", 0.4)),
        record,
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        stability="every", settings=parser.settings(args),
    )  # fmt: skip
    top = next(row for row in curve.history if row["event"] == "maximum")

    # 3. A given charge, up to twice that at pull-in.
    Q = 2 * exact.charge * T**2
    charged = dea.solve(
        scene(dea.ChargedElectrode("top", Q)),
        dea.Ramp("charge", steps=8),
        {**record, "voltage": dea.Potential("top")},
        quiet=True,
        stability="every",
    )
    volts = charged.column("voltage_V")
    split = next(row for row in charged.history if row["event"] == "bifurcation")
    curve.add(
        pull_in_voltage_V=top["voltage_V"],
        pull_in_thickness_stretch=top["thickness_stretch"],
        exact_pull_in_voltage_V=exact.voltage,
        ramp_ended_with=told,
        last_voltage_under_charge_V=float(volts[-1]),
        bifurcation_charge_over_that_of_pull_in=2 * split["charge_factor"],
        bifurcation_voltage_V=split["voltage_V"],
    )
    if comm.rank == 0:
        dea.pictures.curve(args.out, x="thickness_stretch", y="voltage_V")
        if not args.quiet:
            report(curve, exact)


def ramped(driven, record):
    """The sentence with which a ramp beyond pull-in ends.

    It belongs to the error EquilibriumLost.  A script that does not catch this error ends with the
    sentence and with exit status 3.  If the run has a folder, all steps before are kept there.
    """
    try:
        dea.solve(driven, dea.Ramp("voltage", steps=6), record, quiet=True)
    except dea.EquilibriumLost as lost:
        return str(lost)
    return ""


def report(curve, exact):
    s = curve.summary
    print(f"\nthe ramp: {s['ramp_ended_with']}")
    print(f"pull-in:  {s['pull_in_voltage_V']:.6f} V at {s['pull_in_thickness_stretch']:.5f} of "
          f"the thickness;\n          exact {exact.voltage:.6f} V at "
          f"{exact.stretches[2]:.5f}")  # fmt: skip
    print(f"charge:   the voltage falls to {s['last_voltage_under_charge_V']:.1f} V behind the "
          f"maximum, but from {s['bifurcation_charge_over_that_of_pull_in']:.3f} times the charge\n"
          "          of pull-in on the uniform film is not stable: it thins in one "
          "place")  # fmt: skip
    print(f"results:  {curve.out}/voltage_thickness_stretch.png")


if __name__ == "__main__":
    main()
