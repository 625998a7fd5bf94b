"""Polynomials through values at given places, which predict states along a path."""

from __future__ import annotations

import numpy as np


def lagrange_weights(nodes: np.ndarray, x: float) -> np.ndarray:
    """Weights of the polynomial through values at `nodes`, at x."""
    others = [np.delete(nodes, k) for k in range(len(nodes))]
    return np.array([np.prod((x - o) / (n - o)) for n, o in zip(nodes, others, strict=True)])
