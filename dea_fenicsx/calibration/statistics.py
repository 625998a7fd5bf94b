"""What least squares say about the certainty of parameters.

With the residuals r(z), their variances v, the Jacobian J = dr/dz and the rows P of the priors, the
covariance of the coordinates z at the least squares is

    C = A^-1 B A^-1,    A = J^T J + P^T P,    B = J^T diag(v) J + P^T P,

which is A^-1 where the variances are 1.  A region of 95 % is d^T C^-1 d <= q with the deviation d,
and q the quantile of chi-squared where the errors are known, and p times that of Fisher's F where
they are found from the residuals (Seber and Wild, Nonlinear Regression, Wiley 1989).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SMALLEST_SINGULAR_VALUE_OF_PARAMETERS = 1e-7
"""Smallest singular value, relative to the largest, of a combination that anything fixes."""

SMALLEST_COMPONENT_OF_PARAMETER = 1e-3
"""Smallest component of a parameter in a direction that counts."""

TOLD_COMPONENT = 0.05
"""Smallest component that is told, over the largest."""

LOOSE = 1.0
"""Standard deviation, of a logarithm or over its own size, above which a combination is loose."""


@dataclass(frozen=True)
class ParameterCombination:
    """A combination of parameters, and how well the data fix it.

    Attributes
    ----------
    parts
        Component of each parameter that takes part, the largest being 1: powers of positive
        parameters, shares of the sizes of others.
    deviation
        Standard deviation along the direction, of a logarithm or over the size, from the data
        alone; infinite where they do not fix it.
    """

    parts: dict[str, float]
    deviation: float

    @property
    def is_loose(self) -> bool:
        return not self.deviation <= LOOSE

    def __str__(self) -> str:
        return " · ".join(f"{name}^{power:+.2f}" for name, power in self.parts.items())


def inflation(r: np.ndarray) -> float:
    """How many neighbouring residuals count for one: (1 + rho)/(1 - rho), rho their correlation."""
    size = float(r @ r)
    rho = float(r[1:] @ r[:-1]) / size if size > 0 else 0.0
    rho = min(max(rho, 0.0), 1 - 1e-9)
    return min((1 + rho) / (1 - rho), float(len(r)))


def covariance(J: np.ndarray, v: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """The covariance C, its inverse on what is fixed, and the number of fixed directions.

    Parameters
    ----------
    J
        Jacobian of the residuals, shape (n, p).
    v
        Variances of the residuals, shape (n,).
    P
        Rows of the priors, shape (m, p).

    Returns
    -------
    C
        Shape (p, p), with infinite entries on the diagonal where nothing fixes a parameter.
    inverse, rank
        Shape (p, p); zero along directions that nothing fixes.
    """
    both = np.concatenate([J, P])
    lengths = _lengths(both)
    _, values, Vt = np.linalg.svd(both / lengths, full_matrices=True)
    values = np.append(values, np.zeros(len(Vt) - len(values)))
    clear = _clear(values)
    V, s = Vt[clear].T, values[clear]
    rows = np.concatenate([J * np.sqrt(v)[:, None], P]) / lengths @ V / s**2
    C = V @ (rows.T @ rows) @ V.T / np.outer(lengths, lengths)
    inner = np.linalg.pinv(rows.T @ rows)
    inverse = lengths[:, None] * (V @ inner @ V.T) * lengths
    lost = np.any(np.abs(Vt[~clear]) > SMALLEST_COMPONENT_OF_PARAMETER, axis=0)
    C[lost, :] = C[:, lost] = 0.0
    C[lost, lost] = np.inf
    return C, inverse, int(clear.sum())


def _lengths(J: np.ndarray) -> np.ndarray:
    """Lengths of the columns of a Jacobian, 1 for those that are zero."""
    lengths = np.linalg.norm(J, axis=0)
    return np.where(lengths > 0, lengths, 1.0)


def _clear(values: np.ndarray) -> np.ndarray:
    """Which singular values, the largest first, belong to a combination that anything fixes."""
    return values > SMALLEST_SINGULAR_VALUE_OF_PARAMETERS * max(values[0], 1e-300)


def only_fixed(J: np.ndarray) -> np.ndarray:
    """A Jacobian of shape (n, p) without the combinations of parameters that nothing fixes."""
    lengths = _lengths(J)
    U, values, Vt = np.linalg.svd(J / lengths, full_matrices=False)
    clear = _clear(values)
    return np.asarray((U[:, clear] * values[clear]) @ Vt[clear] * lengths)


def directions(
    J: np.ndarray, v: np.ndarray, names: Sequence[str]
) -> tuple[ParameterCombination, ...]:
    """Independent combinations of parameters by growing certainty, from the data alone.

    They are the singular vectors of the Jacobian, each row divided by its standard deviation.
    """
    rows = J / np.sqrt(np.maximum(v, 1e-300))[:, None]
    _, values, Vt = np.linalg.svd(rows, full_matrices=True)
    values = np.append(values, np.zeros(len(Vt) - len(values)))
    found = []
    for s, row in zip(values[::-1], Vt[::-1], strict=True):
        share = row / row[int(np.argmax(np.abs(row)))]
        parts = {n: float(c) for n, c in zip(names, share, strict=True) if abs(c) > TOLD_COMPONENT}
        known = s > SMALLEST_SINGULAR_VALUE_OF_PARAMETERS * values[0]
        found.append(ParameterCombination(parts, float(1 / s) if known else np.inf))
    return tuple(found)


def quantile(rank: int, freedom: float, exact: bool, share: float = 0.95) -> float:
    """What d^T C^-1 d does not exceed in a share of repetitions."""
    from scipy.stats import chi2, f

    if rank == 0:
        return 0.0
    return float(chi2.ppf(share, rank) if exact else rank * f.ppf(share, rank, max(freedom, 1.0)))


def half_width(freedom: float, exact: bool, share: float = 0.95) -> float:
    """Half the interval of one parameter, over its standard deviation."""
    from scipy.stats import norm, t

    return float(norm.ppf((1 + share) / 2) if exact else t.ppf((1 + share) / 2, max(freedom, 1.0)))


def corrected_criterion(kind: str, fit: float, k: int, n: float) -> float:
    """Akaike's corrected criterion (AICc) or Bayes' criterion (BIC).

    Parameters
    ----------
    kind
        ``"AICc"`` or ``"BIC"``.
    fit
        Minus twice the logarithm of the likelihood, up to a constant.
    k
        Number of parameters.
    n
        Number of independent measurements.

    Notes
    -----
    AICc = fit + 2 k + 2 k (k + 1)/(n - k - 1), infinite for n <= k + 1 (Hurvich and Tsai,
    Biometrika 76 (1989) 297); BIC = fit + k ln n (Schwarz, Ann. Statist. 6 (1978) 461).
    """
    if kind == "BIC":
        return fit + k * float(np.log(n))
    return fit + 2 * k + (2 * k * (k + 1) / (n - k - 1) if n > k + 1 else np.inf)
