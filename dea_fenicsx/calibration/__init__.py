"""Calibration: constants from experiments of all kinds, their certainty, and what follows from it.

    found = dea.calibrate(
        [RateTests("cycles", data), SceneTest("bender", build, path, record, volts, measured)],
        [dea.Parameter("elastic.mu", 5e4), dea.Parameter("electric.eps_r", 3.0)], material,
    )
    found.values, found.interval("elastic.mu"), found.loose, found.predict(test)
    found.write("results/fit")

    dea.uncertainty(model, {"mu": Scatter(5e4, 2e3)}, failure={"breakdown_margin": 1.0})

The room stands above `studies`, whose samples it takes, and a fit runs scenes as a study does.
"""

# ruff: noqa: F401  (for type checkers; names are loaded on demand, as in dea_fenicsx)
from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dea_fenicsx.calibration.experiments import FunctionTest, RateTests
    from dea_fenicsx.calibration.film_tests import FilmTest
    from dea_fenicsx.calibration.fitting import calibrate
    from dea_fenicsx.calibration.parameters import Parameter
    from dea_fenicsx.calibration.result import Calibration
    from dea_fenicsx.calibration.scatter import Scatter, Uncertainty, uncertainty
    from dea_fenicsx.calibration.scene_tests import SceneTest
    from dea_fenicsx.calibration.selection import Selection, select

_HOME = {
    "experiments": ("FunctionTest", "RateTests"),
    "film_tests": ("FilmTest",),
    "fitting": ("calibrate",),
    "parameters": ("Parameter",),
    "result": ("Calibration",),
    "scene_tests": ("SceneTest",),
    "selection": ("Selection", "select"),
    "scatter": ("Scatter", "Uncertainty", "uncertainty"),
}
_WHERE = {name: module for module, names in _HOME.items() for name in names}
__all__ = sorted(_WHERE)


def __getattr__(name: str) -> Any:
    if name in _WHERE:
        return getattr(import_module(f"dea_fenicsx.calibration.{_WHERE[name]}"), name)
    raise AttributeError(f"dea_fenicsx.calibration has no {name!r}")


def __dir__() -> list[str]:
    return __all__
