"""Design search: by gradients, or by NSGA-II (pymoo) for several objectives.

    better = improve(build, {"inset": (1e-4, 2e-3)}, {"tip": "max"}, Analysis({"tip": tip}))

    front = search("elastosil-2030", objectives=("voltage", "strain"), constraints={"pull_in": 1.2})
    front.write("front.csv", UNITS)

    front = optimise(my_finite_elements, {"elastomer": (1e-4, 3e-4)}, {"stroke_m": "max"}, out="x")

    sensitivities(model, design, ("voltage", "strain")).table    # d ln(quantity)/d ln(variable)

pymoo is an optional extra: pip install "dea_fenicsx[design]".
"""

# ruff: noqa: F401  (for type checkers; names are loaded on demand, as in dea_fenicsx)
from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dea_fenicsx.design.front import Front
    from dea_fenicsx.design.helical import (
        CONSTRAINTS,
        EFFECTIVE_MU,
        ENVELOPE,
        OBJECTIVES,
        TABLE_4_2,
        UNITS,
        HelicalModel,
        exact_hypervolume,
    )
    from dea_fenicsx.design.improving import Analysis, Improved, improve
    from dea_fenicsx.design.searching import optimise, search
    from dea_fenicsx.design.sensitivity import Sensitivity, draw_sensitivities, sensitivities

_HOME = {
    "front": ("Front",),
    "helical": (
        "CONSTRAINTS", "EFFECTIVE_MU", "ENVELOPE", "OBJECTIVES", "TABLE_4_2", "UNITS",
        "HelicalModel", "exact_hypervolume",
    ),
    "improving": ("Analysis", "Improved", "improve"),
    "searching": ("optimise", "search"),
    "sensitivity": ("Sensitivity", "draw_sensitivities", "sensitivities"),
}  # fmt: skip
_WHERE = {name: module for module, names in _HOME.items() for name in names}
__all__ = sorted(_WHERE)


def __getattr__(name: str) -> Any:
    if name in _WHERE:
        return getattr(import_module(f"dea_fenicsx.design.{_WHERE[name]}"), name)
    raise AttributeError(f"dea_fenicsx.design has no {name!r}")


def __dir__() -> list[str]:
    return __all__
