"""Free stack of round layers with full electrodes under voltage (DDEA, Park 2019, 4.3.2).

Every layer of such a stack is in the same homogeneous state.  So a short column stands for the
whole stack, and its state is known exactly.  The layers are traced through pull-in in the full
field.  They are also pressed by the Maxwell pressure, in the ways that give the voltages of
Park (2019).

Run it with `mpirun -n 2 python demos/ddea_stack.py`.
"""

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import Film, trace
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0

SHARE = 0.5 / 0.55  # of the height is elastomer; the soft 0.05 mm of electrode do not thin
THESIS = {"voltage_V": 57e3, "contraction": 0.30, "cited_voltage_V": 10e3}


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/ddea_stack")
    parser.number("--mu", 0.5e6, "Pa", "shear modulus (Park 2019, Table 5.2, 2 C10)")
    parser.number("--bulk", 2.5e6, "Pa", "bulk modulus (Park 2019, Table 5.2, 2/D1)")
    parser.number("--eps-r", 4.7, "-", "relative permittivity (Park 2019, Table 5.2)")
    parser.number("--thickness", 0.5e-3, "m", "thickness of a layer")
    parser.number("--radius", 7e-3, "m", "radius of the stack")
    parser.count("--layers", 2, "layers of the column")
    parser.number("--until", 0.5, "-", "contraction of a layer at which the trace ends")
    return parser, parser.parse_args()


def column(args, comm):
    """The column as a section (r, z), with an ideal electrode on each face of each layer."""
    layers = [Layer("film", args.thickness) for _ in range(args.layers)]
    faces = ["bottom", *(f"interface_{k}" for k in range(1, args.layers)), "top"]
    return dea.device(BoxStack(args.radius, None, layers, divisions=2), comm), faces


def scene(device, film, electrodes=(), loads=()):
    return dea.Scene(
        device,
        {"film": film},
        electrodes=electrodes,
        supports=[dea.Fix("bottom", "z"), dea.Fix("x_min", "r")],
        loads=loads,
        kinematics=dea.Axisymmetric(),
    )


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    film = dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(args.eps_r),
                        bulk_modulus=args.bulk)  # fmt: skip
    T, eps = args.thickness, args.eps_r * EPSILON_0
    if args.layers < 1:
        raise dea.InputError(f"--layers is {args.layers}, but must be at least 1.")
    device, faces = column(args, comm)
    unit = 0.7 * T * float(np.sqrt(args.mu / eps))  # about the pull-in voltage
    electrodes = [dea.Electrode(tuple(faces[1::2]), unit), dea.Ground(tuple(faces[::2]))]
    driven = scene(device, film, electrodes)  # refuses bad constants before the exact states do
    field, pressed = trace(Film(film, T)), trace(Film(film, T, stress="pressure"))

    record = {
        "contraction": dea.Contraction(("bottom", "top"), "z"),
        "stretch": dea.MeanDisplacement("x_max", "r"),
        "charge": dea.Charge("+".join(faces[1::2])),
    }
    run = dea.solve(
        driven,
        dea.Trace("voltage", first=0.1, longest=1.5, until=("contraction", args.until)),
        record,
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        stability="every",
        options=dea.NewtonOptions(tolerance=1e-12),
        settings=parser.settings(args),
    )
    peak = next(row for row in run.history if row["event"] == "maximum")
    exact_peak, pressed_peak = field.event("pull-in"), pressed.event("pull-in")

    run.add(
        max_relative_error=largest_error(args, run, field),
        pull_in_voltage_V=peak["voltage_V"],
        pull_in_contraction=peak["contraction"],
        exact_pull_in_voltage_V=exact_peak.voltage,
        exact_pull_in_contraction=float(1 - exact_peak.stretches[2]),
        exact_pull_in_voltage_pressure_V=pressed_peak.voltage,
        **by_pressure(args, device, film, pressed),
    )
    if comm.rank == 0:
        draw(args, field, pressed)
        if not args.quiet:
            report(args, run)


def largest_error(args, run, field):
    """Of both stretches and the voltage, against the exact state that has the same thickness."""
    errors = []
    for row in run.history[1:]:
        (state,) = field.at_stretch(1 - row["contraction"], axis=2)
        errors.append([row["voltage_V"] / state.voltage - 1,
                       (1 + row["stretch_m"] / args.radius) / state.stretches[0] - 1])  # fmt: skip
    return float(np.abs(errors).max())


def by_pressure(args, device, film, pressed):
    """The column under Maxwell pressures in place of a field, beside the exact states."""
    T, eps = args.thickness, args.eps_r * EPSILON_0
    pressed_peak = pressed.event("pull-in")
    # the Maxwell pressure eps E^2 on the electrodes alone, in place of the field's stress
    top = pressed_peak.maxwell
    live = press(device, film, dea.FollowerPressure("top", 2 * top), at=(0.5,), until=0.5)
    at = np.argmin(np.abs(live["load_factor"] - 0.5))
    pressed_volts = T * (1 - live["contraction"]) * np.sqrt(2 * top * live["load_factor"] / eps)

    # and with the undeformed thickness in it, eps (V/T)^2, on deformed and on undeformed areas
    volts = THESIS["voltage_V"] * T / 0.5e-3
    p = eps * (volts / T) ** 2
    given = {}
    for name, load in (("live", dea.FollowerPressure), ("dead", dea.DeadPressure)):
        given[name] = press(device, film, load("top", p))["contraction"][-1]
    exact_live = float(1 - pressed.states_at(volts, "undeformed")[0][0].stretches[2])
    (at30,) = pressed.at_stretch(1 - THESIS["contraction"] / SHARE, axis=2)
    return dict(
        pull_in_voltage_pressure_V=float(pressed_volts[at]),
        largest_voltage_pressure_V=float(pressed_volts.max()),
        contraction_live=given["live"],
        contraction_dead=given["dead"],
        exact_contraction_live=exact_live,
        exact_contraction_dead=dead_contraction(film, p),
        voltage_for_30_percent_V=float(T * np.sqrt(at30.maxwell / eps)),
    )


def draw(args, field, pressed):
    """Voltage against contraction, beside the exact branches."""
    keep = 1 - field.stretches[2] < args.until
    lines = {"exact, full field": (1 - field.stretches[2][keep], field.voltage[keep])}
    keep = 1 - pressed.stretches[2] < args.until
    shrink = 1 - pressed.stretches[2][keep]
    lines["exact, pressure of true field"] = shrink, pressed.voltage[keep]
    lines["exact, undeformed thickness"] = shrink, pressed.load("undeformed")[keep]
    dea.pictures.curve(args.out, x="contraction", y="voltage_V", labels=["finite elements"],
                       lines=lines)  # fmt: skip


def press(device, film, load, at=(), until=None):
    """History of the column under a pressure on its top, without a field."""
    path = dea.Ramp("load", steps=8)
    if until is not None:
        path = dea.Trace("load", first=0.05, at=at, until=("contraction", until), longest=1.0)
    record = {"contraction": dea.Contraction(("bottom", "top"), "z")}
    run = dea.solve(scene(device, film, loads=[load]), path, record, quiet=True, stability="never",
                    options=dea.NewtonOptions(tolerance=1e-12))  # fmt: skip
    return {name: run.column(name) for name in ("contraction", "load_factor")}


def dead_contraction(film, p):
    """Exact contraction under a nominal pressure p: dW/de_3 = -p lam_3, dW/de_1 = 0."""
    state, B = Film(film, 1.0), np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]).T
    y = np.zeros(2)
    for load in np.repeat(np.linspace(0.1, 1, 10) * p, 8):  # Newton's method, eight times a load
        _, R, H = state.elastic(B @ y)
        push = np.array([0.0, load * np.exp(y[1])])
        y -= np.linalg.solve(B.T @ H @ B + np.diag(push), B.T @ R + push)
    return float(-np.expm1(y[1]))


def report(args, run):
    s = run.summary
    kV = 1e-3
    rows = [
        ("pull-in, full field, kV", "-", s["exact_pull_in_voltage_V"] * kV,
         s["pull_in_voltage_V"] * kV),
        ("  contraction of a layer, %", "-", 100 * s["exact_pull_in_contraction"],
         100 * s["pull_in_contraction"]),
        ("pull-in, pressure eps E^2 alone, kV", "-", s["exact_pull_in_voltage_pressure_V"] * kV,
         s["pull_in_voltage_pressure_V"] * kV),
        ("at 57 kV, eps (V/T)^2 live, %", "30", 100 * SHARE * s["exact_contraction_live"],
         100 * SHARE * s["contraction_live"]),
        ("at 57 kV, eps (V/T)^2 dead, %", "30", 100 * SHARE * s["exact_contraction_dead"],
         100 * SHARE * s["contraction_dead"]),
    ]  # fmt: skip
    print(f"\n{'':38}{'Park':>8}{'exact':>12}{'finite elements':>18}")
    for name, thesis, exact, fe in rows:
        print(f"{name:38}{thesis:>8}{exact:12.4f}{fe:18.4f}")
    print(f"largest relative error of voltage and stretch along the branch: "
          f"{s['max_relative_error']:.1e}")  # fmt: skip
    full, alone = (s[f"pull_in_voltage{name}_V"] * kV for name in ("", "_pressure"))
    print(
        "\nWhere Park's voltages come from.  With the undeformed thickness in the Maxwell "
        "pressure,\np = eps (V/T)^2 on deformed areas, and 0.05 mm of electrode that does not thin "
        f"beside each 0.5 mm,\n30 % take {s['voltage_for_30_percent_V'] * kV:.2f} kV: the "
        "printed 57 kV.  But the field grows as a layer thins, and it pulls in\nlong before: at "
        f"{full:.1f} kV, or at {alone:.1f} kV if eps E^2 only presses on the electrodes (in a\n"
        "compressible film that is not the field's stress, which also pulls in the plane).\n"
        "The cited 10 kV belong to thinner layers: voltages go with T, and 57 to 10 is 500 um to "
        f"{500 / 5.7:.0f} um,\nor an equi-biaxial pre-stretch of {5.7**0.5:.2f}."
    )
    print(f"\nresults: {run.out}/history.csv, voltage_contraction.png, fields.xdmf")


if __name__ == "__main__":
    main()
