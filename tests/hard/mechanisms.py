"""Mechanisms: rigid parts, springs and weights that are too large or in each other's way."""

from __future__ import annotations

from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from hard.films import run
from hard.table import COMPLETED, MU, REFUSED, RUBBER, case, close

H, RHO, G = 1e-2, 1000.0, 9.81
PLANE = dea.PlaneStrain(H)
CLAMP = dea.Clamp("x_min")
END = dea.Rigid("x_max", turns="")


def strip(*supports, loads=(), density=RHO, cells=2, prescribed=()):
    geometry = BoxStack(cells * H, None, [Layer("film", H)], divisions=(cells,))
    film = dea.Material(RUBBER, density=density)
    return dea.Scene(dea.read_gmsh(geometry, MPI.COMM_SELF), {"film": film}, supports=supports,
                     loads=loads, prescribed=prescribed, kinematics=PLANE)  # fmt: skip


def refused(name, words, *supports, **conditions):
    @case(f"mechanism: {name}", REFUSED, words)
    def ended():
        run(strip(*supports, **conditions), dea.Ramp(steps=1))


PULL = [dea.Force("x_max", (0.1 * MU * H**2, 0.0))]
refused("gravity without density", "needs the density", CLAMP, density=None,
        loads=[dea.Gravity((0.0, -G))])  # fmt: skip
refused("two rigid parts that share an edge", "shares nodes with another rigid part",
        dea.Rigid("x_max", "xy", turns=""), dea.Rigid("top"), loads=PULL)  # fmt: skip
refused("a rigid part that overlaps a clamp", "shares nodes with Clamp", dea.Clamp("bottom"), END,
        loads=PULL)  # fmt: skip
refused("a spring on a surface that does not exist", "no facet group or region", CLAMP, END,
        dea.Spring("x_mx", 1.0, "x"), loads=PULL)  # fmt: skip
refused("a rigid part alone, on a slide", "translation along x", dea.Rigid("x_max", "y", turns=""),
        loads=PULL)  # fmt: skip


@case("mechanism: a spring of zero length", REFUSED, "length 0 at the start")
def zero_spring():
    run(strip(CLAMP, END, dea.Spring("x_max", 1.0, anchor=(2 * H, H / 2)), loads=PULL),
        dea.Ramp(steps=1))  # fmt: skip


@case("mechanism: weight ten times what the film bears as a solid block", COMPLETED)
def heavy():
    """A strip that hangs by one end under rho g L = 10 mu: its support bears its weight."""
    weight = 10 * MU / (2 * H)
    scene = strip(CLAMP, loads=[dea.BodyForce("film", (weight, 0.0))])
    done = run(scene, dea.Ramp(steps=1), {"R": dea.Reaction("x_min", "x")})
    close(done["R_N"], -weight * 2 * H**3, rel=1e-6)
    return f"the support bears {-done['R_N']:.4g} N"


@case("mechanism: a rigid part on one facet", COMPLETED)
def one_facet():
    scene = strip(CLAMP, dea.Rigid("x_max"), loads=[dea.Moment("x_max", 0.01 * MU * H**3)], cells=1)
    done = run(scene, dea.Ramp(steps=1), {"a": dea.PartRotation("x_max")})
    assert done["a_rad"] > 0, "a moment turns it the wrong way"
    return f"turned by {done['a_rad']:.4f} rad"


@case("mechanism: a part of a million times the stiffness of the film on its spring", COMPLETED)
def stiff_spring():
    k = 1e6 * MU * H
    done = run(strip(CLAMP, END, dea.Spring("x_max", k, "x"), loads=PULL), dea.Ramp(steps=1),
               {"u": dea.PartDisplacement("x_max", "x")})  # fmt: skip
    close(done["u_m"], 0.1 * MU * H**2 / k, rel=1e-4)
    return f"moved by {done['u_m']:.3g} m"


@case("mechanism: a torsional spring a million times stiffer than the block", COMPLETED)
def stiff_torsion():
    k, moment = 1e6 * MU * H**3, 0.1 * MU * H**3
    scene = strip(CLAMP, dea.Rigid("x_max"), dea.TorsionSpring("x_max", k),
                  loads=[dea.Moment("x_max", moment)])  # fmt: skip
    done = run(scene, dea.Ramp(steps=1), {"a": dea.PartRotation("x_max")})
    return close(done["a_rad"], moment / k, rel=1e-4, what="angle")


@case("mechanism: a table of forces with a cliff", COMPLETED)
def cliff():
    """The force of the spring rises a hundredfold within a millionth of the strip's length."""
    force = 0.1 * MU * H**2
    law = dea.TableLaw((0.0, 0.01 * H, 0.01 * H + 2e-6 * H, H), (0.0, 0.001 * force, force, force))
    record = {"u": dea.PartDisplacement("x_max", "x"), "R": dea.Reaction("x_min", "x")}
    done = run(strip(CLAMP, END, dea.Spring("x_max", law, "x"), loads=PULL), dea.Ramp(steps=1),
               record)  # fmt: skip
    close(done["R_N"], law(done["u_m"]) - force, rel=1e-6, what="force")
    return close(done["u_m"], 0.01 * H, rel=1e-3, what="displacement")
