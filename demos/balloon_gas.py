"""A balloon of dielectric elastomer, filled with gas, closed, and put under voltage.

A hollow sphere is inflated without voltage until its inner radius has grown to --inflated times its
first one.  Then it is closed: the amount of gas stays, and the pressure is an unknown.  A voltage
between the inner and the outer face lets the wall thin and the sphere grow, while the pressure
falls.  A gas in a low outside pressure gives way easily, one in a high outside pressure is stiff.

Neo-Hookean, inner radius A, outer radius B; dimensionless voltage V/(A sqrt(mu/eps)).  At the inner
radius a, with b^3 = a^3 + B^3 - A^3, the pressure above that outside is

    P = g(a/A) - g(b/B) - V^2/2 (a^-4 - b^-4)/(1/a - 1/b)^2,    g(l) = -2/l - 1/(2 l^4),

in units of mu and A, and the closed isothermal gas has P = (p0 + P_1)(a_1/a)^3 - p0.

    python demos/balloon_gas.py --outside-pressure 0 --voltage 0.1
    python demos/balloon_gas.py --part octant
    python demos/balloon_gas.py --part whole --outside-pressure 0 --voltage 0.1
    python demos/balloon_gas.py --limits --outside-pressure 0

The whole section also knows states whose inner face is off the centre: the round one is found to be
unstable there before the sphere is at its limit.
"""

import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq

import dea_fenicsx as dea
from dea_fenicsx.geometry import HollowSphere
from dea_fenicsx.materials import EPSILON_0

EPS_R = 3.0
LARGEST = 20.0
"""Largest inner radius, in A, at which the closed form is looked for."""


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/balloon_gas")
    parser.number("--outside-pressure", 1.0, "mu", "pressure outside")
    parser.number("--voltage", 0.1, "A sqrt(mu/eps)", "voltage on the closed balloon")
    parser.number("--inflated", 1.2, "A", "inner radius when it is closed")
    parser.number("--ratio", 1.2, "A", "outer radius of the undeformed wall")
    parser.number("--radius", 10e-3, "m", "undeformed inner radius A")
    parser.number("--mu", 50e3, "Pa", "shear modulus")
    parser.add_argument(
        "--part", choices=("half", "whole", "octant"), default="half",
        help="section with an equator, whole section, or an eighth in space",
    )  # fmt: skip
    parser.count("--mesh", 2, "refinement of the mesh")
    parser.add_argument(
        "--limits", action="store_true",
        help="limit points of the voltage: with the gas closed, and at a given pressure",
    )  # fmt: skip
    return parser, parser.parse_args()


def pressure(args, a, volts):
    """The pressure at an inner radius under a voltage, in units of mu."""
    B = args.ratio
    b = (a**3 + B**3 - 1) ** (1 / 3)

    def g(stretch):
        return -2 / stretch - 1 / (2 * stretch**4)

    return g(a) - g(b / B) - volts**2 / 2 * (a**-4 - b**-4) / (1 / a - 1 / b) ** 2


def closed_form(args):
    """The inner radius of the round balloon under the voltage, in A; None if there is none.

    It is the first one on the way up from the state without voltage.
    """
    p0, a_1 = args.outside_pressure, args.inflated
    filled = (p0 + pressure(args, a_1, 0.0)) * a_1**3

    def unbalanced(a):
        return filled / a**3 - p0 - pressure(args, a, args.voltage)

    radii = np.linspace(a_1, LARGEST, 20001)
    over = np.flatnonzero(np.array([unbalanced(a) for a in radii]) <= 1e-14)
    if not len(over):
        return None
    k = over[0]
    return float(radii[0] if k == 0 else brentq(unbalanced, radii[k - 1], radii[k], xtol=1e-14))


def unit_volts(args):
    """A sqrt(mu/eps) in V."""
    return args.radius * np.sqrt(args.mu / (EPS_R * EPSILON_0))


def scene(args, **content):
    """The balloon with a cavity that holds something."""
    mesh = HollowSphere(args.radius, args.ratio * args.radius, args.part).refine(args.mesh)
    device = dea.device(mesh, MPI.COMM_WORLD)
    supports = {
        "half": [dea.Fix("axis", "r"), dea.Fix("equator", "z")],
        "whole": [dea.Fix("axis", "r"), dea.FreeBody()],
        "octant": [dea.Fix(f"{axis}_min", axis) for axis in "xyz"],
    }
    outside = args.outside_pressure * args.mu
    return dea.Scene(
        device,
        {"wall": dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(EPS_R))},
        electrodes=[dea.Electrode("inner", unit_volts(args)), dea.Ground("outer")],
        supports=supports[args.part],
        loads=[dea.Cavity("inner", outside=outside, ramp="fill", **content)],
        kinematics=dea.ThreeD() if args.part == "octant" else dea.Axisymmetric(),
    )


def fill(args):
    """Pressure in Pa, and amount of gas in Pa m^3, that inflate the part that is solved."""
    p0, over = args.outside_pressure, pressure(args, args.inflated, 0.0)
    amount = (p0 + over) * args.inflated**3 - p0
    return over * args.mu, amount * cavity_volume(args) * args.mu


def cavity_volume(args):
    """Undeformed volume in m^3 of the part of the cavity that is solved."""
    share = {"half": 1 / 2, "whole": 1.0, "octant": 1 / 8}[args.part]
    return share * 4 / 3 * np.pi * args.radius**3


def main():
    parser, args = parse()
    if args.ratio <= 1 or args.inflated < 1:
        parser.error("--ratio must be above 1, and --inflated at least 1")
    pascal, gas = fill(args)
    record = {
        "pressure": dea.CavityPressure("inner"),
        "cavity": dea.CavityVolume("inner"),
        "charge": dea.Charge("inner"),
    }
    path = [dea.Ramp("fill", steps=4)]
    if args.voltage:
        path.append(dea.Ramp("voltage", to=args.voltage, steps=4))
    exact = closed_form(args)
    lost = ""
    try:
        run = dea.solve(
            scene(args, gas=gas), path, record, out=args.out, resume=args.resume,
            quiet=args.quiet, stability="every", settings=parser.settings(args),
        )  # fmt: skip
    except dea.EquilibriumLost as end:
        if exact is not None:
            raise
        lost, run = str(end), end.run
    volume = run.column("cavity_m3")
    ratio = float((volume[-1] / volume[0]) ** (1 / 3))
    limits = [limit(args, {"gas": gas}), limit(args, {"pressure": pascal})] if args.limits else []
    run.add(
        inner_radius_ratio=None if lost else ratio,
        closed_form_ratio=exact,
        pressure_over_mu=None if lost else run["pressure_Pa"] / args.mu,
        negative_eigenvalues=None if lost else run.summary["inertia"],
        limit_voltage_of_gas=limits[0] if limits else None,
        limit_voltage_at_pressure=limits[1] if limits else None,
        ended_with=lost or None,
    )
    if MPI.COMM_WORLD.rank == 0 and not args.quiet:
        report(run)


def limit(args, content):
    """The voltage at the limit point of the round balloon, dimensionless; None without one."""
    far = (1.6 * args.inflated) ** 3 * cavity_volume(args)
    try:
        run = dea.solve(
            scene(args, **content),
            [dea.Ramp("fill", steps=4), dea.Trace("voltage", steps=60, until=("cavity_m3", far))],
            {"cavity": dea.CavityVolume("inner")}, quiet=True, stability="never",
        )  # fmt: skip
    except dea.NotReached as end:
        run = end.run
    found = [row["voltage_V"] for row in run.history if row["event"] == "maximum"]
    return found[0] / unit_volts(args) if found else None


def report(run):
    s = run.summary
    if s["ended_with"]:
        print(f"\n{s['ended_with']}")
    else:
        print(f"\ninner radius: {s['inner_radius_ratio']:.8f} A, pressure "
              f"{s['pressure_over_mu']:.8f} mu")  # fmt: skip
        print(f"closed form:  {s['closed_form_ratio']:.8f} A")
        print(f"negative eigenvalues: {s['negative_eigenvalues']}")
    told = {"limit_voltage_of_gas": "with the gas closed",
            "limit_voltage_at_pressure": "at the pressure of the filling"}  # fmt: skip
    for key, words in told.items():
        if s[key]:
            print(f"limit point {words}: {s[key]:.6f}")
    print(f"\nresults: {run.out}/history.csv, fields.xdmf")


if __name__ == "__main__":
    main()
