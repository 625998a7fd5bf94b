"""Functions of the place that a user writes, taken at the middles of cells."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dea_fenicsx.mesh.device import Device
from dea_fenicsx.support.agreement import together
from dea_fenicsx.support.compat import dolfinx
from dea_fenicsx.support.errors import InputError

PlaceFunction = Callable[[np.ndarray], np.ndarray]
"""From positions in m, shape (n, 3), to n numbers."""


def middles(device: Device, cells: np.ndarray) -> np.ndarray:
    """The middles of local cells in m, shape (n, 3)."""
    found = dolfinx.mesh.compute_midpoints(device.mesh, device.dim, cells.astype(np.int32))
    return np.asarray(found) * device.length


def at_middles(device: Device, cells: np.ndarray, function: PlaceFunction, what: str) -> np.ndarray:
    """The values of a function in local cells.  Collective.

    Parameters
    ----------
    device, cells
        The device and its cells.
    function
        A user's function.
    what
        What a message calls it, such as ``"The factor of 'film.elastic.mu'"``.

    Raises
    ------
    InputError
        If it fails, or gives other than as many finite numbers.
    """

    def values() -> np.ndarray:
        at = middles(device, cells)
        try:
            found = np.asarray(function(at), dtype=float)
        except Exception as error:  # the function is the user's own
            why = " ".join(str(error).split()).rstrip(".")
            raise InputError(f"{what} cannot be found ({type(error).__name__}: {why}).") from error
        if found.shape != (len(at),) or not np.isfinite(found).all():
            raise InputError(
                f"{what} gives an array of shape {found.shape} for {len(at)} cells, but must give "
                "one finite number for each."
            )
        return found

    return together(device.comm, values, what)
