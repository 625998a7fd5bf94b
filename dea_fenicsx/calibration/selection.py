"""Choosing among models by a criterion that counts their parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dea_fenicsx.calibration.experiments import Experiment
from dea_fenicsx.calibration.fitting import calibrate
from dea_fenicsx.calibration.parameters import Parameter
from dea_fenicsx.calibration.result import CRITERIA, Calibration
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import one_of


@dataclass(frozen=True, eq=False)
class Selection:
    """Models that were fitted to the same tests.

    Attributes
    ----------
    criterion
        ``"AICc"`` or ``"BIC"``.
    fits
        The calibration of each model by its name, the best first.
    scores
        The criterion of each, over that of the best one.
    """

    criterion: str
    fits: dict[str, Calibration]
    scores: dict[str, float]

    @property
    def best(self) -> Calibration:
        """The fit with the smallest criterion."""
        return next(iter(self.fits.values()))

    @property
    def best_name(self) -> str:
        """Its name."""
        return next(iter(self.fits))

    def __str__(self) -> str:
        rows = [
            f"{name}: {self.criterion} +{self.scores[name]:.4g}, {len(fit.parameters)} parameters, "
            f"residual {100 * max(f.relative for f in fit.columns):.2g} % at most"
            for name, fit in self.fits.items()
        ]
        return "\n".join(rows)

    __repr__ = __str__


def select(
    candidates: Mapping[str, tuple[Any, Sequence[Parameter]]],
    tests: Experiment | Sequence[Experiment],
    criterion: str = "AICc",
    **options: Any,
) -> Selection:
    """Fit several models to the same tests, and order them by a criterion.  Collective.

    Parameters
    ----------
    candidates
        For each name a material and the parameters that are fitted.
    tests
        As in `calibrate`.
    criterion
        ``"AICc"`` (Akaike's, corrected for few data) or ``"BIC"`` (Bayes').
    options
        Those of `calibrate`.

    Notes
    -----
    Residuals along a measured curve are correlated if the model misses its shape.  The number of
    independent ones is therefore that of the model that fits best, for all models alike.

    Raises
    ------
    InputError
        For no candidates, and as `calibrate`.
    """
    one_of(criterion, CRITERIA, "The criterion")
    if not candidates:
        raise InputError("There are no models to choose from; give at least one.")
    fits = {
        name: calibrate(tests, parameters, material, **options)
        for name, (material, parameters) in candidates.items()
    }
    nearest = min(fits.values(), key=lambda fit: min(fit.costs))
    n = float(nearest.independent.sum())
    scores = {name: fit.criterion(criterion, n) for name, fit in fits.items()}
    order = sorted(scores, key=lambda name: scores[name])
    least = scores[order[0]]
    return Selection(
        criterion, {name: fits[name] for name in order}, {n: scores[n] - least for n in order}
    )
