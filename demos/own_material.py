"""Tutorial: a material of your own.

A material is an energy and a few facts about it.  The package derives the stress and the tangent
from the energy.  Here the energy is the I1 model of Lopez-Pamies (C. R. Mecanique 338 (2010) 3),
with one term:

    W = 3^(1 - a)/(2 a) mu (I1^a - 3^a)

W is the energy per undeformed volume, I1 the sum of the squared principal stretches, mu the shear
modulus, and a an exponent.  For a = 1 this is neo-Hookean rubber, and for a > 1 the rubber stiffens
at large stretch.  The method `energy` uses arithmetic alone.  So finite elements can call it with
symbols, and exact states can call the same method with numbers.

Run it with `mpirun -n 2 python demos/own_material.py`.
"""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.exact import Film, trace
from dea_fenicsx.geometry import BoxStack, Layer


@dataclass(frozen=True)
class LopezPamies:
    """W = 3^(1 - a)/(2 a) mu (I1^a - 3^a).  mu is in Pa, and a has no unit."""

    mu: float
    a: float

    def energy(self, strain):
        """W in Pa.  `strain` offers I1, I2, ln(x) and power_sum(alpha)."""
        return 3 ** (1 - self.a) / (2 * self.a) * self.mu * (strain.I1**self.a - 3**self.a)

    def shear_modulus(self):
        """The shear modulus at small strain in Pa, which is the scale of all stresses."""
        return self.mu

    def spherical_slope(self):
        """The slope dW/dstretch of the undeformed rubber in Pa: here 2 dW/dI1 at I1 = 3."""
        return self.mu

    def chain_margin(self, strain):
        """None, because the energy exists at every stretch.  (That of Gent's rubber does not.)"""
        return None

    def faults(self):
        """What is wrong with the constants.  The message of the error is made of these texts."""
        bad = [name for name in ("mu", "a") if not getattr(self, name) > 0]
        return [f"{name} is {getattr(self, name)!r}, but must be > 0" for name in bad]


def parse():
    parser = dea.Parser(__doc__.split("\n")[0], out="results/own_material")
    parser.number("--mu", 50e3, "Pa", "shear modulus")
    parser.number("--a", 1.4, "-", "exponent; 1 is neo-Hookean")
    return parser, parser.parse_args()


def main():
    parser, args = parse()
    comm = MPI.COMM_WORLD
    T = 0.5e-3
    rubber = dea.Material(LopezPamies(args.mu, args.a), dea.IdealDielectric(eps_r=2.8))

    # The whole voltage-stretch curve without a mesh.  At a = 1 it must be the neo-Hookean one.
    curve = trace(Film(rubber, T))
    same = [
        trace(Film(dea.Material(model, rubber.electric), T)).event("pull-in").voltage
        for model in (LopezPamies(args.mu, 1.0), dea.NeoHookean(args.mu))
    ]
    peak = curve.event("pull-in")

    # Finite elements with the same class, to 95 % of pull-in.
    scene = dea.Scene(
        dea.device(BoxStack(T, None, [Layer("film", T)], divisions=1), comm),
        materials={"film": rubber},
        electrodes=[dea.Electrode("top", 0.95 * peak.voltage), dea.Ground("bottom")],
        supports=[dea.Fix("bottom", "z"), dea.Fix("x_min", "r")],
        kinematics=dea.Axisymmetric(),
    )
    run = dea.solve(
        scene,
        dea.Ramp("voltage", steps=5),
        record={"thickness_stretch": dea.MeanStretch(("bottom", "top"), "z")},
        out=args.out,
        resume=args.resume,
        quiet=args.quiet,
        settings=parser.settings(args),
    )
    exact = [curve.states_at(V)[0][0].stretches[2] for V in run.column("voltage_V")[1:]]
    error = float(np.max(np.abs(run.column("thickness_stretch")[1:] / exact - 1)))
    run.add(
        max_relative_error=error,
        pull_in_voltage_V=peak.voltage,
        pull_in_voltage_at_a_1_V=same[0],
        pull_in_voltage_neo_hookean_V=same[1],
    )
    if comm.rank == 0:
        drawn = np.linspace(0, peak.voltage, 200)
        thin = [curve.states_at(V)[0][0].stretches[2] for V in drawn[:-1]] + [peak.stretches[2]]
        dea.pictures.curve(run.out, x="voltage_V", y="thickness_stretch",
                           lines={"exact, to pull-in": (drawn, thin)})  # fmt: skip
    if comm.rank == 0 and not args.quiet:
        print(f"\nlargest relative difference from the exact thickness: {error:.1e}")
        print(f"pull-in: {peak.voltage:.3f} V with a = {args.a:g}, {same[0]:.6f} V with a = 1, "
              f"{same[1]:.6f} V neo-Hookean")  # fmt: skip
        print(f"results: {run.out}/history.csv")


if __name__ == "__main__":
    main()
