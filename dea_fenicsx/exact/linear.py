"""Small strains of layers and stacks: closed forms to check finite elements and large designs by.

The strains of stacks follow from Betti's theorem for a free body of one modulus E: the mean strain
under a pressure p on electrode faces needs the stresses of simple tension or bending only.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dea_fenicsx.support.errors import InputError


def bonded_modulus(mu: float, outer: Any, inner: Any, thickness: Any, faces: int = 2) -> Any:
    """Apparent modulus in Pa of an incompressible ring between flat rigid plates.

    4 mu (1 + S^2), S = w/(2 t): a long strip of width w = outer - inner (Gent and Lindley, Proc.
    Inst. Mech. Eng. 173 (1959) 111), the ring taken as straight.  With ``faces=1`` the ring is
    bonded to one plate and slides on the other, which is half of a ring of twice the thickness.

    Against finite elements (small strain) it is within 3 % for S >= 1 where r_i >= 2 r_o/5, 6 % low
    at r_i = r_o/5, and up to 7 % low around S = 1/4.  It needs plates that stay flat.  A uniform
    pressure on a soft face instead moves the rubber at the edges only, so this is no formula for
    soft electrodes on a rigid base.

    Parameters
    ----------
    mu
        Shear modulus in Pa.
    outer, inner, thickness
        In m.
    faces
        Faces that are bonded: 1 or 2.
    """
    t = _doubled(thickness, faces)
    return 4 * mu * (1 + ((np.asarray(outer) - inner) / (2 * t)) ** 2)


def bonded_ring_modulus(mu: float, outer: Any, inner: Any, thickness: Any, faces: int = 2) -> Any:
    """The same with the curvature of the ring kept in the pressure, and for a full disk.

    The pressure obeys p'' + p'/r = -12 mu e/t^2, zero at both edges.  Its mean over the ring is
    3 mu e/(2 t^2) [r_o^2 + r_i^2 - (r_o^2 - r_i^2)/ln(r_o/r_i)]; the part without pressure gradient
    adds 4 mu e for a ring and 3 mu e for a disk (inner = 0).  Within 2.6 % for S >= 1 where
    r_i >= r_o/5; 16 % low at a hole of r_o/50.
    """
    t = _doubled(thickness, faces)
    a, b = np.broadcast_arrays(np.asarray(outer, float), np.asarray(inner, float))
    with np.errstate(divide="ignore"):
        squares = a**2 + b**2 - np.where(b > 0, (a**2 - b**2) / np.log(a / b), 0.0)
    return mu * (np.where(b > 0, 4.0, 3.0) + 1.5 * squares / t**2)


def _doubled(thickness: Any, faces: int) -> Any:
    if faces not in (1, 2):
        raise InputError(f"The ring has {faces!r} bonded faces, but must have 1 or 2.")
    return np.asarray(thickness, dtype=float) * (2 if faces == 1 else 1)


def stack_share(
    outer: Any, inner: Any, inset: Any, elastomer: Any, electrode: Any, turns: Any = None
) -> Any:
    """Mean axial strain of a helix or stack of one modulus, over -p/E.

    (A_el/A) (t_el/(t_el + t_e)), A_el and A the areas of electrode and ring; 0.800 for the thesis's
    7/2/0.3/0.5/0.05 mm.  Up to the lead angle squared.

    Parameters
    ----------
    outer, inner, inset, elastomer, electrode
        Lengths in m.
    turns
        With a number of turns, the open ends are counted: 2 turns - 1 of 2 turns layers are
        driven.
    """
    areas = ((outer - inset) ** 2 - (inner + inset) ** 2) / (outer**2 - inner**2)
    share = areas * elastomer / (elastomer + electrode)
    return share if turns is None else share * (2 * turns - 1) / (2 * turns)


def bending_curvature(
    outer: Any,
    inner: Any,
    inset: Any,
    elastomer: Any,
    electrode: Any,
    opening: Any = np.pi,
) -> Any:
    """Curvature in 1/m over p/E of a helix of one modulus, driven over a sector.

    (t_el/(t_el + t_e)) (2/3) (r_2^3 - r_1^3) sin(opening/2) over pi (r_o^4 - r_i^4)/4: the first
    moment of the driven area over the second moment of the ring's.  93.4/m for half electrodes of
    the thesis's geometry.

    Parameters
    ----------
    outer, inner, inset, elastomer, electrode
        Lengths in m.
    opening
        Angle of the sector in rad, pi for a half.
    """
    r1, r2 = inner + inset, outer - inset
    moment = 2 / 3 * (r2**3 - r1**3) * np.sin(np.asarray(opening) / 2)
    return elastomer / (elastomer + electrode) * moment / (np.pi / 4 * (outer**4 - inner**4))
