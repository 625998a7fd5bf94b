"""The electric field in a film of any dielectric, by its Maxwell pressure M = D E.

Where displacement and field are proportional, D = eps(e) E with the logarithms e of the stretches,
the Kirchhoff stress of the field is -M J v with v = (1, 1, -1)/2 + (d ln eps/de)/2.
Where the permittivity depends on the field alone it is the same without the second part, up to a
pressure, which an incompressible film carries.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dea_fenicsx.materials.base import EPSILON_0
from dea_fenicsx.materials.dielectric_series import FilmPoint, film_permittivity
from dea_fenicsx.materials.electric import Dielectric
from dea_fenicsx.materials.stretches import Series
from dea_fenicsx.support.errors import InputError

NEWTON = 60
"""Largest number of iterations for the field of a Maxwell pressure."""


class _Growing(FilmPoint):
    """A field whose true size changes with the logarithm t in place of the first stretch."""

    def __init__(self, t: np.ndarray) -> None:
        super().__init__(np.zeros((3, *t.shape)))
        self._t = t

    @property
    def e2(self) -> Series:
        out = np.zeros((10, *self._t.shape))
        out[0] = np.exp(2 * self._t)
        out[1], out[4] = 2 * out[0], 4 * out[0]
        return Series(out)


@dataclass(frozen=True)
class FilmField:
    """Field and displacement in a film.

    Parameters
    ----------
    law
        Its dielectric.

    Raises
    ------
    InputError
        For a dielectric that depends on strain and is not linear in the field.
    """

    law: Dielectric

    def __post_init__(self) -> None:
        if self.law.depends_on_strain and not self.law.is_linear:
            raise InputError(
                f"The exact theory of films knows permittivities that change with strain or with "
                f"the field, but {type(self.law).__name__} changes with both; take finite elements."
            )

    def strain_part(self, e: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """eps at small fields in F/m, and gradient and Hessian of ln eps; see film_permittivity."""
        return film_permittivity(self.law, e)

    def push(self, e: np.ndarray, v: tuple[float, float, float] = (0.5, 0.5, -0.5)) -> np.ndarray:
        """Kirchhoff stress of the field over -M J, shape (3, ...).

        Parameters
        ----------
        e
            Logarithms of the stretches, shape (3, ...).
        v
            The same at a permittivity that does not change.
        """
        _, slope, _ = self.strain_part(e)
        return np.reshape(v, (3, *[1] * (e.ndim - 1))) + slope / 2

    def _grown(self, field: Any) -> tuple[np.ndarray, np.ndarray]:
        """M = D E in Pa, and d ln D/d ln E."""
        field = np.asarray(field, dtype=float)
        t = np.log(np.maximum(field, 1e-30))
        c = self.law.in_si().coenergy(_Growing(t)).c
        n = np.where(field > 0, c[4] / np.where(c[1] > 0, c[1], 1.0) - 1, 1.0)
        return np.where(field > 0, c[1], 0.0), n

    def maxwell(self, e: np.ndarray, field: Any) -> Any:
        """M = D E in Pa of a true field in V/m."""
        if self.law.is_linear:
            return self.strain_part(e)[0] * np.asarray(field) ** 2
        return self._grown(np.abs(field))[0]

    def field(self, e: np.ndarray, M: Any) -> Any:
        """True field in V/m of a Maxwell pressure in Pa."""
        M = np.maximum(M, 0)
        start = np.sqrt(M / self.strain_part(e)[0])
        if self.law.is_linear:
            return start
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            t, goal = np.log(start), np.log(M)
            for _ in range(NEWTON):
                found, n = self._grown(np.exp(t))
                step = np.where(M > 0, (goal - np.log(found)) / (1 + n), 0.0)
                t = t + step
                if np.abs(step).max(initial=0.0) < 1e-15:
                    break
        return np.where(M > 0, np.exp(t), 0.0)

    def displacement(self, e: np.ndarray, M: Any) -> Any:
        """True displacement in C/m^2 of a Maxwell pressure in Pa."""
        M = np.maximum(M, 0)
        if self.law.is_linear:
            return np.sqrt(M * self.strain_part(e)[0])
        field = self.field(e, M)
        return np.where(M > 0, M / np.where(field > 0, field, 1.0), 0.0)

    def field_of(self, e: np.ndarray, displacement: Any) -> Any:
        """True field in V/m of a displacement in C/m^2, which may saturate (inf beyond)."""
        D = np.abs(np.asarray(displacement, dtype=float))
        start = D / self.strain_part(e)[0]
        if self.law.is_linear:
            return start
        low, high, E = start, start + D / EPSILON_0 * 1e6, start
        beyond = high / 2
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for _ in range(200):  # Newton's method for ln E, kept between bounds
                M, n = self._grown(E)
                below = M < D * E
                low, high = np.where(below, E, low), np.where(below, high, E)
                aim = E * np.exp(np.log(D * E / M) / n)
                last, E = E, np.where((aim >= low) & (aim <= high), aim, np.sqrt(low * high))
                if not np.any(np.abs(E - last) > 1e-15 * E):
                    break
        return np.where(D > 0, np.where(beyond > E, E, np.inf), 0.0)

    def stored(self, e: np.ndarray, M: Any) -> Any:
        """Energy of the field in J per deformed m^3, the integral of E dD at kept strain."""
        if self.law.is_linear:
            return M / 2
        t = np.log(np.maximum(self.field(e, M), 1e-30))
        return np.where(M > 0, M - self.law.in_si().coenergy(_Growing(t)).c[0], 0.0)

    def through(
        self, e: np.ndarray, lengths: np.ndarray, areas: np.ndarray, volts: float
    ) -> np.ndarray:
        """True fields in V/m in parts that one flux passes in turn, as in a curved layer.

        Newton's method for the N fields E_i and the flux, with

            D_i(E_i) a_i = flux,   sum l_i E_i = V.

        Parameters
        ----------
        e
            Logarithms of the stretches of the parts, shape (3, N); the field is along 3.
        lengths
            Weights l_i in m, shape (N,): lengths along the field.
        areas
            Areas a_i that the flux passes, of any one unit, shape (N,).
        volts
            V in V.

        Returns
        -------
        ndarray of shape (N,)
            E_i in V/m; NaN if the displacement hardly grows with the field any more.
        """
        E = np.full(lengths.shape, abs(volts) / lengths.sum())
        for _ in range(NEWTON if volts else 0):
            M, n = (self.maxwell(e, E), 1.0) if self.law.is_linear else self._grown(E)
            D = M / E
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = n * D / E  # dD/dE
                flux = (abs(volts) - lengths @ (E - D / slope)) / (lengths @ (1 / (areas * slope)))
                step = (flux / areas - D) / slope
            E = np.maximum(E + step, E / 10)
            if not np.abs(step).max() > 1e-14 * E.max():
                break
        return np.copysign(E, volts)

    def growth(self, e: np.ndarray, M: Any) -> Any:
        """d ln D/d ln E at kept strain: 1 where they are proportional."""
        if self.law.is_linear:
            return 1.0
        return self._grown(self.field(e, M))[1]

    def controls(self, e: np.ndarray, M: Any, control: str) -> np.ndarray:
        """d ln(M J)/de at a kept voltage, charge, Maxwell pressure or nominal field, (3, ...)."""
        _, g, _ = self.strain_part(e)
        n = self.growth(e, M)
        one = np.ones_like(g)
        third, plane = np.zeros_like(g), np.zeros_like(g)
        third[2], plane[:2] = 1.0, 1.0
        return {
            "voltage": lambda: one + g - (1 + n) * third,
            "charge": lambda: one - g - (1 + 1 / n) * plane,
            "pressure": lambda: one,
            "undeformed": lambda: one + g,
        }[control]()
