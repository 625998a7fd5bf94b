"""Checks of single inputs that several modules share: names, numbers, groups without members."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable

from mpi4py import MPI

from dea_fenicsx.errors import InputError
from dea_fenicsx.mesh import Device


def known(name: str, names: Iterable[str], what: str) -> None:
    """Raise InputError unless `name` is one of `names`, with the nearest as a suggestion."""
    names = list(names)
    if name in names:
        return
    near = difflib.get_close_matches(name, names, n=1)
    hint = f"did you mean {near[0]!r}?" if near else ""
    listing = ", ".join(sorted(names)) or "none"
    raise InputError(f"There is no {what} named {name!r}; {hint} the mesh has: {listing}.")


def finite(value: object, what: str) -> None:
    """Raise InputError unless `value` is a finite real number."""
    try:
        ok = math.isfinite(value)  # type: ignore[arg-type]
    except TypeError:
        ok = False
    if not ok:
        raise InputError(f"{what} is {value!r}, but must be a finite number.")


def group_size(device: Device, name: str) -> int:
    """Number of cells or facets in a named group; shared ones count on each rank.  Collective."""
    local = device.cells_of(name) if name in device.regions else device.facets_of(name)
    return device.comm.allreduce(len(local), op=MPI.SUM)
