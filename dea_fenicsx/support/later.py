"""Modules that few runs need, imported when something of them is first asked for.

A small run takes a few tenths of a second.  Most of scipy would take as long to import.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any


class Later:
    """A module by its full name, imported when an attribute of it is first asked for."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        found = getattr(import_module(self._name), attribute)
        setattr(self, attribute, found)
        return found

    def __repr__(self) -> str:
        return f"Later({self._name!r})"
