"""Forms and expressions of DOLFINx, made from code that this process has compiled before.

DOLFINx makes them from UFL forms alone, and looks for the code anew each time.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

import cffi  # type: ignore[import-untyped]
import numpy as np
from ufl.algorithms.analysis import extract_coefficients, extract_constants

from dea_fenicsx.support import form_kinds
from dea_fenicsx.support.form_kinds import Kind

_FFI = cffi.FFI()


class DolfinxObjects:
    """Makes objects of DOLFINx.

    Parameters
    ----------
    dolfinx
        The module.

    Attributes
    ----------
    version
        Its version.
    """

    def __init__(self, dolfinx: Any) -> None:
        self._dolfinx = dolfinx
        self.version = tuple(int(part) for part in dolfinx.__version__.split(".")[:2])
        self._old = self.version < (0, 11)
        # It is known here for these versions what DOLFINx makes its objects from.
        self._known = self.version == (0, 9) or not self._old

    def keep_form(self, kind: Kind | None, options: Hashable, form: Any, made: Any) -> None:
        """Keep the code of a compiled form for all forms of its kind."""
        if kind is None or not self._known or made is None:
            return
        told = list(form.coefficients()), list(form.constants()), list(form.arguments())
        if _alike(told, (kind.coefficients, kind.constants, kind.arguments)):
            form_kinds.keep(kind, options, (made.ufcx_form, made.module))

    def form(self, kind: Kind, code: Any, module: Any) -> Any:
        """The form of a kind, compiled, from its code."""
        fem = self._dolfinx.fem
        spaces = [v.ufl_function_space()._cpp_object for v in kind.arguments]
        where = {
            getattr(fem.IntegralType, name): [
                (number, np.array(entities)) for number, entities in sorted(told or [], key=_number)
            ]
            for name, told in kind.subdomains.items()
        }
        given = _given(kind, code), [c._cpp_object for c in kind.constants], where
        address = _address(code)
        first: Any = address if self._old else [address]
        maps: Any = {} if self._old else []
        cls = fem.forms.form_cpp_class(self._dolfinx.default_scalar_type)
        made = cls(first, spaces, *given, maps, kind.domain.ufl_cargo())
        return fem.Form(made, code, None, module)

    def keep_expression(self, kind: Kind | None, options: Hashable, made: Any) -> None:
        """Keep the code of a compiled expression for all expressions of its kind."""
        if kind is None or not self._known or kind.arguments:
            return
        expr = made.ufl_expression
        told = list(extract_coefficients(expr)), list(extract_constants(expr))
        if _alike(told, (kind.coefficients, kind.constants)):
            form_kinds.keep(kind, options, (made.ufcx_expression,))

    def expression(self, kind: Kind, code: Any) -> Any:
        """The expression of a kind, compiled, from its code."""
        constants = [c._cpp_object for c in kind.constants]
        maps: tuple[Any, ...] = () if self._old else ([],)
        scalar = np.dtype(self._dolfinx.default_scalar_type).name
        create = getattr(self._dolfinx.cpp.fem, f"create_expression_{scalar}")
        made = object.__new__(self._dolfinx.fem.Expression)
        made._ufcx_expression, made._code, made._ufl_expression = code, None, None
        setattr(made, "_argument_function_space" if self._old else "_argument_space", None)
        made._cpp_object = create(_address(code), _given(kind, code), constants, *maps, None)
        return made

    def values(self, expression: Any, mesh: Any, cells: np.ndarray) -> np.ndarray:
        """An expression without arguments at its points in cells.

        DOLFINx's own function asks for the kinds of its arguments first.
        """
        if self._old:
            return np.asarray(expression.eval(mesh, cells))
        made, fem = expression._cpp_object, self._dolfinx.cpp.fem
        shape = (len(cells), len(made.X()), *made.value_shape)
        found = np.zeros(shape, dtype=self._dolfinx.default_scalar_type)
        cells = np.asarray(cells, dtype=np.int32)
        given = fem.pack_coefficients(made, mesh._cpp_object, cells)
        constants = fem.pack_constants(made)
        fem.tabulate_expression(found, made, constants, given, mesh._cpp_object, cells)
        return found


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
