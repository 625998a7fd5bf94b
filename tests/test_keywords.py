"""Keywords that a function takes as a typed dictionary: defaults, wrong names, missing ones."""

from __future__ import annotations

import numpy as np
import pytest

import dea_fenicsx as dea
from dea_fenicsx.design.evolution import EvolutionOptions, evolve
from dea_fenicsx.design.searching import OptimiseOptions, optimise, search
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.support.validation import keywords


def test_what_is_left_out_has_its_default():
    found = keywords("f", {"seed": 3}, OptimiseOptions, {"seed": 1, "quiet": False})
    assert found == {"seed": 3, "quiet": False}


def test_inherited_keywords_are_known_and_needed_ones_missed():
    given = {"population": 4, "generations": 1, "seed": 0}
    assert keywords("f", given, EvolutionOptions, {"start": ()}) == given | {"start": ()}
    with pytest.raises(dea.InputError, match="f needs seed=, which is missing"):
        keywords("f", {"population": 4, "generations": 1}, EvolutionOptions, {})


@pytest.mark.parametrize("call", [
    lambda: dea.read_gmsh(BoxStack(1.0, 1.0, [Layer("a", 1.0)]), curve=False),
    lambda: search("elastosil-2030", populations=4),
    lambda: optimise(lambda x: {"f": x}, {"x": (0.0, 1.0)}, {"f": "min"}, seeds=4),
    lambda: evolve(lambda X: {}, {"x": (0.0, 1.0)}, {"f": "min"}, {}, generation=4),
])  # fmt: skip
def test_a_wrong_name_is_told_with_the_nearest(call):
    with pytest.raises(dea.InputError, match=r"takes no keyword .*; did you mean"):
        call()


def test_a_search_is_called_as_before():
    pytest.importorskip("pymoo")

    def both(X):
        return {"f": X[:, 0] ** 2, "g": (X[:, 0] - 1) ** 2}

    front = evolve(both, {"x": (0.0, 1.0)}, {"f": "min", "g": "min"}, {}, population=8,
                   generations=3, seed=2, start=({"x": 0.5},))  # fmt: skip
    assert len(front.columns["x"]) >= 8 and front.evaluations >= 20
    assert np.allclose(front.columns["f"], front.columns["x"] ** 2, rtol=1e-15)
