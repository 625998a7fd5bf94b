"""Bender with interdigitated electrodes on both faces: it bends to the side that is driven.

Fingers of two electrodes take turns along each face of a plate.  A voltage between them makes a
field along the plate below this face, which shortens there, and the plate bends to this side.  With
the voltage on the other face it bends to the other side by the same amount.  With both faces driven
it stays straight and grows thicker.

Beside the capacitance of the fingers stands that of Igreja and Dias (2004) for fingers on a half
space of the same permittivity, by complete elliptic integrals.  The field outside the plate is left
out here and there.

    python demos/bimorph.py
    python demos/bimorph.py --fingers 12 --voltage 6000
"""

import math

from mpi4py import MPI
from scipy.special import ellipk, ellipkm1

import dea_fenicsx as dea
from dea_fenicsx.geometry import FingerStack, Layer
from dea_fenicsx.materials import EPSILON_0


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/bimorph")
    parser.number("--mu", 100e3, "Pa", "shear modulus")
    parser.number("--permittivity", 3.0, "-", "relative permittivity")
    parser.number("--thickness", 0.5e-3, "m", "thickness of the plate")
    parser.number("--width", 5e-3, "m", "width of the plate, along the fingers")
    parser.count("--fingers", 24, "fingers on each face")
    parser.number("--finger", 0.25e-3, "m", "width of a finger")
    parser.number("--gap", 0.25e-3, "m", "gap between two fingers")
    parser.number("--voltage", 4e3, "V", "voltage between the fingers; voltage_V is half of it")
    parser.count("--steps", 2, "steps of the voltage")
    parser.count("--mesh", 1, "refinement of the mesh")
    return parser, parser.parse_args()


def scene(args, driven):
    """The plate, clamped at its left end, with the voltage on some of its faces."""
    layer = Layer("plate", args.thickness, 6, grading=4.0)
    shape = FingerStack(
        [layer], args.fingers, args.finger, args.gap, args.gap, both=True, divisions=(2, 2, 2, 1)
    )
    film = dea.Material(dea.NeoHookean(args.mu), dea.IdealDielectric(args.permittivity))
    electrodes = []
    for face in ("top", "bottom"):
        if face in driven:  # half above and half below the other face's potential
            electrodes += [dea.Electrode(f"{face}_a", args.voltage / 2),
                           dea.Electrode(f"{face}_b", -args.voltage / 2)]  # fmt: skip
        else:
            electrodes += [dea.Ground(f"{face}_a"), dea.Ground(f"{face}_b")]
    return dea.Scene(
        dea.device(shape.refine(args.mesh), MPI.COMM_WORLD), {"plate": film},
        electrodes=electrodes, supports=[dea.Clamp("x_min")],
        kinematics=dea.PlaneStrain(args.width),
    )  # fmt: skip


def on_half_space(args):
    """Capacitance in F of one face's fingers on a half space (Igreja and Dias 2004)."""
    eps = args.permittivity * EPSILON_0 * args.width
    share = args.finger / (args.finger + args.gap)
    inner = _ratio(math.sin(math.pi * share / 2))
    outer = _ratio(2 * share**0.5 / (1 + share))
    c_inner, c_outer = eps * inner, eps * outer
    return (args.fingers - 3) * c_inner / 2 + 2 * c_inner * c_outer / (c_inner + c_outer)


def _ratio(k):
    """K(k)/K(sqrt(1 - k^2)) of complete elliptic integrals of the first kind."""
    return float(ellipk(k**2) / ellipkm1(k**2))


def main():
    parser, args = parse()
    path = dea.Ramp("voltage", steps=args.steps)
    tip = dea.MeanDisplacement("x_max", "y")
    run = dea.solve(
        scene(args, ("top",)), path, {"tip": tip, "of_fingers": dea.Capacitance("top_a")},
        out=args.out, resume=args.resume, quiet=args.quiet, settings=parser.settings(args),
    )  # fmt: skip
    down = dea.solve(scene(args, ("bottom",)), path, {"tip": tip}, quiet=True)
    both = dea.solve(scene(args, ("top", "bottom")), path, {"tip": tip}, quiet=True)
    known = on_half_space(args)
    run.add(
        tip_of_lower_face_m=down["tip_m"], tip_of_both_faces_m=both["tip_m"],
        capacitance_at_rest_F=run.column("of_fingers_F")[0] / 2, half_space_capacitance_F=known,
    )  # fmt: skip
    if MPI.COMM_WORLD.rank == 0:
        say = (lambda text: None) if args.quiet else print
        s = run.summary
        say(f"tip with the upper face driven {1e6 * s['tip_m']:.2f} um, with the lower one "
            f"{1e6 * down['tip_m']:.2f} um, with both {1e6 * abs(both['tip_m']):.2f} um")
        say(f"capacitance of a face {1e12 * s['capacitance_at_rest_F']:.4f} pF, on a half space "
            f"{1e12 * known:.4f} pF")  # fmt: skip
        dea.pictures.curve(run.out, "voltage_V", "tip_m")
        # Displacements are enlarged by a power of ten, so that the plate is seen to bend.
        length = args.fingers * (args.finger + args.gap) + args.gap
        enlarged = 10.0 ** math.floor(math.log10(0.3 * length / max(abs(s["tip_m"]), 1e-12)))
        dea.pictures.deformed(run.out, warp=enlarged, say=say)


if __name__ == "__main__":
    main()
