"""Homogeneous states as plain functions of the in-plane stretches, for arrays of any size.

All of an incompressible ideal dielectric elastomer.  `lam1` and `lam2` broadcast against one
another and against the electric quantity; a million states take about a second.
"""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np

from dea_fenicsx.exact.film_field import FilmField
from dea_fenicsx.materials import Material
from dea_fenicsx.materials.base import is_compressible
from dea_fenicsx.materials.stretches import taylor
from dea_fenicsx.support.errors import InputError

Stress = Literal["field", "pressure"]
"""What the electric field does: its full stress, or a pressure eps E^2 on the film's faces."""

STRESSES = get_args(Stress)


def without_time(material: Material, what: str) -> None:
    """Raise InputError if a material has viscous branches, of which `what` knows nothing."""
    if material.viscous:
        raise InputError(
            f"{what} knows no time, but the material has viscous branches; say which response is "
            "meant: exact.relaxed(...) or exact.instantaneous(...) of the film or material."
        )


def of_kept_volume(material: Material, what: str) -> None:
    """Raise InputError if the energy of a material is that of a foam, whose volume changes."""
    if is_compressible(material.elastic):
        raise InputError(
            f"{what} needs a material that keeps its volume, but "
            f"{type(material.elastic).__name__} is a foam; take exact.Film, which knows it."
        )


def elastic_stress(material: Material, lam1: Any, lam2: Any) -> np.ndarray:
    """True stresses lam_i dW/dlam_i - lam_3 dW/dlam_3 in Pa without field, shape (2, ...)."""
    without_time(material, "elastic_stress()")
    of_kept_volume(material, "elastic_stress()")
    _, R, _ = taylor(material.elastic, _log(lam1, lam2))
    return R[:2] - R[2]


def maxwell_pressure(
    material: Material,
    thickness: float,
    lam1: Any,
    lam2: Any,
    *,
    voltage: Any = None,
    charge: Any = None,
    pressure: Any = None,
    undeformed: Any = None,
) -> np.ndarray:
    """Maxwell pressure eps E^2 in Pa for one of four electric conditions.

    Parameters
    ----------
    material, thickness
        The dielectric and its undeformed thickness T in m.
    lam1, lam2
        In-plane stretches.
    voltage
        V between the electrodes: eps (V lam1 lam2/T)^2.
    charge
        Charge per undeformed area in C/m^2, as in an open circuit: q^2/(eps lam1^2 lam2^2).
    pressure
        The pressure itself in Pa.
    undeformed
        V, taken with the undeformed thickness: eps (V/T)^2.
    """
    given = {
        "voltage": voltage, "charge": charge, "pressure": pressure, "undeformed": undeformed
    }  # fmt: skip
    named = [k for k, value in given.items() if value is not None]
    if len(named) != 1:
        raise InputError(
            f"Exactly one of {', '.join(given)} is needed, but {len(named)} are given."
        )
    field, e = FilmField(material.dielectric), _log(lam1, lam2)
    area = np.asarray(lam1) * np.asarray(lam2)
    if voltage is not None:
        return field.maxwell(e, np.asarray(voltage) * area / thickness)
    if charge is not None:
        D = np.asarray(charge) / area
        return D * field.field_of(e, D)
    if pressure is not None:
        return np.asarray(pressure) + 0 * area
    return field.maxwell(e, np.asarray(undeformed) / thickness + 0 * area)


def true_stress(material: Material, thickness: float, lam1: Any, lam2: Any, **electric: Any) -> Any:
    """True in-plane stresses in Pa that hold the state, shape (2, ...); see `maxwell_pressure`."""
    M = maxwell_pressure(material, thickness, lam1, lam2, **electric)
    return elastic_stress(material, lam1, lam2) - pull(material, lam1, lam2) * M


def nominal_stress(
    material: Material, thickness: float, lam1: Any, lam2: Any, **electric: Any
) -> Any:
    """Dead loads in Pa that hold the state, shape (2, ...); see `maxwell_pressure`."""
    stress = true_stress(material, thickness, lam1, lam2, **electric)
    return stress / np.stack(np.broadcast_arrays(lam1, lam2), axis=0)


def open_circuit_voltage(charge: Any, eps: float, thickness: float, lam1: Any, lam2: Any) -> Any:
    """Voltage in V of a film that keeps its charge per undeformed area (C/m^2) while it deforms."""
    return charge * thickness / (eps * (np.asarray(lam1) * np.asarray(lam2)) ** 2)


def second_variation(material: Material, lam1: Any, lam2: Any, maxwell: Any) -> np.ndarray:
    """Smallest eigenvalue in Pa of the second variation at kept voltage and kept dead loads.

    In logarithmic stretches, with the dead loads that hold the state; positive where stable.
    """
    K = _stiffness(material, lam1, lam2, np.asarray(maxwell, dtype=float))
    half, det = (K[0] + K[1]) / 2, K[0] * K[1] - K[2] ** 2
    return half - np.sqrt(np.maximum(half**2 - det, 0))


def _stiffness(material: Material, lam1: Any, lam2: Any, M: np.ndarray) -> np.ndarray:
    """Entries 11, 22, 12 of the second variation at kept voltage and dead loads."""
    f, K = elastic_stiffness(material, lam1, lam2)
    w = pull(material, lam1, lam2)
    return K - np.stack([f[0] - w[0] * M, f[1] - w[1] * M, 0 * M]) - M * softening(
        material, lam1, lam2, M
    )


def pull(material: Material, lam1: Any, lam2: Any) -> np.ndarray:
    """In-plane true stress that the field takes away, over M: 1 for an ideal one; (2, ...)."""
    _, g, _ = FilmField(material.dielectric).strain_part(_log(lam1, lam2))
    return 1 + (g[:2] - g[2]) / 2


def softening(material: Material, lam1: Any, lam2: Any, M: Any = 0.0) -> np.ndarray:
    """Derivative of M times `pull` by the logarithmic stretches at kept voltage, over M.

    Entries 11, 22, 12; 2 each for an ideal dielectric.
    """
    field, e = FilmField(material.dielectric), _log(lam1, lam2)
    _, g, h = field.strain_part(e)
    kept = field.controls(e, M, "voltage")
    kept = kept[:2] - kept[2]
    w = 1 + (g[:2] - g[2]) / 2
    curved = [h[i, j] - h[i, 2] - h[2, j] + h[2, 2] for i, j in ((0, 0), (1, 1), (0, 1))]
    return np.array(
        [w[0] * kept[0], w[1] * kept[1], (w[0] * kept[1] + w[1] * kept[0]) / 2]
    ) + np.array(curved) / 2


def elastic_stiffness(material: Material, lam1: Any, lam2: Any) -> tuple[np.ndarray, np.ndarray]:
    """True stresses without field, and d^2 W/de_i de_j at constant volume, entries 11, 22, 12."""
    without_time(material, "A state's stability")
    of_kept_volume(material, "A state's stability")
    _, R, H = taylor(material.elastic, _log(lam1, lam2))
    K = [H[i, j] - H[i, 2] - H[2, j] + H[2, 2] for i, j in ((0, 0), (1, 1), (0, 1))]
    return R[:2] - R[2], np.array(K)


def _log(lam1: Any, lam2: Any) -> np.ndarray:
    e1, e2 = np.broadcast_arrays(np.log(lam1), np.log(lam2))
    return np.stack([e1, e2, -e1 - e2])
