"""Helical actuator that bends: electrodes over one half only (Park 2019, 4.3.3).

Every layer of the driven half thins, so the end face tilts and the actuator shortens.  Under a
given pressure the curvature has a closed form.  Under voltage the field is solved in full.

Run it with `mpirun -n 2 python demos/hdea_bending.py`.
"""

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact.linear import bending_curvature
from dea_fenicsx.geometry import HDEA
from dea_fenicsx.materials import EPSILON_0

# cells per turn, over the electrode's width, over each rim, through each elastomer layer
MESHES = {
    1: {"angular": 12, "radial": 4, "rim": 1, "through": 1},
    2: {"angular": 20, "radial": 6, "rim": 2, "through": 2},
}
HALF = ((0.0, 180.0),)
THESIS = {"angle_deg": 4.2, "voltage_V": 117e3}
ENDS = ("bottom", "top")


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/hdea_bending")
    parser.number("--voltage", 6e3, "V", "voltage between the electrodes at the end of the ramp")
    parser.count("--steps", 6, "voltage steps")
    parser.count("--turns", 2, "turns of the helix")
    parser.number("--mu", 73.7e3, "Pa", "shear modulus (Park 2019, Table 5.2, G)")
    parser.number("--bulk", None, "Pa", "bulk modulus; default: incompressible")
    parser.number("--eps-r", 4.7, "-", "relative permittivity (Park 2019, Table 5.2)")
    parser.count("--mesh", 1, f"mesh density, {min(MESHES)} (coarse) to {max(MESHES)} (fine)",
                 MESHES)  # fmt: skip
    parser.count("--curvature", 0, "turns (3 or more) on which the curvature under a given "
                 "pressure is compared with the closed form")  # fmt: skip
    parser.add_argument("--reach", action="store_true", help="on to 4.2 degrees or to pull-in, and "
                        "to 4.2 degrees by given pressure")  # fmt: skip
    args = parser.parse_args()
    if args.curvature and args.curvature < 3:
        raise dea.InputError(f"--curvature is {args.curvature}, but must be 3 turns or more.")
    return parser, args


def materials(args):
    rubber = dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(args.eps_r), args.bulk)
    metal = dea.Material(dea.NeoHookean(args.mu), dea.Conductor(), args.bulk)
    return {"elastomer": rubber, "electrode_a": metal, "electrode_b": metal}


def record():
    return {
        "contraction": dea.Contraction(ENDS, "z"),
        "bending_angle": dea.BendingAngle(ENDS),
        "about_x": dea.Rotation(ENDS, "x"),
        "about_y": dea.Rotation(ENDS, "y"),
        "twist": dea.Rotation(ENDS, "z"),
    }


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    geometry = HDEA(turns=args.turns, sectors=HALF, **MESHES[args.mesh])
    device = dea.device(geometry, comm)
    scene = dea.Scene(
        device,
        materials(args),
        electrodes=[dea.Electrode("electrode_a", args.voltage), dea.Ground("electrode_b")],
        supports=[dea.FreeBody()],
    )
    path = [dea.Ramp("voltage", steps=args.steps)]
    if args.reach:
        until = ("bending_angle_rad", np.radians(THESIS["angle_deg"]))
        path.append(dea.Trace("voltage", first=0.1, steps=40, until=until))
    lost = ""
    try:
        run = dea.solve(
            scene, path, record(), out=args.out, resume=args.resume, quiet=args.quiet,
            settings=parser.settings(args), stability="every" if args.reach else "last",
        )  # fmt: skip
    except dea.EquilibriumLost as error:
        if not args.reach:
            raise
        run, lost = error.run, str(error)
    shape = (geometry.outer_radius, geometry.inner_radius, geometry.inset, geometry.elastomer,
             geometry.electrode)  # fmt: skip
    kappa = float(bending_curvature(*shape))
    # driven are 2 turns - 1 of the 2 turns layers
    length = (args.turns - 0.5) * geometry.pitch
    K = np.inf if args.bulk is None else args.bulk
    young = 9 * args.mu / (3 + args.mu / K)
    unit = geometry.elastomer / np.sqrt(args.eps_r * EPSILON_0)  # V over the root of a pressure
    wanted = np.radians(THESIS["angle_deg"])
    top = max(run.history, key=lambda row: row["voltage_V"])
    run.add(
        bending_angle_deg=float(np.degrees(run["bending_angle_rad"])),
        linear_angle_deg=float(np.degrees(kappa * length * (run["voltage_V"] / unit) ** 2 / young)),
        linear_voltage_for_4_2_deg_V=float(unit * np.sqrt(wanted / (kappa * length) * young)),
        largest_voltage_V=top["voltage_V"],
        angle_at_largest_voltage_deg=float(np.degrees(top["bending_angle_rad"])),
    )
    say = print if comm.rank == 0 and not args.quiet else lambda *a, **k: None
    if args.reach and np.isclose(run["bending_angle_rad"], wanted):
        run.add(voltage_for_4_2_deg_V=run["voltage_V"], contraction_at_4_2_deg=run["contraction"])
    if args.reach:
        unstable = next((row for row in run.history if row["inertia"]), None)
        run.add(**reach(args, device, unit), lost=lost,
                unstable_from_V=unstable["voltage_V"] if unstable else None)  # fmt: skip
    if args.curvature:
        curvature(args, comm, run, kappa, young, say)
    report(args, run, say)
    if comm.rank == 0:
        curve = dea.pictures.curve(args.out, x="voltage_V", y="bending_angle_rad")[0]
        picture = dea.pictures.deformed(args.out, warp=5.0, say=say)
        say(f"\nfields:  {run.out / 'fields.xdmf'}\nhistory: {run.out / 'history.csv'}")
        say(f"curve:   {curve}\npicture: {picture}")


def curvature(args, comm, run, kappa, young, say):
    """Curvature under a small given pressure, over p/E, from what one more turn adds to the angle.

    The ends of few turns are soft, and their influence fades over some turns only.  The base is
    clamped: the pressure on the tilted faces of a half leaves a small couple, which the three
    vertices that hold a free body would bear with local dents.
    """
    strain, rows = 1e-4, []
    p = strain * young
    say("\ngiven pressure: what a turn adds to the angle of the end face, over p/E, in 1/m\nturns  "
        "unknowns  finite elements  closed form")  # fmt: skip
    for turns in (args.curvature - 1, args.curvature):
        geometry = HDEA(turns=turns, sectors=HALF, **MESHES[args.mesh])
        scene = dea.Scene(
            dea.device(geometry, comm),
            materials(args),
            supports=[dea.Clamp("bottom")],
            loads=[dea.DeadPressure(f"electrode_{e}_active", p) for e in "ab"],
        )
        small = dea.solve(scene, dea.Ramp("load", steps=1), record(), quiet=True,
                          stability="never")  # fmt: skip
        turn = np.array([small["about_x_rad"], small["about_y_rad"]]) / strain / geometry.pitch
        added = np.linalg.norm(turn - rows[-1]["turn"]) if rows else float("nan")
        rows.append({"turns": turns, "unknowns": small.summary["unknowns"], "added": added,
                     "turn": turn.tolist()})  # fmt: skip
        say(f"{turns:5d}{rows[-1]['unknowns']:10d}{added:17.2f}{kappa:13.2f}")
    run.add(curvature=[row["added"] for row in rows[1:]], exact_curvature=kappa)


def reach(args, device, unit):
    """Bent to 4.2 degrees by a given pressure p, and the voltage T sqrt(p/eps) that stands for it.

    With the undeformed thickness in the field, as in Park (2019); on undeformed areas, and on a
    clamped base (see `curvature`).
    """
    wanted = np.radians(THESIS["angle_deg"])
    scene = dea.Scene(
        device,
        materials(args),
        supports=[dea.Clamp("bottom")],
        loads=[dea.DeadPressure(f"electrode_{e}_active", args.mu) for e in "ab"],
    )
    path = dea.Trace("load", first=0.2, steps=60, until=("bending_angle_rad", wanted))
    try:
        run = dea.solve(scene, path, record(), quiet=args.quiet, stability="never")
    except dea.EquilibriumLost as error:
        run = error.run
    p = args.mu * run["load_factor"]
    found = {"given_pressure_angle_deg": float(np.degrees(run["bending_angle_rad"])),
             "given_pressure_Pa": p}  # fmt: skip
    if np.isclose(run["bending_angle_rad"], wanted):
        found |= {"pressure_for_4_2_deg_Pa": p,
                  "given_pressure_voltage_for_4_2_deg_V": unit * float(np.sqrt(p))}  # fmt: skip
    return found


def report(args, run, say):
    s = run.summary

    def kilovolts(name):
        return f"{s[name] / 1e3:.2f}" if name in s else "-"

    say(f"\n{'':48}{'Park':>8}{'linear':>10}{'finite elements':>18}")
    rows = [
        (f"bending angle at {run['voltage_V']:.0f} V, deg", "-", f"{s['linear_angle_deg']:.4f}",
         f"{s['bending_angle_deg']:.4f}"),
        (f"contraction at {run['voltage_V']:.0f} V, %", "-", "-", f"{100 * s['contraction']:.4f}"),
        ("voltage for 4.2 deg, full field, kV", "117", "-", kilovolts("voltage_for_4_2_deg_V")),
        ("  undeformed thickness, given pressure, kV", "117",
         kilovolts("linear_voltage_for_4_2_deg_V"),
         kilovolts("given_pressure_voltage_for_4_2_deg_V")),
        ("largest voltage along the path, kV", "-", "-", f"{s['largest_voltage_V'] / 1e3:.3f}"),
        ("  bending angle there, deg", "4.2", "-", f"{s['angle_at_largest_voltage_deg']:.4f}"),
    ]  # fmt: skip
    for name, thesis, linear, fe in rows:
        say(f"{name:48}{thesis:>8}{linear:>10}{fe:>18}")
    say("linear: small strains under a given pressure, without fringes, without the growth of the "
        "field as\nlayers thin")  # fmt: skip
    if "unstable_from_V" in s:
        volts = s["unstable_from_V"]
        say("every state on the path is stable" if volts is None else
            f"negative eigenvalues from {volts:.1f} V on")  # fmt: skip
    if s.get("lost"):
        say(f"the path ends: {s['lost']}")


if __name__ == "__main__":
    main()
