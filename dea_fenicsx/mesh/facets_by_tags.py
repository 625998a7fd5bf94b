"""Facets of surfaces, found once for each set of tags."""

from __future__ import annotations

from typing import Any

import numpy as np


class FacetsByTags(dict[tuple[int, ...], np.ndarray]):
    """Sorted local facets by their tags, each found when it is asked for the first time.

    Parameters
    ----------
    facets
        The facet tags of a mesh.
    """

    def __init__(self, facets: Any) -> None:
        super().__init__()
        self._facets = facets

    def __missing__(self, tags: tuple[int, ...]) -> np.ndarray:
        found = self[tags] = np.sort(np.concatenate([self._facets.find(tag) for tag in tags]))
        return found
