"""Pre-stretched VHB film with a Mylar strip on the smooth fold (Park 2019, 5.4 to 5.6).

The film is stretched from 1 x 1 in and then stiffened.  So its mesh shows the stretched state.

1. Without a stiffener: the voltage over the strain is compared with the exact curve, for each model
   of Table 5.5.  The width is held, and where the case has a second load, both sides are also put
   under dead loads.  The loss of tension is found.
2. With the strip p1 p2 p3 p4, flat: the voltage for a strain rises, within the rule of mixtures.
3. Bending by a strip that lies off the middle, in a section across the fold: the demo gives the
   angle of each of 32 elements and of the whole, and the displacement of the tip.  A stiffener of
   full width is compared with exact finite bending.

Park (2019) gives no thickness of film and stiffener, no offset and no permittivity.  All of these
are options, and `--study` shows what they do to the bending.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import FREE, Film, Held, Laminate, Ply, bend, elastic_stress, trace
from dea_fenicsx.geometry import BoxStack, Layer, StiffenedFilm, StiffenedSection
from dea_fenicsx.materials import EPSILON_0, bulk_modulus_of
from dea_fenicsx.origami import INCH, SmoothFold
from dea_fenicsx.results.reading import read_frame

MODELS = ("neo-hookean", "mooney-rivlin", "ogden", "gent")
CASES = {  # stretches along x and y, column of Table 5.5; x is under a dead load
    "2.125": ((2.125, 1.0), "2p125"),
    "2.75": ((2.75, 1.0), "2p75"),
    "cell": ((2.125, 2.75), "2p125"),
    "3.5": ((3.5, 3.5), "3p5"),
}
SLACK = {("neo-hookean", "2.125"): 0.145, ("gent", "2.125"): 0.136,
         ("neo-hookean", "2.75"): 0.103, ("gent", "2.75"): 0.091}  # fmt: skip
QUIET = {"quiet": True, "stability": "never"}


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/stiffened_membrane")
    parser.add_argument("--case", choices=CASES, default="cell", help="pre-stretch of part 2")
    parser.add_argument("--model", choices=MODELS, default="ogden", help="rubber of parts 2 and 3")
    parser.add_argument("--models", choices=MODELS, nargs="*", default=MODELS,
                        help="rubbers of part 1")  # fmt: skip
    parser.add_argument("--width", choices=("held", "loaded"), default="held",
                        help="y in part 2: held at its stretch, or under a dead load")  # fmt: skip
    parser.number("--thickness", 1e-3, "m", "film before the stretch (not printed)")
    parser.number("--eps-r", 4.7, "-", "relative permittivity (not printed)")
    parser.number("--stiffener", 50e-6, "m", "thickness of the Mylar strip (not printed)")
    parser.number("--stiffener-young", 4.895277678e9, "Pa", "Young's modulus of Mylar (Park 2019)")
    parser.number("--strip", 0.883e-3, "m", "width of the strip, w of the smooth fold")
    parser.number("--offset", -1.0, "m", "strip's middle above the film's; below 0: on top")
    parser.number("--strain", 0.1, "-", "strain of the bare film at the end of part 2")
    parser.number("--volts", 6e3, "V", "voltage of part 3, across three films as one (Park: 6 kV)")
    parser.count("--mesh", 1, "refinement of part 2")
    parser.add_argument("--study", action="store_true", help="vary the strip's and film's data")
    return parser, parser.parse_args()


def rubber(args, model, case):
    found = dea.materials.get(f"vhb-thesis-{model}-{CASES[case][1]}")
    return dea.Material(found.elastic, dea.IdealDielectric(args.eps_r))


def mylar_of(args, shape):
    """Mylar, Poisson's ratio 0.38; on the film it lies outside the electrodes."""
    mu = args.stiffener_young / (2 * 1.38)
    electric = None if shape.on_top else dea.IdealDielectric(3.3)
    return dea.Material(dea.NeoHookean(mu), electric, bulk_modulus_of(mu, 0.38))


def film_of(args, model, case, width):
    """The exact film under the loads of a case."""
    (l1, l2), _ = CASES[case]
    film = Film(rubber(args, model, case), args.thickness, FREE, FREE)
    if width == "held":
        film = Film(film.material, args.thickness, FREE, Held(l2))
    return film.prestretched(l1, l2)


def loaded(film, stretches, width, volts, device, supports, materials):
    """The scene of a film in its stretched state; `volts` at ramp factor 1."""
    l1, l2 = stretches
    loads = [dea.DeadLoad("x_max", (film.first.pascal * l1, 0.0, 0.0))]
    if width == "held":
        supports = [*supports, dea.Fix("y_max", "y")]
    else:
        loads.append(dea.DeadLoad("y_max", (0.0, film.second.pascal * l2, 0.0)))
    return dea.Scene(
        device, materials,
        electrodes=[dea.Electrode("top", volts), dea.Ground("bottom")],
        supports=[dea.Fix("y_min", "y"), *supports],
        prescribed=[dea.PreStretch("film", x=l1, y=l2)], loads=loads,
    )  # fmt: skip


def tension_up(film, stretches, parts=6, together=False):
    """The pre-stretch and, together with it or always a little ahead, the load that bears it."""
    if together:
        return [dea.Ramp(("prestretch", "load"), steps=16)]
    t = np.linspace(0, 1, parts + 1)[1:]
    stress = elastic_stress(film.material, stretches[0] ** t, stretches[1] ** t)[0]
    path = []
    for share, bearing in zip(t, stress / stress[-1], strict=True):
        path += [dea.Ramp("load", to=bearing, steps=1), dea.Ramp("prestretch", to=share, steps=1)]
    return path


STRAINS = {"stretch_x": dea.MeanStretch(("x_min", "x_max"), "x"),
           "stretch_y": dea.MeanStretch(("y_min", "y_max"), "y")}  # fmt: skip


# ------------------------------------------------------------------ 1. without stiffener


def rests(branch, stretches):
    """Whether the film's stable state under its loads is the pre-stretch it was given.

    Under two dead loads a Mooney-Rivlin film may rest at quite unequal stretches instead (Treloar;
    Kearsley 1986).
    """
    return np.allclose(branch.at(0.0).stretches[:2], stretches, rtol=1e-6)


def bare(args, model, case, width):
    """Largest relative error of the voltage against the exact curve; strain at loss of tension.

    Both None where the film does not rest at its pre-stretch.
    """
    stretches, _ = CASES[case]
    film = film_of(args, model, case, width)
    branch = trace(film, max_stretch=12.0)
    if not rests(branch, stretches):
        return None, None
    # up to 20 % strain, or close to the limit point
    peak = branch.event("pull-in")
    volts = branch.at_stretch(stretches[0] * 1.2)[0].voltage
    if peak and peak.stretches[0] < 1.25 * stretches[0]:
        volts = 0.95 * peak.voltage
    size = args.thickness / np.prod(stretches)
    cell = BoxStack(size, size, [Layer("film", size)])
    scene = loaded(film, stretches, width, volts, dea.device(cell, MPI.COMM_WORLD),
                   [dea.Fix("x_min", "x"), dea.Fix("bottom", "z")],
                   {"film": film.material})  # fmt: skip
    run = dea.solve(scene, [*tension_up(film, stretches), dea.Ramp("voltage", steps=8)], STRAINS,
                    failures=[dea.LossOfTension("z")], **QUIET)  # fmt: skip
    rows = [row for row in run.history if row["voltage_V"] > 0]
    error = 0.0
    for row in rows:
        state, _ = branch.states_at(row["voltage_V"])[0]
        error = max(error, abs(stretches[0] * row["stretch_x"] / state.stretches[0] - 1))
    slack = [row["stretch_x"] - 1 for row in rows if row["event"] == "loss of tension"]
    return float(error), (float(slack[0]) if slack else None)


# --------------------------------------------------------------------- 2. with stiffener


def stiffened(args, out, settings):
    """Voltage against strain with the strip, beside the bare film and the rule of mixtures."""
    stretches, _ = CASES[args.case]
    film = film_of(args, args.model, args.case, args.width)
    branch = trace(film, max_stretch=12.0)
    a, b = (s * INCH for s in stretches)
    h = args.thickness / np.prod(stretches)
    fold = SmoothFold((0.0, 0.0), (a, b), args.strip, (0.12 * np.hypot(a, b),) * 2)
    shape = StiffenedFilm(
        a, b, corners=fold.corners, thickness=h, stiffener=args.stiffener, through=1, along=4,
        beside=3, offset=None if args.offset < 0 else args.offset,
    ).refine(args.mesh)  # fmt: skip
    mylar = mylar_of(args, shape)
    volts = branch.at_stretch(stretches[0] * (1 + args.strain))[0].voltage
    # on a smooth table: a strip that lies off the middle cannot bend the film
    scene = loaded(film, stretches, args.width, volts, dea.device(shape, MPI.COMM_WORLD),
                   [dea.Fix("x_min", "x"), dea.Fix("bottom", "z")],
                   {"film": film.material, "stiffener": mylar})  # fmt: skip
    path = [*tension_up(film, stretches, together=True), dea.Ramp("voltage", steps=6)]
    run = dea.solve(scene, path, STRAINS, out=out, resume=args.resume, quiet=args.quiet,
                    settings=settings)  # fmt: skip
    V, strain = run.column("voltage_V"), run.column("stretch_x") - 1
    V, strain = V[V > 0], strain[V > 0]
    plain = np.array([branch.at_stretch(stretches[0] * (1 + s))[0].voltage for s in strain])
    # all of it strained alike: the strip's share of the stress, plane stress, y held
    ply = Ply(mylar, args.stiffener)
    share = shape.measures()["stiffener"] / (a * b * h)
    extra = ply.plane_modulus * share * strain * h**2 / (args.eps_r * EPSILON_0 * (1 + strain))
    mixed = np.sqrt(plain**2 + extra)
    found = {
        "stiffened_voltage_V": [float(v) for v in V],
        "strain_x": [float(s) for s in strain],
        "bare_voltage_V": [float(v) for v in plain],
        "mixture_voltage_V": [float(v) for v in mixed] if args.width == "held" else None,
        "voltage_rise": float(V[-1] / plain[-1] - 1),
        "film_thickness_m": float(h),
    }
    return run, found


# ------------------------------------------------------------------------- 3. bending


def profile(strip, thickness, stiffener, offset=None, length=None, cells=(14, 4, 14)):
    """Shape of a section: `strip` is the stiffener's width in the middle, or both of its ends."""
    length = length or CASES["cell"][0][0] * INCH
    middle = length / 2
    reach = strip if isinstance(strip, tuple) else (middle - strip / 2, middle + strip / 2)
    return StiffenedSection(thickness=thickness, stiffener=stiffener, offset=offset,
                            length=length, strip=reach, cells=cells)  # fmt: skip


def section(args, volts, shape, eps_r=None, out=None, stiff=None, steps=6):
    """Run of the bending of a film that bears no tension, clamped at one end."""
    film = dea.materials.get(f"vhb-thesis-{args.model}-2p125").elastic
    mylar = stiff or mylar_of(args, shape)
    scene = dea.Scene(
        dea.device(shape, MPI.COMM_WORLD),
        {"film": dea.Material(film, dea.IdealDielectric(eps_r or args.eps_r)),
         "stiffener": mylar},
        electrodes=[dea.Electrode("top", volts), dea.Ground("bottom")],
        supports=[dea.Clamp("x_min")], kinematics=dea.PlaneStrain(),
    )  # fmt: skip
    record = {"angle": dea.Rotation("x_max", "z"), "tip": dea.MeanDisplacement("x_max", "y")}
    return dea.solve(scene, dea.Ramp("voltage", steps=steps), record, out=out, **QUIET)


def element_angles(folder, shape):
    """Turn of each element along the width at the last step in degrees, on rank 0."""
    frame = read_frame(folder)
    X, u = np.asarray(frame.grid.points), np.asarray(frame.grid.point_data["displacement_m"])
    line = np.flatnonzero(np.abs(X[:, 1] - shape.thickness / 2) < 1e-6 * shape.thickness)
    line = line[np.argsort(X[line, 0])][::2]  # ends of the quadratic cells
    chord = np.diff(X[line] + u[line], axis=0)
    return np.degrees(np.diff(np.arctan2(chord[:, 1], chord[:, 0]), prepend=0.0))


def bending(args, out):
    """The section across the fold, and a bilayer against exact finite bending to 90 degrees."""
    h = args.thickness / np.prod(CASES["cell"][0])
    three = 3 * h  # three layers as one rectangle, as in Park (2019)
    offset = None if args.offset < 0 else args.offset
    shape = profile(args.strip, three, args.stiffener, offset)
    run = section(args, args.volts, shape, out=out / "section")
    found = {"bending_angle_deg": np.degrees(run["angle_rad"]), "tip_displacement_m": run["tip_m"],
             "section_voltage_V": args.volts, "thesis_bending_angle_6kV_deg": 39.2}  # fmt: skip
    flat = section(args, args.volts, profile(args.strip, three, args.stiffener, 0.0))
    found["mid_plane_bending_angle_deg"] = abs(np.degrees(flat["angle_rad"]))

    # bilayer: a stiffener all over, of a rubber four times as stiff
    elastic = dea.NeoHookean(4 * rubber(args, args.model, "cell").elastic.shear_modulus())
    back = dea.Material(elastic)
    length, layer = 10e-3, 0.2e-3
    plies = [Ply(rubber(args, args.model, "2.125"), layer, driven=True), Ply(back, layer / 2)]
    grid = layer * np.sqrt(elastic.mu / 4 / (args.eps_r * EPSILON_0)) * np.linspace(0.05, 0.95, 46)
    exact = -np.degrees([s.angle_per_length * length for s in bend(plies, grid)])
    top = float(np.interp(90, exact, grid))
    bilayer = profile((0.0, length), layer, layer / 2, length=length, cells=(1, 24, 1))
    run = section(args, top, bilayer, stiff=back)
    ours, V = np.degrees(run.column("angle_rad")), run.column("voltage_V")
    theory = -np.degrees([s.angle_per_length * length for s in bend(plies, V)])
    found |= {
        "bilayer_angle_deg": [float(x) for x in ours],
        "bilayer_exact_angle_deg": [float(x) for x in theory],
        "bilayer_voltage_V": [float(x) for x in V],
        "bilayer_largest_difference": float(np.max(np.abs(ours[1:] / theory[1:] - 1))),
        "bilayer_linear_angle_deg": -np.degrees(float(Laminate(plies).curvature(top)) * length),
    }
    if args.study:
        found["study"] = vary(args, three)
    return found, shape


def vary(args, film):
    """Bending angle and tip displacement for other strips and films, one changed at a time."""
    base = {"strip": args.strip, "thickness": film, "stiffener": args.stiffener,
            "eps_r": args.eps_r, "offset": None}  # fmt: skip
    tried = [{}, {"stiffener": 12e-6}, {"stiffener": 25e-6}, {"stiffener": 100e-6},
             {"stiffener": 250e-6}, {"thickness": film / 2}, {"thickness": 2 * film},
             {"eps_r": 2.86}, {"strip": 3e-3}, {"strip": 10e-3}, {"strip": 30e-3},
             {"offset": 0.0}, {"offset": film / 8}, {"offset": film / 4}]  # fmt: skip
    table = []
    for change in tried:
        chosen = base | change
        eps_r = chosen.pop("eps_r")
        run = section(args, args.volts, profile(**chosen), eps_r=eps_r)
        words = ", ".join(f"{k} {v:g}" for k, v in change.items()) or "nothing"
        table.append(
            {"changed": words, "angle_deg": float(np.degrees(run["angle_rad"])),
             "tip_m": float(run["tip_m"])}
        )
    return table


# --------------------------------------------------------------------------- report


def main():
    parser, args = parse()
    comm, out = MPI.COMM_WORLD, Path(args.out)
    for name in ("thickness", "eps_r", "stiffener", "stiffener_young", "strip", "strain"):
        if not getattr(args, name) > 0:
            raise dea.InputError(
                f"--{name.replace('_', '-')} is {getattr(args, name):g}, but must be above 0."
            )
    stretches, _ = CASES[args.case]
    if not rests(trace(film_of(args, args.model, args.case, args.width)), stretches):
        raise dea.InputError(
            f"A {args.model} film does not rest at the stretches {stretches[0]:g} and "
            f"{stretches[1]:g} under dead loads; take --width held."
        )
    readings = [(m, c, w) for m in args.models for c in CASES for w in ("held", "loaded")
                if w == "held" or c in ("cell", "3.5")]  # fmt: skip
    checked = {key: bare(args, *key) for key in readings}
    run, found = stiffened(args, out, parser.settings(args))
    bent, shape = bending(args, out)
    run.add(
        max_relative_error=max(error for error, _ in checked.values() if error is not None),
        loss_of_tension_strain={f"{m}, {c}": s for (m, c, w), (_, s) in checked.items()
                                if (m, c) in SLACK and w == "held"},
        **found, **bent,
    )  # fmt: skip
    if comm.rank == 0:
        angles = element_angles(out / "section", shape)
        run.summary["element_angle_deg"] = [float(a) for a in angles]
        draw(out / "voltage_strain.png", found, args)
        draw_bending(out / "element_angle.png", angles)
        dea.pictures.deformed(out)
        dea.pictures.deformed(out / "section")
    run.add(element_angle_deg=comm.bcast(run.summary.get("element_angle_deg"), root=0))
    if comm.rank == 0 and not args.quiet:
        report(run.summary, checked)
        print(f"\nresults: {out}/history.csv, fields.xdmf, section/, voltage_strain.png, "
              "element_angle.png")  # fmt: skip


def report(s, checked):
    print(f"\n{'model':15}{'case':8}{'width':8}{'error':>9}{'slack at strain':>17}{'table':>8}")
    for (model, case, width), (error, slack) in checked.items():
        known = SLACK.get((model, case)) if width == "held" else None
        print(f"{model:15}{case:8}{width:8}"
              f"{'unstable' if error is None else format(error, '.1e'):>9}"
              f"{'-' if slack is None else f'{100 * slack:.2f} %':>17}"
              f"{'' if known is None else f'{100 * known:.1f} %':>8}")  # fmt: skip
    print(f"\nat {100 * s['strain_x'][-1]:.3f} % strain: bare film "
          f"{s['bare_voltage_V'][-1]:.1f} V, with the strip {s['stiffened_voltage_V'][-1]:.1f} V "
          f"({100 * s['voltage_rise']:+.2f} %)"
          + (f", rule of mixtures {s['mixture_voltage_V'][-1]:.0f} V"
             if s["mixture_voltage_V"] else ""))  # fmt: skip
    print(f"section across the fold: {s['bending_angle_deg']:.3f} degrees, tip "
          f"{1e3 * s['tip_displacement_m']:.4g} mm (Park: 39.2 degrees, data missing); strip in "
          f"the mid-plane {s['mid_plane_bending_angle_deg']:.1e} degrees")  # fmt: skip
    print("bilayer, degrees:        " + "".join(f"{a:9.3f}" for a in s["bilayer_angle_deg"]))
    print("exact finite bending:    " + "".join(f"{a:9.3f}" for a in s["bilayer_exact_angle_deg"])
          + f"   (linear {s['bilayer_linear_angle_deg']:.1f})")  # fmt: skip
    for row in s.get("study", ()):
        print(f"  {row['changed']:22}{row['angle_deg']:10.3f} degrees {1e3 * row['tip_m']:9.3f} mm")


def draw(path, found, args):
    figure = Figure(figsize=(3.6, 2.8), layout="constrained")
    axes = figure.subplots()
    x = 100 * np.array(found["strain_x"])
    axes.plot(x, np.array(found["bare_voltage_V"]) / 1e3, "k", label="exact, no stiffener")
    axes.plot(x, np.array(found["stiffened_voltage_V"]) / 1e3, "o-", mfc="none",
              label=f"with strip, {args.model}")  # fmt: skip
    axes.set(xlabel="Strain along x (%)", ylabel="Voltage (kV)")
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=200)


def draw_bending(path, angles):
    figure = Figure(figsize=(3.6, 2.8), layout="constrained")
    axes = figure.subplots()
    axes.bar(np.arange(1, len(angles) + 1), angles)
    axes.set(xlabel="Element along the width", ylabel="Turn of the element (deg)")
    figure.savefig(path, dpi=200)


if __name__ == "__main__":
    main()
