"""Files that are safe to write, and text from files that is safe to show.

What a stranger's file says is data: a name in it is never a path, and a text from it never tells a
terminal what to do.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

LONGEST_NAME = 80
"""Letters of a file's name that is made of a name from a file; file systems take 255 bytes."""

LONGEST_TEXT = 300
"""Letters of a text from a file that are shown."""

LONGEST_PATH = 1000
"""Letters of a path that a command shows."""


def clean(text: object, longest: int = LONGEST_TEXT) -> str:
    """A text on one line, without control characters, and not too long.

    Line ends, escape sequences of terminals and marks that turn the direction of writing are not
    printable, and each becomes a space.
    """
    found = "".join(c if c.isprintable() else " " for c in str(text)[: 2 * longest])
    found = " ".join(found.split())
    return found if len(found) <= longest else found[: longest - 3] + "..."


def listed(names: Iterable[object], most: int = 40) -> str:
    """Names from a file, for a message: each of them clean, and not too many."""
    found = [clean(name, LONGEST_NAME) for name in names]
    rest = len(found) - most
    return ", ".join(found[:most]) + (f" and {rest} more" if rest > 0 else "")


def file_name(name: str) -> str:
    """The name of a file in the folder at hand, made of any text.

    Letters, digits and ``. + -`` stay.  All else becomes ``_``, so that the name holds no
    separator; it does not begin with a dot either.
    """
    found = re.sub(r"[^\w.+-]", "_", str(name)[:LONGEST_NAME]).lstrip(".")
    while len(found.encode("utf-8", "replace")) > 2 * LONGEST_NAME:
        found = found[:-1]
    return found.encode("utf-8", "replace").decode() or "column"


def new_file(path: Path) -> None:
    """Make an empty file; whatever has that name, a link for instance, is removed and not followed.

    Raises
    ------
    OSError
        If it cannot be made, or something else takes the name at the same moment.
    """
    with suppress(FileNotFoundError):
        path.unlink()
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    os.close(os.open(path, flags, 0o666))


def replace_file(
    path: Path, write: Callable[[Path], object], *, ending: str = ".new", empty: bool = True
) -> None:
    """Write a file through a temporary one beside it, so that a reader never sees half of it.

    A link of either name is replaced; what it points to is left alone.

    Parameters
    ----------
    path
        The file.
    write
        Writes the temporary file, whose path it is given.
    ending
        What the temporary file's name ends in, for writers that go by the ending.
    empty
        Whether the temporary file is made, empty, before `write` is called.  False for what may end
        the process, so that it leaves nothing behind.
    """
    temporary = path.with_name(f".{path.name}{ending}")
    if empty:
        new_file(temporary)
    else:
        with suppress(FileNotFoundError):
            temporary.unlink()
    try:
        write(temporary)
        os.replace(temporary, path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise


def free_name(path: Path) -> Path:
    """The path, or with _2, _3 and so on behind it, by which there is nothing yet, not a link."""
    found, number = path, 1
    while os.path.lexists(found):
        number += 1
        found = path.with_name(f"{path.name}_{number}")
    return found


def append_line(path: Path, line: str) -> None:
    """Append a line to a file that is no link."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC
    with open(os.open(path, flags, 0o666), "a", encoding="utf-8", errors="replace") as file:
        file.write(line + "\n")
