"""What UFL and Basix do again and again, done once, and what they would keep for ever, let go.

Each function changes one of them when this module is imported.  What is not there in another
version stays as it is.
"""

from __future__ import annotations

import itertools
from contextlib import suppress
from functools import singledispatchmethod
from typing import Any

import basix.ufl
import ufl
import ufl.algorithms.analysis


def _let_traversers_go() -> None:
    """Keep CPython 3.13 from holding on to each UFL expression whose derivatives were expanded.

    Its `singledispatchmethod` caches a method for each instance in a dictionary with weak keys,
    and the method owns the instance: no key ever goes.  UFL's traversers own the expression, its
    functions and their communicators, of which MPICH has 2048.  Without a cache nothing is kept.
    """
    with suppress(ImportError):  # UFL 2024.2 has no such classes
        from ufl.corealg.dag_traverser import DAGTraverser

        classes = [DAGTraverser]
        for cls in classes:
            classes += cls.__subclasses__()
            for method in vars(cls).values():
                if isinstance(method, singledispatchmethod) and hasattr(method, "_method_cache"):
                    method._method_cache = None


_let_traversers_go()


def _count_constants_with_one_length() -> None:
    """Let the numbers of all constants have equally many digits.

    UFL sorts the factors of a product by what is printed of them, so that a constant of number 10
    comes before that of number 9.  The same scene would be compiled anew where its constants have
    such numbers, which depends on how many constants a script had before.
    """
    ufl.Constant._counter = itertools.count(10**9)


_count_constants_with_one_length()


def _keep_cells() -> None:
    """Let all elements of one shape of cell share UFL's description of it, which never changes.

    Basix describes the cell anew, with all of its edges and faces, whenever an element is asked for
    it.  UFL asks so often that this took a tenth of a small run.
    """
    made: dict[str, Any] = {}
    base = basix.ufl._ElementBase
    describe = vars(base)["cell"].fget

    def cell(element: Any) -> Any:
        name = element._cellname
        if name not in made:
            made[name] = describe(element)
        return made[name]

    base.cell = property(cell, doc=describe.__doc__)


with suppress(AttributeError, KeyError):  # what is not there in another version stays as it is
    _keep_cells()


def _find_constants_late() -> None:
    """Let a form look for its constants when it is asked for them.

    UFL does it whenever it makes a form, so for each part of a sum and for each sum of them.
    """
    slot, look = vars(ufl.Form)["_constants"], ufl.algorithms.analysis.extract_constants

    def extract(a: Any) -> Any:
        # a form that is being made has no hash yet
        return None if type(a) is ufl.Form and not hasattr(a, "_hash") else look(a)

    def constants(form: Any) -> Any:
        found = slot.__get__(form)
        if found is None:
            found = look(form)
            slot.__set__(form, found)
        return found

    ufl.algorithms.analysis.extract_constants = extract
    ufl.Form._constants = property(constants, slot.__set__)


with suppress(AttributeError, KeyError):
    _find_constants_late()
