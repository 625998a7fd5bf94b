"""Tutorial: your own geometry, from a gmsh .geo script and from a STEP file.

Only the names of parts and surfaces link a drawing to a scene.  So the device may have any shape.
Here it is a film with the outline of a clover leaf and an electrode on each face.  A free film of
any outline is in the same state everywhere, and this state is known exactly.  So the result can be
checked.  Draw your own device and name its parts and surfaces.  This command shows the names in a
file, with the size and the place of each part and surface:

    dea mesh demos/own_geometry_data/clover.geo --unit 1e-3 --size 2e-3

A .geo script is a program that gmsh runs, so use only those that you trust.  Files of the types
.msh and STEP are only data.

Run it with `mpirun -n 2 python demos/own_geometry.py`.
"""

from pathlib import Path

from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import Film, trace

DATA = Path(__file__).parent / "own_geometry_data"


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/own_geometry")
    parser.number("--mu", 50e3, "Pa", "shear modulus")
    parser.number("--size", 4e-3, "m", "largest element")
    parser.number("--voltage", 6e3, "V", "end of the ramp")
    return parser, parser.parse_args()


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    # A .geo script names parts and surfaces itself (Physical Volume, Physical Surface).  It has no
    # unit of length: `unit` says that this one is in mm.
    geo = dea.device(DATA / "clover.geo", comm, unit=1e-3, size=args.size)
    # A STEP file has its unit, and the names of solids at most.  `dea mesh` numbers the rest:
    # surface_5 is the lower face, surface_6 the upper one.
    names = {"bottom": "surface_5", "top": "surface_6", "edge": ["surface_1", "surface_2"]}
    step = dea.device(DATA / "clover.step", comm, size=args.size, names=names)

    film = dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(eps_r=2.8))
    runs = []
    for device, out in ((geo, args.out), (step, None)):
        scene = dea.Scene(
            device,
            materials={"film": film},
            electrodes=[dea.Electrode("top", args.voltage), dea.Ground("bottom")],
            supports=[dea.FreeBody()],
        )
        runs.append(dea.solve(scene, dea.Ramp("voltage", steps=3), {"area": dea.Area("top")}, out,
                              quiet=args.quiet, settings=parser.settings(args)))  # fmt: skip
    # the area of a face grows with the square of the stretch in the plane
    found = [(run["area_m2"] / run.column("area_m2")[0]) ** 0.5 for run in runs]
    exact = trace(Film(film, 0.5e-3)).states_at(args.voltage)[0][0].stretches[0]
    runs[0].add(stretch_geo=found[0], stretch_step=found[1], exact_stretch=float(exact))
    if comm.rank == 0 and not args.quiet:
        print(f"\nstretch at {args.voltage:g} V: {found[0]:.9f} from the .geo script, "
              f"{found[1]:.9f} from the STEP file, {exact:.9f} exact")  # fmt: skip
        print(f"results: {runs[0].out}/fields.xdmf")


if __name__ == "__main__":
    main()
