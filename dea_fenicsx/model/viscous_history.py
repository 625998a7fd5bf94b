"""The viscous strain of Maxwell branches at quadrature points, from one step of time to the next.

C_v is symmetric with determinant 1.  Over a step of length dt backward Euler and BDF2 give it in
closed form,

    C_v,new = unimodular part of (dt/tau C + H)
    Euler:  H = C_n
    BDF2:   H = (1 + w) C_n - w^2/(1 + w) C_(n-1)

with w the length of this step over that of the last one.  Where H is not positive, BDF2 gives way
to Euler at that point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
"""Places of the six numbers of a symmetric tensor."""


@dataclass(frozen=True, eq=False)
class ViscousHistory:
    """What the branches remember.

    Attributes
    ----------
    strains
        C_v at the last accepted times, the newest first, each of shape (branches, cells, points,
        6).
    times
        Those times in s, the newest first.
    span
        Time in s from the newest of them to the present state; 0 in an accepted state, and
        infinite where all branches are relaxed.
    """

    strains: tuple[np.ndarray, ...]
    times: tuple[float, ...]
    span: float = 0.0


def determinant(c: np.ndarray) -> np.ndarray:
    """Determinants of symmetric tensors of shape (..., 6)."""
    xx, yy, zz, yz, xz, xy = np.moveaxis(c, -1, 0)
    return xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)


def unimodular(c: np.ndarray) -> np.ndarray:
    """Positive tensors over the cube root of their determinants."""
    return np.asarray(c / np.cbrt(determinant(c))[..., None])


def is_positive(c: np.ndarray) -> np.ndarray:
    """Whether symmetric tensors are positive definite, by their principal minors."""
    xx, yy, _, _, _, xy = np.moveaxis(c, -1, 0)
    return (xx > 0) & (xx * yy - xy * xy > 0) & (determinant(c) > 0)


def combined(history: ViscousHistory, second_order: bool = True) -> np.ndarray:
    """H of the step from the newest accepted time to the present state, like C_v.

    BDF2 with the ratio w of this step to the last one is

        (1 + 2w)/(1 + w) C_new = (1 + w) C_n - w^2/(1 + w) C_(n-1) + dt dC_v/dt,

    in which the part of dC_v/dt along C_v itself only changes a factor, as that of C_new does.
    """
    now = history.strains[0]
    if not second_order or len(history.strains) < 2 or not np.isfinite(history.span):
        return now
    w = history.span / (history.times[0] - history.times[1])
    both = (1 + w) * now - w * w / (1 + w) * history.strains[1]
    return np.where(is_positive(both)[..., None], both, now)
