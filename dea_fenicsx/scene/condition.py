"""The base of all conditions of a scene.

A condition checks itself against the scene and describes itself to the model by declarations.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Protocol

from dea_fenicsx.materials import Material
from dea_fenicsx.mesh.device import Device, group_size
from dea_fenicsx.scene.declarations import Declaration, GlobalUnknown
from dea_fenicsx.scene.kinematics_base import Kinematics
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.validation import known


class Setting(Protocol):
    """The part of a scene that a condition may read; see `Scene`."""

    @property
    def device(self) -> Device: ...
    @property
    def materials(self) -> Mapping[str, Material]: ...
    @property
    def kinematics(self) -> Kinematics: ...
    @property
    def electrodes(self) -> Sequence[Any]: ...
    @property
    def supports(self) -> Sequence[Support]: ...
    @property
    def prescribed(self) -> Sequence[Prescribed]: ...
    @property
    def loads(self) -> Sequence[Load]: ...
    @property
    def temperature(self) -> float | None: ...


type Told = Sequence[tuple[Condition, Declaration]]
"""All declarations of a scene, each with the condition that makes it."""


class Condition(ABC):
    """Anything that a user imposes on a device.

    A condition of one's own is a frozen dataclass below `Support`, `Prescribed` or `Load` that
    states its `declarations`.  Those of the latter two have a field ``ramp``.
    """

    heats: ClassVar[bool] = False
    """Whether its ramp changes temperatures and nothing else."""

    @property
    def surface_names(self) -> tuple[str, ...]:
        """Facet groups that it names."""
        return ()

    @property
    def region_names(self) -> tuple[str, ...]:
        """Regions that it names."""
        return ()

    @property
    def joined_surfaces(self) -> tuple[str, str] | None:
        """Two facet groups that it makes one place; None for most conditions."""
        return None

    @property
    def rigid_part(self) -> str | None:
        """The facet group or region that it makes rigid; None for most conditions."""
        return None

    def check(self, scene: Setting) -> None:
        """Raise InputError unless it makes sense in a scene.  Collective.

        Without more, the groups that it names must be in the mesh, and the surfaces have facets.
        """
        for name in self.surface_names:
            known(name, scene.device.surfaces, "facet group")
            if group_size(scene.device, name) == 0:
                raise InputError(f"{type(self).__name__} on {name!r} finds no facets in the mesh.")
        for name in self.region_names:
            known(name, scene.device.regions, "region")

    @abstractmethod
    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        """The declarations that describe this condition to the model.

        The scene asks for them once, after `check` of all conditions.
        """

    @property
    def moved_by(self) -> str | None:
        """The ramp that changes what it does; None for one that stays as it is."""
        return None

    def check_beside(self, told: Told) -> None:  # noqa: B027  (most have nothing to check)
        """Raise InputError unless it agrees with what all conditions of a scene declare."""


class Support(Condition):
    """What holds a device at every load.

    One that a ramp brings to its state, such as a strained spring, names this ramp in `moved_by`.
    """


class Extension(Support):
    """Fields and terms of one's own, which it declares as `AddedPhysics`.

    No ramp drives it, so it is listed among the supports of a scene.
    """


class Driven(Condition):
    """A condition that is driven by a ramp, whose name is a field of its class."""

    ramp: str

    @property
    def moved_by(self) -> str | None:
        return self.ramp


class Prescribed(Driven):
    """A motion or a stretch that is driven by a ramp."""


class Load(Driven):
    """Forces that are driven by a ramp."""


class OnSurface:
    """A condition on the facet group `where`."""

    where: str

    @property
    def surface_names(self) -> tuple[str, ...]:
        return (self.where,)


class OnGroups:
    """A condition on the group `where` of the mesh, or on several groups."""

    where: str | tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its groups."""
        return (self.where,) if isinstance(self.where, str) else tuple(self.where)

    @property
    def label(self) -> str:
        """The names in one."""
        return "+".join(self.names)


class InRegions(OnGroups):
    """A condition in the region `where`, or in several regions."""

    @property
    def region_names(self) -> tuple[str, ...]:
        return self.names

    def check_named(self) -> None:
        """Raise InputError if no region is named."""
        if not self.names:
            raise InputError(
                f"{type(self).__name__} names no region; give it at least one name."
            )


def of_kind[D: Declaration](told: Told, kind: type[D]) -> list[tuple[Condition, D]]:
    """The declarations of one kind, each with its condition, in their order."""
    return [(item, one) for item, one in told if isinstance(one, kind)]


def check_global(scene: Setting, unknown: GlobalUnknown, item: object) -> None:
    """Raise InputError if an item needs a global unknown that the scene's kinematics lacks."""
    if unknown not in scene.kinematics.global_unknowns:
        raise InputError(
            f"{type(item).__name__} is for {unknown.used_in}; take "
            f"kinematics={unknown.kinematics}."
        )


def check_axes(item: Any, axes: str, scene: Setting) -> None:
    """Raise InputError unless a condition on a surface names displacement components."""
    known_axes = scene.kinematics.axes
    if not axes or any(a not in known_axes for a in axes):
        raise InputError(
            f"{type(item).__name__} on {item.where!r} names the axes {axes!r}, but must name one "
            f"or more of {', '.join(known_axes)}."
        )
