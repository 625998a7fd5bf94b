"""Derivatives of a test's prediction by the coordinates of a calibration."""

from __future__ import annotations

import numpy as np

from dea_fenicsx.calibration.experiments import Experiment
from dea_fenicsx.calibration.parameters import Coordinates


def slopes_of(over: Coordinates, z: np.ndarray, test: Experiment) -> dict[str, np.ndarray]:
    """The derivatives of all columns by the coordinates, each of shape (n, p).  Collective.

    They are those of the test where it knows them, and central differences otherwise.
    """
    trial = over.trial(z)
    exact = test.slopes(trial)
    found = {c.name: np.zeros((len(c.measured), len(z))) for c in test.columns()}
    for k, p in enumerate(over.all):
        own = exact.get(p.name)
        if own is None:
            ends = []
            for sign in (-1.0, 1.0):
                moved = z.copy()
                moved[k] += sign * test.step
                ends.append(test.predict(over.trial(moved)))
            own = {
                name: (np.asarray(ends[1][name]) - np.asarray(ends[0][name])) / (2 * test.step)
                for name in found
            }
            scale = 1.0
        else:
            scale = p.slope(trial[p.name])
        for name, values in found.items():
            values[:, k] = np.asarray(own[name]) * scale
    return found
