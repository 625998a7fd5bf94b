"""Rotation of a surface as a whole, such as an end face that bends or twists.

The rotation R of a facet group is that of the rigid motion which is nearest to the motion of the
group, in the mean square over the undeformed area.  With a = X - mean X, b = x - mean x and the
singular value decomposition

    int b a^T dA = U S V^T,   R = U diag(1, 1, det(U V^T)) V^T

(Kabsch, Acta Cryst. A32 (1976) 922).  R is exact for a rigid motion and a mean for a warped face.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI

from dea_fenicsx.measure.observables import Measurement
from dea_fenicsx.mesh.device import one_sided
from dea_fenicsx.model.fields import Role
from dea_fenicsx.model.kernels import measure
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import known


@dataclass(frozen=True)
class Rotation:
    """Rotation of a facet group about an axis, in rad: a component of its rotation vector.

    The vector's direction is the axis of the rotation R (see this module), its length the angle,
    0 to pi.

    Parameters
    ----------
    where
        A facet group, or two: of the second relative to the first, R_2 R_1^T.
    about
        ``"x"``, ``"y"`` or ``"z"``, fixed in space; in plane strain all turns about ``"z"``, and
        about the others it is 0.
    """

    where: str | tuple[str, str]
    about: str
    unit = "rad"

    def bind(self, problem: Problem) -> Measurement:
        k = _axis(self.about)
        _is_flat(problem)  # refuses kinematics without rotations
        rotation = _relative(problem, self.where)
        return lambda: float(_vector(rotation())[k])


@dataclass(frozen=True)
class BendingAngle:
    """Angle in rad by which the normals of two end faces part: between R_1 e and R_2 e.

    The angle has no direction, so it is never negative.  A twist about the axis e does not change
    it.

    Parameters
    ----------
    between
        Two facet groups, or one: the angle by which its own axis turns.
    axis
        The axis e that runs from one to the other: by default ``"z"``, and in plane strain, where
        any axis of the plane turns alike, ``"x"``.
    """

    between: str | tuple[str, str]
    axis: str | None = None
    unit = "rad"

    def bind(self, problem: Problem) -> Measurement:
        flat = _is_flat(problem)
        k = _axis(self.axis or ("x" if flat else "z"))
        if flat and k == 2:
            raise InputError(
                f"The bending angle of {self.between!r} is of the axis 'z', but in plane strain "
                "that axis never turns; name 'x' or 'y', or leave it out."
            )
        names = (self.between,) if isinstance(self.between, str) else tuple(self.between)
        rotations = [_rotation(problem, name) for name in names]

        def value() -> float:
            a, b = np.eye(3)[k] if len(names) == 1 else rotations[0]()[:, k], rotations[-1]()[:, k]
            return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))

        return value


def _is_flat(problem: Problem) -> bool:
    """Whether all turns in a plane; refuses kinematics in which no face turns as a whole."""
    dim = problem.scene.device.dim
    if not problem.scene.kinematics.cartesian:
        raise InputError(
            "Rotations are measured in three dimensions and in plane strain only; a helical cell "
            "has OverallTwist."
        )
    return dim == 2


def _axis(name: str) -> int:
    if name not in ("x", "y", "z"):
        raise InputError(f"The axis is {name!r}, but must be one of x, y, z.")
    return "xyz".index(name)


def _vector(R: np.ndarray) -> np.ndarray:
    """Rotation vector of a rotation, accurate at small angles and near pi."""
    skew = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    sine, cosine = np.linalg.norm(skew), (np.trace(R) - 1) / 2
    angle = np.arctan2(sine, cosine)
    if sine > 1e-6 or cosine > 0:
        return skew * (angle / sine if sine > 0 else 1.0)
    values, vectors = np.linalg.eigh((R + R.T) / 2)  # half a turn: the axis stays where it is
    return angle * vectors[:, np.argmax(values)]


def _relative(problem: Problem, where: str | tuple[str, str]) -> Callable[[], np.ndarray]:
    if isinstance(where, str):
        return _rotation(problem, where)
    first, second = (_rotation(problem, name) for name in where)
    return lambda: second() @ first().T


def _rotation(problem: Problem, where: str) -> Callable[[], np.ndarray]:
    """Rotation matrix of a facet group, bound to a problem.  Collective."""
    device = problem.scene.device
    dim = device.dim
    known(where, device.surfaces, "facet group")
    mesh, comm = problem.mesh, problem.comm
    degree = problem.scene.elements.quadrature_of_surfaces
    ds = measure(device, [one_sided(device, where)], degree, "ds")(0)
    x = ufl.SpatialCoordinate(mesh)
    # One compiled form serves all moments; the constants select the moment.
    c, d = (dolfinx.fem.Constant(mesh, np.zeros(4)) for _ in range(2))
    e = dolfinx.fem.Constant(mesh, np.zeros(dim))

    def linear(k: Any) -> Any:
        return k[0] + sum(k[i + 1] * x[i] for i in range(dim))

    area_form = compat.compile_form(linear(c) * linear(d) * ds)
    v = problem.space.symbolic(Role.MOTION, ufl.TestFunction(problem.W))
    work_form = compat.compile_form(linear(c) * ufl.dot(e, v) * ds)

    def moment(p: np.ndarray, q: np.ndarray) -> float:
        c.value[:], d.value[:] = p, q
        mine = dolfinx.fem.assemble_scalar(area_form)
        return float(np.real(comm.allreduce(mine, op=MPI.SUM)))

    one, unit = np.eye(4)[0], np.eye(4)[1:]
    area = moment(one, one)
    middle = [moment(one, unit[i]) / area for i in range(dim)]
    arms = [unit[i] - middle[i] * one for i in range(dim)]  # components of a = X - mean X
    rest = np.zeros((3, 3))
    rest[:dim, :dim] = [[moment(a, b) for b in arms] for a in arms]
    if dim == 2:
        rest[2, 2] = np.trace(rest)  # the depth does not turn
    weights: np.ndarray = np.zeros((3, 3, problem.owned))
    for i in range(dim):
        for j in range(dim):
            c.value[:], e.value[:] = arms[j], np.eye(dim)[i]
            vector = dolfinx.fem.assemble_vector(work_form)
            vector.scatter_reverse(dolfinx.la.InsertMode.add)
            weights[i, j] = vector.array[: problem.owned]
    # most entries are zero: keep those of the face
    seen = np.flatnonzero(np.any(weights, axis=(0, 1)))
    weights = weights[:, :, seen].copy()

    def value() -> np.ndarray:
        mine = weights @ problem.w.x.array[seen]
        U, _, Vt = np.linalg.svd(rest + comm.allreduce(mine, op=MPI.SUM))
        return U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt

    return value
