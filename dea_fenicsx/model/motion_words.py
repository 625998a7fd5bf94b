"""Names of rigid motions, for messages."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dea_fenicsx.mesh.cell_quality import point
from dea_fenicsx.scene.kinematics_base import Kinematics


class BoundingCube(NamedTuple):
    """Middle, shape (3,), and half of the largest extent of a part, dimensionless."""

    middle: np.ndarray
    half: float


def in_words(kinematics: Kinematics, box: BoundingCube, free: np.ndarray, length: float) -> str:
    """The rigid motions that nothing holds, in words for a message.

    Parameters
    ----------
    kinematics
        The kinematics, which knows the order of the numbers of a motion.
    box
        Where the part lies, dimensionless.
    free
        One rigid motion in each row.
    length
        The unit of length in m.
    """
    width, axes = free.shape[1], kinematics.axes
    if len(free) == width > 1 and kinematics.cartesian:
        return f"every rigid motion, translations along {_listed(list(axes))} and rotations"
    words = []
    for row in _reduced(free):
        word = kinematics.motion_in_words(row)
        if word is not None:
            words.append(word)
            continue
        if len(axes) == 2:
            turn, shift = np.array([0.0, 0.0, row[0]]), np.array([*row[1:], 0.0])
        else:
            turn, shift = row[:3], row[3:]
        size = np.linalg.norm(turn)
        if size < 1e-6:
            words.append(f"translation along {_direction(shift)}")
            continue
        # Points of the axis move along it only.  Lengths are in units of half the part's size.
        along = float(turn @ shift) / size
        on_axis = np.cross(turn, shift) / size**2
        at = point((box.middle + box.half * on_axis) * length, len(axes))
        screw = "" if abs(along) < 1e-6 * size else " together with a translation along it"
        which = f"about the {_direction(turn)} axis " if len(axes) == 3 else ""
        words.append(f"rotation {which}{'through' if which else 'about'} {at}{screw}")
    return _listed(words)


def _reduced(rows: np.ndarray) -> np.ndarray:
    """Reduced row echelon form: the same space by vectors along the coordinates if possible."""
    rows = rows.copy()
    done = 0
    for column in range(rows.shape[1]):
        if done == len(rows):
            break
        pivot = done + int(np.argmax(np.abs(rows[done:, column])))
        if abs(rows[pivot, column]) < 1e-6:
            continue
        rows[[done, pivot]] = rows[[pivot, done]]
        rows[done] /= rows[done, column]
        for k in range(len(rows)):
            if k != done:
                rows[k] -= rows[k, column] * rows[done]
        done += 1
    rows[np.abs(rows) < 1e-9] = 0.0
    return rows


def _direction(vector: np.ndarray) -> str:
    unit = vector / np.linalg.norm(vector)
    k = int(np.argmax(np.abs(unit)))
    if abs(unit[k]) > 1 - 1e-6:
        return "xyz"[k]
    return f"({', '.join(f'{v + 0.0:.2g}' for v in np.round(unit, 6))})"


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
