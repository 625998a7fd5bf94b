"""Which variable matters: relative derivatives of the quantities at a design."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from dea_fenicsx.pictures.curves import STYLE, write_whole
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import replace_file


@dataclass(frozen=True)
class Sensitivity:
    """Relative derivatives at one design.

    Attributes
    ----------
    design
        Variables by name.
    table
        Quantity to variable to d ln(quantity)/d ln(variable): the change in per cent for one per
        cent of the variable.
    """

    design: Mapping[str, float]
    table: Mapping[str, Mapping[str, float]]

    def write(self, path: str | os.PathLike) -> Path:
        """Write the table as CSV: a line for each quantity, a column for each variable."""
        place = Path(path)
        place.parent.mkdir(parents=True, exist_ok=True)

        def write(target: Path) -> None:
            with target.open("w", newline="", encoding="utf-8") as f:
                writer = csv.writer(f)
                writer.writerow(["quantity", *self.design])
                for name, row in self.table.items():
                    writer.writerow([name, *(row[v] for v in self.design)])

        replace_file(place, write)
        return place


def sensitivities(
    function: Callable[..., Mapping[str, float]],
    design: Mapping[str, float],
    quantities: Sequence[str],
    step: float = 1e-3,
) -> Sensitivity:
    """Central differences in the logarithms, d ln f/d ln x = (x/f) df/dx.

    Parameters
    ----------
    function
        Called with the variables by name; returns quantities by name.  Twice for each variable.
    design
        Where; every variable must be > 0.
    quantities
        Names of quantities, which must not change sign.
    step
        Relative step.  The error goes as its square, and as the function's own error over it.

    Raises
    ------
    InputError
        If a variable is not positive, or a quantity is missing, not positive or not there at the
        neighbouring designs.
    """
    table: dict[str, dict[str, float]] = {name: {} for name in quantities}
    for variable, value in design.items():
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"{variable} is {value!r}; a relative derivative needs a number > 0.")
        logs = []
        for sign in (1, -1):
            found = function(**{**design, variable: value * math.exp(sign * step)})
            for name in quantities:
                if name not in found:
                    raise InputError(
                        f"The function returns no quantity {name!r}; it returns: "
                        f"{', '.join(found)}."
                    )
                if not found[name] > 0:
                    raise InputError(
                        f"{name} is {float(found[name]):g} near this design (at another "
                        f"{variable}); a relative derivative needs a number > 0."
                    )
            logs.append({name: math.log(float(found[name])) for name in quantities})
        for name in quantities:
            table[name][variable] = (logs[0][name] - logs[1][name]) / (2 * step)
    return Sensitivity(dict(design), table)


def draw_sensitivities(found: Sensitivity, path: str | os.PathLike) -> Path:
    """Draw the table as bars, a group for each variable (PNG)."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(5.0, 3.0), layout="constrained")
        axes = figure.subplots()
        count = len(found.table)
        for i, (name, row) in enumerate(found.table.items()):
            places = [k + (i - (count - 1) / 2) * 0.8 / count for k in range(len(row))]
            axes.bar(places, list(row.values()), 0.8 / count, label=name.replace("_", " "))
        axes.axhline(0, color="k", lw=0.6)
        names = ["\n".join(v.split("_")) for v in found.design]
        axes.set_xticks(range(len(found.design)), names)
        axes.tick_params(axis="x", length=0)
        axes.set_ylabel("Change in % for 1 % of the variable")
        axes.legend(fontsize=6.5)
        return write_whole(Path(path), lambda p: figure.savefig(p, format="png", dpi=300))
