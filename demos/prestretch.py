"""Tutorial: pre-stretch, held by a frame or by weights.

A film is stretched to 2.5 times its length in both directions of its plane.  Then the voltage is
applied.

On a frame the stretch l of the film is constant.  The voltage only lowers the tension s of the
film, and at some voltage the film is slack (s = 0).  Weights pull with a constant force P per
undeformed area, which is called a dead load.  On weights the area of the film grows with the
voltage, until pull-in: a maximum of the voltage, beyond which there is no equilibrium.  The film is
in the same state everywhere, and this state is known exactly:

    frame:    true stress  s = mu (l^2 - l^-4) - eps (l^2 V/T)^2
    weights:  l P + eps (l^2 V/T)^2 = mu (l^2 - l^-4),   P = mu (2.5 - 2.5^-5)

V is the voltage, T the undeformed thickness, eps the permittivity, and mu the shear modulus.

Run it with `mpirun -n 2 python demos/prestretch.py`.  The demo cube.py follows the film on weights
to pull-in.  The demo membrane_disc.py has a round frame with an electrode in its middle.
"""

from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import Film, trace
from dea_fenicsx.geometry import BoxStack, Layer


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/prestretch")
    parser.number("--mu", 50e3, "Pa", "shear modulus")
    parser.number("--prestretch", 2.5, "-", "stretch in both directions of the plane")
    parser.number("--voltage", 3000.0, "V", "end of the ramp of the film on weights")
    return parser, parser.parse_args()


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    T, mu, lam = 0.5e-3, args.mu, args.prestretch  # m, Pa, -
    film = dea.Material(dea.NeoHookean(mu), dea.IdealDielectric(eps_r=2.8))
    # All lengths are those of the film before it is stretched.  A quarter of it is enough: x_min
    # and y_min are planes of symmetry.
    device = dea.device(BoxStack(5e-3, 5e-3, [Layer("film", T)], divisions=(2, 2)), comm)

    def scene(volts, **held):
        return dea.Scene(
            device,
            materials={"film": film},
            electrodes=[dea.Electrode("top", volts), dea.Ground("bottom")],
            supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
            **held,
        )

    # A frame: the stretch is prescribed, ramped up first, and kept while the voltage rises.  The
    # state in which the tension normal to z vanishes gets a step of its own.
    slack = T / lam**2 * (mu * (lam**2 - lam**-4) / film.electric.permittivity()) ** 0.5
    frame = dea.solve(
        scene(1.2 * slack, prescribed=[dea.Stretch(f"{a}_max", a, lam) for a in "xy"]),
        [dea.Ramp("stretch", steps=4), dea.Ramp("voltage", steps=4)],
        record={"force": dea.Reaction("x_max", "x")},
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        failures=[dea.LossOfTension("z")],
        settings=parser.settings(args),
    )

    # Weights: a force per undeformed area, ramped up first, and kept while the voltage rises.
    P = mu * (lam - lam**-5)
    pulled = [dea.DeadLoad("x_max", (P, 0, 0)), dea.DeadLoad("y_max", (0, P, 0))]
    weights = dea.solve(
        scene(args.voltage, loads=pulled),
        [dea.Ramp("load", steps=4), dea.Ramp("voltage", steps=4)],
        record={"stretch": dea.MeanStretch(("x_min", "x_max"), "x")},
        quiet=args.quiet,
    )
    branch = trace(Film(film, T).prestretched(lam, lam))  # the dead loads that hold this stretch
    exact = next(s for s, stable in branch.states_at(args.voltage) if stable)
    frame.add(
        slack_voltage_V=frame.summary["failures"][0]["voltage_V"],
        exact_slack_voltage_V=slack,
        stretch_on_weights=weights["stretch"],
        exact_stretch_on_weights=float(exact.stretches[0]),
        exact_pull_in_voltage_on_weights_V=branch.event("pull-in").voltage,
    )
    if comm.rank == 0 and not args.quiet:
        s = frame.summary
        gain = (weights["stretch"] / lam) ** 2 - 1
        print(f"\nframe:   goes slack at {s['slack_voltage_V']:.4f} V, exact {slack:.4f} V")
        print(f"weights: stretch {s['stretch_on_weights']:.8f} at {args.voltage:g} V, exact "
              f"{s['exact_stretch_on_weights']:.8f}; area {gain:+.1%}, "
              f"pull-in at {s['exact_pull_in_voltage_on_weights_V']:.1f} V")  # fmt: skip
        print(f"results: {frame.out}/history.csv")


if __name__ == "__main__":
    main()
