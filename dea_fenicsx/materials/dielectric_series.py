"""The numeric `FieldPoint`: a dielectric in a film, with derivatives in logarithmic stretches."""

from __future__ import annotations

from typing import Any

import numpy as np

from dea_fenicsx.materials.base import EPSILON_0
from dea_fenicsx.materials.electric import Dielectric
from dea_fenicsx.materials.stretches import _I, _J, PrincipalStrain, Series


class FilmPoint(PrincipalStrain):
    """A field along axis 3 of principal stretches, whose true size is kept in derivatives.

    Parameters
    ----------
    e
        Logarithms of the principal stretches, shape (3, ...).
    field
        True field in V/m, of shape (...).
    """

    def __init__(self, e: np.ndarray, field: Any = 1.0) -> None:
        super().__init__(e - e.sum(axis=0) / 3)
        self._volume, self._square = e.sum(axis=0), np.asarray(field, dtype=float) ** 2
        self._log3 = e[2]

    @property
    def I1(self) -> Series:
        """tr C of the volume-preserving part, with derivatives in e itself."""
        c, P = super().I1.c, np.eye(3) - 1 / 3
        H = np.empty((3, 3, *c.shape[1:]))
        H[_I, _J] = c[4:]
        H[_J, _I] = c[4:]
        H = np.einsum("ij,jk...,kl->il...", P, H, P)
        return Series(np.concatenate([c[:1], np.tensordot(P, c[1:4], 1), H[_I, _J]]))

    @property
    def e2(self) -> Series:
        out = np.zeros((10, *self.e.shape[1:]))
        out[0] = self._square
        return Series(out)

    @property
    def E2(self) -> Series:
        """lam3^2 times the square of the true field."""
        out = np.zeros((10, *self.e.shape[1:]))
        out[0] = np.exp(2 * self._log3) * self._square
        out[3], out[6] = 2 * out[0], 4 * out[0]
        return Series(out)

    @property
    def ln_J(self) -> Series:
        out = np.zeros((10, *self.e.shape[1:]))
        out[0], out[1:4] = self._volume, 1.0
        return Series(out)

    vacuum = EPSILON_0

    @staticmethod
    def exp(x: Any) -> Any:
        return x.exp()

    @staticmethod
    def choose(x: Series, edge: float, below: Any, above: Any) -> Series:
        low, high = (v if isinstance(v, Series) else 0 * x + v for v in (below, above))
        return Series(np.where(x.c[0] < edge, low.c, high.c))

    @staticmethod
    def at_least(x: Series, edge: float) -> Series:
        return FilmPoint.choose(x, edge, 0 * x + edge, x)


def film_permittivity(law: Dielectric, e: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Permittivity across a film in F/m, and the gradient and Hessian of its logarithm.

    That of small fields, where the displacement is not proportional to the field.

    Parameters
    ----------
    law
        The dielectric.
    e
        Logarithms of the principal stretches, shape (3, ...); the field is along 3.

    Returns
    -------
    eps, g, h : ndarrays of shape (...), (3, ...), (3, 3, ...)
    """
    e = np.asarray(e, dtype=float)
    if not law.depends_on_strain:
        none = np.zeros((3, *e.shape))
        return np.full(e.shape[1:], law.permittivity()), none[0], none
    c = (2 * law.in_si().coenergy(FilmPoint(e))).c
    eps, slope = c[0], c[1:4] / c[0]
    H = np.empty((3, 3, *e.shape[1:]))
    H[_I, _J] = c[4:] / eps
    H[_J, _I] = c[4:] / eps
    return eps, slope, H - slope[:, None] * slope[None, :]
