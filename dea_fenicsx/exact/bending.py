"""Layers bent into a circle under voltage: exact at any deformation, for incompressible layers.

Plane sections stay plane: a flat laminate becomes a sector, the length along it the angle k X.
With Z the undeformed height, b the stretch of the bottom face, a the stretch across,

    lam_t^2 = b^2 + 2 k Z/a,    lam_r = 1/(a lam_t),    r = lam_t/k,

and equilibrium, with total stresses (the field's included),

    d sigma_r/dZ = k (sigma_t - sigma_r)/(a lam_t^2),   sigma_r = 0 on both faces,   no moment,

fixes b and k (and a, where the section may stretch across).  The field is radial, with D r uniform
in each driven layer.  Rivlin, Proc. R. Soc. A 195 (1949) 463, for one layer without a field.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import legendre
from scipy.optimize import root

from dea_fenicsx.exact.film_field import FilmField
from dea_fenicsx.exact.laminate import Across, Laminate, Ply
from dea_fenicsx.materials.electric import Dielectric
from dea_fenicsx.materials.stretches import taylor
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import si

GAUSS_POINTS_OF_LAYER = 20
"""Number of Gauss points in each layer; with 20 the error of these smooth integrands is
rounding.
"""


@dataclass(frozen=True)
class Bent:
    """One state of a bent laminate.

    Attributes
    ----------
    volts : V
    angle_per_length : k, rad of turn per undeformed metre; positive where the top is the longer
    bottom : stretch along the bottom face
    across : stretch across
    """

    volts: float
    angle_per_length: float
    bottom: float
    across: float


def bend(plies: Sequence[Ply], volts: Any, across: Across = "held") -> list[Bent]:
    """States of a laminate at growing voltages, followed from the flat state.

    Parameters
    ----------
    plies
        Incompressible layers from the bottom up.
    volts
        Voltages in V, growing.
    across
        ``"held"`` (plane strain) or ``"uniform"`` (generalised plane strain), see `Laminate`.

    Raises
    ------
    InputError
        For a layer with a bulk modulus, or a voltage that no equilibrium reaches from the flat
        state.
    """
    flat = Laminate(plies, across)
    if across == "free":
        raise InputError('bend: across is "free", but must be "held" or "uniform".')
    if any(ply.material.bulk_modulus is not None for ply in plies):
        raise InputError("bend: a layer has a bulk modulus; give it none, so that it keeps volume.")
    height = float(flat.faces[-1])
    stiff = max(ply.plane_modulus for ply in plies)
    states, last, unknowns = [], 0.0, np.array([0.0, 0.0, 0.0])[: 2 + (across == "uniform")]
    for target in np.atleast_1d(np.asarray(si(volts, "V", "bend: volts"), dtype=float)):
        step = target - last
        while last != target:
            now = target if abs(target - last) <= abs(step) else last + step

            def residual(x: np.ndarray, volts: float = now) -> np.ndarray:
                return _resultants(plies, height, x, volts) / stiff

            found = root(residual, unknowns, tol=1e-13)
            near = np.max(np.abs(found.x - unknowns)) < 0.3
            if np.max(np.abs(found.fun)) < 1e-11 and near:
                unknowns, last = found.x, now
                continue
            step /= 2
            if abs(step) < 1e-4 * max(abs(target), 1e-300):
                raise InputError(
                    f"bend: from the flat state no equilibrium is reached beyond {last:g} V; ask "
                    "for lower voltages."
                )
        stretch = float(np.exp(unknowns[2])) if len(unknowns) > 2 else 1.0
        states.append(
            Bent(float(target), float(unknowns[1] / height), float(np.exp(unknowns[0])), stretch)
        )
    return states


_X, _W = legendre.leggauss(GAUSS_POINTS_OF_LAYER)
# values at the Gauss points to their integral from -1 up to each of them
_INTEGRAL = np.array(
    [legendre.legval(_X, legendre.legint(c, lbnd=-1))
     for c in np.linalg.inv(legendre.legvander(_X, GAUSS_POINTS_OF_LAYER - 1)).T]
).T  # fmt: skip


def _maxwell(
    law: Dielectric, e: np.ndarray, heights: np.ndarray, volts: float
) -> tuple[np.ndarray, np.ndarray]:
    """D E in Pa at the points of a layer, and the Kirchhoff stress of the field over -D E."""
    field, lam = FilmField(law), np.exp(e)
    E = field.through(e, heights * lam[2], lam[0], volts)
    return field.maxwell(e, E), field.push(e)


def _resultants(plies: Sequence[Ply], height: float, x: np.ndarray, volts: float) -> np.ndarray:
    """Radial stress on the top over k, moment and force across, in units of stress.

    `x` holds ln b, k height and (where it is free) ln a.
    """
    b, k = np.exp(x[0]), x[1] / height
    a = np.exp(x[2]) if len(x) > 2 else 1.0
    force, moment, thrust, low = 0.0, 0.0, 0.0, 0.0
    for ply in plies:
        t = ply.thickness
        Z = low + t * (1 + _X) / 2
        # a trial that turns the top inside out still gets finite numbers, of a stretch near 0
        square = np.maximum(b * b + 2 * k * Z / a, 1e-6)
        lam = np.sqrt(square)
        e = np.array([np.log(lam), np.full(GAUSS_POINTS_OF_LAYER, np.log(a)), -np.log(lam * a)])
        _, R, _ = taylor(ply.material.elastic, e)
        hoop, side = R[0] - R[2], R[1] - R[2]
        if ply.driven:
            M, push = _maxwell(ply.material.dielectric, e, t / 2 * _W, volts)
            hoop, side = hoop - (push[0] - push[2]) * M, side - (push[1] - push[2]) * M
        slope = hoop / square
        radial = k / a * (force + t / 2 * (_INTEGRAL @ slope))
        arm = 2 * Z / (lam + b)
        moment += t / 2 * _W @ ((radial + hoop) * arm / lam) / a**2
        thrust += t / 2 * _W @ (radial + side)
        force += t / 2 * _W @ slope
        low += t
    return np.array([force / height, moment / height**2, thrust / height])[: len(x)]
