"""One ring layer of the helical actuator under 4 to 40 kPa on its electrodes (Park 2019, 4.3.3).

A free layer is in a homogeneous state and follows the analytic model.  On a rigid base the rubber
cannot flow sideways.  Under a flat plate its stiffness is then that of the shape factor S,
E = 4 mu (1 + S^2).  Under a soft electrode the edges are squeezed, and the middle hardly moves.

Run it with `mpirun -n 2 python demos/hdea_single_layer.py`.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact.helicoid import elastic_pressure
from dea_fenicsx.exact.linear import bonded_modulus, bonded_ring_modulus
from dea_fenicsx.geometry import BoxStack, Layer

PRESSURES = (4e3, 10e3, 20e3, 30e3, 40e3)


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/hdea_single_layer")
    parser.number("--mu", 73.7e3, "Pa", "shear modulus (Park 2019, Table 5.2, G)")
    parser.number("--outer-radius", 5e-3, "m", "outer radius (Park 2019: 5 mm)")
    parser.number("--inner-radius", 1e-3, "m", "inner radius (not printed)")
    parser.number("--thickness", 0.5e-3, "m", "thickness of the layer (Park 2019: 0.5 mm)")
    parser.count("--radial", 24, "cells over the width")
    parser.count("--through", 4, "cells through the thickness")
    return parser, parser.parse_args()


def ring(args, comm):
    """The section of the ring layer."""
    width = args.outer_radius - args.inner_radius
    if not 0 < args.inner_radius < args.outer_radius:
        raise dea.InputError(
            f"--inner-radius is {args.inner_radius:g} m, but must be above 0 and below the outer "
            f"radius {args.outer_radius:g} m."
        )
    layer = Layer("film", args.thickness, divisions=args.through, grading=2.0)
    shape = BoxStack(width, None, [layer], divisions=args.radial, grading=8.0, x0=args.inner_radius)
    return dea.device(shape, comm)


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    device = ring(args, comm)
    film = dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(4.7))
    T, top = args.thickness, max(PRESSURES)
    area = np.pi * (args.outer_radius**2 - args.inner_radius**2)
    pressed = (dea.FollowerPressure("top", top),)
    modulus = bonded_modulus(args.mu, args.outer_radius, args.inner_radius, T, faces=1)
    ring_modulus = bonded_ring_modulus(args.mu, args.outer_radius, args.inner_radius, T, faces=1)

    def case(base, loads=(), plate=0.0, **how):
        """One support of the layer: its pressures (of the mean, under a plate) and contractions."""
        scene = dea.Scene(
            device,
            {"film": film},
            supports=[base],
            loads=loads,
            prescribed=[dea.Displacement("top", "z", -plate)] if plate else (),
            kinematics=dea.Axisymmetric(),
        )
        record = {"contraction": dea.Contraction(("bottom", "top"), "z")}
        if plate:
            record["force"] = dea.Reaction("top", "z")
        path = dea.Ramp("stretch" if plate else "load", steps=8,
                        at=() if plate else tuple(p / top for p in PRESSURES[:-1]))  # fmt: skip
        run = dea.solve(scene, path, record, options=dea.NewtonOptions(tolerance=1e-11), **how)
        p = -run.column("force_N") / area if plate else top * run.column("load_factor")
        return run, p, run.column("contraction")

    bonded, slides = dea.Clamp("bottom"), dea.Fix("bottom", "z")
    quiet = {"quiet": True, "stability": "never"}
    run, *free = case(slides, pressed, out=args.out, resume=args.resume, quiet=args.quiet,
                      settings=parser.settings(args))  # fmt: skip
    found = {"free": free}
    found["bonded, soft electrode"] = case(bonded, pressed, **quiet)[1:]
    # the plate sinks as far as the shape factor says for the largest pressure
    found["bonded, flat plate"] = case(bonded, plate=T * top / modulus, **quiet)[1:]

    # and by 1e-5 of the thickness for the modulus at rest, which is what the shape factor gives
    _, start, sunk = case(bonded, plate=1e-5 * T, **quiet)

    run.add(
        **findings(film, found),
        plate_modulus_Pa=float(start[-1] / sunk[-1]),
        shape_factor_modulus_Pa=float(modulus),
        ring_modulus_Pa=float(ring_modulus),
        shape_factor=(args.outer_radius - args.inner_radius) / (4 * T),
    )
    if comm.rank == 0:
        draw(Path(args.out) / "contraction_pressure.png", film, found, modulus)
        if not args.quiet:
            report(run, found)


def findings(film, found):
    """Contractions at the pressures of Park (2019), and those of the analytic model."""
    p, k = found["free"]
    at = [int(np.argmin(np.abs(p - wanted))) for wanted in PRESSURES]
    exact = [solve_free(film, wanted) for wanted in PRESSURES]
    plate_p, plate_k = found["bonded, flat plate"]
    soft_p, soft_k = found["bonded, soft electrode"]
    return {
        "contraction_free": [float(k[i]) for i in at],
        "exact_contraction_free": exact,
        "max_relative_error": float(np.max(np.abs(elastic_pressure(film, k[1:]) / p[1:] - 1))),
        "contraction_bonded_soft": [float(soft_k[np.argmin(np.abs(soft_p - w))])
                                    for w in PRESSURES],
        "pressure_of_plate_Pa": [float(v) for v in plate_p],
        "contraction_of_plate": [float(v) for v in plate_k],
    }  # fmt: skip


def solve_free(film, pressure):
    """Analytic contraction of the free layer at a live pressure."""
    low, high = 0.0, 0.95
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if elastic_pressure(film, middle) < pressure else (low, middle)
    return (low + high) / 2


def report(run, found):
    s = run.summary
    print(f"\n{'contraction, %, at kPa':34}" + "".join(f"{p / 1e3:>11g}" for p in PRESSURES))
    plate = np.interp(PRESSURES, s["pressure_of_plate_Pa"], s["contraction_of_plate"])
    rows = [
        ("Park", None),
        ("free, analytic", s["exact_contraction_free"]),
        ("free, finite elements", s["contraction_free"]),
        ("flat plate, shape factor", np.array(PRESSURES) / s["shape_factor_modulus_Pa"]),
        ("flat plate, finite elements", plate),
        ("soft electrode, finite elements", s["contraction_bonded_soft"]),
    ]
    for name, values in rows:
        cells = ["plot only"] * len(PRESSURES) if values is None else [f"{100 * v:.5f}"
                                                                     for v in values]  # fmt: skip
        print(f"{name:34}" + "".join(f"{c:>11}" for c in cells))
    print(
        f"largest relative error of the free layer's pressure: {s['max_relative_error']:.1e}\n\n"
        f"Flat plate on a bonded ring, S = w/(4 t) = {s['shape_factor']:g}: finite elements "
        f"{s['plate_modulus_Pa'] / 1e6:.4f} MPa, 4 mu (1 + S^2) "
        f"{s['shape_factor_modulus_Pa'] / 1e6:.4f} MPa,\nwith the ring's curvature "
        f"{s['ring_modulus_Pa'] / 1e6:.4f} MPa; all at rest, it stiffens as it is pressed.\n"
        "Park (2019) prints neither inner radius nor support nor material."
    )
    print(f"\nresults: {run.out}/history.csv, contraction_pressure.png, fields.xdmf")


def draw(path, film, found, modulus):
    figure = Figure(figsize=(4.0, 3.2), layout="constrained")
    axes = figure.subplots()
    top = max(PRESSURES)
    k = np.linspace(0, solve_free(film, top), 101)
    axes.plot(elastic_pressure(film, k) / 1e3, 100 * k, "k", lw=1, label="analytic, free")
    axes.plot([0, top / 1e3], [0, 100 * top / modulus], "k--", lw=1, label="shape factor")
    for mark, (name, (p, c)) in zip("os^", found.items(), strict=True):
        axes.plot(p / 1e3, 100 * c, mark, mfc="none", label=f"FE, {name}")
    axes.set(xlabel="Pressure (kPa)", ylabel="Contraction (%)")
    figure.legend(frameon=False, fontsize=7, loc="outside upper center", ncols=2)
    figure.savefig(path, dpi=200)


if __name__ == "__main__":
    main()
