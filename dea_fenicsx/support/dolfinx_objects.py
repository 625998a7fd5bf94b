"""Forms and expressions of DOLFINx, made from code that this process has compiled before.

DOLFINx makes them from UFL forms alone, and looks for the code anew each time.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

import cffi
import dolfinx
import numpy as np

from dea_fenicsx.support import form_kinds
from dea_fenicsx.support.form_kinds import Kind

_FFI = cffi.FFI()

VERSION = tuple(int(part) for part in dolfinx.__version__.split(".")[:2])

KNOWN = VERSION == (0, 9) or VERSION >= (0, 11)
"""Whether it is known here what DOLFINx makes its objects from."""


def keep_form(kind: Kind | None, options: Hashable, form: Any, made: Any) -> None:
    """Keep the code of a compiled form for all forms of its kind."""
    if kind is None or not KNOWN or made is None:
        return
    told = list(form.coefficients()), list(form.constants()), list(form.arguments())
    if _alike(told, (kind.coefficients, kind.constants, kind.arguments)):
        form_kinds.keep(kind, options, (made.ufcx_form, made.module))


def form(kind: Kind, code: Any, module: Any) -> Any:
    """The form of a kind, compiled, from its code."""
    spaces = [v.ufl_function_space()._cpp_object for v in kind.arguments]
    where = {
        getattr(dolfinx.fem.IntegralType, name): [
            (number, np.array(entities)) for number, entities in sorted(told or [], key=_number)
        ]
        for name, told in kind.subdomains.items()
    }
    address: Any = _address(code)
    given = _given(kind, code), [c._cpp_object for c in kind.constants], where
    first, maps = (address, {}) if VERSION < (0, 11) else ([address], [])
    mesh = kind.domain.ufl_cargo()
    cls = dolfinx.fem.forms.form_cpp_class(dolfinx.default_scalar_type)
    return dolfinx.fem.Form(cls(first, spaces, *given, maps, mesh), code, None, module)


def keep_expression(kind: Kind | None, options: Hashable, made: Any) -> None:
    """Keep the code of a compiled expression for all expressions of its kind."""
    if kind is None or not KNOWN or kind.arguments:
        return
    from ufl.algorithms.analysis import extract_coefficients, extract_constants

    expr = made.ufl_expression
    told = list(extract_coefficients(expr)), list(extract_constants(expr)), []
    if _alike(told, (kind.coefficients, kind.constants, [])):
        form_kinds.keep(kind, options, (made.ufcx_expression,))


def expression(kind: Kind, code: Any) -> Any:
    """The expression of a kind, compiled, from its code."""
    constants = [c._cpp_object for c in kind.constants]
    maps = () if VERSION < (0, 11) else ([],)
    kind_of_number = np.dtype(dolfinx.default_scalar_type).name
    create = getattr(dolfinx.cpp.fem, f"create_expression_{kind_of_number}")
    made = object.__new__(dolfinx.fem.Expression)
    made._ufcx_expression, made._code = code, None
    made._ufl_expression, space = None, "_argument_space" if maps else "_argument_function_space"
    setattr(made, space, None)
    made._cpp_object = create(_address(code), _given(kind, code), constants, *maps, None)
    return made


def _given(kind: Kind, code: Any) -> list[Any]:
    """The functions that the code takes, in its order."""
    places = code.original_coefficient_positions
    return [kind.coefficients[places[i]]._cpp_object for i in range(code.num_coefficients)]


def _address(code: Any) -> int:
    """Where compiled code lies in memory."""
    return int(_FFI.cast("uintptr_t", _FFI.addressof(code)))


def _number(told: tuple[int, Any]) -> int:
    """The number of a list of entities."""
    return told[0]


def _alike(told: tuple[list, ...], found: tuple[list, ...]) -> bool:
    """Whether UFL finds the same functions in the same order."""
    return all(
        len(a) == len(b) and all(x == y for x, y in zip(a, b, strict=True))
        for a, b in zip(told, found, strict=True)
    )
