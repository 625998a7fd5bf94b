"""``python -m dea_fenicsx.docs.api FOLDER``: pages of all public names, from their docstrings.

Needs pdoc (the extra "tests").
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

from dea_fenicsx.support.errors import InputError, install_hook

ROOMS = (
    "", ".geometry", ".materials", ".exact", ".origami", ".calibration", ".design", ".pictures",
)  # fmt: skip
"""Modules with a public ``__all__``."""


def write(folder: Path) -> Path:
    """Write the pages; returns the first one.

    Raises
    ------
    InputError
        If pdoc is not installed.
    """
    try:
        import pdoc
        import pdoc.render
    except ImportError as error:
        raise InputError("API pages need pdoc; install it with pip install pdoc.") from error
    for room in ROOMS:
        module = import_module(f"dea_fenicsx{room}")
        for public in module.__all__:  # most are loaded on first use, and pdoc looks without
            setattr(module, public, getattr(module, public))
    pdoc.render.configure(docformat="numpy", show_source=False)
    pdoc.pdoc("dea_fenicsx", output_directory=folder)  # and what its own __all__ names
    return folder / "dea_fenicsx.html"


if __name__ == "__main__":
    install_hook()
    print(write(Path(sys.argv[1] if len(sys.argv) > 1 else "build/api")))
