"""The spiral box moved by its hinges (Park 2019, 5.3, Table 5.3, chapter 6), in closed form.

The law of the hinges consists of the printed angles, or of those of a file (`--law`).  The printed
heights are proportional to the angle.  They are compared with rigid panels that tilt, and with the
panels of a Kresling storey, which turns as it sinks.  The printed forces are compared with an ideal
film that may not stretch, for any number of layers.  The forces are also those of the four cells of
a storey, and of any number of storeys.
"""

import csv
import json
from pathlib import Path

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import Film, trace
from dea_fenicsx.origami import (
    INCH,
    POUND_FORCE,
    Box,
    Kresling,
    blocked_force,
    table_of_angles,
    voltage_to_block,
)

VOLTS = np.array([0.0, 1e3, 2e3, 4e3])
GAMMA_DEG = np.array([54.0, 50.0, 45.0, 31.0])
LOSS = np.array([0.0, 0.122, 0.275, 0.7027]) * INCH
FORCE = np.array([0.0, 0.35, 1.26, 4.175]) * POUND_FORCE
SIDE, EDGE, K = 2.125 * INCH, 2.75 * INCH, 17 * POUND_FORCE / INCH
COLLAPSED = 0.2 * INCH  # ten panels of 0.02 in
PRINTED = "as printed, h0 gamma/gamma0"
BOXES = {  # name in the results
    PRINTED: "as_printed",
    "rigid panels, 54 degrees at rest": "rigid_54_deg",
    "rigid panels 2.75 in long": "rigid_panels_2p75_in_long",
    "Kresling storey, twist 45 degrees": "kresling_storey",
}


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/kresling_box")
    parser.number("--height", 1.65 * INCH, "m", "of a storey without voltage")
    parser.count("--layers", 3, "films of a hinge on each other")
    parser.count("--cells", 4, "hinged cells of a storey; their forces add up")
    parser.count("--storeys", 1, "storeys on each other; their strokes add up")
    parser.number("--thickness", 50e-6, "m", "of one film")
    parser.number("--width", SIDE, "m", "of a hinge")
    parser.number("--eps-r", 4.7, "-", "relative permittivity of the film")
    parser.number("--shear-modulus", 73.7e3, "Pa", "of the film, for its pull-in voltage when free")
    parser.add_argument("--law", metavar="CSV", help="hinge law of your own, from 0 V up: columns "
                        "voltage_V, angle_deg")  # fmt: skip
    return parser, parser.parse_args()


def read_law(path):
    """Voltages in V and angles in degrees of a CSV file."""
    try:
        with open(path, newline="", encoding="utf-8") as f:
            rows = list(csv.DictReader(f))
        volts, angles = ([float(row[c]) for row in rows] for c in ("voltage_V", "angle_deg"))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise dea.InputError(
            f"--law {path} must be a CSV file of numbers with the columns voltage_V and angle_deg "
            f"({type(error).__name__}: {error})."
        ) from error
    if not volts or volts[0] != 0:
        raise dea.InputError(f"--law {path} must begin with the angle at 0 V.")
    return np.array(volts), np.array(angles)


def main():
    parser, args = parse()
    known = read_law(args.law) if args.law else (VOLTS, GAMMA_DEG)
    law, last = table_of_angles(known[0], np.radians(known[1])), known[0][-1]
    volts = np.unique([*VOLTS[last >= VOLTS], last])
    sizes = {"cells": args.cells, "storeys": args.storeys}
    leaning = float(np.hypot(args.height, np.sqrt(2) * SIDE * np.sin(np.pi / 8)))
    storey = Kresling(SIDE, leaning, K, args.height)
    made = (
        Box(law, args.height, "proportional", **sizes),
        Box(law, args.height, **sizes),
        Box(law, args.height, panel=EDGE, **sizes),
        Box(law, args.height, "storey", storey=storey, **sizes),
    )
    boxes = dict(zip(BOXES, made, strict=True))
    film = {"eps_r": args.eps_r, "thickness": args.thickness, "width": args.width}
    hinge = blocked_force(volts, **film, layers=args.layers)
    if MPI.COMM_WORLD.rank != 0:
        return  # nothing here is shared work
    out = Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    need = Kresling(SIDE, EDGE, K).peak()[1]
    needed = {
        f"{n}_layers_V": float(voltage_to_block(need, **film, layers=n))
        for n in sorted({1, args.layers, 10, 100})
    }
    soft = dea.Material(dea.NeoHookean(args.shear_modulus), dea.IdealDielectric(args.eps_r))
    summary = {
        "voltage_V": volts.tolist(),
        "printed": {"voltage_V": VOLTS.tolist(), "loss_m": LOSS.tolist(),
                    "angle_deg": GAMMA_DEG.tolist(), "force_N": FORCE.tolist()},
        "boxes": {
            name: {
                "angle_deg": np.degrees(box.gamma(volts)).tolist(),
                "height_m": box.total_height(volts).tolist(),
                "stroke_m": box.stroke(volts).tolist(),
                "strokes_at_last_voltage": {
                    k: float(v) for k, v in box.strokes(last, COLLAPSED).items()
                },
            }
            for name, box in boxes.items()
        },
        "turn_of_storey_deg": np.degrees(made[-1].turn(volts) - storey.rest_twist).tolist(),
        "blocked_force_of_hinge_N": hinge.tolist(),
        "blocked_force_of_box_N": (args.cells * hinge).tolist(),
        "printed_power_of_voltage": float(np.polyfit(np.log(VOLTS[1:]), np.log(FORCE[1:]), 1)[0]),
        "collapse_force_N": need,
        "voltage_for_collapse_force": needed,
        "free_film_pull_in_V": float(trace(Film(soft, args.thickness)).event("pull-in").voltage),
        "settings": parser.settings(args),
    }  # fmt: skip
    (out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", "utf-8")
    write_curves(boxes, film, args, np.linspace(0, last, 81), out / "box.csv")
    draw(boxes, film, args, np.linspace(0, last, 161), out / "box.png")
    if not args.quiet:
        report(summary, boxes, args)
        print(f"\nresults: {out}/summary.json, box.csv, box.png")


def write_curves(boxes, film, args, volts, path):
    columns = {"voltage_V": volts}
    for name, box in boxes.items():
        columns[f"{BOXES[name]}_angle_deg"] = np.degrees(box.gamma(volts))
        columns[f"{BOXES[name]}_height_m"] = box.total_height(volts)
    for n in sorted({1, args.layers, 10}):
        columns[f"hinge_of_{n}_layers_force_N"] = blocked_force(volts, **film, layers=n)
        columns[f"box_of_{n}_layers_force_N"] = args.cells * blocked_force(volts, **film, layers=n)
    with path.open("w", newline="", encoding="utf-8") as f:
        writer = csv.writer(f)
        writer.writerow(columns)
        writer.writerows([f"{x:.9g}" for x in row] for row in zip(*columns.values(), strict=True))


def draw(boxes, film, args, volts, path):
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 3.3), layout="constrained")
    height, angle, force = figure.subplots(1, 3)
    for i, (name, box) in enumerate(boxes.items()):
        style = ("-", "--", "-.", ":")[i]
        height.plot(volts / 1e3, 1e3 * box.total_height(volts), style, color=f"C{i}", lw=1,
                    label=name)  # fmt: skip
        angle.plot(volts / 1e3, np.degrees(box.gamma(volts)), style, color=f"C{i}", lw=1)
    height.plot(VOLTS / 1e3, 1e3 * args.storeys * (args.height - LOSS), "ko", ms=3,
                label="Table 5.3")  # fmt: skip
    angle.plot(VOLTS / 1e3, GAMMA_DEG, "ko", ms=3)
    for i, n in enumerate(sorted({1, args.layers, 10, 30})):
        force.plot(volts / 1e3, blocked_force(volts, **film, layers=n), color=f"C{i + 3}", lw=1,
                   label=f"{n} layers" if n > 1 else "1 layer")  # fmt: skip
    force.plot(VOLTS / 1e3, FORCE, "ko", ms=3)
    force.legend(fontsize=6, frameon=False)
    for axes, text in ((height, "Height (mm)"), (angle, "Angle of the panels (degrees)"),
                       (force, "Blocked force of a hinge (N)")):  # fmt: skip
        axes.set(xlabel="Voltage (kV)", ylabel=text, ylim=(0, None))
    figure.legend(*height.get_legend_handles_labels(), fontsize=7, frameon=False, ncols=2,
                  loc="outside upper center")  # fmt: skip
    figure.savefig(path, dpi=200)


def report(s, boxes, args):
    volts = s["voltage_V"]

    def line(name, values, unit):
        print(f"{name:40}" + "".join(f"{v:9.4g}" for v in np.round(values, 9) + 0.0) + f"  {unit}")

    line("voltage, printed", VOLTS / 1e3, "kV")
    line("loss of height, printed", LOSS / INCH, "in")
    line("angle, printed", GAMMA_DEG, "deg")
    line("blocked force, printed", FORCE, "N")
    line("\nvoltage", np.array(volts) / 1e3, "kV")
    for name, box in boxes.items():
        line(f"  {name}", box.stroke(volts) / args.storeys / INCH, "in")
    for name in list(boxes)[2:]:
        line(f"  {name}", s["boxes"][name]["angle_deg"], "deg")
    line("  by which the storey has turned", s["turn_of_storey_deg"], "deg")
    line(f"  {args.layers} films of a hinge", s["blocked_force_of_hinge_N"], "N")
    line(f"  of {args.cells} cells", s["blocked_force_of_box_N"], "N")
    power, needed = s["printed_power_of_voltage"], s["voltage_for_collapse_force"]
    print(f"\nprinted forces go with V^{power:.2f}, those of a film that may not stretch with V^2")
    print(f"the collapse takes {s['collapse_force_N']:.1f} N for each diagonal: "
          + ", ".join(f"{v / 1e3:.2f} kV with {k.split('_')[0]}" for k, v in needed.items())
          + " layers")  # fmt: skip
    print(f"a free film pulls in at {s['free_film_pull_in_V']:.0f} V")
    for name, box in s["boxes"].items():
        share = box["strokes_at_last_voltage"]
        print(f"{name}: at {volts[-1] / 1e3:g} kV {100 * share['of_start']:.1f} % of the height, "
              f"{100 * share['of_end']:.1f} % of what is left, "
              f"{100 * share['of_collapsed']:.0f} % of ten panels' thickness")  # fmt: skip


if __name__ == "__main__":
    main()
