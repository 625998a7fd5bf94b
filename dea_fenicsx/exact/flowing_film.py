"""A film whose viscous branches have any springs and flow laws.

With the elastic logarithmic stretches e_i = ebar_i - a_i/2 of a branch, ebar the volume-preserving
part of the film's and a the logarithms of the principal values of C_v, a spring of energy W has

    Kirchhoff stresses dev t, t_i = dW/de_i,    da/dt = dev t/eta,

and the branch dissipates |dev t|^2/(2 eta) per undeformed volume and time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dea_fenicsx.exact.film import Film
from dea_fenicsx.exact.viscous_film import DEVIATOR, Forces, ViscousFilm
from dea_fenicsx.materials import Maxwell, NeoHookean, ViscousBranch
from dea_fenicsx.materials.stretches import taylor


@dataclass(frozen=True, eq=False)
class FlowingForces(Forces):
    """Equilibrium of a film, with its branches.

    Attributes
    ----------
    W, t, K : energy of each spring in Pa and its derivatives by e, (K, N), (K, 3, N), (K, 3, 3, N)
    fluidity : one over the viscosity of each branch, in 1/(Pa s), shape (K, 1, N)
    """

    W: np.ndarray
    t: np.ndarray
    K: np.ndarray
    fluidity: np.ndarray

    @property
    def deviator(self) -> np.ndarray:
        """Kirchhoff stresses of each branch in Pa, shape (K, 3, N)."""
        return np.asarray(self.t - self.t.mean(axis=1, keepdims=True))


class FlowingFilm(ViscousFilm):
    """Equations of such a film; see `ViscousFilm`."""

    HAS_SLOPE = False

    def __init__(self, film: Film, control: str, symmetric: bool):
        self.branches = [
            ViscousBranch(NeoHookean(b.mu), b.tau) if isinstance(b, Maxwell) else b
            for b in film.material.viscous
        ]
        super().__init__(film, control, symmetric)

    def _times(self) -> list[float]:
        return [b.relaxation_times()[1] for b in self.branches]

    def forces(self, y: np.ndarray, a: np.ndarray, loads: np.ndarray) -> FlowingForces:
        e = self.stretches(y, loads)
        x = self.springs(e, a)
        parts = [taylor(b.spring, np.log(x[k]) / 2) for k, b in enumerate(self.branches)]
        W, t, K = (np.array(values) for values in zip(*parts, strict=True))
        slope = np.einsum("ij,jkn,kl->iln", DEVIATOR, K.sum(axis=0), DEVIATOR)
        balance = self._balance(e, t.sum(axis=0), slope, loads)
        return FlowingForces(e, *balance, x, W, t, K, self._fluidity(a, t))

    def _fluidity(self, a: np.ndarray, t: np.ndarray) -> np.ndarray:
        third = np.concatenate([a, -a.sum(axis=1, keepdims=True)], axis=1)
        I1 = np.exp(third).sum(axis=1)
        J2 = ((t - t.mean(axis=1, keepdims=True)) ** 2).sum(axis=1) / 2
        rates = [b.rate(I1[k], J2[k])[0] / b.mu for k, b in enumerate(self.branches)]
        return np.array(rates)[:, None]

    def pull(self, f: Forces) -> np.ndarray:
        assert isinstance(f, FlowingForces)
        return np.asarray(f.deviator.sum(axis=0))

    def spring_energy(self, f: Forces) -> np.ndarray:
        assert isinstance(f, FlowingForces)
        return np.asarray(f.W.sum(axis=0))

    def flow(self, f: Forces) -> np.ndarray:
        assert isinstance(f, FlowingForces)
        return np.asarray(f.deviator[:, :2] * f.fluidity)

    def dissipation(self, f: Forces) -> np.ndarray:
        assert isinstance(f, FlowingForces)
        return np.asarray((f.fluidity / 2 * f.deviator**2).sum(axis=1))

    def _released(self, f: Forces, adot: np.ndarray) -> np.ndarray:
        assert isinstance(f, FlowingForces)
        return np.einsum("kijn,kjn->in", f.K, adot) / 2


def equations_of(film: Film, control: str, symmetric: bool) -> ViscousFilm:
    """The equations of a film; see `ViscousFilm`."""
    closed = all(isinstance(b, Maxwell) for b in film.material.viscous)
    return (ViscousFilm if closed else FlowingFilm)(film, control, symmetric)
