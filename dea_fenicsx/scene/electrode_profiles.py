"""The potential that an electrode is given at each place of it: its voltage times a profile."""

from __future__ import annotations

import numpy as np

from dea_fenicsx.scene.conditions import ChargedElectrode, Electrode, ThinFilm
from dea_fenicsx.scene.kinematics import Kinematics


def profile(
    kinematics: Kinematics, electrode: Electrode | ChargedElectrode, X: np.ndarray
) -> np.ndarray:
    """Potential over the electrode's voltage at undeformed positions X in m, shape (n, 3).

    It is 1 throughout an ordinary electrode.  Through a thin film it rises from 0 to 1, and a taper
    lets it fall from 1 to 0.
    """
    share = np.ones(len(X))
    if isinstance(electrode, ThinFilm):
        rise = coordinate(kinematics, electrode.along, X) - electrode.start
        share = rise / (electrode.end - electrode.start)
    for taper in electrode.tapers if isinstance(electrode, Electrode) else ():
        t = (coordinate(kinematics, taper.along, X) - taper.start) / (taper.end - taper.start)
        share = share * (1 + np.cos(np.pi * np.clip(t, 0, 1))) / 2
    return share


def coordinate(kinematics: Kinematics, name: str, X: np.ndarray) -> np.ndarray:
    """An undeformed coordinate, or ``"r"``, the distance from the z axis in space."""
    names = kinematics.coordinates
    if name in tuple(names):
        return X[:, names.index(name)]
    return np.hypot(X[:, 0], X[:, 1])


def given_volts(electrode: Electrode | ChargedElectrode) -> float:
    """The voltage at ramp factor 1; 0 of an electrode whose potential floats."""
    return electrode.volts if isinstance(electrode, Electrode) else 0.0


def driven_alike(a: Electrode | ChargedElectrode, b: Electrode | ChargedElectrode) -> bool:
    """Whether two electrodes are given potentials, by the same ramp or by none."""
    if isinstance(a, ChargedElectrode) or isinstance(b, ChargedElectrode):
        return False
    return a.ramp == b.ramp or not (a.volts or b.volts)
