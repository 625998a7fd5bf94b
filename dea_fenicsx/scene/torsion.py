"""Torsional springs on rigid parts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dea_fenicsx.scene.condition import Setting, Support, Told, of_kind
from dea_fenicsx.scene.declarations import Declaration
from dea_fenicsx.scene.own_functions import scalar_of, unknown_number
from dea_fenicsx.scene.part_declarations import RigidSurface
from dea_fenicsx.scene.springs import CubicLaw, SpringForce
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import is_number, shown
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite, known


@dataclass(frozen=True)
class TorsionMoment(SpringForce):
    """A torsional spring on a rigid part; `law` is its moment in N m from its angle in rad.

    Attributes
    ----------
    axis
        The axis about which it acts.
    length
        The angle in rad without moment, reached at ramp factor 1, or None.
    """

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        return {} if self.length is None else {"angle of a spring": (self.length,)}


@dataclass(frozen=True)
@in_si(rest="rad")
class TorsionSpring(Support):
    """A torsional spring between a rigid part and the ground, or another rigid part.

    Its angle is that by which the part has turned about an axis, less that of the part `to` and
    less `rest`; several turns count.  In space the part turns about this axis alone, as of
    ``Rigid(..., turns="z")``.  Its energy is part of `Energy("springs")`.

    Parameters
    ----------
    where
        The name that is `Rigid`.
    law
        Stiffness in N m/rad, or the moment in N m as a function of the angle in rad: a `TableLaw`
        or a function of your own that takes numbers and UFL expressions.
    about
        The axis: ``"x"``, ``"y"`` or ``"z"``; in a plane ``"z"``.
    to
        The rigid part at its other end; by default the ground.
    rest
        Angle in rad at which it has no moment, reached on the ramp.
    ramp
        Ramp that brings the spring to `rest`, at factor 1.
    """

    where: str
    law: float | Callable[..., Any]
    about: str = "z"
    to: str | None = None
    rest: float = 0.0
    ramp: str = "spring"

    @property
    def moved_by(self) -> str | None:
        return self.ramp if self.rest else None

    @property
    def _ends(self) -> tuple[str, ...]:
        return (self.where,) if self.to is None else (self.where, self.to)

    def check(self, scene: Setting) -> None:
        names = [*scene.device.surfaces, *scene.device.regions]
        for name in self._ends:
            known(name, names, "facet group or region")
        what = f"The torsional spring on {self.where!r}"
        finite(self.rest, f"rest= of the torsional spring on {self.where!r}")
        self._check_law(what)
        turns = {3: "xyz", 1: "z", 0: ""}[scene.kinematics.rotations]
        if not turns:
            raise InputError(f"{what} is for three dimensions and plane strain only.")
        if self.about not in turns or len(self.about) != 1:
            raise InputError(
                f"{what} is about {self.about!r}, but must be about {' or '.join(turns)}."
            )
        if self.to == self.where:
            raise InputError(f"{what} ends there, too; leave to= out.")
        others = [item.ramp for item in (*scene.loads, *scene.prescribed)]
        if self.moved_by is not None and (self.ramp in others or not self.ramp):
            raise InputError(
                f"{what} and a load or a prescribed motion share the ramp {self.ramp!r}; give the "
                "spring a ramp of its own, and move both in one Ramp((..., ...))."
            )

    def _check_law(self, what: str) -> None:
        if is_number(self.law):
            finite(self.law, f"The stiffness of the torsional spring on {self.where!r}")
            return
        if not callable(self.law):
            raise InputError(
                f"The law of the torsional spring on {self.where!r} is {shown(self.law)}, but must "
                "be a stiffness in N m/rad or a function of the angle."
            )
        try:
            moment = float(self.law(0.0))
        except Exception as error:
            told = " ".join(str(error).split())
            raise InputError(f"{what} has a law that fails at the angle 0 ({told}).") from error
        finite(moment, f"The moment of the torsional spring on {self.where!r} at the angle 0")
        at = unknown_number()
        scalar_of(self.law, at, f"The law of {what[0].lower()}{what[1:]}", "the moment in N m")

    def check_beside(self, told: Told) -> None:
        parts = {one.surface: one for _, one in of_kind(told, RigidSurface)}
        for name in self._ends:
            if name not in parts:
                raise InputError(
                    f"TorsionSpring on {name!r} needs a rigid part; add Rigid({name!r}) to the "
                    "supports."
                )
            if parts[name].turns != self.about:
                raise InputError(
                    f"The torsional spring on {self.where!r} is about {self.about!r}, but "
                    f"{name!r} turns about {parts[name].turns or 'no axis'}; give "
                    f"Rigid({name!r}, turns={self.about!r})."
                )

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        law = self.law if callable(self.law) else CubicLaw(float(self.law))
        ramp = self.moved_by
        angle = None if ramp is None else self.rest
        return [TorsionMoment(self.where, law, self.about, self.to, None, angle, ramp)]
