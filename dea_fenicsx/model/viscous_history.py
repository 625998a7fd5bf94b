"""The viscous strain of Maxwell branches at quadrature points, from one step of time to the next.

C_v is symmetric with determinant 1.  A step of each rule ends at

    C_v,new = unimodular part of (h/tau C + H)

    backward Euler  h = dt            H = C_n
    BDF2            h = dt (1 + w)/(1 + 2 w),   H = [(1 + w)^2 C_n - w^2 C_(n-1)] / (1 + 2 w)
    BDF3            the same with three earlier values, by the derivative at the end of the step of
                    the cubic through them and C_v,new
    SDIRK2          two stages with h = g dt, g = 1 - 1/sqrt(2); the first is one of backward Euler
                    and ends at C_1, the second has H = C_n + (1 - g)/g (C_1 - C_n)

with w the length of this step over that of the last one.  For BDF2 and BDF3 only the ratio of h to
H counts, and the code divides both by h/dt.  They need earlier values, so that SDIRK2 makes the
first steps.  Where the H of a rule is not positive, that of the next lower order takes its place.

The unimodular part keeps the order of each rule.  The rule itself gives C_v,new (1 + a) = h/tau C +
H up to its error, where a = h tr(C C_v,new^-1)/(3 tau) is a number.  So det C_v,new = 1 fixes this
number as well as the trace does.

Sources: A. V. Shutov, R. Landgraf, J. Ihlemann, Comput. Methods Appl. Mech. Eng. 265 (2013) 213;
R. Alexander, SIAM J. Numer. Anal. 14 (1977) 1006.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

STAGE_SHARE = 1 - 1 / math.sqrt(2)
"""Length of each stage of SDIRK2, as a share of the step."""


class Rule(Enum):
    """The rule by which a step of time goes from the history to the present."""

    EULER = "backward Euler"
    BDF2 = "BDF2"
    BDF3 = "BDF3"
    STAGE = "second stage of SDIRK2"

    @property
    def order(self) -> int:
        """Order of its error at a fixed time in the length of the steps."""
        return {Rule.EULER: 1, Rule.BDF3: 3}.get(self, 2)

    @property
    def known(self) -> int:
        """Number of accepted times that its estimated error needs."""
        return self.order + 1


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
        Time in s that the present state is behind the newest of them; 0 in an accepted state, and
        infinite where all branches are relaxed.  In the second stage of SDIRK2, whose newest
        strains are those of the first stage, it is the length of a stage.
    rule
        How the present strains follow from them.
    """

    strains: tuple[np.ndarray, ...]
    times: tuple[float, ...]
    span: float = 0.0
    rule: Rule = Rule.BDF2

    @property
    def levels(self) -> int:
        """Number of accepted times that are known."""
        return len(self.times)

    @property
    def settled(self) -> bool:
        """Whether it is that of an accepted state."""
        return self.span == 0

    def restarted(self) -> ViscousHistory:
        """The same without earlier values, for the rates jump here."""
        return replace(self, strains=self.strains[:1], times=self.times[:1])

    def ahead(self, span: float, rule: Rule = Rule.BDF2) -> ViscousHistory:
        """The same for a state that lies later by a time in s."""
        return replace(self, span=span, rule=rule)


def determinant(c: np.ndarray) -> np.ndarray:
    """Determinants of symmetric tensors of shape (..., 6)."""
    xx, yy, zz, yz, xz, xy = np.moveaxis(c, -1, 0)
    return xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)


def inverse(c: np.ndarray) -> np.ndarray:
    """Inverses of symmetric tensors of shape (..., 6)."""
    xx, yy, zz, yz, xz, xy = np.moveaxis(c, -1, 0)
    adjugate = (
        yy * zz - yz * yz, xx * zz - xz * xz, xx * yy - xy * xy,
        xy * xz - xx * yz, xy * yz - yy * xz, xz * yz - zz * xy,
    )  # fmt: skip
    return np.stack(adjugate, axis=-1) / determinant(c)[..., None]


def contracted(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The double contraction a : b of symmetric tensors of shape (..., 6)."""
    return np.asarray(a[..., :3] * b[..., :3]).sum(-1) + 2 * (a[..., 3:] * b[..., 3:]).sum(-1)


def unimodular(c: np.ndarray) -> np.ndarray:
    """Positive tensors over the cube root of their determinants."""
    return np.asarray(c / np.cbrt(determinant(c))[..., None])


def is_positive(c: np.ndarray) -> np.ndarray:
    """Whether symmetric tensors are positive definite, by their principal minors."""
    xx, yy, _, _, _, xy = np.moveaxis(c, -1, 0)
    return (xx > 0) & (xx * yy - xy * xy > 0) & (determinant(c) > 0)


def combined(history: ViscousHistory) -> np.ndarray:
    """H of the step to the present state, laid out like C_v.  See the head of this file."""
    strains, rule = history.strains, history.rule
    if rule is Rule.EULER or len(strains) < 2 or not 0 < history.span < np.inf:
        return strains[0]
    if rule is Rule.STAGE:
        now = strains[1]
        both = now + (1 - STAGE_SHARE) / STAGE_SHARE * (strains[0] - now)
    else:
        now = strains[0]
        w = history.span / (history.times[0] - history.times[1])
        both = (1 + w) * now - w * w / (1 + w) * strains[1]
    found = np.where(is_positive(both)[..., None], both, now)
    if rule is Rule.BDF3 and len(strains) > 2:
        three = cubic_rule(history)
        found = np.where(is_positive(three)[..., None], three, found)
    return found


def cubic_rule(history: ViscousHistory) -> np.ndarray:
    """H of BDF3, divided by h/dt, from the three newest strains."""
    back = history.span + history.times[0] - np.array(history.times[:3])  # times before the end
    weights = [
        back[j] * back[k] / (back[i] * (back[j] - back[i]) * (back[k] - back[i]))
        for i, j, k in ((0, 1, 2), (1, 0, 2), (2, 0, 1))
    ]
    past = sum(weight * c for weight, c in zip(weights, history.strains[:3], strict=True))
    return np.asarray(history.span * past)
