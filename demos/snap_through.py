"""Snap-through of a free Gent film: over pull-in, down to the minimum, up the stretched branch.

The branch is followed by arc length and compared with the exact state at every step:

    eps (V/T)^2 = mu Jm/(Jm - I1 + 3) (lam^2 - lam^-4)/lam^4,   lam the stretch in the plane.

Under a voltage that is ramped up and down, the film snaps at the maximum and back at the minimum.
"""

import gmsh
import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq, minimize_scalar

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0


class Tetrahedra:
    """The film as an unstructured mesh of tetrahedra."""

    def __init__(self, size):
        self.size = size

    def build(self):
        if not gmsh.isInitialized():
            gmsh.initialize(interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("film")
        gmsh.model.occ.addBox(0, 0, 0, *3 * [self.size])
        gmsh.model.occ.synchronize()
        names = ["x_min", "x_max", "y_min", "y_max", "bottom", "top"]
        for k, name in enumerate(names, start=1):
            gmsh.model.addPhysicalGroup(2, [k], name=name)
        gmsh.model.addPhysicalGroup(3, [1], name="film")
        gmsh.model.mesh.setSize(gmsh.model.getEntities(0), 0.6 * self.size)
        gmsh.model.mesh.generate(3)
        return gmsh.model


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/snap_through")
    parser.number("--mu", 50e3, "Pa", "shear modulus")
    parser.number("--jm", 120.0, "-", "Gent's limit of I1 - 3")
    parser.number("--eps-r", 4.7, "-", "relative permittivity")
    parser.number("--thickness", 1e-3, "m", "thickness of the film")
    parser.number("--until", 6.5, "-", "stretch at which the trace ends")
    parser.add_argument("--mesh", choices=("cell", "irregular"), default="cell",
                        help="one hexahedron, or unstructured tetrahedra")  # fmt: skip
    return parser, parser.parse_args()


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    T = args.thickness
    mesh = BoxStack(T, T, [Layer("film", T)], divisions=(1, 1))
    device = dea.device(mesh if args.mesh == "cell" else Tetrahedra(T), comm)
    film = dea.Material(dea.Gent(args.mu, args.jm), dea.IdealDielectric(args.eps_r))
    unit = T * np.sqrt(args.mu / (args.eps_r * EPSILON_0))
    scene = dea.Scene(
        device,
        {"film": film},
        electrodes=[dea.Electrode("top", unit), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y"), dea.Fix("bottom", "z")],
    )
    run = dea.solve(
        scene,
        dea.Trace("voltage", first=0.05, until=("stretch", args.until)),
        record={"stretch": dea.MeanStretch(("x_min", "x_max"), "x"), "charge": dea.Charge("top")},
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        stability="every",
        settings=parser.settings(args),
    )

    def exact(lam):
        mu = args.mu * args.jm / (args.jm - 2 * lam**2 - lam**-4 + 3)
        return T * np.sqrt(mu * (lam**2 - lam**-4) / lam**4 / (args.eps_r * EPSILON_0))

    stretch, voltage = run.column("stretch"), run.column("voltage_V")
    error = np.max(np.abs(voltage[1:] / exact(stretch[1:]) - 1))
    events = {row["event"]: row for row in run.history if row["event"]}
    found = {"max_relative_error": error}
    for event, name in (("maximum", "pull_in"), ("minimum", "snap_minimum")):
        if event in events:
            found[f"{name}_voltage_V"] = events[event]["voltage_V"]
            found[f"{name}_stretch"] = events[event]["stretch"]
    top = minimize_scalar(lambda x: -exact(x), bounds=(1.05, 2), method="bounded",
                          options={"xatol": 1e-10})  # fmt: skip
    low = minimize_scalar(exact, bounds=(2, 0.95 * np.sqrt(args.jm / 2 + 1.5)), method="bounded",
                          options={"xatol": 1e-10})  # fmt: skip
    found |= {"exact_pull_in_voltage_V": -top.fun, "exact_snap_minimum_voltage_V": low.fun}
    if exact(stretch[-1]) > low.fun and stretch[-1] > low.x:
        # where the film lands when it snaps at constant voltage
        edge = np.sqrt(args.jm / 2 + 1.5) * (1 - 1e-5)
        found["landing_stretch"] = brentq(lambda x: exact(x) + top.fun, low.x, edge)
        found["snap_back_stretch"] = brentq(lambda x: exact(x) - low.fun, 1.0001, top.x)
    run.add(**found)
    if comm.rank == 0:
        dea.pictures.curve(args.out, x="stretch", y="voltage_V")
        if not args.quiet:
            report(run, top, low)


def report(run, top, low):
    s = run.summary
    print(f"\n{'':22}{'finite elements':>18}{'exact':>18}")
    for name, key, value in (("pull-in, V", "pull_in_voltage_V", -top.fun),
                             ("pull-in stretch", "pull_in_stretch", top.x),
                             ("minimum, V", "snap_minimum_voltage_V", low.fun),
                             ("minimum stretch", "snap_minimum_stretch", low.x)):  # fmt: skip
        print(f"{name:22}{s.get(key, float('nan')):18.6f}{value:18.6f}")
    print(f"largest relative error of the voltage along the branch: {s['max_relative_error']:.1e}")
    if "landing_stretch" in s:
        print(f"ramped up, the film snaps from stretch {top.x:.3f} to {s['landing_stretch']:.3f}; "
              f"ramped down, from {low.x:.3f} back to {s['snap_back_stretch']:.3f}")  # fmt: skip
    print(f"\nresults: {run.out}/history.csv, voltage_stretch.png, fields.xdmf")


if __name__ == "__main__":
    main()
