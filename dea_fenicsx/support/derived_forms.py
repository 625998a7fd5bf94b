"""Forms that follow from another form alone, such as the tangent from the residual.

Two residuals of one kind have tangents of one kind.  So what a tangent of that kind was made from
is noted once, by the places of its functions and constants in the residual.  The next one is made
from its code and from the new residual, and neither its expression nor its kind is needed.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any

from dea_fenicsx.support.form_kinds import MOST_KINDS_KEPT, Kind


@dataclass(frozen=True)
class Recipe:
    """How the kind of a form is put together from that of another one.

    Attributes
    ----------
    key
        The key of the form's own kind.
    coefficients, constants
        Places of its functions and constants in what it follows from.
    arguments
        Number of its test and trial functions.
    types
        The types of its integrals.
    """

    key: Hashable
    coefficients: tuple[int, ...]
    constants: tuple[int, ...]
    arguments: int
    types: tuple[str, ...]

    @classmethod
    def of(cls, kind: Kind, parent: Kind, beside: Sequence[Any]) -> Recipe | None:
        """The recipe of a kind; None if it has more than the other form and these functions."""
        functions = _places([*parent.coefficients, *beside])
        constants = _places(parent.constants)
        spaces = {id(v.ufl_function_space()) for v in (*parent.arguments, *kind.arguments)}
        alike = all(parent.subdomains.get(t) is told for t, told in kind.subdomains.items())
        if len(spaces) != 1 or not alike or kind.domain.ufl_id() != parent.domain.ufl_id():
            return None
        try:
            return cls(
                kind.key, tuple(functions[id(f)] for f in kind.coefficients),
                tuple(constants[id(c)] for c in kind.constants), len(kind.arguments),
                tuple(kind.subdomains),
            )  # fmt: skip
        except KeyError:
            return None

    def kind(self, parent: Kind, beside: Sequence[Any]) -> Kind:
        """The kind that follows from another form, in the same way."""
        functions = [*parent.coefficients, *beside]
        return Kind(
            self.key, [functions[i] for i in self.coefficients],
            [parent.constants[i] for i in self.constants], parent.arguments[:1] * self.arguments,
            parent.domain, {t: parent.subdomains[t] for t in self.types},
        )  # fmt: skip


def _places(objects: Sequence[Any]) -> dict[int, int]:
    return {id(one): place for place, one in enumerate(objects)}


_recipes: dict[Hashable, Recipe] = {}
"""The recipes of this process by the other form's key and by what follows; the oldest first."""


def known(parent: Kind | None, what: Hashable) -> Recipe | None:
    """The recipe of what follows from a form, if this process has noted it."""
    return None if parent is None else _recipes.get((parent.key, what))


def note(parent: Kind | None, what: Hashable, kind: Kind | None, beside: Sequence[Any]) -> None:
    """Note how a kind follows from a form, if it does so from this form alone."""
    if parent is None or kind is None or (made := Recipe.of(kind, parent, beside)) is None:
        return
    while len(_recipes) >= MOST_KINDS_KEPT:
        del _recipes[next(iter(_recipes))]
    _recipes[parent.key, what] = made

