"""Springs between rigid parts and the ground, and elastic foundations of surfaces."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dea_fenicsx.scene.condition import OnSurface, Setting, Support, Told, of_kind
from dea_fenicsx.scene.declarations import Declaration, SurfaceFields, SurfaceWork
from dea_fenicsx.scene.own_functions import scalar_of, unknown_number
from dea_fenicsx.scene.part_declarations import RigidSurface
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import is_number, shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite, known, positive


@dataclass(frozen=True)
@in_si(linear="N/m", cubic="N/m**3")
class CubicLaw:
    """Force k d + k3 d^3 in N at the elongation d in m.

    With k < 0 < k3 the spring is bistable about d = 0.

    Parameters
    ----------
    linear, cubic
        k in N/m and k3 in N/m^3.
    """

    linear: float
    cubic: float = 0.0

    def __post_init__(self) -> None:
        _check_numbers(self, ("linear", "cubic"))

    def __call__(self, d: Any) -> Any:
        """The force, a number or an expression."""
        return self.linear * d + self.cubic * d * d * d


@dataclass(frozen=True)
@in_si(newtons="N", metres="m")
class BistableLaw:
    """Force of a bistable spring: 0 at the elongations 0, s/2 and s, with peaks of +F and -F.

    It is the cubic c d (d - s/2) (d - s) with c = 12 sqrt(3) F/s^3.

    Parameters
    ----------
    newtons
        The peak force F.
    metres
        The distance s of the two stable states; negative for one in the other direction.
    """

    newtons: float
    metres: float

    def __post_init__(self) -> None:
        _check_numbers(self, ("newtons", "metres"))
        if self.metres == 0:
            raise InputError("metres= of BistableLaw is 0, but must be a distance.")

    def __call__(self, d: Any) -> Any:
        """The force, a number or an expression."""
        s = self.metres
        c = 12 * float(np.sqrt(3.0)) * self.newtons / abs(s) ** 3
        return c * d * (d - s / 2) * (d - s)


def _check_numbers(law: CubicLaw | BistableLaw, names: Sequence[str]) -> None:
    """Raise InputError unless the constants of a law are finite numbers."""
    for name in names:
        value = getattr(law, name)
        if not is_number(value) or not np.isfinite(float(value)):
            raise InputError(
                f"{name}= of {type(law).__name__} is {shown(value)}, but must be a finite number."
            )


@dataclass(frozen=True)
class SpringForce(Declaration):
    """A spring on a rigid part.

    Attributes
    ----------
    surface
        Name of the part.
    law
        Its force in N from its elongation in m, a number or a UFL expression.
    axis
        The axis along which it acts, or None for one between two points.
    to
        The name of the part at its other end; None for the ground.
    anchor
        The other point in m, where it has two.
    length
        Its length in m without force between two points, or None for the initial one; along an axis
        the displacement at which it has no force.  It is reached at ramp factor 1; at 0 the spring
        has no force where nothing has moved.
    ramp
        Name of the ramp, or None where nothing is to be reached.
    """

    surface: str
    law: Callable[[Any], Any]
    axis: str | None
    to: str | None
    anchor: tuple[float, ...] | None
    length: float | None
    ramp: str | None = None

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        return {} if self.length is None else {"length of a spring": (self.length,)}


@dataclass(frozen=True)
@in_si(rest="m", anchor="m", length="m")
class Spring(Support):
    """A spring between the centre of a rigid part and the ground, or another rigid part.

    Along an axis its elongation is the displacement of the part, less that of the part `to` and
    less `rest`.  Between the point `anchor`, which is fixed, and the centre it is the distance less
    the free length.  It has an energy, `Energy("springs")`, so that the tangent stays symmetric and
    the count of negative eigenvalues is that of the device with its springs.

    A spring that is strained from the start, by `rest` or by a free length, is brought there on a
    ramp, for a run begins in the undeformed device without forces.

    Parameters
    ----------
    where
        The name that is `Rigid`.
    law
        Stiffness in N/m, or the force in N as a function of the elongation in m: `CubicLaw`,
        `BistableLaw` or a function of your own that takes numbers and UFL expressions.
    axis
        The axis along which it acts.
    to
        The rigid part at its other end; by default the ground.
    rest
        Displacement in m along the axis at which it has no force.
    anchor
        The fixed point in m of a spring between two points.
    length
        Free length in m of a spring between two points; by default its initial length.
    ramp
        Ramp that brings the spring to `rest` or to its free length, at factor 1.
    """

    where: str
    law: float | Callable[..., Any]
    axis: str | None = None
    to: str | None = None
    rest: float = 0.0
    anchor: tuple[float, ...] | None = None
    length: float | None = None
    ramp: str = "spring"

    @property
    def moved_by(self) -> str | None:
        return self.ramp if self.rest or self.length is not None else None

    def check(self, scene: Setting) -> None:
        names = [*scene.device.surfaces, *scene.device.regions]
        for name in (self.where, *([] if self.to is None else [self.to])):
            known(name, names, "facet group or region")
        self._check_law()
        what, kinematics = f"The spring on {self.where!r}", scene.kinematics
        others = [item.ramp for item in (*scene.loads, *scene.prescribed)]
        if self.moved_by is not None and (self.ramp in others or not self.ramp):
            raise InputError(
                f"{what} and a load or a prescribed motion share the ramp {self.ramp!r}; give the "
                "spring a ramp of its own, and move both in one Ramp((..., ...))."
            )
        finite(self.rest, f"rest= of the spring on {self.where!r}")
        if (self.axis is None) == (self.anchor is None):
            raise InputError(f"{what} needs one of axis= and anchor=; give where it acts.")
        axes = tuple(kinematics.axes) if kinematics.cartesian else tuple(kinematics.axes[-1:])
        if self.axis is not None and self.axis not in axes:
            raise InputError(
                f"{what} acts along {self.axis!r}, but must act along {' or '.join(axes)}."
            )
        if self.axis is not None and self.length is not None:
            raise InputError(f"{what} acts along an axis, where rest= stands for length=.")
        if self.anchor is not None:
            self._check_anchor(what, scene)

    def _check_law(self) -> None:
        """Raise InputError unless the law gives a finite force at rest."""
        if is_number(self.law):
            finite(self.law, f"The stiffness of the spring on {self.where!r}")
            return
        if not callable(self.law):
            raise InputError(
                f"The law of the spring on {self.where!r} is {shown(self.law)}, but must be a "
                "stiffness in N/m or a function of the elongation."
            )
        try:
            force = float(self.law(0.0))
        except Exception as error:
            told = " ".join(str(error).split())
            raise InputError(
                f"The law of the spring on {self.where!r} fails at the elongation 0 ({told})."
            ) from error
        finite(force, f"The force of the spring on {self.where!r} at the elongation 0")
        at = unknown_number()
        scalar_of(self.law, at, f"The law of the spring on {self.where!r}", "the force in N")

    def _check_anchor(self, what: str, scene: Setting) -> None:
        axes = scene.kinematics.axes
        assert self.anchor is not None
        if not scene.kinematics.cartesian:
            raise InputError(f"{what} has an anchor, but in an axisymmetric section acts along z.")
        if len(self.anchor) != len(axes):
            raise InputError(
                f"The anchor of the spring on {self.where!r} has {len(self.anchor)} components, "
                f"but must have {len(axes)}: one for each of {', '.join(axes)}."
            )
        for value in self.anchor:
            finite(value, f"The anchor of the spring on {self.where!r}")
        if self.length is not None:
            positive(self.length, f"length= of the spring on {self.where!r}")
        if self.to is not None or self.rest:
            raise InputError(f"{what} has an anchor, so leave to= and rest= out.")

    def check_beside(self, told: Told) -> None:
        parts = {one.surface for _, one in of_kind(told, RigidSurface)}
        for name in (self.where, *([] if self.to is None else [self.to])):
            if name not in parts:
                raise InputError(
                    f"Spring on {name!r} needs a rigid part; add Rigid({name!r}) to the supports, "
                    f"or take ElasticFoundation({name!r}, ...)."
                )
        if self.to == self.where:
            raise InputError(f"The spring on {self.where!r} ends there, too; leave to= out.")

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        law = self.law if callable(self.law) else CubicLaw(float(self.law))
        length = self.length if self.axis is None else self.rest
        ramp = self.moved_by
        return [SpringForce(self.where, law, self.axis, self.to, self.anchor, length, ramp)]


@dataclass(frozen=True)
class FoundationWork(SurfaceWork):
    """Work of a foundation of a stiffness in N/m^3, for each axis; it is there at every load."""

    stiffness: tuple[float, ...]
    metre: float
    follows: ClassVar[bool] = True

    def density(self, at: SurfaceFields) -> Any:
        u, v = at.displacement, at.virtual
        pascals = tuple(k * self.metre for k in self.stiffness)
        moduli = at.stress(pascals)
        return -sum(moduli[a] * u[a] * v[a] for a in range(len(pascals)))


@dataclass(frozen=True)
@in_si(newtons_per_cubic_metre="N/m**3")
class ElasticFoundation(OnSurface, Support):
    """A bed of springs on a surface: the traction -k u by undeformed area, with k in N/m^3.

    Parameters
    ----------
    where
        Name of a facet group.
    newtons_per_cubic_metre
        k.
    axes
        Axes along which it acts; by default all.
    """

    where: str
    newtons_per_cubic_metre: float
    axes: str | None = None

    def check(self, scene: Setting) -> None:
        super().check(scene)
        k = self.newtons_per_cubic_metre
        finite(k, f"The stiffness of the foundation of {self.where!r}")
        if k < 0:
            raise InputError(f"The stiffness of the foundation of {self.where!r} is below 0.")
        if scene.kinematics.global_unknowns:
            raise InputError(
                f"ElasticFoundation on {self.where!r} is not available in "
                f"{scene.kinematics.title}; take ThreeD(), PlaneStrain() or Axisymmetric()."
            )
        axes = scene.kinematics.axes
        if self.axes is not None and (not self.axes or set(self.axes) - set(axes)):
            raise InputError(
                f"The foundation of {self.where!r} acts along {self.axes!r}, but must act along "
                f"one or more of {', '.join(axes)}."
            )

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        axes = scene.kinematics.axes
        chosen = axes if self.axes is None else self.axes
        k = tuple(self.newtons_per_cubic_metre * (axis in chosen) for axis in axes)
        return [FoundationWork(self.where, "", k, scene.device.length)]
