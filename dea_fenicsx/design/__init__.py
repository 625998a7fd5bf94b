"""Design search: NSGA-II (pymoo) on the analytic helical actuator or on any Python function.

    front = search("elastosil-2030", objectives=("voltage", "strain"), constraints={"pull_in": 1.2})
    front.write("front.csv", UNITS)

    front = optimise(my_finite_elements, {"elastomer": (1e-4, 3e-4)}, {"stroke_m": "max"}, out="x")

    for row in sensitivities(model, design): print(row)

pymoo is an optional extra: pip install "dea_fenicsx[design]".
"""

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
from dea_fenicsx.design.search import optimise, search
from dea_fenicsx.design.sensitivity import Sensitivity, draw_sensitivities, sensitivities

__all__ = [
    "search",
    "optimise",
    "Front",
    "HelicalModel",
    "ENVELOPE",
    "OBJECTIVES",
    "CONSTRAINTS",
    "UNITS",
    "TABLE_4_2",
    "EFFECTIVE_MU",
    "exact_hypervolume",
    "Sensitivity",
    "sensitivities",
    "draw_sensitivities",
]
