"""Parametric gmsh geometry, one device family a file.

Every family is a frozen dataclass that is checked when it is made, knows its closed-form volumes
and areas, and hands a mesh with *named* physical groups to gmsh.  Materials are not known here.
The families are loaded on first use, so that ``python -m dea_fenicsx.geometry.hdea`` runs clean.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .base import Geometry, Layer
from .grading import graded

if TYPE_CHECKING:
    from .air_box import AirBox
    from .air_core import AirCore
    from .air_gap import AirGap
    from .balloon import Balloon
    from .box_stack import BoxStack
    from .dea_hinge import DEAHinge
    from .disc_capacitor import DiscCapacitor
    from .disk_stack import DiskStack
    from .fingers import FingerStack
    from .hdea import HDEA
    from .helical_cell import HelicalCell
    from .hollow_sphere import HollowSphere
    from .kresling_cell import KreslingCell
    from .membrane_disc import MembraneDisc
    from .meridian import Meridian
    from .roll import Roll
    from .stiffened_film import StiffenedFilm, StiffenedSection
    from .tabbed_stack import TabbedStack
    from .tube import Tube

__all__ = [
    "AirBox", "AirCore", "AirGap", "Balloon", "BoxStack", "DEAHinge", "DiscCapacitor", "DiskStack",
    "FingerStack", "Geometry", "HDEA", "HelicalCell", "HollowSphere", "KreslingCell", "Layer",
    "MembraneDisc", "Meridian", "Roll", "StiffenedFilm", "StiffenedSection", "TabbedStack",
    "Tube", "graded",
]  # fmt: skip

_HOME = {
    "AirBox": "air_box",
    "AirCore": "air_core",
    "AirGap": "air_gap",
    "Balloon": "balloon",
    "BoxStack": "box_stack",
    "DEAHinge": "dea_hinge",
    "DiscCapacitor": "disc_capacitor",
    "DiskStack": "disk_stack",
    "FingerStack": "fingers",
    "HDEA": "hdea",
    "HelicalCell": "helical_cell",
    "HollowSphere": "hollow_sphere",
    "KreslingCell": "kresling_cell",
    "MembraneDisc": "membrane_disc",
    "Meridian": "meridian",
    "Roll": "roll",
    "StiffenedFilm": "stiffened_film",
    "StiffenedSection": "stiffened_film",
    "TabbedStack": "tabbed_stack",
    "Tube": "tube",
}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f".{_HOME[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
