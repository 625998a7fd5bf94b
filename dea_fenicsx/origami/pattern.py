"""Crease pattern of the spiral box and the smooth fold that replaces a crease (5.2, 5.4.3).

A storey is a row of rectangular cells a x b; each has its diagonal as valley, and mountains along
all its sides.  `CreasePattern.write_svg` draws it to cut, in mm.  Lengths in m.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from dea_fenicsx.origami.kresling import Kresling
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import check_declared
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import one_of

STYLES = {  # stroke, dashes in mm
    "cut": ("#d00000", ""),
    "mountain": ("#0040c0", "4 1 0.6 1"),
    "valley": ("#008040", "2.5 1.5"),
    "stiffener": ("#808080", ""),
}
"""Layers of the drawing."""
Stiffeners = Literal["none", "fold", "panels"]
STIFFENERS: tuple[Stiffeners, ...] = get_args(Stiffeners)


@in_si(start="m", end="m", width="m", offsets="m")
@dataclass(frozen=True, eq=False)
class SmoothFold:
    """The strip, folded round, that takes the place of a crease from `start` to `end`.

    Parameters
    ----------
    start, end
        Points v1 and v2 in the plane in m.
    width
        w, across the crease, in m.
    offsets
        o1 and o2, from v1 and v2 to the ends of the strip, in m.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    width: float
    offsets: tuple[float, float]

    def __post_init__(self) -> None:
        if not self.width > 0:
            raise InputError(f"SmoothFold: width is {self.width}, but must be positive.")
        if min(self.offsets) < 0:
            raise InputError("SmoothFold: offsets must not be negative.")
        if not self.crease_length > sum(self.offsets):
            raise InputError(
                f"SmoothFold: nothing is left of a crease of {self.crease_length:g} m between "
                f"offsets of {self.offsets[0]:g} and {self.offsets[1]:g} m."
            )

    @property
    def crease_length(self) -> float:
        return float(np.hypot(*np.subtract(self.end, self.start)))

    @property
    def along(self) -> np.ndarray:
        """Unit vector m/|m| from v1 to v2."""
        return np.subtract(self.end, self.start) / self.crease_length

    @property
    def across(self) -> np.ndarray:
        """e3 x m/|m|, to the left of the crease."""
        x, y = self.along
        return np.array([-y, x])

    @property
    def length(self) -> float:
        """From p1 to p2 in m."""
        return self.crease_length - sum(self.offsets)

    @property
    def corners(self) -> np.ndarray:
        """p1, p2, p3, p4 (section 5.4.3), shape (4, 2)."""
        near = self.start + self.offsets[0] * self.along
        far = self.end - self.offsets[1] * self.along
        half = self.width / 2 * self.across
        return np.array([near - half, far - half, far + half, near + half])


def least_fold_width(thickness: Any, angle: Any = np.pi) -> Any:
    """Width in m below which a panel cannot be bent round by `angle`: angle x thickness/2.

    A strip of length w bent to an arc has the inner radius w/angle - thickness/2, which ends at 0.
    """
    return np.asarray(angle) * thickness / 2


@in_si(side="m", height="m", fold="m", offset="m", thickness="m", tab="m")
@dataclass(frozen=True, eq=False)
class CreasePattern:
    """Pattern of a spiral box, by default the thesis's: a letter sheet in 4 x 4 cells.

    Parameters
    ----------
    side, height
        Of a cell in m.
    sides
        Cells of a storey.
    storeys
        Rows.
    alternate
        Every other row leans to the other side, so that the twists cancel.
    fold, offset
        Width of the smooth folds, and how far they end before the corners, in m.
    thickness
        Of the panels in m; 0 for paper.
    stiffeners
        ``"none"``, on the ``"fold"`` (the rectangles p1 to p4, as the thesis says), or on the
        ``"panels"`` (the triangles between the folds).
    tab
        Width of the strip that joins the last cell to the first in m.

    Raises
    ------
    InputError
        For a pattern that cannot close, a panel that its fold cannot bend round, or a stiffener
        that would lie outside its cell.
    """

    side: float = 53.975e-3
    height: float = 69.85e-3
    sides: int = 4
    storeys: int = 4
    alternate: bool = False
    fold: float = 1e-3
    offset: float = 10e-3
    thickness: float = 0.0
    stiffeners: Stiffeners = "none"
    tab: float = 0.0

    def __post_init__(self) -> None:
        check_declared(self)
        Kresling(self.side, self.height, sides=self.sides)  # says if it cannot close
        if self.storeys < 1:
            raise InputError(f"CreasePattern: storeys is {self.storeys}, but must be 1 or more.")
        for name in ("fold", "offset", "thickness", "tab"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise InputError(
                    f"CreasePattern: {name} is {value}, but must be finite and not negative."
                )
        one_of(self.stiffeners, STIFFENERS, "CreasePattern: stiffeners", f"in {STIFFENERS}")
        least = float(least_fold_width(self.thickness))
        if self.fold < least:
            raise InputError(
                f"CreasePattern: panels {self.thickness:g} m thick need folds at least {least:g} m "
                f"wide to lie on each other, but fold is {self.fold:g} m."
            )
        corners = self.smooth_fold.corners
        outside = (corners < 0) | (corners > [self.side, self.height])
        if self.stiffeners == "fold" and outside.any():
            raise InputError(
                f"CreasePattern: a stiffener {self.fold:g} m wide that ends {self.offset:g} m from "
                "the corners lies outside its cell; make it narrower or the offset larger."
            )
        if self.stiffeners == "panels" and 2 * self._inradius <= self.fold:
            raise InputError(
                f"CreasePattern: folds of {self.fold:g} m leave no panel between them."
            )

    # ------------------------------------------------------------------ one cell

    @property
    def smooth_fold(self) -> SmoothFold:
        """Of the diagonal in the first cell."""
        return SmoothFold((0.0, 0.0), (self.side, self.height), self.fold, (self.offset,) * 2)

    @property
    def diagonal(self) -> float:
        return float(np.hypot(self.side, self.height))

    @property
    def _inradius(self) -> float:
        return (self.side + self.height - self.diagonal) / 2

    @property
    def panels(self) -> np.ndarray:
        """The two triangles of a cell, drawn in by half a fold; shape (2, 3, 2)."""
        a, b, c = self.side, self.height, self.diagonal
        # scaled about the centre of the inscribed circle, all sides move in by the same distance
        shrink = 1 - self.fold / 2 / self._inradius
        below = np.array([[0, 0], [a, 0], [a, b]], dtype=float)
        r = (a + b - c) / 2
        centre = np.array([a - r, r])
        below = centre + shrink * (below - centre)
        return np.array([below, [a, b] - below])

    # ------------------------------------------------------------------ the sheet

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the sheet in m, with the tab."""
        return self.sides * self.side + self.tab, self.storeys * self.height

    def _leans_left(self, row: int) -> bool:
        return self.alternate and row % 2 == 1

    def _placed(self, shape: np.ndarray) -> list[np.ndarray]:
        """A shape of the first cell in all cells."""
        found = []
        for row in range(self.storeys):
            own = np.array(shape)
            if self._leans_left(row):
                own[:, 0] = self.side - own[:, 0]
            for column in range(self.sides):
                found.append(own + np.array([column * self.side, row * self.height]))
        return found

    def lines(self) -> dict[str, list[np.ndarray]]:
        """Polylines by layer, each of shape (m, 2) in m, y upwards.

        ``cut`` and ``stiffener`` are closed (first point repeated).
        """
        a, b, width, height = self.side, self.height, self.sides * self.side, self.size[1]
        edge = [[0.0, 0.0], [width, 0.0]]
        for row in range(self.storeys if self.tab else 0):
            slope = min(self.tab, b / 4)
            low, high = row * b, (row + 1) * b
            edge += [[width, low], [width + self.tab, low + slope],
                     [width + self.tab, high - slope], [width, high]]  # fmt: skip
        edge += [[width, height], [0.0, height], [0.0, 0.0]]
        outline = [p for i, p in enumerate(edge) if i == 0 or p != edge[i - 1]]
        upright = range(1, self.sides + (1 if self.tab else 0))
        mountain = [np.array([[k * a, 0.0], [k * a, height]]) for k in upright]
        mountain += [np.array([[0.0, k * b], [width, k * b]]) for k in range(1, self.storeys)]
        shapes = {"none": [], "fold": [self.smooth_fold.corners], "panels": list(self.panels)}
        closed = [np.vstack([s, s[:1]]) for s in shapes[self.stiffeners]]
        return {
            "stiffener": [p for s in closed for p in self._placed(s)],
            "mountain": mountain,
            "valley": self._placed(np.array([[0.0, 0.0], [a, b]])),
            "cut": [np.array(outline)],
        }

    def write_svg(self, path: str | Path, margin: float = 5e-3) -> Path:
        """Write the pattern true to scale; one group, and layer of Inkscape, for each kind of line.

        Parameters
        ----------
        path
            The file.
        margin
            Around the sheet in m.
        """
        width, height = (1e3 * (s + 2 * margin) for s in self.size)
        top = self.size[1]
        parts = [
            '<svg xmlns="http://www.w3.org/2000/svg" '
            'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" '
            f'width="{width:.6g}mm" height="{height:.6g}mm" '
            f'viewBox="0 0 {width:.6g} {height:.6g}">',
            f"<title>Spiral box, {self.storeys} x {self.sides} cells of {1e3 * self.side:g} x "
            f"{1e3 * self.height:g} mm</title>",
        ]
        for name, lines in self.lines().items():
            colour, dashes = STYLES[name]
            fill = "#d8d8d8" if name == "stiffener" else "none"
            dash = f' stroke-dasharray="{dashes}"' if dashes else ""
            parts.append(
                f'<g id="{name}" inkscape:groupmode="layer" inkscape:label="{name}" '
                f'fill="{fill}" stroke="{colour}" stroke-width="0.2"{dash}>'
            )
            for line in lines:
                points = 1e3 * (np.array([[0, top]]) + line * [1, -1] + margin)
                text = " L ".join(f"{x:.9g} {y:.9g}" for x, y in points)
                parts.append(f'<path d="M {text}"/>')
            parts.append("</g>")
        parts.append("</svg>\n")
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join(parts), encoding="utf-8")
        return path
