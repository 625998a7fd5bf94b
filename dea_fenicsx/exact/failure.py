"""The four ways a film fails, as bounds on the voltage over the stretch, and the first on a path.

Loss of tension (a direction goes slack and wrinkles), electrical breakdown, electromechanical
instability (the second variation at constant voltage and dead loads loses its definiteness), and
the stretch limit of the chains.  Zhao and Suo, Phys. Rev. B 76 (2007) 134113; Moscardo et al.,
J. Appl. Phys. 104 (2008) 093503.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from dea_fenicsx.exact.states import elastic_stiffness, elastic_stress, pull, softening
from dea_fenicsx.materials import Material
from dea_fenicsx.materials.dielectric_series import film_permittivity
from dea_fenicsx.materials.stretches import margin
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import si

MODES = ("loss of tension", "breakdown", "instability", "stretch limit")


def limits(material: Material, lam1: Any, lam2: Any, held: bool = False) -> dict[str, np.ndarray]:
    """Largest Maxwell pressure in Pa that each mode allows at given in-plane stretches.

    Parameters
    ----------
    material
        An incompressible dielectric elastomer, whose field is proportional to the displacement.
    lam1, lam2
        In-plane stretches; they broadcast.
    held
        Whether direction 2 is held: then only direction 1 can run away.

    Returns
    -------
    dict
        For each of `MODES` an array; inf where the mode sets no bound, and 0 for the stretch limit
        beyond lock-up.
    """
    lam1, lam2 = np.broadcast_arrays(np.asarray(lam1, float), np.asarray(lam2, float))
    f, K = elastic_stiffness(material, lam1, lam2)
    if not material.dielectric.is_linear:
        raise InputError(
            f"Failure maps know fields that are proportional to the displacement, which that of "
            f"{type(material.dielectric).__name__} is not; trace exact.Film instead."
        )
    w, B = pull(material, lam1, lam2), softening(material, lam1, lam2)
    # the matrix A - M B with A = K - diag(f), singular in M
    A11, A22, A12 = K[0] - f[0], K[1] - f[1], K[2]
    B11, B22, B12 = B[0] - w[0], B[1] - w[1], B[2]
    if held:
        with np.errstate(divide="ignore", invalid="ignore"):
            unstable = np.where(A11 > 0, np.where(B11 > 0, A11 / B11, np.inf), 0.0)
    else:
        # (A11 - M B11)(A22 - M B22) - (A12 - M B12)^2 = 0
        a, c = B11 * B22 - B12**2, A11 * A22 - A12**2
        b = 2 * A12 * B12 - A11 * B22 - A22 * B11
        disc = b * b - 4 * a * c
        root = np.sqrt(np.maximum(disc, 0))
        with np.errstate(divide="ignore", invalid="ignore"):
            roots = np.stack([(-b + root) / (2 * a), (-b - root) / (2 * a)])
        first = np.min(np.where((roots > 0) & (disc >= 0), roots, np.inf), axis=0)
        unstable = np.where((c > 0) & (A11 + A22 > 0), first, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        slack = np.min(np.where(w > 0, np.maximum(f, 0.0) / w, np.inf), axis=0)
    out = {"loss of tension": slack, "instability": unstable}
    electric = material.dielectric
    field = electric.breakdown_field(np.sqrt(lam1 * lam2))
    out["breakdown"] = (
        np.full(lam1.shape, np.inf) if field is None
        else _eps(material, lam1, lam2) * field**2
    )
    e = _log(lam1, lam2)
    inside = margin(material.elastic, e) > 0
    out["stretch limit"] = np.full(lam1.shape, np.inf)
    return {mode: np.where(inside, out[mode], 0.0) for mode in MODES}


def _log(lam1: Any, lam2: Any) -> np.ndarray:
    e1, e2 = np.broadcast_arrays(np.log(lam1), np.log(lam2))
    return np.stack([e1, e2, -e1 - e2])


def _eps(material: Material, lam1: Any, lam2: Any) -> np.ndarray:
    """Permittivity across the film in F/m."""
    return film_permittivity(material.dielectric, _log(lam1, lam2))[0]


@dataclass(frozen=True, eq=False)
class FailureMap:
    """Bounds of the allowable region along a line of in-plane stretches.

    Attributes
    ----------
    lam1, lam2
        The stretches.
    maxwell
        Largest Maxwell pressure in Pa for each mode.
    material, thickness
        The film.
    """

    material: Material
    thickness: float
    lam1: np.ndarray
    lam2: np.ndarray
    maxwell: dict[str, np.ndarray]

    def _eps(self) -> np.ndarray:
        return _eps(self.material, self.lam1, self.lam2)

    def voltage(self, mode: str) -> np.ndarray:
        """Largest voltage in V that a mode allows at each stretch."""
        return self.thickness / (self.lam1 * self.lam2) * np.sqrt(self.maxwell[mode] / self._eps())

    def charge(self, mode: str) -> np.ndarray:
        """Largest charge per undeformed area in C/m^2 that a mode allows at each stretch."""
        return self.lam1 * self.lam2 * np.sqrt(self.maxwell[mode] * self._eps())

    def force(self, mode: str) -> np.ndarray:
        """Nominal stress along direction 1 in Pa on a mode's bound, conjugate to the stretch."""
        w = pull(self.material, self.lam1, self.lam2)[0]
        f = elastic_stress(self.material, self.lam1, self.lam2)[0]
        return (f - w * self.maxwell[mode]) / self.lam1

    def allowed(self) -> np.ndarray:
        """Largest voltage in V that all modes allow at each stretch."""
        return np.min([self.voltage(m) for m in MODES], axis=0)

    def governing(self) -> list[str]:
        """The mode that bounds the voltage at each stretch."""
        k = np.argmin([self.maxwell[m] for m in MODES], axis=0)
        return [MODES[i] for i in k]

    def draw(self, ax: Any = None, plane: str = "voltage-stretch") -> Any:
        """Draw the bounds and shade the allowable region; returns the axes.

        Parameters
        ----------
        ax
            Axes of matplotlib; made if None.
        plane
            ``"voltage-stretch"``, ``"voltage-charge"`` or ``"force-stretch"``; the last two are
            the work-conjugate pairs.
        """
        if plane not in ("voltage-stretch", "voltage-charge", "force-stretch"):
            raise InputError(
                f"There is no plane {plane!r}; choose voltage-stretch, voltage-charge or "
                "force-stretch."
            )
        import matplotlib.pyplot as plt

        ax = ax or plt.subplots()[1]
        beyond = self.maxwell["stretch limit"] == 0
        if beyond.any() and plane != "voltage-charge":
            ax.axvline(self.lam1[beyond].min(), color="k", ls="--", label="stretch limit")
        for mode in MODES:
            bound = np.isfinite(self.maxwell[mode]) & (self.maxwell[mode] > 0)
            if not bound.any():
                continue
            x = {"voltage-stretch": self.lam1, "voltage-charge": self.charge(mode) * 1e3}.get(
                plane, self.lam1
            )
            y = self.force(mode) / 1e3 if plane == "force-stretch" else self.voltage(mode) / 1e3
            ax.plot(x[bound], y[bound], label=mode)
        if plane == "voltage-stretch":
            top = np.where(np.isfinite(self.allowed()), self.allowed(), 0) / 1e3
            ax.fill_between(self.lam1, 0, top, alpha=0.15, color="tab:green", label="allowable")
        ax.set_xlabel("charge per undeformed area in mC/m²" if "charge" in plane else "stretch 1")
        ax.set_ylabel("nominal stress 1 in kPa" if "force" in plane else "voltage in kV")
        ax.legend()
        return ax


def failure_map(
    material: Material, thickness: float, lam1: Any, lam2: Any = None, held: bool = False
) -> FailureMap:
    """Failure map along a line of stretches: equi-biaxial if `lam2` is None."""
    thickness = si(thickness, "m", "The thickness")
    lam1 = np.asarray(lam1, dtype=float)
    lam1, lam2 = (np.array(x) for x in np.broadcast_arrays(lam1, lam1 if lam2 is None else lam2))
    return FailureMap(material, thickness, lam1, lam2, limits(material, lam1, lam2, held))


@dataclass(frozen=True)
class Failure:
    """The first failure on a path: the mode, where on the path, the stretches and the voltage."""

    mode: str
    place: float
    lam1: float
    lam2: float
    voltage: float


def first_failure(
    material: Material,
    thickness: float,
    path: Callable[[float], tuple[float, float, float]],
    samples: int = 400,
    held: bool = False,
) -> Failure | None:
    """The first mode met along a path, or None.

    Parameters
    ----------
    material, thickness
        The film.
    path
        Function of a number from 0 to 1 that gives (lam1, lam2, voltage in V).
    samples
        Points at which the path is sampled before the crossing is refined.
    held
        Whether direction 2 is held.
    """
    thickness = si(thickness, "m", "The thickness")

    def excess(s: float, mode: str) -> float:
        l1, l2, volts = path(s)
        M = float(_eps(material, l1, l2)) * (volts * l1 * l2 / thickness) ** 2
        bound = float(limits(material, l1, l2, held)[mode])
        if not np.isfinite(bound):
            return -1.0
        scale = material.elastic.shear_modulus()
        return (M - bound) / (M + bound + 1e-12 * scale) if bound > 0 or M > 0 else -1e-16

    s = np.linspace(0, 1, samples + 1)
    points = np.array([path(x) for x in s]).T
    M = _eps(material, points[0], points[1]) * (points[2] * points[0] * points[1] / thickness) ** 2
    found = []
    for mode, bound in limits(material, points[0], points[1], held).items():
        over = bound < M
        if not over.any():
            continue
        k = int(np.argmax(over))
        place = s[k]
        if k > 0 and excess(s[k - 1], mode) * excess(s[k], mode) < 0:
            place = brentq(lambda x, m=mode: excess(x, m), s[k - 1], s[k], xtol=1e-14)
        l1, l2, volts = path(float(place))
        found.append(Failure(mode, float(place), float(l1), float(l2), float(volts)))
    return min(found, key=lambda f: f.place, default=None)
