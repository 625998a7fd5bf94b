"""The kind of a form or expression: what makes its compiled code, and nothing of its mesh.

To find a compiled form in its cache, FFCx and DOLFINx walk over its expression some twenty times.
In a loop over small problems that took as long as their solution.  Here one walk finds everything
that the code depends on, which is the key under which this process keeps the code, and what the
code is to be given: the functions, constants and spaces of the problem at hand.

Two forms of the same kind differ by the names of indices, labels, functions and constants alone.
The same order of the functions by their numbers is part of the key, since FFCx takes them in it.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import ufl
from ufl.classes import ConstantValue, ExprList, ExprMapping, GeometricQuantity, Label, MultiIndex
from ufl.constantvalue import ScalarValue, Zero
from ufl.core.multiindex import FixedIndex

MOST_KINDS_KEPT = 1000
"""Kinds that a process keeps; a study may give a form to each of its numbers."""


@dataclass
class Kind:
    """The kind of a form or an expression.

    Attributes
    ----------
    key
        Equal for two forms of the same kind, within one process.  It holds no mesh.
    coefficients, constants
        The functions and constants, in the order of their numbers.
    arguments
        The test and trial functions in the order of their numbers.
    domain
        The mesh, of UFL.
    subdomains
        For each type of integral the lists of entities over which it is taken, or None.
    """

    key: Hashable
    coefficients: list[Any]
    constants: list[Any]
    arguments: list[Any]
    domain: Any
    subdomains: dict[str, Any] = field(default_factory=dict)


class _Unknown(Exception):
    """An expression has parts that are not known here."""


def kind_of_form(form: Any) -> Kind | None:
    """The kind of a form over one mesh; None if it has parts that are not known here."""
    walk, found = _Walk(), []
    subdomains: dict[str, Any] = {}
    try:
        for integral in form.integrals():
            if getattr(integral, "extra_domain_integral_type_map", dict)():
                raise _Unknown
            walk.over(integral.ufl_domain())
            type_, entities = integral.integral_type(), integral.subdomain_data()
            if not (entities is None or isinstance(entities, list)):
                raise _Unknown
            if subdomains.setdefault(type_, entities) is not entities:
                raise _Unknown
            found.append((
                walk.number(integral.integrand()), type_, integral.subdomain_id(),
                tuple(sorted(integral.metadata().items())), entities is None,
            ))  # fmt: skip
        kind = walk.kind(("form", tuple(found)))
        hash(kind.key)
    except (_Unknown, TypeError):  # metadata that cannot be hashed or sorted
        return None
    kind.subdomains = subdomains
    return kind


def kind_of_expression(expression: Any, points: Any) -> Kind | None:
    """The kind of an expression at reference points; None as of `kind_of_form`."""
    walk = _Walk()
    try:
        root = walk.number(expression)
        return walk.kind(("expression", root, points.shape, points.tobytes()))
    except _Unknown:
        return None


class _Walk:
    """A walk over expressions that share their functions, indices and mesh.

    Equal nodes get the same number, which stands for them in the nodes that use them.
    """

    def __init__(self) -> None:
        self._numbers: dict[int, int] = {}  # of an expression, by its id
        self._nodes: dict[tuple, int] = {}
        self._indices: dict[Any, int] = {}
        self._labels: dict[Any, int] = {}
        self._found: dict[str, dict[int, Any]] = {"w": {}, "c": {}, "v": {}}
        self._spaces: dict[int, tuple[Any, Hashable]] = {}
        self._domain: Any = None

    def over(self, domain: Any) -> None:
        """Note a mesh, which must be the same everywhere."""
        if self._domain is None:
            self._domain = domain
        elif domain is not self._domain and domain.ufl_id() != self._domain.ufl_id():
            raise _Unknown

    def number(self, root: Any) -> int:
        """The number of an expression."""
        numbers, nodes, stack = self._numbers, self._nodes, [root]
        while stack:
            e = stack[-1]
            if id(e) in numbers:
                stack.pop()
                continue
            operands = e.ufl_operands
            node, waits = [e._ufl_typecode_], False
            for o in operands:
                number = numbers.get(id(o))
                if number is None and o.ufl_operands:
                    stack.append(o)
                    waits = True
                elif number is None:
                    number = numbers[id(o)] = nodes.setdefault(self._terminal(o), len(nodes))
                node.append(number)
            if not waits:
                stack.pop()
                told = tuple(node) if operands else self._terminal(e)
                numbers[id(e)] = nodes.setdefault(told, len(nodes))
        return numbers[id(root)]

    def kind(self, what: tuple) -> Kind:
        """The kind of what has been walked over."""
        if self._domain is None:
            raise _Unknown
        found = {name: sorted(given.items()) for name, given in self._found.items()}
        orders = tuple(
            tuple(position for position, _ in _by_count(list(given)))
            for given in (self._found["w"], self._found["c"])
        )
        element = repr(self._domain.ufl_coordinate_element())
        functions, constants, arguments = ([f for _, f in found[name]] for name in "wcv")
        key = (what, tuple(self._nodes), orders, element)
        return Kind(key, functions, constants, arguments, self._domain)

    # ------------------------------------------------------------------ terminals

    def _terminal(self, e: Any) -> tuple:
        """What makes the code of an expression without operands."""
        cls = type(e)
        if cls not in _told_by:
            _told_by[cls] = next((told for types, told in _TOLD if issubclass(cls, types)), None)
        told = _told_by[cls]
        if told is None:
            raise _Unknown
        return (e._ufl_typecode_, *told(self, e))

    def _index(self, e: Any) -> Iterable[Hashable]:
        for i in e:
            yield int(i) if isinstance(i, FixedIndex) else ("i", self._free(i.count()))

    def _free(self, count: int) -> int:
        return self._indices.setdefault(count, len(self._indices))

    def _label(self, e: Any) -> Iterable[Hashable]:
        return (self._labels.setdefault(e.count(), len(self._labels)),)

    def _coefficient(self, e: Any) -> Iterable[Hashable]:
        return self._place("w", e.count(), e), self._space(e.ufl_function_space())

    def _constant(self, e: Any) -> Iterable[Hashable]:
        self.over(e.ufl_domain())
        return self._place("c", e.count(), e), e.ufl_shape

    def _argument(self, e: Any) -> Iterable[Hashable]:
        if e.part() is not None:
            raise _Unknown
        self._place("v", e.number(), e)
        return e.number(), self._space(e.ufl_function_space())

    def _place(self, name: str, count: int, e: Any) -> int:
        """Where a function stands in the order in which functions are met."""
        given = self._found[name]
        if given.setdefault(count, e) is not e and name != "v":
            raise _Unknown
        return list(given).index(count)

    def _space(self, space: Any) -> Hashable:
        if id(space) not in self._spaces:
            self.over(space.ufl_domain())
            label = space.label() if hasattr(space, "label") else ""
            told = (type(space).__name__, repr(space.ufl_element()), label)
            self._spaces[id(space)] = space, told  # the space, lest another one have its id
        return self._spaces[id(space)][1]

    def _quantity(self, e: Any) -> Iterable[Hashable]:
        (domain,) = e.ufl_domains()
        self.over(domain)
        return ()

    def _zero(self, e: Any) -> Iterable[Hashable]:
        free = tuple(self._free(count) for count in e.ufl_free_indices)
        return e.ufl_shape, free, e.ufl_index_dimensions

    def _value(self, e: Any) -> Iterable[Hashable]:
        return (e._value,)

    def _shown(self, e: Any) -> Iterable[Hashable]:
        return (repr(e),)

    def _nothing(self, _: Any) -> Iterable[Hashable]:
        return ()


_TOLD: tuple[tuple[type, Callable[[_Walk, Any], Iterable[Hashable]]], ...] = (
    (MultiIndex, _Walk._index), (Label, _Walk._label), (Zero, _Walk._zero),
    (ScalarValue, _Walk._value), (ConstantValue, _Walk._shown),
    (ufl.Coefficient, _Walk._coefficient), (ufl.Constant, _Walk._constant),
    (ufl.Argument, _Walk._argument), (GeometricQuantity, _Walk._quantity),
    (ExprList, _Walk._nothing), (ExprMapping, _Walk._nothing),
)  # fmt: skip
"""How each kind of terminal tells what makes its code."""


_told_by: dict[type, Callable[[_Walk, Any], Iterable[Hashable]] | None] = {}
"""The same by the class of a terminal, as they are met."""


def _by_count(counts: Sequence[int]) -> list[tuple[int, int]]:
    """Places in the order of their counts."""
    return sorted(enumerate(counts), key=lambda pair: pair[1])


_kept: dict[Hashable, Any] = {}
"""What this process has compiled, by its key; the oldest first."""


def kept(kind: Kind | None, options: Hashable) -> Any:
    """What this process has kept for a kind and options; None if there is nothing."""
    return None if kind is None else _kept.get((kind.key, options))


def keep(kind: Kind, options: Hashable, made: Any) -> None:
    """Keep what has been compiled for a kind."""
    while len(_kept) >= MOST_KINDS_KEPT:
        del _kept[next(iter(_kept))]
    _kept[kind.key, options] = made


def clear() -> None:
    """Forget what has been compiled."""
    _kept.clear()
