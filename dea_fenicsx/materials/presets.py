"""The library of named materials, each with its source."""

from __future__ import annotations

import tomllib
import warnings
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from dea_fenicsx.materials.base import Elastic
from dea_fenicsx.materials.chains import ArrudaBoyce, Gent
from dea_fenicsx.materials.curve_data import TestData, read_data
from dea_fenicsx.materials.electric import Breakdown, Conductor, Electric, IdealDielectric
from dea_fenicsx.materials.material import Material, bulk_modulus_of
from dea_fenicsx.materials.ogden import Ogden
from dea_fenicsx.materials.polynomial import MooneyRivlin, NeoHookean, Yeoh
from dea_fenicsx.materials.stretches import TESTS, nominal_stress
from dea_fenicsx.materials.viscous import Maxwell
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.validation import nearest

MODELS: dict[str, Any] = {
    m.__name__: m for m in (NeoHookean, MooneyRivlin, Yeoh, Ogden, Gent, ArrudaBoyce)
}

MARKS = {
    "S": "read at the source",
    "M": "from memory of the literature, unverified",
    "D": "derived by least squares from data read at the source",
}


UNVERIFIED = "M"
"""The mark of presets that give a warning where they are used."""

UNTOLD_STRETCH = 3.0
"""Largest stretch in pictures of presets whose source does not tell the range of its tests."""

MOST_TOLD = 4
"""Number of sets for one rubber that a message tells."""


@dataclass(frozen=True)
class Preset:
    """A named material.

    Attributes
    ----------
    name : as in `list`
    material : the material
    mark : ``"S"``, ``"M"`` or ``"D"``, see `MARKS`
    source : where the constants come from
    note : what to beware of, or empty
    use : what it is for, in one line
    density_source : where the density comes from, or empty where there is none
    year : of the source, or None where it is not known
    stretches : least and largest stretch of the tests behind it, or None where not told
    curve : name of the measured curve that comes with it, or empty
    """

    name: str
    material: Material
    mark: str
    source: str
    note: str = ""
    use: str = ""
    density_source: str = ""
    year: int | None = None
    stretches: tuple[float, float] | None = None
    curve: str = ""

    def data(self) -> TestData | None:
        """The measured uniaxial curve that its constants were fitted to, or None without one."""
        if not self.curve:
            return None
        file = resources.files("dea_fenicsx.materials").joinpath("curves", f"{self.curve}.csv")
        with resources.as_file(file) as path:
            return read_data(path, "uniaxial", 0, 1, unit=1.0, delimiter=",")

    def __str__(self) -> str:
        note = f" {self.note}" if self.note else ""
        elastic, branches = self.material.elastic, self.material.viscous
        viscous = f", branches {', '.join(map(str, branches))}" if branches else ""
        return f"{self.name}: {elastic}{viscous} ({MARKS[self.mark]}: {self.source}).{note}"

    def plot(self, max_stretch: float | None = None, ax: Any = None) -> Any:
        """Draw the uniaxial, planar and equi-biaxial curves; returns the axes of matplotlib.

        Those of a viscous material are of its equilibrium, after an infinite time.  Measured points
        are drawn where they come with the preset.

        Parameters
        ----------
        max_stretch
            Largest stretch; by default that of the tests, or 3 where it is not told.
        ax
            Axes to draw on; made if None.
        """
        import matplotlib.pyplot as plt

        ax = ax or plt.subplots()[1]
        data = self.data()
        if max_stretch is None:
            max_stretch = self.stretches[1] if self.stretches else UNTOLD_STRETCH
        stretch = np.linspace(1, max_stretch, 200)
        for test in TESTS:
            ax.plot(stretch, nominal_stress(self.material.elastic, test, stretch) / 1e3, label=test)
        if data is not None:
            inside = data.stretch <= max_stretch
            points = data.stretch[inside], data.stress[inside] / 1e3
            ax.plot(*points, "ko", label="measured, uniaxial")
        ax.set_xlabel("stretch")
        ax.set_ylabel("nominal stress in kPa")
        ax.set_title(f"{self.name} ({self.year})" if self.year else self.name)
        ax.legend()
        return ax


def names() -> list[str]:
    """Names of all presets."""
    return sorted(_library())


def preset(name: str) -> Preset:
    """A preset with its source.

    Raises
    ------
    InputError
        If there is none of this name; the nearest is named.
    """
    library = _library()
    if not isinstance(name, str) or name not in library:
        raise InputError(f"There is no material named {shown(name)}; {_advice(str(name))}")
    return library[name]


def _advice(name: str) -> str:
    """Which set to take instead of one that is not there."""
    library = _library()
    family = [other for other in library if _plain(name) and _plain(other).startswith(_plain(name))]
    if len(family) > 1:
        first, *told = [f"{other!r} ({library[other].use})" for other in family[:MOST_TOLD]]
        more = f" and {len(family) - MOST_TOLD} more" if len(family) > MOST_TOLD else ""
        return (
            f"the nearest is {first}; there are also {', '.join(told)}{more}; `dea materials` "
            "lists all."
        )
    near = nearest(name.lower(), library, cutoff=0.0)
    return f"the nearest is {near!r}, and dea_fenicsx.materials.list() names all."


def _plain(name: str) -> str:
    """Letters and digits of a name, in small letters."""
    return "".join(c for c in name.lower() if c.isalnum())


def get(name: str) -> Material:
    """The material of a preset; see `preset`.

    A preset with the mark M, whose constants nobody compared with their source, gives a warning.
    """
    found = preset(name)
    if found.mark == UNVERIFIED:
        warnings.warn(
            f"The constants of {name!r} are {MARKS[UNVERIFIED]} ({found.source}); compare them "
            "with their source, or take a preset with another mark.",
            stacklevel=2,
        )
    return found.material


@cache
def _library() -> dict[str, Preset]:
    text = resources.files("dea_fenicsx.materials").joinpath("presets.toml").read_text("utf-8")
    return {name: _build(name, entry) for name, entry in tomllib.loads(text).items()}


def _build(name: str, entry: dict[str, Any]) -> Preset:
    bulk = entry.get("bulk_modulus")
    constants = entry.get("constants", {})
    if "young" in entry:
        mu = entry["young"] / (2 * (1 + entry["poisson"]))
        constants = {"mu": mu}
        bulk = bulk_modulus_of(mu, entry["poisson"])
    elastic: Elastic
    if entry["model"] == "Ogden":
        make = {"eq76": Ogden.from_eq76, "abaqus": Ogden.from_abaqus}[entry["convention"]]
        elastic = make(**constants)
    else:
        elastic = MODELS[entry["model"]](**constants)
    viscous = tuple(Maxwell(**branch) for branch in entry.get("viscous", ()))
    electric: Electric
    if entry.get("conductor"):
        electric = Conductor()
    else:
        law = Breakdown(**entry["breakdown"]) if "breakdown" in entry else None
        electric = IdealDielectric(entry["eps_r"], law)
    return Preset(
        name,
        Material(elastic, electric, bulk, name, viscous, entry.get("density")),
        entry["mark"],
        entry["source"],
        entry.get("note", ""),
        entry["use"],
        entry.get("density_source", ""),
        entry.get("year"),
        tuple(entry["stretches"]) if "stretches" in entry else None,
        entry.get("curve", ""),
    )
