"""A film that swells into a blister: buckling of a viscous film under a rising voltage.

A square film of VHB 4910, 150 x 150 x 0.612 mm, is clamped at its edges.  Its bottom is grounded;
the electrode on its top is a square of 90 mm, so that its edges lie 45 mm from the middle.  The
nominal field e = V/H sqrt(eps/G) rises at a constant rate.  The field makes the driven part larger,
the clamped rim does not let it grow, and the film buckles.  It is then followed until the march
ends.  A quarter of the film is solved, with planes of symmetry.

A flat film that is not stretched beforehand has no tension to lose, so that it buckles where a
plate does.  Its imperfection is an offset of its middle plane, that of the middle times
cos^2(pi x/(2 L)) cos^2(pi y/(2 L)) with L = 75 mm; --imperfection is the former over the thickness.
The fringe at the edge of the one-sided electrode bends the film as well.  Two fields are known from
plate theory (`Plate`): that at which the relaxed film buckles, and that at which the film buckles
at once.  Between the two an imperfect film creeps into its buckle, the later, the faster the
voltage rises and the smaller the imperfection is.  Plate theory tells this course too, as long as
the deflection is small.  So the onset does not converge to one number as the imperfection vanishes,
unless the rate does so too: what converges is its distance from plate theory.

The onset is the moment at which the middle has been moved by a tenth of the thickness.

Without inertia (--density 0) the march ends where its equilibrium is lost.  That may be a mere
snap: two dents jump into the slope of the blister.  Where they do so depends on the mesh.  With
inertia (--density 1000) the film vibrates after such a snap and goes on, and the march ends in a
collapse: beside the edge of the electrode the film becomes ever thinner.  A film that nothing
holds, whose pull-in is exact, collapses at nearly the same field, `free_film_pull_in_field`.
Inertia delays the onset as well if the voltage rises fast: the lowest frequency of the flat film is
0.36 Hz when it is relaxed, and 0.80 Hz at once.

    python demos/blister.py --rate 1e-2
    python demos/blister.py --rate 1e-3 --mesh fine
    python demos/blister.py --rate 1e-1 --density 1000 --mesh coarse
"""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from scipy.linalg import eigh

import dea_fenicsx as dea
from dea_fenicsx.exact import Film as FreeFilm
from dea_fenicsx.exact import march
from dea_fenicsx.geometry import BoxStack, Layer, graded
from dea_fenicsx.materials import EPSILON_0

G, LIMIT = 15.36e3, 5.99
BRANCHES = ((26.06e3, 0.6074), (26.53e3, 6.56), (10.83e3, 61.25))
"""Shear modulus in Pa and relaxation time in s of each branch (Wang et al., JMPS 95 (2016) 213)."""


def vhb(G=G, density=None):
    """The material; its branches go with G."""
    return dea.Material(
        dea.ArrudaBoyce(G, LIMIT, form="pade"), dea.IdealDielectric(4.8), density=density,
        viscous=[dea.Maxwell(G / 15.36e3 * mu, tau) for mu, tau in BRANCHES],
    )  # fmt: skip


VHB = vhb()
SMALL = VHB.elastic.shear_modulus() / G
"""Modulus of the equilibrium network at small strain, over G."""

HALF, EDGE, THICKNESS = 75e-3, 45e-3, 0.612e-3
"""Half of the side of the film, and of the electrode, and the thickness, in m."""

MOVED = 0.1
"""Deflection of the middle at the onset, over the thickness."""

EARLY = 0.08
"""Nominal field up to which the march is a precise one: the film buckles before."""

MOVED_WRONGLY = 1e-4
"""Error of a step in the displacement with inertia, over the largest extent of the film."""

MESHES = {"coarse": (4, 2, 1.5, 1), "medium": (8, 5, 3.0, 1), "fine": (12, 7, 6.0, 2)}
"""Cells from the middle to the electrode's edge, from there to the rim, grading towards that edge,
and cells through the thickness."""


@dataclass(frozen=True)
class Film(BoxStack):
    """A quarter of the film, with cells graded towards the electrode's edge.

    Parameters (besides those of a `BoxStack`)
    ----------
    inner
        Number of cells from the middle to the electrode's edge.
    ratio
        Largest over smallest cell of either part.
    offset
        Of the middle plane, in m.

    Notes
    -----
    The facet group "top" is divided into "electrode" and "bare".
    """

    inner: int = 1
    ratio: float = 1.0
    offset: float = 0.0

    def mesh(self):
        mesh, n = super().mesh(), self.divisions[0]
        outer = EDGE + (HALF - EDGE) * graded(n - self.inner, self.ratio, "start")
        ends = np.concatenate([EDGE * graded(self.inner, self.ratio, "end"), outer[1:]])
        plane = np.interp(mesh.points[:, :2], np.linspace(0, HALF, n + 1), ends)
        mesh.points[:, :2] = plane
        mesh.points[:, 2] += self.offset * np.prod(np.cos(np.pi * plane / (2 * HALF)) ** 2, axis=1)
        top = mesh.facets.pop("top")
        inside = np.all(mesh.points[top][..., :2].max(axis=(1, 2)) < EDGE * (1 + 1e-9), axis=-1)
        mesh.facets |= {"electrode": top[inside], "bare": top[~inside]}
        return mesh


class Plate:
    """The clamped plate with the Maxwell stress of a square electrode, by Ritz's method.

    The stresses in the plane, s = 2 mu (strain + its trace times 1) - eps E^2 in the driven part,
    follow from their balance.  They do not depend on mu, and rise with e^2 in viscous films too.
    With them each mode of buckling m has a field e_m at which a plate with the modulus mu buckles,
    e_m^2 = Lambda_m (H/L)^2 mu/(3 G), and the deflection q_m of an imperfect viscous plate obeys

        mu (q_m - a_m) + sum_k G_k (q_m - a_m - v_k) + 3 rho (L^2/H)^2 sum_n M_mn q_n''
            = mu (e/e_m)^2 q_m,
        dv_k/dt = (q_m - a_m - v_k)/tau_k

    with the share a_m of the mode in the imperfection and the density rho, which is 0 without
    inertia.  M_mn is the integral of the product of two modes; lengths are over L.

    Parameters
    ----------
    share
        Side of the electrode over that of the film.
    waves, terms
        Numbers of shapes along each axis, of the deflection and of the motion in the plane.
    points
        Points of Gauss's rule in the electrode and beyond it, along each axis.

    Attributes
    ----------
    fields
        e_m of the relaxed film.
    share, middle
        Of each mode in the imperfection, and the deflection of the middle in it.
    mass
        M_mn.
    """

    def __init__(self, share=EDGE / HALF, waves=8, terms=16, points=40):
        x, w = np.polynomial.legendre.leggauss(points)
        x, w = (x + 1) / 2, w / 2
        x = np.concatenate([share * x, share + (1 - share) * x])[:, None]
        self.x, self.w = x, np.concatenate([share * w, (1 - share) * w])
        self.live = (x[:, 0] < share).astype(float)
        a, b = (np.arange(waves) + k for k in (0, 1))
        angles = [np.pi * n * x for n in (a, b)]
        # clamped at x = 1, even in x
        self.shape = sum(np.cos(t) for t in angles)
        self.slope = sum(-np.pi * n * np.sin(t) for n, t in zip((a, b), angles, strict=True))
        bend = sum(-((np.pi * n) ** 2) * np.cos(t) for n, t in zip((a, b), angles, strict=True))
        P, P2 = self.shape, bend
        stiff = sum(
            np.kron(self._over(f, k), self._over(g, m))
            for f, g, k, m in ((P2, P, P2, P), (P, P2, P, P2), (P2, P, P, P2), (P, P2, P2, P))
        )
        growth, modes = eigh(self._softening(*self._stresses(terms)), stiff)
        first = growth > 0
        growth, modes = growth[first][::-1], modes[:, first][:, ::-1]
        self.fields = THICKNESS / HALF * np.sqrt(SMALL / (3 * growth))
        # cos^2(pi x/2) is half of the first shape
        imperfection = np.zeros(waves**2)
        imperfection[0] = 1 / 4
        at_middle = np.full(waves**2, 4.0)
        self.share, self.middle = modes.T @ stiff @ imperfection, modes.T @ at_middle
        self.mass = modes.T @ np.kron(self._over(P, P), self._over(P, P)) @ modes

    def _over(self, f, g):
        """Integrals of products over half of the side."""
        return (f * self.w[:, None]).T @ g

    def _stresses(self, terms):
        """xx, yy and xy of the stress in units of eps E^2 at the points."""
        x, i = self.x, np.arange(1, terms + 1)
        k, m = np.pi * i, np.pi * (i - 0.5)
        S, dS, C, dC = np.sin(k * x), k * np.cos(k * x), np.cos(m * x), -m * np.sin(m * x)
        over = self._over
        # u = S_i(x) C_j(y), v = C_i(x) S_j(y); energy mu [strain : strain + trace^2]
        uu = 4 * np.kron(over(dS, dS), over(C, C)) + np.kron(over(S, S), over(dC, dC))
        uv = 2 * np.kron(over(dS, C), over(C, dS)) + np.kron(over(S, dC), over(dC, S))
        vv = 4 * np.kron(over(C, C), over(dS, dS)) + np.kron(over(dC, dC), over(S, S))
        wide, high = (self.live * self.w) @ dS, (self.live * self.w) @ C
        load = np.concatenate([np.kron(wide, high), np.kron(high, wide)])
        u, v = np.linalg.solve(np.block([[uu, uv], [uv.T, vv]]), load).reshape(2, terms, terms)
        u_x, u_y, v_x, v_y = dS @ u @ C.T, S @ u @ dC.T, dC @ v @ S.T, C @ v @ dS.T
        maxwell = np.outer(self.live, self.live)
        return 2 * (2 * u_x + v_y) - maxwell, 2 * (2 * v_y + u_x) - maxwell, u_y + v_x

    def _softening(self, xx, yy, xy):
        """What compressive stresses take from the stiffness."""
        P, d, n = self.shape, self.slope, self.shape.shape[1] ** 2
        total = 0
        for stress, f, g, k, m in ((xx, d, P, d, P), (yy, P, d, P, d), (xy, d, P, P, d),
                                   (xy, P, d, d, P)):  # fmt: skip
            weighted = stress * np.outer(self.w, self.w)
            total = total - np.einsum("xy,xi,yj,xk,yl->ijkl", weighted, f, g, k, m, optimize=True)
        return total.reshape(n, n)

    def onset(self, rate, imperfection, density=0.0, steps=4000):
        """Field at which an imperfect film has moved by `MOVED` without a fringe."""
        beyond = 2.0 if density else 1 - 1e-6  # a film with mass outlives its buckling load
        top = self.fields[0] * np.sqrt(1 + sum(mu for mu, _ in BRANCHES) / (SMALL * G))
        fields = np.linspace(0, top * beyond, steps + 1)
        dt = fields[1] / rate
        g, tau = np.array(BRANCHES).T[:, :, None] / np.array([SMALL * G, 1.0])[:, None, None]
        decay = np.exp(-dt / tau)
        ramp = (1 - decay) * tau / dt  # exact for deflections that are linear over a step
        inert = 3 * density * HALF**4 / (SMALL * G * THICKNESS**2) * self.mass
        v, before = np.zeros((len(BRANCHES), len(self.fields))), np.zeros(len(self.fields))
        speed, push = np.zeros((2, len(self.fields)))  # first and second derivative by time
        found = [0.0]
        for e in fields[1:]:
            old = decay * v + (ramp - decay) * before
            load = (e / self.fields) ** 2
            stiff = np.diag(1 + (g * ramp).sum(0) - load) + 4 / dt**2 * inert
            past = 4 / dt**2 * before + 4 / dt * speed + push  # trapezoidal rule
            pushed = load * self.share + (g * old).sum(0) + inert @ past
            moved = np.linalg.solve(stiff, pushed)
            push, speed = 4 / dt**2 * moved - past, 2 / dt * (moved - before) - speed
            v, before = old + (1 - ramp) * moved, moved
            found.append(abs(imperfection) * float(self.middle @ moved))
            if found[-1] > MOVED:
                return float(np.interp(MOVED, found, fields[: len(found)]))
        return float(fields[-1])


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/blister")
    parser.number("--rate", 1e-2, "1/s", "rate of the nominal field, in units of sqrt(G/eps)")
    parser.number("--to", 1.5, "-", "nominal field at which the march ends at the latest")
    parser.number("--imperfection", 0.02, "-", "offset of the middle plane, over the thickness")
    parser.count("--early-steps", 100, f"equal steps up to a field of {EARLY}")
    parser.number("--mu", G, "Pa", "equilibrium shear modulus G; the branches go with it")
    parser.number("--tolerance", 1e-4, "-", "of the march beyond")
    parser.number("--density", 0.0, "kg/m^3", "of the film, for inertia; 0 for none")
    parser.add_argument("--mesh", choices=MESHES, default="medium", help="coarse, medium or fine")
    return parser, parser.parse_args()


def film(mesh, imperfection):
    """The geometry; the imperfection is over the thickness."""
    inner, outer, ratio, through = MESHES[mesh]
    return Film(HALF, HALF, [Layer("film", THICKNESS, through)], inner + outer,
                inner=inner, ratio=ratio, offset=imperfection * THICKNESS)  # fmt: skip


def scene(args):
    """The film; at a ramp factor of 1 the nominal field is sqrt(G/eps)."""
    unit = THICKNESS * float(np.sqrt(args.mu / (4.8 * EPSILON_0)))
    return dea.Scene(
        dea.device(film(args.mesh, args.imperfection), MPI.COMM_WORLD),
        {"film": vhb(args.mu, args.density or None)},
        electrodes=[dea.Electrode("electrode", unit), dea.Ground("bottom")],
        supports=[dea.Clamp("x_max"), dea.Clamp("y_max"),
                  dea.Fix("x_min", "x"), dea.Fix("y_min", "y")],
    )  # fmt: skip


def main():
    parser, args = parse()
    for name in ("rate", "to"):
        if not (np.isfinite(getattr(args, name)) and getattr(args, name) > 0):
            raise dea.InputError(f"--{name} is {getattr(args, name)}, but must be a number > 0.")
    if not abs(args.imperfection) <= 1:
        raise dea.InputError(
            f"--imperfection is {args.imperfection}, but must lie between -1 and 1 thickness."
        )
    run, end = followed(parser, args, path(args))
    run.add(**findings(args, run, end))
    if MPI.COMM_WORLD.rank == 0:
        draw(args, run)
        if not args.quiet:
            report(args, run)


def path(args):
    """Equal steps up to `EARLY`, then steps of a stated error."""
    inertia = dea.Inertia(0.0, MOVED_WRONGLY) if args.density else False
    early = min(EARLY, args.to)
    path = [dea.March(early / args.rate, {"voltage": dea.Rise(early, early / args.rate)},
                      steps=args.early_steps, inertia=inertia)]  # fmt: skip
    if args.to > early:
        seconds = (args.to - early) / args.rate
        drive = dea.Rise(args.to, seconds, low=early)
        path.append(dea.March(seconds, {"voltage": drive}, None, args.tolerance, inertia=inertia))
    return path


def followed(parser, args, path):
    """The run, and how the march ended."""
    z = args.imperfection * THICKNESS  # of the bottom's middle
    try:
        run = dea.solve(
            scene(args),
            path,
            record={"middle": dea.AtPoint((0.0, 0.0, z), "displacement", "z"),
                    "highest": dea.LargestDisplacement("bottom", "z")},
            out=args.out,
            resume=args.resume,
            quiet=args.quiet,
            stability="never",
            settings=parser.settings(args),
        )  # fmt: skip
    except (dea.EquilibriumLost, dea.SolverError) as error:
        if getattr(error, "run", None) is None:
            raise
        return error.run, str(error)
    return run, f"came to the field {args.to:g}"


def findings(args, run, end):
    """What the run found, and what plate theory says of the onset."""
    middle, seconds = run.column("middle_m") / THICKNESS, run.column("time_s")
    field = args.rate * seconds
    moved = np.abs(middle)
    onset = None
    if moved.max() > MOVED:
        k = int(np.argmax(moved > MOVED))
        share = np.log(MOVED / moved[k - 1]) / np.log(moved[k] / moved[k - 1])
        onset = float(field[k - 1] + share * (field[k] - field[k - 1]))
    plate = Plate()
    stiffer = np.sqrt(1 + sum(mu for mu, _ in BRANCHES) / (SMALL * G))
    return {
        "rate_per_s": args.rate,
        "onset_field": onset,
        "onset_time_s": onset and onset / args.rate,
        "plate_onset_field": plate.onset(args.rate, args.imperfection, args.density),
        "plate_buckling_field_relaxed": float(plate.fields[0]),
        "plate_buckling_field_instantaneous": float(plate.fields[0] * stiffer),
        "free_film_pull_in_field": free_film(args.rate),
        "last_field": float(field[-1]),
        "last_true_field_over_nominal": run["max_field_V_per_m"] * THICKNESS / run["voltage_V"],
        "last_deflection_over_thickness": float(middle[-1]),
        "end": end,
        "seconds": run.summary["wall_s"],
    }


def free_film(rate):
    """Field at which a film of any modulus that nothing holds pulls in under this rate."""
    film = FreeFilm(VHB, THICKNESS)
    unit = THICKNESS * float(np.sqrt(G / film.permittivity))
    course = march(film, 2 / rate, voltage=dea.Rise(2 * unit, 2 / rate))
    return course.pull_in.voltage / unit


def draw(args, run):
    """The deflection of the middle over the field, early and up to the end."""
    from matplotlib.figure import Figure

    field = args.rate * run.column("time_s")
    middle = np.abs(run.column("middle_m")) / THICKNESS
    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    early, whole = figure.subplots(1, 2)
    some = middle > 0
    early.semilogy(field[some], middle[some], ".-", markersize=4)
    early.axhline(MOVED, color="gray", linewidth=0.8)
    for key, color in (("relaxed", "tab:green"), ("instantaneous", "tab:red")):
        early.axvline(run.summary[f"plate_buckling_field_{key}"], color=color, linestyle="--",
                      label=f"flat plate, {key}")  # fmt: skip
    early.set_xlim(0, EARLY)
    early.set_ylim(1e-4, max(20 * MOVED, 1.5 * middle[field <= EARLY].max()))
    early.legend()
    whole.plot(field, middle, ".-", markersize=4)
    for axes in (early, whole):
        axes.set_xlabel("nominal field over sqrt(G/eps)")
        axes.set_ylabel("deflection of the middle over the thickness")
    figure.savefig(f"{args.out}/deflection_field.png", dpi=150)


def report(args, run):
    s = run.summary
    print(f"\na flat plate buckles at the field {s['plate_buckling_field_relaxed']:.5f} when it is "
          f"relaxed, at {s['plate_buckling_field_instantaneous']:.5f} at once")  # fmt: skip
    if s["onset_field"] is not None:
        print(f"at {args.rate:g} /s this film buckles at {s['onset_field']:.5f}, after "
              f"{s['onset_time_s']:.4g} s; plate theory {s['plate_onset_field']:.5f}")  # fmt: skip
    print(
        f"last field {s['last_field']:.5f}, deflection {s['last_deflection_over_thickness']:.4g} "
        f"thicknesses, {s['steps']} steps, {s['unknowns']} unknowns, {s['seconds']:.0f} s"
    )
    print(
        f"largest true field {s['last_true_field_over_nominal']:.4g} times the nominal one; "
        f"a free film pulls in at {s['free_film_pull_in_field']:.5f}"
    )
    print(f"end: {s['end']}\n\nresults: {run.out}/history.csv, deflection_field.png, fields.xdmf")


if __name__ == "__main__":
    main()
