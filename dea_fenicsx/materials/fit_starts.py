"""Models from which a fit starts besides the one that it is given."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from dea_fenicsx.materials.curve_data import TestData
from dea_fenicsx.materials.ogden import Ogden
from dea_fenicsx.materials.polynomial import MooneyRivlin, NeoHookean, Yeoh
from dea_fenicsx.materials.stretches import nominal_stress

EXPONENT_FACTORS = (1.0, -1.0, 2.0, -2.0, 0.5, -0.5)
"""Exponents of Ogden's model that are tried, over those that it starts from."""

MOST_TERMS = 3
"""Largest number of terms of Ogden's model for which all combinations of exponents are tried."""

MOST_OGDEN_STARTS = 3
"""Number of combinations of exponents, the best ones, from which a search starts."""


def other_starts(first: Any, curves: Sequence[TestData]) -> list[Any]:
    """More models to start from.

    A model that contains the neo-Hookean one starts from that one's fit as well, so that it never
    fits worse.  Ogden's model is not defined at the exponent 0, which no search can cross, so it
    starts from exponents of other signs and sizes as well.

    Parameters
    ----------
    first
        The model that the fit starts from.
    curves
        The data, each curve of equal weight.
    """
    if isinstance(first, Ogden):
        return list(_ogden_starts(first, curves))
    if isinstance(first, MooneyRivlin | Yeoh):
        rows = _weighted([NeoHookean(1.0)], curves)
        mu = float(np.linalg.lstsq(rows, _weighted(None, curves)[:, 0])[0][0])
        if mu > 0:
            return [MooneyRivlin(mu / 2, 0.0) if isinstance(first, MooneyRivlin)
                    else Yeoh(mu / 2, 0.0, 0.0)]  # fmt: skip
    return []


def _weighted(models: Sequence[Any] | None, curves: Sequence[TestData]) -> np.ndarray:
    """Stresses of some models, or of the data, over each curve's size, shape (points, models)."""
    parts = []
    for c in curves:
        size = max(float(np.linalg.norm(c.stress)), 1e-300)
        columns = [c.stress] if models is None else [
            nominal_stress(m, c.test, c.stretch) for m in models
        ]  # fmt: skip
        parts.append(np.column_stack(columns) / size)
    return np.concatenate(parts)


def _ogden_starts(first: Ogden, curves: Sequence[TestData]) -> list[Ogden]:
    """The best combinations of exponents; the moduli of each are linear least squares."""
    if len(first.alpha) > MOST_TERMS:
        return []
    exponents = [[a * share for share in EXPONENT_FACTORS] for a in first.alpha]
    each = dict.fromkeys(a for some in exponents for a in some)
    with np.errstate(all="ignore"):
        columns = {a: _weighted([Ogden((1.0,), (a,))], curves)[:, 0] for a in each}
    data = _weighted(None, curves)[:, 0]
    found = []
    for alpha in product(*exponents):
        rows = np.column_stack([columns[a] for a in alpha])
        if len(set(alpha)) < len(alpha) or not np.all(np.isfinite(rows)):
            continue
        mu = np.linalg.lstsq(rows, data)[0]
        model = Ogden(tuple(map(float, mu)), tuple(map(float, alpha)))
        if not model.faults():
            found.append((float(np.sum((rows @ mu - data) ** 2)), model))
    found.sort(key=lambda pair: pair[0])
    return [model for _, model in found[:MOST_OGDEN_STARTS]]
