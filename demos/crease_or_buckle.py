"""A film bonded to a base: under voltage it buckles into waves, or folds into creases.

A film of thickness h and shear modulus mu carries a voltage.  It is bonded to a base of modulus
mu_b, and neither can move sideways (plane strain), so that nothing deforms at first: the field E
only puts the film under the compressive stress eps E^2.  Small waves with wave number k deform film
and base by u_y = f(y) cos kx, and turn the field so that both faces keep their potentials.  The
flat state is neutral against them where, with the normal stress n = -P + 2 mu f' of an
incompressible body, P = mu (f''' - k^2 f')/k^2,

    top:        f'' + k^2 f = 0,  n = eps E^2 g';
    interface:  f, f' and mu (f'' + k^2 f) continuous,  n - eps E^2 g' = n of the base;
    bottom:     f = f' = 0,

where f'''' - 2 k^2 f'' + k^4 f = 0 in both, and g'' = k^2 g in the film with g = f at its faces.
This is an eigenvalue problem for eps E^2.  On a soft base its least value lies at a wavelength of
several h: the film buckles, for a very soft base at

    eps E^2 = mu (3 mu_b/mu)^(2/3),     k h = (3 mu_b/mu)^(1/3).

On a stiff base it is least for very short waves, eps E^2 = 2 mu.  Long before that, near
sqrt(mu/eps), the surface folds into creases (Q. Wang, L. Zhang, X. Zhao, Phys. Rev. Lett. 106
(2011) 118301).  So a film whose waves are neutral at a higher field than this creases first.

    python demos/crease_or_buckle.py
    python demos/crease_or_buckle.py --ratio 2

The first command traces half a wave to its bifurcation and on along its branch.  The second cuts a
small notch at a plane of symmetry, and tells the field at which its corner has sunk by half its
width; from there on it sinks very fast.  The two sides of a notch may overlap, for this model has
no contact (see crease.py).
"""

import numpy as np
from crease import Notched
from mpi4py import MPI
from scipy.linalg import eig
from scipy.optimize import minimize_scalar

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0

EPS_R = 4.0
SHORT = 20.0
"""Largest k h that is looked at.  Waves that are shorter than this do not reach the base."""

WIDE, DEEP = 0.01, 0.002
"""Half the width and the depth of the notch, over h."""

CREASE = 1.03
"""Field in sqrt(mu/eps) at which films without waves crease."""


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/crease_or_buckle")
    parser.number("--mu", 1e5, "Pa", "shear modulus of the film")
    parser.number("--ratio", 0.05, "-", "shear modulus of the base over that of the film")
    parser.number("--thickness", 0.1e-3, "m", "thickness h of the film")
    parser.number("--depth", 10.0, "-", "thickness of the base over that of the film")
    parser.number("--to", 1.1, "-", "end of the buckled branch: eps E^2 over its value at onset")
    parser.count("--cells", 8, "cells along half a wave")
    parser.count("--mesh", 1, "refinement of the mesh of a crease")
    return parser, parser.parse_args()


def waves(k, y, y0, y1):
    """The four solutions f of a layer at a height y, with three derivatives; shape (4, 4)."""
    rows = np.empty((4, 4))
    for column, (sign, gap) in enumerate(((1, y1 - y), (-1, y - y0))):
        decay = np.exp(-k * gap)
        for order in range(4):
            rows[order, 2 * column] = (sign * k) ** order * decay
            rows[order, 2 * column + 1] = (k * gap - order) * (sign * k) ** order * decay
    return rows


def neutral(k, depth, ratio):
    """eps E^2/mu at which waves of k (in 1/h) are neutral, for a base of a depth in h."""
    top, low = waves(k, 1.0, 0.0, 1.0), waves(k, 0.0, 0.0, 1.0)
    under, bottom = waves(k, 0.0, -depth, 0.0), waves(k, -depth, -depth, 0.0)

    def shear(rows, mu):
        return mu * (rows[2] + k * k * rows[0])

    def normal(rows, mu):
        return mu * (3 * rows[1] - rows[3] / k**2)

    film, base = slice(0, 4), slice(4, 8)
    A, B = np.zeros((8, 8)), np.zeros((8, 8))
    A[0, film] = shear(top, 1.0)
    A[1, film] = normal(top, 1.0)
    A[2, film], A[2, base] = shear(low, 1.0), -shear(under, ratio)
    A[3, film], A[3, base] = normal(low, 1.0), -normal(under, ratio)
    A[4, film], A[4, base] = low[0], -under[0]
    A[5, film], A[5, base] = low[1], -under[1]
    A[6, base], A[7, base] = bottom[0], bottom[1]
    c, s = 1 / np.tanh(k), 1 / np.sinh(k)
    B[1, film] = k * (c * top[0] - s * low[0])
    B[3, film] = k * (s * top[0] - c * low[0])
    values = eig(A, B, right=False)
    real = np.isfinite(values) & (abs(values.imag) < 1e-6 * abs(values))
    values = values[real].real
    return float(np.min(values[values > 1e-9]))


def critical(depth, ratio):
    """Least eps E^2/mu of all waves, and its k in 1/h."""
    numbers = np.geomspace(0.02, SHORT, 120)
    values = [neutral(k, depth, ratio) for k in numbers]
    at = int(np.argmin(values))
    if at in (0, len(numbers) - 1):
        return values[at], None
    found = minimize_scalar(neutral, bounds=(numbers[at - 1], numbers[at + 1]),
                            args=(depth, ratio), method="bounded")  # fmt: skip
    return float(found.fun), float(found.x)


def volts(args, value):
    """Voltage at which eps E^2/mu has a value."""
    return args.thickness * float(np.sqrt(value * args.mu / (EPS_R * EPSILON_0)))


def scene(args, mesh, unit):
    """Film on base; at a ramp factor of 1 the voltage is `unit`."""
    return dea.Scene(
        dea.device(mesh, MPI.COMM_WORLD),
        {
            "film": dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(EPS_R)),
            "base": dea.Material(dea.NeoHookean(args.ratio * args.mu)),
        },
        electrodes=[dea.Electrode("top", unit), dea.Ground("interface_1")],
        supports=[dea.Clamp("bottom"), dea.Fix("x_min", "x"), dea.Fix("x_max", "x")],
        kinematics=dea.PlaneStrain(),
    )


def buckled(parser, args, value, k):
    """Half a wave to its bifurcation and on along its branch."""
    h, n = args.thickness, args.cells
    length = np.pi / k * h
    layers = [
        Layer("base", args.depth * h, max(2, round(args.depth / np.pi * k * n / 2))),
        Layer("film", h, max(1, round(k * n / np.pi))),
    ]
    mesh = BoxStack(length, None, layers, divisions=n)
    end = volts(args, args.to * value)
    path = dea.Trace("voltage", first=0.3, switch=0.05, until=("voltage_V", end), steps=60)
    run = dea.solve(
        scene(args, mesh, volts(args, value)), path,
        {"crest": dea.AtPoint((0.0, (1 + args.depth) * h), "displacement", "y"),
         "trough": dea.AtPoint((length, (1 + args.depth) * h), "displacement", "y")},
        out=args.out, resume=args.resume, quiet=args.quiet, stability="every",
        settings=parser.settings(args),
    )  # fmt: skip
    onset = next(row["voltage_V"] for row in run.history if row["event"] == "bifurcation")
    return run, onset


def folded(parser, args):
    """The film with a notch, until its corner has sunk by half the width of the notch."""
    h, k = args.thickness, args.mesh
    layers = [Layer("base", args.depth * h, 8 * k), Layer("film", h, 14 * k)]
    mesh = Notched(
        4 * h, None, layers, divisions=20 * k, wide=WIDE * h, deep=DEEP * h, notch=2 * k
    )
    path = dea.Trace("voltage", first=0.2, until=("corner_m", -WIDE * h), steps=60, longest=0.5)
    return dea.solve(
        scene(args, mesh, volts(args, 1.0)), path,
        {"corner": dea.AtPoint((0.0, (1 + args.depth - DEEP) * h), "displacement", "y")},
        out=args.out, resume=args.resume, quiet=args.quiet, stability="never",
        settings=parser.settings(args),
    )  # fmt: skip


def main():
    parser, args = parse()
    for name in ("mu", "ratio", "thickness", "depth"):
        if not (np.isfinite(getattr(args, name)) and getattr(args, name) > 0):
            parser.error(f"--{name} is {getattr(args, name)}, but must be a number above 0")
    if not args.to > 1:
        parser.error("--to must be above 1")
    value, k = critical(args.depth, args.ratio)
    kind = "crease" if k is None or value > CREASE**2 else "buckle"
    found = dict.fromkeys((
        "bifurcation_field", "relative_difference", "wavelength_m", "last_amplitude_m",
        "folding_field",
    ))  # fmt: skip
    if kind == "buckle":
        run, onset = buckled(parser, args, value, k)
        found["bifurcation_field"] = onset / volts(args, 1.0)
        found["relative_difference"] = onset / volts(args, value) - 1
        found["wavelength_m"] = 2 * np.pi / k * args.thickness
        found["last_amplitude_m"] = abs(run["crest_m"] - run["trough_m"]) / 2
    else:
        run = folded(parser, args)
        found["folding_field"] = run["voltage_V"] / volts(args, 1.0)
    run.add(kind=kind, neutral_field=float(np.sqrt(value)), neutral_wave_number=k, **found)
    if MPI.COMM_WORLD.rank == 0:
        dea.pictures.deformed(args.out)
        if not args.quiet:
            report(run)


def report(run):
    s = run.summary
    waves = f"k h = {s['neutral_wave_number']:.4g}" if s["neutral_wave_number"] else "short waves"
    print(
        f"\nflat film: neutral at E = {s['neutral_field']:.5f} sqrt(mu/eps), {waves}: {s['kind']}"
    )
    if s["kind"] == "buckle":
        print(f"it buckles at {s['bifurcation_field']:.5f} "
              f"({100 * s['relative_difference']:+.2f} %), "
              f"wavelength {1e3 * s['wavelength_m']:.4g} mm")  # fmt: skip
        print(f"at {s['voltage_V']:.5g} V the waves are {1e6 * s['last_amplitude_m']:.4g} um high")
    else:
        print(f"a notch folds at {s['folding_field']:.4f}")
    print(f"\nresults: {run.out}/history.csv, fields.xdmf")


if __name__ == "__main__":
    main()
