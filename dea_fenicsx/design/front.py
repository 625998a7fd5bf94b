"""The result of a search: the designs that no other design beats in every objective."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dea_fenicsx.design.variables import signs
from dea_fenicsx.pictures.curves import STYLE, axis_label, write_whole
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import replace_file


@dataclass(frozen=True, eq=False)
class Front:
    """The non-dominated ones of all designs that a search has tried.

    Attributes
    ----------
    variables
        Names of the design variables.
    objectives
        Name of each objective to ``"min"`` or ``"max"``.
    columns
        Variables and all quantities of the designs by name, each of shape (n,), in the order of
        the first objective.
    evaluations, failed
        Designs tried, and those of them that could not be evaluated.
    reasons
        Why designs failed: message to number.
    wall_s
        Time of the search in s.
    """

    variables: tuple[str, ...]
    objectives: Mapping[str, str]
    columns: Mapping[str, np.ndarray]
    evaluations: int = 0
    failed: int = 0
    reasons: Mapping[str, int] = field(default_factory=dict)
    wall_s: float = 0.0

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.columns:
            raise InputError(
                f"The front has no column {name!r}; it has: {', '.join(self.columns)}."
            )
        return self.columns[name]

    def row(self, i: int) -> dict[str, float]:
        """All of one design, by name."""
        return {name: float(values[i]) for name, values in self.columns.items()}

    def design(self, i: int) -> dict[str, float]:
        """The variables of one design, by name."""
        return {name: float(self.columns[name][i]) for name in self.variables}

    @property
    def minimised(self) -> np.ndarray:
        """Objectives turned so that less is better, shape (n, objectives)."""
        pairs = zip(self.objectives, signs(self.objectives), strict=True)
        return np.column_stack([sign * self.columns[name] for name, sign in pairs])

    # ------------------------------------------------------------------ judging

    def hypervolume(self, reference: Mapping[str, float]) -> float:
        """Measure of what the front dominates, up to a reference point worse than all of it.

        Parameters
        ----------
        reference
            The worst value of each objective.
        """
        from pymoo.indicators.hv import HV

        pairs = zip(self.objectives, signs(self.objectives), strict=True)
        point = np.array([sign * reference[name] for name, sign in pairs])
        return float(HV(ref_point=point)(self.minimised))

    def weighted_sum(self, weight: float, scaled: bool = False) -> int:
        """The design with the least w f1 + (1 - w) f2 (thesis eq 62).

        f is the objective itself where it is to be small, and its reciprocal where it is to be
        large.  Printed so, volts are added to a pure number: with w = 1/2 the voltage decides all.
        `scaled` brings each f to the range 0 to 1 over the front first.
        """
        if len(self.objectives) != 2:
            raise InputError(
                f"The weighted sum of eq 62 takes two objectives, not {len(self.objectives)}."
            )
        if not 0 <= weight <= 1:
            raise InputError(f"The weight is {weight!r}, but must lie between 0 and 1.")
        f = [self[n] if kind == "min" else 1 / self[n] for n, kind in self.objectives.items()]
        if scaled:
            f = [(v - v.min()) / max(np.ptp(v), 1e-300) for v in f]
        return int(np.argmin(weight * f[0] + (1 - weight) * f[1]))

    # ------------------------------------------------------------------ writing

    def write(self, path: str | os.PathLike, units: Mapping[str, str] | None = None) -> Path:
        """Write the front as CSV, a line for each design.

        Parameters
        ----------
        path
            The file.  It appears whole or not at all.
        units
            Unit of each column, appended to its name: ``voltage`` becomes ``voltage_V``.
        """
        place = Path(path)
        place.parent.mkdir(parents=True, exist_ok=True)

        def write(target: Path) -> None:
            with target.open("w", newline="", encoding="utf-8") as f:
                writer = csv.writer(f)
                writer.writerow(with_unit(n, units) for n in self.columns)
                writer.writerows(zip(*(v.tolist() for v in self.columns.values()), strict=True))

        replace_file(place, write)
        return place

    def draw(
        self,
        path: str | os.PathLike,
        *,
        units: Mapping[str, str] | None = None,
        points: Mapping[str, Mapping[str, float]] | None = None,
        lines: Mapping[str, Mapping[str, Sequence[float] | np.ndarray]] | None = None,
        weight: float | None = None,
    ) -> Path:
        """Draw the first two objectives against one another.

        Parameters
        ----------
        path
            The picture (PNG).
        units
            As in `write`.
        points
            Designs to compare with: label to the values of the two objectives.
        lines
            Curves to compare with, in the same way.
        weight
            Mark the optimum of the weighted sum of eq 62 with this weight, as printed and scaled.
        """
        import matplotlib
        from matplotlib.figure import Figure

        if len(self.objectives) < 2:
            raise InputError("A front of one objective is a single design and has no picture.")
        x, y = list(self.objectives)[:2]
        labels = [
            axis_label(with_unit(n, units), float(np.max(np.abs(self[n])))) for n in (x, y)
        ]
        (x_text, x_unit), (y_text, y_unit) = labels
        with matplotlib.rc_context(STYLE):
            figure = Figure(figsize=(4.5, 3.2), layout="constrained")
            axes = figure.subplots()
            for label, line in (lines or {}).items():
                axes.plot(np.asarray(line[x]) / x_unit, np.asarray(line[y]) / y_unit, color="0.55",
                          lw=3, label=label, solid_capstyle="butt")  # fmt: skip
            axes.plot(self[x] / x_unit, self[y] / y_unit, ".", ms=2.5, label="front", color="C0")
            if weight is not None:
                for scaled, mark, what in ((False, "v", "as printed"), (True, "^", "scaled")):
                    i = self.weighted_sum(weight, scaled)
                    axes.plot(self[x][i] / x_unit, self[y][i] / y_unit, mark, ms=6, color="C3",
                              mfc="white", label=f"eq 62, w = {weight:g}, {what}")  # fmt: skip
            for k, (label, point) in enumerate((points or {}).items()):
                axes.plot(point[x] / x_unit, point[y] / y_unit, "sDPX*"[k % 5], ms=6, color="k",
                          mfc="none", label=label)  # fmt: skip
            axes.set(xlabel=x_text, ylabel=y_text)
            axes.legend(fontsize=6.5)
            return write_whole(Path(path), lambda p: figure.savefig(p, format="png", dpi=300))


def with_unit(name: str, units: Mapping[str, str] | None) -> str:
    """A column's name with its unit, as in history.csv."""
    unit = (units or {}).get(name, "")
    return f"{name}_{unit}" if unit else name


def first_front(F: np.ndarray) -> np.ndarray:
    """Indices of the non-dominated rows of F (less is better), equal rows once."""
    from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

    _, once = np.unique(F, axis=0, return_index=True)
    once = np.sort(once)
    best = NonDominatedSorting().do(F[once], only_non_dominated_front=True)
    return once[np.sort(np.asarray(best, dtype=int))]

