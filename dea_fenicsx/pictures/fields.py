"""Rendering of a run's fields: the device and a section through it, side by side.

Only `dea_fenicsx.pictures render` comes here, in a process of its own, whose memory is free again
afterwards.  The images are drawn by `raster`; axes, scales and text are matplotlib's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dea_fenicsx.pictures.drawn_body import ISOMETRIC, DrawnBody, X, Y, Z
from dea_fenicsx.pictures.obstacles import DrawnObstacle
from dea_fenicsx.pictures.pieces import triangles_of
from dea_fenicsx.pictures.raster import Canvas
from dea_fenicsx.pictures.section import Section

_GREY, _LINE, _RED = (0xB8, 0xB8, 0xB8), (0x40, 0x40, 0x40), (0xD6, 0x27, 0x28)
_OBSTACLE, _OBSTACLE_EDGE = (0xC6, 0xD8, 0xE8), (0x5B, 0x7C, 0x99)
_GLAZE = 0.45
"""Share of an obstacle's colour where it is seen in space; one can look through it."""

_COLOURS = "viridis"
_WIDTH = 174 / 25.4  # inch: two columns
_DPI = 300
_TALLEST = 1.1 * _WIDTH
"""Largest height of an image in inches."""

_LEAST_HEIGHT = 1.8
"""Smallest height of a picture in inches, in which the label of the colour scale has room."""

_NARROWEST = 4.0
"""Smallest width of a picture in inches, in which its title has room."""

_MOST_PIXELS = 6e6
"""Most pixels of a rendered image; twice as many across as are shown, so that edges are smooth."""

_LINE_WIDTH = 3
"""Width of a line in pixels of a rendered image."""

_LIGHT = np.array([0.2, 0.5, 0.85])
"""Where the light comes from, as seen in a picture: from the right, from above, from the viewer."""

_AMBIENT, _DIFFUSE = 0.5, 0.55
"""Brightness of a surface without light, and what the light adds to it."""


_MANY = 100_000
"""Triangles that are looked at together."""


# ------------------------------------------------------------------------ images


@dataclass(frozen=True)
class _Image:
    """A rendered image and where it lies, in metres, in the plane of the camera."""

    pixels: np.ndarray
    extent: tuple[float, float, float, float]


class _Camera:
    """A view in parallel projection, which a canvas takes in pixels.

    Parameters
    ----------
    seen
        Points that must be seen, shape (n, 3).
    right, up
        Unit vectors of the picture.
    width_inch, dpi, margin
        Width, resolution, and room around as a share of the larger side.
    """

    def __init__(
        self, seen: np.ndarray, right: np.ndarray, up: np.ndarray, width_inch: float, dpi: int,
        margin: float = 0.03,
    ) -> None:  # fmt: skip
        self.axes = np.array([right, up, np.cross(right, up)])
        across = [seen @ axis for axis in self.axes[:2]]
        low, high = np.array([a.min() for a in across]), np.array([a.max() for a in across])
        pad = margin * (high - low).max()
        self.low, self.high = low - pad, high + pad
        width, height = self.high - self.low
        size = _pixels(width, height, width_inch, dpi)
        self.canvas = Canvas(*(n // 2 * 2 for n in size))
        self.scale = self.canvas.width / width, self.canvas.height / height

    def at(self, points: np.ndarray) -> np.ndarray:
        """Places of points in pixels, shape (..., 3)."""
        across = points @ self.axes.T.astype(points.dtype)
        for k in (0, 1):
            across[..., k] -= self.low[k]
            across[..., k] *= self.scale[k]
        across[..., 2] *= max(self.scale)
        return np.asarray(across)

    def image(self) -> _Image:
        """What was drawn, at half the resolution."""
        fine = self.canvas.image()
        total = np.full((fine.shape[0] // 2, fine.shape[1] // 2, 3), 2, dtype=np.uint16)  # rounds
        for row in (0, 1):
            for column in (0, 1):
                total += fine[row::2, column::2]
        extent = self.low[0], self.high[0], self.low[1], self.high[1]
        return _Image((total // 4).astype(np.uint8), extent)


def _pixels(width: float, height: float, width_inch: float, dpi: int) -> tuple[int, int]:
    """Pixels across and along of an image with the sides of a view, twice as many as are shown."""
    inches = min(width_inch, _TALLEST * width / height)
    across = inches * 2 * dpi
    across = min(across, (_MOST_PIXELS * width / height) ** 0.5)
    return max(round(across), 16), max(round(across * height / width), 16)


def _colours() -> np.ndarray:
    """The scale of colours from 0 to 255, shape (256, 3)."""
    import matplotlib

    return np.asarray(255 * matplotlib.colormaps[_COLOURS](np.arange(256))[:, :3])


@dataclass(frozen=True)
class View:
    """What pictures of one film share, so that nothing jumps between them.

    Attributes
    ----------
    limits : ends of the colour scale, in SI units
    outside, section : points that must be seen, shape (n, 3)
    dpi : resolution
    """

    limits: tuple[float, float]
    outside: np.ndarray
    section: np.ndarray
    dpi: int


@dataclass(frozen=True)
class Words:
    """What stands in a picture.

    Attributes
    ----------
    title : from the step's time to the text above the picture
    label : from a name with its unit and the largest value to the axis label and the divisor
    axes : names of the axes of the run's fields
    """

    title: Callable[[float], str]
    label: Callable[[str, float], tuple[str, float]]
    axes: tuple[str, str, str] = ("x", "y", "z")


def limits_of(values: np.ndarray, name: str) -> tuple[float, float]:
    """Ends of the colour scale; those of an electric field and of a constant start at 0."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
    if name.endswith("V_per_m") or high - low < 1e-9 * max(abs(high), abs(low)):
        low = min(low, 0.0)
    return (low, high) if high > low else (low, low + 1.0)


def render(
    folder: Path, field: str, step: int, warp: float, path: Path, words: Words,
    view: View | None = None,
) -> None:  # fmt: skip
    """Draw a step of a run: the device in isometric view and a section through it.

    Parameters
    ----------
    folder, field, step
        The run, the name of one of its fields, and the step.
    warp
        Scale of the drawn displacement.
    path
        The PNG file.
    words
        What stands in the picture.
    view
        Colour scale, frame and resolution; by default what fits this step.
    """
    body = DrawnBody(folder, field, step, words.axes)
    if view is None:
        view = View(limits_of(body.values, body.name), *body.seen(warp), _DPI)
    low, high = view.limits
    text, divisor = words.label(body.name, max(abs(low), abs(high)))
    grey = "" if np.isfinite(body.values).all() else ", no field in grey"
    blue = ", obstacles in blue" if body.obstacles else ""
    title, panels = words.title(body.time) + grey + blue, _panels(body, warp, view, words.axes)
    del body  # matplotlib needs the memory
    _compose(panels, (low / divisor, high / divisor), text, title, path, view.dpi)


@dataclass(frozen=True)
class _Panel:
    """An image in the picture.

    Attributes
    ----------
    image : the image
    axes : names of the axes across and along; none for an isometric view without axes
    title : text above it
    """

    image: _Image
    axes: tuple[str, ...]
    title: str = ""


def _panels(
    body: DrawnBody, warp: float, view: View, axes: tuple[str, str, str]
) -> list[_Panel]:
    """Images of the deformed device and of its section, each over the undeformed edges."""
    if body.flat:
        camera = _Camera(view.outside, X, Y, _WIDTH, view.dpi)
        _draw_device(camera, body, warp, view.limits)
        return [_Panel(camera.image(), axes[:2])]
    camera = _Camera(view.outside, *ISOMETRIC, _WIDTH / 2, view.dpi, 0.01)
    _draw_device(camera, body, warp, view.limits)
    panels = [_Panel(camera.image(), ())]
    section = body.section
    if section is not None:
        camera = _Camera(view.section, X, Z, _WIDTH / 2, view.dpi)
        _draw_section(camera, body, section, warp, view.limits)
        above = f"section y = {round(1e3 * section.at, 4) + 0.0:g} mm"
        panels.append(_Panel(camera.image(), ("x", "z"), above))
    return panels


def _draw_device(
    camera: _Camera, body: DrawnBody, warp: float, limits: tuple[float, float]
) -> None:
    """Draw the deformed device, its edges, and those of the undeformed one in red."""
    points = body.faces.points
    moved = points + points.dtype.type(warp) * body.faces.moves
    _fill_device(camera, body, moved, limits)
    if body.flat:
        _paint_obstacles(camera, [one.warped(warp) for one in body.obstacles], 0.0)
    shapes = [moved, points] if warp else [moved]
    for lines, colour in zip(body.outlines(shapes), (_LINE, _RED), strict=False):
        camera.canvas.lines(camera.at(lines), colour, _LINE_WIDTH, not body.flat)
    for triangles in [] if body.flat else body.shells(warp):
        at = camera.at(triangles).reshape(-1, 3)
        corners = np.arange(len(at)).reshape(-1, 3)
        bright = _brightness(at, corners)
        camera.canvas.glaze(at, corners, np.array(_OBSTACLE_EDGE), bright, _GLAZE)


def _paint_obstacles(camera: _Camera, obstacles: list[DrawnObstacle], at: float) -> None:
    """Paint obstacles behind what is drawn, in a plane: that of a flat device, or y = `at`."""
    canvas, rows = camera.canvas, max(_MANY // camera.canvas.width, 1)
    (low_x, low_y), (by_x, by_y) = camera.low, camera.scale
    x = low_x + (np.arange(canvas.width) + 0.5) / by_x
    for row in range(0, canvas.height, rows):
        y = low_y + (np.arange(row, min(row + rows, canvas.height)) + 0.5) / by_y
        points = x[None, :, None] * camera.axes[0] + y[:, None, None] * camera.axes[1]
        points = points - at * camera.axes[2]
        for obstacle in obstacles:
            gap = obstacle.gap(points)
            canvas.paint_behind(gap < 0, row, _OBSTACLE)
            canvas.paint_behind(np.abs(gap) < _LINE_WIDTH / max(by_x, by_y), row, _OBSTACLE_EDGE)


def _fill_device(
    camera: _Camera, body: DrawnBody, moved: np.ndarray, limits: tuple[float, float]
) -> None:
    """Draw the faces of the device in the colours of the field."""
    faces = body.faces
    fine = triangles_of(faces, body.facing(moved, camera.axes[2]))
    at = fine.at(camera.at(moved))
    shade = None if body.flat else _brightness(at, fine.corners)
    values = fine.at(body.values[faces.kept]) if body.nodal else body.values[
        faces.parents[fine.faces]
    ]
    camera.canvas.fill(
        at, fine.corners, values, body.nodal, _colours(), np.array(_GREY), limits, shade
    )


def _brightness(at: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Brightness of each triangle by its direction to the light."""
    light = (_LIGHT / np.linalg.norm(_LIGHT)).astype(np.float32)
    found = np.empty(len(corners), dtype=np.float32)
    for begin in range(0, len(corners), _MANY):
        some = corners[begin : begin + _MANY]
        a, b, c = (at[some[:, k]].astype(np.float32) for k in range(3))
        normal = np.cross(b - a, c - a)
        normal *= np.where(normal[:, 2:] < 0, -1, 1).astype(np.float32)  # the side that is seen
        towards = normal @ light / np.maximum(np.linalg.norm(normal, axis=1), 1e-30)
        found[begin : begin + _MANY] = _AMBIENT + _DIFFUSE * np.clip(towards, 0.0, 1.0)
    return found


def _draw_section(
    camera: _Camera, body: DrawnBody, section: Section, warp: float, limits: tuple[float, float]
) -> None:
    """Draw the deformed section, its edges, and those of the undeformed one in red over it."""
    at = camera.at(section.points + warp * section.moves).reshape(-1, 3)
    corners = np.arange(len(at)).reshape(-1, 3)
    nodal = section.values.ndim == 2
    camera.canvas.fill(
        at, corners, section.values.ravel(), nodal, _colours(), np.array(_GREY), limits
    )
    _paint_obstacles(camera, [one.warped(warp) for one in body.obstacles], section.at)
    lines = camera.at(section.lines + warp * section.line_moves)
    camera.canvas.lines(lines, _LINE, _LINE_WIDTH, False)
    if warp:
        camera.canvas.lines(camera.at(section.lines), _RED, _LINE_WIDTH, False)


def _compose(
    panels: list[_Panel], limits: tuple[float, float], label: str, title: str, path: Path, dpi: int
) -> None:
    """Set the images side by side with their axes in mm, a colour scale and a title."""
    import matplotlib
    from matplotlib.figure import Figure

    style = {"font.size": 8, "font.family": "sans-serif", "axes.linewidth": 0.6,
             "xtick.major.width": 0.6, "ytick.major.width": 0.6}  # fmt: skip
    with matplotlib.rc_context(style):
        shapes = [panel.image.pixels.shape for panel in panels]
        tallest = max(rows / columns for rows, columns, *_ in shapes)
        height = min(0.8 * _WIDTH / len(panels) * tallest + 0.75, 1.2 * _WIDTH)
        height = max(height, _LEAST_HEIGHT)
        width = _WIDTH
        if len(panels) == 1:  # a tall picture alone leaves no empty paper beside it
            width = min(_WIDTH, max(_NARROWEST, height / tallest + 2.0))
        figure = Figure(figsize=(width, height), layout="constrained")
        axes = np.atleast_1d(figure.subplots(1, len(panels)))
        for axis, panel in zip(axes, panels, strict=True):
            axis.imshow(panel.image.pixels, extent=[1e3 * e for e in panel.image.extent])
            if panel.axes:
                # Numbers below a narrow image would run into each other, and so beside a low one.
                rows, columns, *_ = panel.image.pixels.shape
                below, beside = 12 * columns // rows, 30 * rows // (columns * len(panels))
                axis.locator_params(axis="x", nbins=max(1, min(6, below)), min_n_ticks=1)
                axis.locator_params(axis="y", nbins=max(1, min(9, beside)), min_n_ticks=1)
                axis.set_xlabel(f"{panel.axes[0]} (mm)")
                axis.set_ylabel(f"{panel.axes[1]} (mm)")
                if panel.title:
                    axis.set_title(panel.title, fontsize=8)
            else:
                axis.set_axis_off()
        scale = matplotlib.cm.ScalarMappable(matplotlib.colors.Normalize(*limits), _COLOURS)
        figure.colorbar(scale, ax=list(axes), label=label, aspect=25)
        figure.suptitle(title, fontsize=8, wrap=True)
        figure.savefig(path, format="png", dpi=dpi)
