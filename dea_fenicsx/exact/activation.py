"""The activation model of thesis section 4.4.2 (eq 47 to 60), mended.

After Wissler and Mazza: a film at an equi-biaxial stretch is activated so that its thickness
stretch falls by k, while the true in-plane stress stays what it was.  Mended are H (eq 53), which
is 2 lam^2 (...), and the Maxwell pressure (eq 59), which is eps V^2/t^2.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dea_fenicsx.exact.film_field import FilmField
from dea_fenicsx.exact.states import elastic_stress
from dea_fenicsx.materials import Material
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import si


def activation_voltage(material: Material, thickness: float, k: Any, stretch: float = 1.0) -> Any:
    """Voltage in V that thins a film from lam3 = 1/stretch^2 to 1/stretch^2 - k.

    Parameters
    ----------
    material, thickness
        The dielectric, incompressible, and its undeformed thickness in m.
    k
        Fall of the thickness stretch, between 0 and 1/stretch^2.
    stretch
        Equi-biaxial stretch before activation; its true stress is kept.
    """
    thickness = si(thickness, "m", "The thickness")
    lam3 = 1 / stretch**2 - np.asarray(k, dtype=float)
    if np.any(lam3 <= 0) or np.any(np.asarray(k) < 0):
        raise InputError(f"k must lie between 0 and 1/stretch^2 = {1 / stretch**2:g}.")
    lam = 1 / np.sqrt(lam3)
    before = elastic_stress(material, stretch, stretch)[0]
    pressure = elastic_stress(material, lam, lam)[0] - before
    field = FilmField(material.dielectric)
    e = np.log(np.stack([lam, lam, lam3]))
    push = field.push(e)
    share = push[0] - push[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        M = np.where(share > 0, pressure / share, np.nan)  # no field thins it if share <= 0
    return thickness * lam3 * field.field(e, M)
