"""Wrinkles of a stretched film on a frame: onset, number and wavelength, and how they grow.

A rectangular film, L long and W wide, is stretched by l_x along x and by a smaller l_y along y, and
glued to a frame.  The true tensions are

    T_x = mu (l_x^2 - l_z^2) - eps E^2,    T_y = mu (l_y^2 - l_z^2) - eps E^2,    l_z = 1/(l_x l_y),

with the true field E.  Behind the voltage at which T_y vanishes the film is compressed along y,
while T_x still pulls.  It buckles into wrinkles along x.  Their theory is that of a thin plate with
clamped edges,

    D lap(lap w) = h (T_x w_xx + T_y w_yy),    D = mu l_y^2 h^3/3,    h = l_z H:

about a state with T_y = 0 an incompressible neo-Hookean film at a given charge bends across the
wrinkles like an unstretched plate with the modulus mu l_y^2.  The plate's lowest voltage and its
shape are found by the Ritz method.  For a film that is infinitely wide, and for small D, the
wavelength tends to that of E. Cerda and L. Mahadevan, Phys. Rev. Lett. 90 (2003) 074302,

    sqrt(2 pi L l_x) (D/(h T_x))^(1/4).

The film is traced to its first bifurcation and then along the branch of its wrinkles.  A quarter of
the film is solved, with two planes of symmetry, so wrinkles with a crest or a trough at the centre
are found; the theory looks for the same ones.

    python demos/wrinkles.py
    python demos/wrinkles.py --slenderness 200 --cells 8 32 --to 2
"""

from pathlib import Path

import h5py
import numpy as np
from mpi4py import MPI
from numpy.polynomial import Legendre
from numpy.polynomial.legendre import leggauss
from scipy.linalg import eigh

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.materials import EPSILON_0

TERMS = (8, 24)
"""Number of even polynomials of the Ritz method along x and y."""


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/wrinkles")
    parser.number("--mu", 50e3, "Pa", "shear modulus")
    parser.number("--eps-r", 4.7, "-", "relative permittivity")
    parser.number("--thickness", 0.1e-3, "m", "thickness H before the stretch")
    parser.number("--slenderness", 100.0, "-", "length over thickness before the stretch, L/H")
    parser.number("--aspect", 2.0, "-", "width over length before the stretch, W/L")
    parser.number("--stretch", 1.1, "-", "stretch l_y across the wrinkles")
    parser.number("--more", 1.05, "-", "stretch along the wrinkles over that across, l_x/l_y")
    parser.number("--to", 1.5, "-", "eps E^2 above slackness at the end, over its value at onset")
    parser.add_argument("--cells", type=int, nargs=2, default=[6, 20], metavar=("X", "Y"),
                        help="cells of the quarter along x and y")  # fmt: skip
    return parser, parser.parse_args()


class Film:
    """Lengths in m and stresses in Pa of the stretched film."""

    def __init__(self, args):
        self.lx, self.ly = args.more * args.stretch, args.stretch
        self.lz = 1 / (self.lx * self.ly)
        self.H, self.h = args.thickness, args.thickness * self.lz
        self.L = args.slenderness * args.thickness
        self.W = args.aspect * self.L
        self.mu, self.eps = args.mu, args.eps_r * EPSILON_0
        self.slack = args.mu * (self.ly**2 - self.lz**2)  # eps E^2 where T_y vanishes

    def volts(self, pressure):
        """Voltage at which eps E^2 has a value in Pa."""
        return self.h * np.sqrt(pressure / self.eps)

    def compression(self, volts):
        """-T_y of the flat film in Pa."""
        return self.eps * (volts / self.h) ** 2 - self.slack


def clamped(n, half):
    """Products of n even shapes that are clamped at both ends, and the shapes on [-1, 1].

    The products are those of the shapes, of their slopes and of their curvatures, and of the
    curvatures with the shapes, integrated over a length of twice `half`.
    """
    rim = Legendre([2 / 3, 0, -2 / 3])  # 1 - x^2
    shapes = [rim * rim * Legendre.basis(2 * k) for k in range(n)]
    x, weights = leggauss(2 * n + 6)
    values, slopes, bends = (
        np.array([shape.deriv(order)(x) if order else shape(x) for shape in shapes]) / half**order
        for order in range(3)
    )
    return (
        *((f * weights * half) @ g.T
          for f, g in ((values, values), (slopes, slopes), (bends, bends), (bends, values))),
        shapes,
    )  # fmt: skip


def plate(film):
    """eps E^2 at the onset of wrinkles in Pa, and their shape along y at the middle of x."""
    D = film.mu * film.ly**2 * film.h**3 / 3
    half = film.lx * film.L / 2, film.ly * film.W / 2
    ax, sx, bx, mx, along = clamped(TERMS[0], half[0])
    ay, sy, by, my, across = clamped(TERMS[1], half[1])
    bending = np.kron(bx, ay) + np.kron(ax, by) + np.kron(mx, my.T) + np.kron(mx.T, my)
    slopes = np.kron(sx, ay), np.kron(ax, sy)
    strains = film.mu * (np.array([film.lx, film.ly]) ** 2 - film.lz**2)
    stiffness = D * bending + film.h * (strains[0] * slopes[0] + strains[1] * slopes[1])
    values, vectors = eigh(film.h * (slopes[0] + slopes[1]), stiffness)
    shares = vectors[:, -1].reshape(TERMS)
    middle = np.array([s(0.0) for s in along]) @ shares
    y = np.linspace(0, 1, 400)
    profile = sum(c * s(y) for c, s in zip(middle, across, strict=True))
    return 1 / values[-1], half[1] * y, profile


def measured(y, w):
    """Amplitude, wavelength and number of crests and troughs, from half a profile.

    The profile goes from the centre, where it is symmetric, to the rim.  Extrema lie at the
    vertices of parabolas through three places.  Those below a tenth of the largest one, near the
    rim, are left out.
    """
    y, w = np.concatenate([-y[:0:-1], y]), np.concatenate([w[:0:-1], w])
    at, heights = [], []
    for k in range(1, len(y) - 1):
        a, b, c = np.polyfit(y[k - 1 : k + 2] - y[k], w[k - 1 : k + 2], 2)
        vertex = -b / (2 * a) if a else np.inf
        left, right = (y[k - 1] - y[k]) / 2, (y[k + 1] - y[k]) / 2
        if left <= vertex < right and (w[k] - w[k - 1]) * (w[k + 1] - w[k]) <= 0:
            at.append(y[k] + vertex)
            heights.append(c - b * b / (4 * a))
    at, heights = np.array(at), np.array(heights)
    if len(at) == 0:
        return 0.0, None, 0
    high = abs(heights) > 0.1 * np.max(abs(heights))
    at, heights = at[high], heights[high]
    wavelength = 2 * float(np.mean(np.diff(at))) if len(at) > 1 else None
    return float(heights.max() - heights.min()) / 2, wavelength, len(at)


def scene(args, film, volts):
    """A quarter of the film; the voltage is `volts` at a ramp factor of 1."""
    half = film.L / 2, film.W / 2
    mesh = BoxStack(*half, [Layer("film", film.H)], divisions=tuple(args.cells))
    return dea.Scene(
        dea.device(mesh, MPI.COMM_WORLD),
        {"film": dea.Material(dea.NeoHookean(film.mu), dea.IdealDielectric(args.eps_r))},
        electrodes=[dea.Electrode("top", volts), dea.Ground("bottom")],
        supports=[dea.Fix("x_min", "x"), dea.Fix("y_min", "y")],
        prescribed=[
            dea.Stretch(rim, axis, stretch)
            for rim in ("x_max", "y_max")
            for axis, stretch in zip("xyz", (film.lx, film.ly, film.lz), strict=True)
        ],
    )


def profiles(run, film):
    """Amplitude, wavelength and number of wrinkles at each step.  Collective."""
    found = []
    if MPI.COMM_WORLD.rank == 0:
        with h5py.File(Path(run.out) / "fields.h5") as h5:
            X = h5["grid/points"][:]
            line = (abs(X[:, 0]) < 1e-9 * film.L) & (abs(X[:, 2]) < 1e-9 * film.H)
            line = np.flatnonzero(line)[np.argsort(X[line, 1])]
            for row in run.history:
                moved = h5[f"step_{row['step']:05d}/node/displacement_m"][:][line]
                found.append(measured(X[line, 1] + moved[:, 1], moved[:, 2]))
    return MPI.COMM_WORLD.bcast(found)


def exponent(load, amplitude, onset):
    """Power of the voltage beyond the onset with which the first wrinkles grow."""
    early = (load > onset) & (load < onset + 0.1 * (load[-1] - onset))
    if np.count_nonzero(early) < 2:
        return None
    return float(np.polyfit(np.log(load[early] - onset), np.log(amplitude[early]), 1)[0])


def solved(parser, args, film, onset, end):
    """The run: stretched, brought to slackness, and traced to its end along the wrinkles."""
    slack = film.volts(film.slack) / onset
    trace = dea.Trace("voltage", first=0.4 * (1 - slack), longest=2.0, steps=80, switch=0.02,
                      until=("voltage_V", end))  # fmt: skip
    return dea.solve(
        scene(args, film, onset),
        [dea.Ramp("stretch", steps=2), dea.Ramp("voltage", to=slack, steps=1), trace],
        {"deflection": dea.LargestDisplacement("bottom", "z")},
        out=args.out, resume=args.resume, quiet=args.quiet, stability="every",
        settings=parser.settings(args),
    )  # fmt: skip


def main():
    parser, args = parse()
    if not (args.more > 1 and args.stretch > 1 and args.to > 1 and min(args.cells) > 0):
        parser.error("--more, --stretch and --to must be above 1, and --cells above 0")
    film = Film(args)
    pressure, y, shape = plate(film)
    theory = film.volts(pressure)
    end = film.volts(film.slack + args.to * (pressure - film.slack))
    run = solved(parser, args, film, theory, end)
    events = [k for k, row in enumerate(run.history) if row["event"] == "bifurcation"]
    if not events:
        raise dea.InputError(f"No wrinkles up to {end:.6g} V: take a larger --to.")
    first = events[0] + 1
    found = profiles(run, film)[first:]
    amplitude, wavelength, number = (np.array(f) for f in zip(*found, strict=True))
    volts = run.column("voltage_V")
    onset = float(volts[first - 1])
    _, plate_wavelength, plate_number = measured(y, shape)
    run.add(
        onset_voltage_V=onset,
        theory_onset_voltage_V=float(theory),
        slack_voltage_V=float(film.volts(film.slack)),
        onset_compression_Pa=float(film.compression(onset)),
        theory_onset_compression_Pa=float(film.compression(theory)),
        number=int(number[0]),
        theory_number=plate_number,
        wavelength_m=float(wavelength[0]),
        theory_wavelength_m=plate_wavelength,
        growth_exponent=exponent(volts[first:], amplitude, onset),
        last_voltage_V=float(volts[-1]),
        last_amplitude_m=float(amplitude[-1]),
        last_wavelength_m=float(wavelength[-1]),
        last_number=int(number[-1]),
    )
    if MPI.COMM_WORLD.rank == 0:
        picture = draw(run, volts[first:], amplitude, wavelength, onset)
        if not args.quiet:
            report(run, picture)


def draw(run, volts, amplitude, wavelength, onset):
    """Amplitude and wavelength over the voltage."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (above, below) = plt.subplots(
        2, 1, figsize=(4.2, 4.2), sharex=True, layout="constrained"
    )
    above.plot(np.append(onset, volts), 1e6 * np.append(0, amplitude), "o-", markersize=3)
    above.set(ylabel="amplitude (um)")
    below.plot(volts, 1e3 * wavelength, "o-", markersize=3, label="film")
    below.axhline(
        1e3 * run.summary["theory_wavelength_m"], ls="--", color="k", label="plate at its onset"
    )
    below.set(xlabel="voltage (V)", ylabel="wavelength (mm)")
    below.legend()
    path = Path(run.out) / "amplitude_wavelength.png"
    figure.savefig(path, dpi=200)
    plt.close(figure)
    return path


def report(run, picture):
    s = run.summary
    print("\n                         film       plate")
    print(f"onset               {s['onset_voltage_V']:9.3f}   {s['theory_onset_voltage_V']:9.3f} V")
    print(f"compression there   {s['onset_compression_Pa']:9.2f}   "
          f"{s['theory_onset_compression_Pa']:9.2f} Pa")  # fmt: skip
    print(f"wavelength          {1e3 * s['wavelength_m']:9.4f}   "
          f"{1e3 * s['theory_wavelength_m']:9.4f} mm")  # fmt: skip
    print(f"crests and troughs  {s['number']:9d}   {s['theory_number']:9d}")
    if s["growth_exponent"]:
        print(f"the first wrinkles grow with the power {s['growth_exponent']:.3f} of the voltage")
    print(f"at {s['last_voltage_V']:.6g} V: amplitude {1e6 * s['last_amplitude_m']:.4g} um, "
          f"wavelength {1e3 * s['last_wavelength_m']:.4g} mm")  # fmt: skip
    print(f"\nresults: {picture}, {run.out}/history.csv, fields.xdmf, modes/")


if __name__ == "__main__":
    main()
