"""Helically periodic cell of the HDEA: one pitch of its cross-section for any number of turns.

Axial stretch and twist are unknowns of the cell.  They are free here, so the cell is the middle of
a long actuator under voltage.  The cross-section is that of `hdea_two_turn.py`.

Run it with `mpirun -n 2 python demos/hdea_helical_cell.py`.  --linear adds the linear benchmarks.
--loads adds the same scene under three kinds of load.  --force adds the blocked force and the
stiffness.  --pull-in follows the branch from the end of the ramp by arc length.  --edges does so on
several meshes, with three kinds of electrode edge.
"""

import csv

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import HelicalCell
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.materials.material import bulk_modulus_of

COARSE = HelicalCell(radial=12, rim=3, grading=8, grading_rim=3, grading_through=3, films=True)
EDGES = ("sharp", "tapered", "thin film")
# electrode modulus over elastomer modulus, Poisson's ratio
LINEAR = ((1, 0.406), (10, 0.406), (100, 0.406), (1e5, 0.406), (1000, 0.495), (1e5, 0.495))


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/hdea_helical_cell")
    parser.number("--voltage", 6e3, "V", "voltage between the electrodes at the end of the ramp")
    parser.count("--steps", 6, "voltage steps")
    parser.number("--mu", 73.7e3, "Pa", "shear modulus of the elastomer (Park 2019, Table 5.2, G)")
    parser.number("--electrode-mu", None, "Pa", "shear modulus of the electrodes; default: --mu")
    parser.number("--eps-r", 4.7, "-", "relative permittivity (Park 2019, Table 5.2)")
    parser.count("--mesh", 1, "mesh density: all divisions of the coarse mesh times this")
    parser.number("--taper", 0.0, "m", "width over which the driven electrode's potential falls to "
                  "zero at its edges; narrower than an elastomer layer it makes things worse")
    parser.add_argument("--loads", action="store_true", help="also compare full field, thin-film "
                        "field and given Maxwell pressure (loads.csv)")  # fmt: skip
    parser.add_argument("--force", action="store_true", help="also blocked force and stiffness")
    parser.add_argument("--edges", action="store_true", help="also the voltage for 13 % and "
                        "pull-in with sharp and tapered edges and without fringes, on the meshes "
                        "1, 2, ... up to --mesh (edges.csv)")  # fmt: skip
    parser.add_argument("--pull-in", action="store_true", help="go on from the ramp's end to "
                        "pull-in, by arc length")  # fmt: skip
    parser.add_argument("--linear", action="store_true", help="also run the linear benchmarks, as "
                        "rings and as a helix (linear.csv)")  # fmt: skip
    return parser, parser.parse_args()


def materials(mu, electrode_mu, eps_r, nu=None, thin=False):
    """Of each region.  With thin films the field lives in these alone, and nothing conducts."""

    def material(stiffness, electric=None):
        kappa = None if nu is None else bulk_modulus_of(stiffness, nu)
        return dea.Material(dea.NeoHookean(stiffness), electric, kappa)

    electrode = material(electrode_mu, None if thin else dea.Conductor())
    rubber = material(mu, dea.IdealDielectric(eps_r))
    return {
        "elastomer": material(mu) if thin else rubber,
        "film_below": rubber,
        "film_above": rubber,
        "electrode_a": electrode,
        "electrode_b": electrode,
    }


def driven(args, device, geometry, volts, edge="sharp", rings=False, **more):
    """A free cell, one electrode driven and the other grounded."""
    if edge == "thin film":
        electrodes = [
            dea.ThinFilm(name, volts, start=low, end=high)
            for name, (low, high) in geometry.film_spans.items()
        ]
    else:
        tapers = ()
        if edge == "tapered":
            w = args.taper or 1e-3
            r1, r2 = geometry.device(1).electrode_radii
            tapers = (dea.Taper(r1 + w, r1), dea.Taper(r2 - w, r2))
        electrodes = [dea.Electrode("electrode_a", volts, taper=tapers), dea.Ground("electrode_b")]
    return dea.Scene(
        device,
        materials(args.mu, args.electrode_mu or args.mu, args.eps_r, thin=edge == "thin film"),
        electrodes=electrodes,
        supports=[dea.FreeBody()],
        kinematics=dea.Helical(0.0 if rings else geometry.pitch),
        **more,
    )


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    geometry = COARSE.refine(args.mesh)
    device = dea.device(geometry, comm)
    path = [dea.Ramp("voltage", steps=args.steps)]
    if args.pull_in:
        path.append(dea.Trace("voltage", first=0.1, steps=60, until=("contraction", 0.4)))
    lost = ""
    try:
        run = dea.solve(
            driven(args, device, geometry, args.voltage, "tapered" if args.taper else "sharp"),
            path,
            record={
                "contraction": dea.OverallContraction(),
                "twist": dea.OverallTwist(),
                "capacitance": dea.Capacitance("electrode_a"),
            },
            out=args.out,
            resume=args.resume,
            quiet=args.quiet,
            stability="every",
            settings=parser.settings(args),
        )
    except dea.EquilibriumLost as error:
        if not args.pull_in:
            raise
        run, lost = error.run, str(error)
    run.add(twist_rad=run["twist_rad_per_m"] * geometry.pitch)
    say = print if comm.rank == 0 and not args.quiet else lambda *a, **k: None
    report(args, run, geometry, lost, say)
    if args.linear:
        linear(args, comm, run, device, geometry, say)
    if args.loads:
        loads(args, comm, run, device, geometry, say)
    if args.force:
        force(args, run, device, geometry, say)
    if args.edges:
        edges(args, comm, run, say)
    if comm.rank == 0:
        curve = dea.pictures.curve(args.out, x="voltage_V", y="contraction")[0]
        picture = dea.pictures.deformed(args.out, say=say)
        say(f"\nfields:  {run.out / 'fields.xdmf'}\nhistory: {run.out / 'history.csv'}")
        say(f"curve:   {curve}\npicture: {picture}")


def report(args, run, geometry, lost, say):
    """State the end of the ramp and, of a trace, where the branch turns or ends."""
    rows = run.history
    end = next((r for r in rows if np.isclose(r["voltage_V"], args.voltage, rtol=1e-12)), rows[-1])
    say(f"\nat {end['voltage_V']:g} V: contraction {end['contraction']:.6f}, twist "
        f"{end['twist_rad_per_m'] * geometry.pitch:.6f} rad per turn")  # fmt: skip
    if not args.pull_in:
        return
    top = next((r for r in rows if r["event"] == "maximum"), None)
    unstable = next((r for r in rows if r["inertia"]), None)
    if top:
        say(f"pull-in of the whole cell at {top['voltage_V']:.1f} V, contraction "
            f"{top['contraction']:.4f}")  # fmt: skip
        run.add(pull_in_voltage_V=top["voltage_V"], pull_in_contraction=top["contraction"])
    if unstable:
        before = rows[rows.index(unstable) - 1]
        say(f"stable up to {before['voltage_V']:.1f} V; at {unstable['voltage_V']:.1f} V "
            f"{unstable['inertia']} negative eigenvalues (at sharp electrode edges, so this "
            "voltage depends on the mesh)")
        run.add(stable_up_to_V=before["voltage_V"], unstable_from_V=unstable["voltage_V"])
    if lost:
        say(f"the branch ends: {lost}")


def linear(args, comm, run, device, geometry, say):
    """Mean axial strain at a small load, over p/E: given pressure, and the full field.

    With a given pressure and one modulus, Betti's theorem gives -0.800.  Rings (c = 0) are what an
    axisymmetric model sees; the helix differs by the square of the lead angle.
    """
    share = 0.5 / 0.55 * ((6.7**2 - 2.3**2) / (7**2 - 2**2))
    strain, rows = 1e-4, []
    say("\nelectrodes  nu       rings     helix    twist/strain  (strain E/p)")
    for ratio, nu in LINEAR:
        mu_e = ratio * args.mu
        p = strain * 2 * args.mu * (1 + nu)
        found = []
        for pitch in (0.0, geometry.pitch):
            scene = dea.Scene(
                device,
                materials(args.mu, mu_e, args.eps_r, nu),
                supports=[dea.FreeBody()],
                loads=[dea.DeadPressure(f"electrode_{e}_active", p) for e in "ab"],
                kinematics=dea.Helical(pitch),
            )
            # rounding in stiff electrodes is felt in the soft elastomer
            options = dea.NewtonOptions(tolerance=1e-10 if ratio < 1e3 else 1e-8)
            found.append(small(scene, "load", strain, options))
        rows.append([ratio, nu, found[0][0], found[1][0], found[1][1] * geometry.pitch])
        say(f"{ratio:10g}{nu:6.3f}{rows[-1][2]:11.5f}{rows[-1][3]:10.5f}{rows[-1][4]:12.5f}")
    p = strain * 3 * args.mu
    volts = geometry.elastomer * np.sqrt(p / (args.eps_r * EPSILON_0))
    field = [
        small(driven(args, device, geometry, volts, rings=rings), "voltage", strain)
        for rings in (True, False)
    ]
    say(f"full field, elastomer and electrodes as in the ramp: rings {field[0][0]:.5f}, helix "
        f"{field[1][0]:.5f}; exact under given pressure, one modulus: {-share:.5f}")  # fmt: skip
    columns = ["electrode_ratio", "nu", "rings", "helix", "twist_rad_per_strain"]
    run.add(linear=[dict(zip(columns, row, strict=True)) for row in rows],
            linear_exact=-share, linear_full_field=[f[0] for f in field])  # fmt: skip
    table(comm, run.out / "linear.csv", columns, rows)


def table(comm, path, columns, rows):
    if comm.rank == 0:
        with open(path, "w", newline="") as f:
            csv.writer(f).writerows([columns, *rows])


def pressed(args, device, geometry, p):
    """The cell under a given pressure on the undeformed faces of its electrodes."""
    return dea.Scene(
        device,
        materials(args.mu, args.electrode_mu or args.mu, args.eps_r),
        supports=[dea.FreeBody()],
        loads=[dea.DeadPressure(f"electrode_{e}_active", p) for e in "ab"],
        kinematics=dea.Helical(geometry.pitch),
    )


def loads(args, comm, run, device, geometry, say):
    """One scene under the full field, the field V/T of thin films, and Park's pressure.

    Park (2019) applies eps (V/T)^2 of the undeformed thickness as a force on the electrodes.
    """
    top, shares = args.voltage, np.arange(1, args.steps + 1) / args.steps
    p = args.eps_r * EPSILON_0 * (top / geometry.elastomer) ** 2
    record = {"c": dea.OverallContraction(), "k": dea.OverallTwist()}
    quiet = {"quiet": True, "stability": "never"}
    found = {
        name: dea.solve(driven(args, device, geometry, top, edge), dea.Ramp("voltage",
                        steps=args.steps), record, **quiet)
        for name, edge in (("full field", "sharp"), ("thin film", "thin film"))
    }  # fmt: skip
    squares = dea.Ramp("load", steps=1, at=tuple(shares[:-1] ** 2))
    found["given pressure"] = dea.solve(pressed(args, device, geometry, p), squares, record,
                                        **quiet)  # fmt: skip
    rows = []
    for share in shares:
        row = [share * top]
        for name, one in found.items():
            reached = share**2 if name == "given pressure" else share * top
            column = one.column("load_factor" if name == "given pressure" else "voltage_V")
            row.append(float(one.column("c")[np.argmin(np.abs(column - reached))]))
        rows.append(row)
    say("\ncontraction in % under three loads, and what the simpler ones miss of the full field\n"
        " voltage V  full field   thin film            given pressure")  # fmt: skip
    for volts, full, thin, given in rows:
        say(f"{volts:10.0f}{100 * full:12.4f}{100 * thin:12.4f} ({thin / full - 1:+7.2%})"
            f"{100 * given:12.4f} ({given / full - 1:+7.2%})")  # fmt: skip
    say("thin film: without fringes; given pressure: also without the field's growth as layers thin"
        "\nand without what it pulls in their plane")
    columns = ["voltage_V", "full_field", "thin_film", "given_pressure"]
    run.add(loads=[dict(zip(columns, row, strict=True)) for row in rows])
    table(comm, run.out / "loads.csv", columns, rows)


def force(args, run, device, geometry, say):
    """Blocked force at the ramp's end; axial stiffness of a turn at rest and there.

    Linear, without fringes: blocked force p A_el t/(t + t_e), stiffness E A/pitch.
    """
    shape = geometry.device(1)
    area = np.pi * (shape.outer_radius**2 - shape.inner_radius**2)
    p = args.eps_r * EPSILON_0 * (args.voltage / shape.elastomer) ** 2
    linear = p * shape.flat_area * shape.elastomer / (shape.elastomer + shape.electrode)
    pull = 1e-4 * 3 * args.mu * area
    record = {"force": dea.OverallForce(), "stretch": dea.OverallStretch()}
    quiet = {"quiet": True, "stability": "never"}
    ramp, small = dea.Ramp("voltage", steps=args.steps), dea.Ramp("load", steps=1)
    held = driven(args, device, geometry, args.voltage, prescribed=[dea.AxialStretch(1.0)])
    loaded = driven(args, device, geometry, args.voltage, loads=[dea.AxialForce(pull)])
    blocked = dea.solve(held, ramp, record, **quiet)["force_N"]
    rest = dea.solve(loaded, small, record, **quiet)["stretch"] - 1
    live = dea.solve(loaded, [ramp, small], record, **quiet).column("stretch")
    stiffness = [float(pull / (d * geometry.pitch)) for d in (rest, live[-1] - live[-2])]
    say(f"\nat {args.voltage:g} V: blocked force {blocked:.4f} N (linear, no fringes: "
        f"{linear:.4f} N); stiffness of a turn {stiffness[1]:.1f} N/m, at rest "
        f"{stiffness[0]:.1f} N/m (E A/pitch: {3 * args.mu * area / geometry.pitch:.1f} N/m)")
    run.add(blocked_force_N=blocked, linear_blocked_force_N=float(linear),
            stiffness_of_turn_N_per_m=stiffness[1], stiffness_of_turn_at_rest_N_per_m=stiffness[0],
            linear_stiffness_of_turn_N_per_m=float(3 * args.mu * area / geometry.pitch))


def edges(args, comm, run, say):
    """13 % and pull-in, with sharp and with tapered electrode edges, and without fringes.

    The field at a sharp edge grows without bound as the mesh is refined, and an elastomer that does
    not stiffen creases there at a voltage which falls with the cell.
    """
    goal, rows = 0.13, []
    say("\nedge        mesh  unknowns  voltage for 13 %, V  first bifurcation   pull-in V  "
        "contraction")  # fmt: skip
    for edge in EDGES:
        for mesh in [2**k for k in range(8) if 2**k <= args.mesh]:
            geometry = COARSE.refine(mesh)
            device = dea.device(geometry, comm)
            path = dea.Trace("voltage", first=0.2, steps=40, until=("c", 0.4), longest=1.0)
            try:
                one = dea.solve(driven(args, device, geometry, 12e3, edge), path,
                                {"c": dea.OverallContraction()}, quiet=True, stability="every")
            except dea.EquilibriumLost as error:
                one = error.run
            c, volts = one.column("c"), one.column("voltage_V")
            k = int(np.argmax(c >= goal))
            # the square of the voltage over the contraction is smooth: cubic through four states
            near = slice(max(k - 2, 0), k + 2)
            V13 = float(np.sqrt(np.polyval(np.polyfit(c[near], volts[near] ** 2, len(c[near]) - 1),
                                           goal))) if k else None  # fmt: skip
            events = {r["event"]: r for r in reversed(one.history) if r["event"]}
            fork, top = (events.get(name, {}) for name in ("bifurcation", "maximum"))
            row = [edge, mesh, one.summary["unknowns"], V13, fork.get("voltage_V"),
                   top.get("voltage_V"), top.get("c", float(c[-1]))]  # fmt: skip
            rows.append(row)
            shown = ["-" if v is None else f"{v:.1f}" for v in row[3:6]]
            say(f"{edge:12}{mesh:4d}{row[2]:10d}{shown[0]:>21}{shown[1]:>19}{shown[2]:>12}"
                f"{row[6]:13.4f}")  # fmt: skip
    columns = ["edge", "mesh", "unknowns", "voltage_for_13_percent_V", "bifurcation_V",
               "pull_in_V", "last_contraction"]  # fmt: skip
    named = (dict(zip(columns, row, strict=True)) for row in rows)
    run.add(edges=[{n: v for n, v in row.items() if v is not None} for row in named])
    table(comm, run.out / "edges.csv", columns, rows)


def small(scene, ramp, strain, options=None):
    """Mean axial strain and twist (rad/m) over `strain` in one step."""
    record = {"c": dea.OverallContraction(), "k": dea.OverallTwist()}
    run = dea.solve(scene, dea.Ramp(ramp, steps=1), record, quiet=True, stability="never",
                    options=options)  # fmt: skip
    return -run["c"] / strain, run["k_rad_per_m"] / strain


if __name__ == "__main__":
    main()
