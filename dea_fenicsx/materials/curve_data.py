"""Measured stress-stretch curves, and how they are read from files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.materials.separators import parsed
from dea_fenicsx.materials.stretches import TESTS
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import shown
from dea_fenicsx.support.units import in_si


@dataclass(frozen=True, eq=False)
@in_si(stretch="", stress="Pa")
class TestData:
    """One measured curve.

    Parameters
    ----------
    test
        ``"uniaxial"``, ``"planar"`` or ``"equibiaxial"``.
    stretch
        Stretches, shape (n,).
    stress
        Nominal stresses in Pa, shape (n,).
    """

    __test__ = False  # not a test of pytest's

    test: str
    stretch: Any
    stress: Any

    def __post_init__(self) -> None:
        take_columns(self, self.test, ("stretch", "stress"))
        if len(self.stretch) != len(self.stress):
            raise InputError(
                f"The {self.test} data have {len(self.stretch)} stretches and {len(self.stress)} "
                "stresses, but must have as many of each."
            )
        if not (np.all(np.isfinite(self.stretch)) and np.all(np.isfinite(self.stress))):
            raise InputError(f"The {self.test} data hold values that are no finite numbers.")
        if np.any(self.stretch <= 0):
            raise InputError(
                f"The {self.test} data hold a stretch of {self.stretch.min():g}, but a stretch is "
                "> 0 (1 + strain)."
            )


def read_data(
    path: str | Path,
    test: str,
    stretch: int,
    stress: int,
    unit: float,
    delimiter: str | None = None,
    decimal: str = ".",
) -> TestData:
    """Read a curve from a text file; lines that hold no numbers there are passed over.

    Parameters
    ----------
    path, test
        The file, and its test as in `TestData`.
    stretch, stress
        Numbers of the columns, from 0.
    unit
        Unit of the stresses in Pa (1e6 for MPa).
    delimiter, decimal
        Column delimiter (None for blanks) and decimal sign.  Where the file holds no numbers with
        them, commas, semicolons, tabs and decimal commas are tried as well.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"There is no data file {path}.")
    lines = path.read_text(encoding="latin-1").splitlines()
    rows = parsed(
        lines, delimiter, decimal, lambda cells: [float(cells[k]) for k in (stretch, stress)]
    )
    if not rows:
        raise InputError(
            f"{path} holds no numbers in columns {stretch} and {stress}, which count from 0, "
            "whatever sign separates its columns."
        )
    columns = np.array(rows).T
    return TestData(test, columns[0], columns[1] * unit)


def take_columns(data: Any, test: object, names: Sequence[str]) -> None:
    """Turn fields of a dataclass into arrays of one dimension, and check the name of its test.

    Raises
    ------
    InputError
        If a field holds anything but numbers, or there is no such test.
    """
    for name in names:
        given = getattr(data, name)
        try:
            object.__setattr__(data, name, np.asarray(given, dtype=float).ravel())
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError(
                f"The {name} of the data is {shown(given)}, but must be an array of numbers."
            ) from error
    if not isinstance(test, str) or test not in TESTS:
        raise InputError(f"There is no test {shown(test)}; the tests are {', '.join(TESTS)}.")
