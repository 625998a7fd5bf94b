"""The pressure of a gas or a liquid on a membrane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dea_fenicsx.scene.body_forces import BodyFields, BodyWork
from dea_fenicsx.scene.condition import InRegions, Load, Setting
from dea_fenicsx.scene.declarations import Declaration
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite


@dataclass(frozen=True)
class PressureWork(BodyWork):
    """Work of a pressure in Pa on regions of a membrane, away from a point in m."""

    regions: tuple[str, ...]
    pascal: float
    away_from: tuple[float, ...]
    follows = True

    def amounts(self) -> Mapping[str, tuple[float, ...]]:
        return {"pascal": (self.pascal,)}

    def density(self, at: BodyFields) -> Any:
        return at.pressure(self.pascal, self.away_from, self.regions)


@dataclass(frozen=True)
@in_si(pascal="Pa", away_from="m")
class MembranePressure(InRegions, Load):
    """True pressure on one side of a membrane, which follows it: the force on dA is p cof(F) N dA.

    Parameters
    ----------
    where
        Name of a region of the film, or several names.
    pascal
        Pressure at ramp factor 1, in Pa.
    away_from
        A point in m, one number for each coordinate of the mesh, away from which the undeformed
        film is pushed: one inside of a balloon, or one below a flat film that is inflated upwards.
    """

    where: str | tuple[str, ...]
    pascal: float
    away_from: tuple[float, ...]
    ramp: str = "load"

    def check(self, scene: Setting) -> None:
        kinematics = scene.kinematics
        if not kinematics.is_membrane or kinematics.is_flat:
            raise InputError(
                "MembranePressure is for a membrane that can leave its plane; take "
                "AxisymmetricMembrane or SurfaceMembrane, or FollowerPressure on a solid."
            )
        super().check(scene)
        self.check_named()
        finite(self.pascal, f"The pressure on {', '.join(self.names)}")
        axes = kinematics.coordinates
        if len(self.away_from) != len(axes):
            raise InputError(
                f"away_from= of MembranePressure has {len(self.away_from)} coordinates, but must "
                f"have {len(axes)}: one for each of {', '.join(axes)}."
            )
        for value in self.away_from:
            finite(value, "away_from= of MembranePressure")

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        names = tuple(dict.fromkeys(self.names))
        return [PressureWork(self.ramp, names, self.pascal, tuple(map(float, self.away_from)))]
