"""Checks of functions that a user writes and that the forms contain."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import basix.ufl
import numpy as np
import ufl
from ufl.constantvalue import ScalarValue
from ufl.corealg.traversal import unique_pre_traversal

from dea_fenicsx.support.errors import InputError


def unknown_number() -> Any:
    """A UFL scalar without a value, which no function can turn into a number."""
    domain = ufl.Mesh(basix.ufl.element("Lagrange", "interval", 1, shape=(1,)))
    return ufl.variable(ufl.SpatialCoordinate(domain)[0])


def scalar_of(function: Callable[[Any], Any], at: Any, what: str, means: str) -> Any:
    """The UFL expression that a function returns.

    Parameters
    ----------
    function
        The function.
    at
        Its argument, a UFL scalar or vector.
    what
        The subject of a message, such as ``"The law of the spring on 'lid'"``.
    means
        What the function should return, such as ``"the force in N"``.

    Raises
    ------
    InputError
        If it fails, or if it returns no scalar, or one that contains a number that is not finite.
    """
    kind = "scalar" if not at.ufl_shape else f"vector of {at.ufl_shape[0]} components"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # UFL warns of what the error tells
            found = ufl.as_ufl(function(at))
    except Exception as error:
        told = " ".join(str(error).split())[:120]
        raise InputError(
            f"{what} fails for a UFL {kind} ({type(error).__name__}: {told}); write {means} with "
            "the functions of ufl, such as ufl.sqrt."
        ) from error
    if found.ufl_shape != ():
        raise InputError(
            f"{what} returns something of shape {found.ufl_shape}, but must return one number, "
            f"{means}."
        )
    for part in unique_pre_traversal(found):
        if isinstance(part, ScalarValue) and not np.isfinite(complex(part)):
            raise InputError(f"{what} contains a number that is not finite; give finite ones.")
    return found
