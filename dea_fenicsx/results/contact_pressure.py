"""The contact pressure on obstacles as a field of the results."""

from __future__ import annotations

import numpy as np

from dea_fenicsx.model.problem import Problem


def contact_pressure(problem: Problem, cells: int) -> np.ndarray | None:
    """The contact pressure in Pa on the facets of each of the first cells.  Collective.

    It is the contact force over the deformed area, and the largest one where several facets of a
    cell may touch.  It is 0 in all cells that touch nothing, and None without obstacles, or where
    the kinematics knows no deformed area.
    """
    contacts = problem.forms.contacts
    if not contacts or problem.scene.kinematics.overall:
        return None
    found = np.zeros(cells)
    for contact in contacts:
        np.maximum.at(found, contact.facets[:, 0], contact.points.pressures())
    return found * problem.scales.stress
