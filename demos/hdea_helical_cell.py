"""Helically periodic cell of the HDEA: one pitch of its cross-section for any number of turns.

Axial stretch and twist are unknowns of the cell, free here: the middle of a long actuator under
voltage.  The cross-section is that of `hdea_two_turn.py`.

Run it with `mpirun -n 2 python demos/hdea_helical_cell.py`; --linear adds the linear benchmarks,
--pull-in follows the branch from the ramp's end by arc length.
"""

import csv

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import HelicalCell
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.materials.material import bulk_modulus_of

COARSE = HelicalCell(radial=12, rim=3, grading=8, grading_rim=3, grading_through=3)
# electrode modulus over elastomer modulus, Poisson's ratio: digest section 5
LINEAR = ((1, 0.406), (10, 0.406), (100, 0.406), (1e5, 0.406), (1000, 0.495), (1e5, 0.495))


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/hdea_helical_cell")
    parser.number("--voltage", 6e3, "V", "voltage between the electrodes at the end of the ramp")
    parser.count("--steps", 6, "voltage steps")
    parser.number("--mu", 73.7e3, "Pa", "shear modulus of the elastomer (thesis Table 5.2, G)")
    parser.number("--electrode-mu", None, "Pa", "shear modulus of the electrodes; default: --mu")
    parser.number("--eps-r", 4.7, "-", "relative permittivity (thesis Table 5.2)")
    parser.count("--mesh", 1, "mesh density: all divisions of the coarse mesh times this")
    parser.add_argument("--pull-in", action="store_true", help="go on from the ramp's end to "
                        "pull-in, by arc length")  # fmt: skip
    parser.add_argument("--linear", action="store_true", help="also run the linear benchmarks, as "
                        "rings and as a helix (linear.csv)")  # fmt: skip
    return parser, parser.parse_args()


def materials(mu, electrode_mu, eps_r, nu=None):
    def material(stiffness, electric):
        kappa = None if nu is None else bulk_modulus_of(stiffness, nu)
        return dea.Material(dea.NeoHookean(stiffness), electric, kappa)

    electrode = material(electrode_mu, dea.Conductor())
    rubber = material(mu, dea.IdealDielectric(eps_r))
    return {"elastomer": rubber, "electrode_a": electrode, "electrode_b": electrode}


def driven(args, device, volts, pitch):
    """A free cell, one electrode driven and the other grounded."""
    return dea.Scene(
        device,
        materials(args.mu, args.electrode_mu or args.mu, args.eps_r),
        electrodes=[dea.Electrode("electrode_a", volts), dea.Ground("electrode_b")],
        supports=[dea.FreeBody()],
        kinematics=dea.Helical(pitch),
    )


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    geometry = COARSE.refine(args.mesh)
    device = dea.read_gmsh(geometry, comm)
    path = [dea.Ramp("voltage", steps=args.steps)]
    if args.pull_in:
        path.append(dea.Trace("voltage", first=0.1, steps=60, until=("contraction", 0.4)))
    lost = ""
    try:
        run = dea.solve(
            driven(args, device, args.voltage, geometry.pitch),
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
        small(driven(args, device, volts, pitch), "voltage", strain)
        for pitch in (0.0, geometry.pitch)
    ]
    say(f"full field, elastomer and electrodes as in the ramp: rings {field[0][0]:.5f}, helix "
        f"{field[1][0]:.5f}; exact under given pressure, one modulus: {-share:.5f}")  # fmt: skip
    columns = ["electrode_ratio", "nu", "rings", "helix", "twist_rad_per_strain"]
    run.add(linear=[dict(zip(columns, row, strict=True)) for row in rows],
            linear_exact=-share, linear_full_field=[f[0] for f in field])  # fmt: skip
    if comm.rank == 0:
        with open(run.out / "linear.csv", "w", newline="") as f:
            writer = csv.writer(f)
            writer.writerow(columns)
            writer.writerows(rows)


def small(scene, ramp, strain, options=None):
    """Mean axial strain and twist (rad/m) over `strain` in one step."""
    record = {"c": dea.OverallContraction(), "k": dea.OverallTwist()}
    run = dea.solve(scene, dea.Ramp(ramp, steps=1), record, quiet=True, stability="never",
                    options=options)  # fmt: skip
    return -run["c"] / strain, run["k_rad_per_m"] / strain


if __name__ == "__main__":
    main()
