"""Places as seen from a rigid part, for obstacles that it carries."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import ufl

from dea_fenicsx.model.rigid_parts import RigidPart


def seen_from(part: RigidPart, turns: str, q: Any, place: Any, along: Sequence[int]) -> Any:
    """The place that a point of the carrier had in the undeformed device: X0 + R^T (x - X0 - c).

    Parameters
    ----------
    part
        The rigid part with its centre X0.
    turns
        The axes of coordinates about which it turns.  In space it is one at most, since the rows of
        other rotations are no derivatives by the unknowns; see `rigid_turns`.
    q
        Its unknowns, symbolic: the displacement c of the centre first, then rotations.
    place
        A place in space, dimensionless, a 3-vector.
    along
        Which components in space the displacement has.
    """
    n = len(part.shifts)
    unknowns = [q] if not q.ufl_shape else [q[k] for k in range(q.ufl_shape[0])]
    arm = [place[i] for i in range(3)]
    for a, i in enumerate(along):
        moved = sum(float(s) * x for s, x in zip(part.shifts[:, a], unknowns, strict=False) if s)
        arm[i] = arm[i] - float(part.centre[a]) - moved
    angles = unknowns[n:]
    for name in turns if angles else "":
        axis = "xyz".index(name)
        angle = angles[axis] if len(angles) == 3 else angles[0]
        i, j = (axis + 1) % 3, (axis + 2) % 3
        cos, sin = ufl.cos(angle), ufl.sin(angle)
        arm[i], arm[j] = cos * arm[i] + sin * arm[j], cos * arm[j] - sin * arm[i]
    for a, i in enumerate(along):
        arm[i] = arm[i] + float(part.centre[a])
    return ufl.as_vector(arm)
