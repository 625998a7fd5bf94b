"""Docstrings of the package as Sphinx reads them.

The docstrings are written to be read with ``help``.  What Sphinx would take for markup is marked as
plain text here, and lines that are indented as in a formula are kept as they are.
"""

from __future__ import annotations

import re


def plain(lines: list[str]) -> list[str]:
    """The lines of a docstring; outside of code and formulas, signs of markup are escaped."""
    found: list[str] = []
    code = False
    for number, line in enumerate(lines):
        indent = len(line) - len(line.lstrip())
        before = lines[number - 1] if number else ""
        if line.strip() and not line.lstrip().startswith((":", "..")):
            # A block that is indented behind a blank line is a formula or code.
            if indent >= 4 and (code or not before.strip()):
                if not code and found and not found[-1].strip():
                    last = next((f for f in reversed(found) if f.strip()), "")
                    if not last.rstrip().endswith("::"):
                        found += ["::", ""]
                code = True
            elif indent < 4:
                code = False
        found.append(line if code else escaped(line))
    return found


def escaped(line: str) -> str:
    """A line of prose with its signs of markup escaped, except in ``code`` and `code`."""
    if line.lstrip().startswith((":", "..", "* ", "- ")):
        return line
    parts = re.split(r"(``[^`]*``|`[^`]*`)", line)
    parts[::2] = [re.sub(r"([|*])", r"\\\1", part) for part in parts[::2]]
    parts[::2] = [re.sub(r"(?<=\w)_(?!\w)", r"\\_", part) for part in parts[::2]]
    # Behind code, markup wants a space or a punctuation mark; an escaped space does not show.
    parts[2::2] = [re.sub(r"^(?=[\w^(])", r"\\ ", part) for part in parts[2::2]]
    return "".join(parts)


def read(app, what: str, name: str, obj, options, lines: list[str]) -> None:
    """Called by autodoc for each docstring, before napoleon reads its sections."""
    lines[:] = plain(lines)


def setup(app) -> dict[str, bool]:
    """Let autodoc pass each docstring through `read` first."""
    app.connect("autodoc-process-docstring", read, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
