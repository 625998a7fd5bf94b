"""Rendering of a run's fields: the device and a section through it, side by side.

Only `dea_fenicsx.pictures render` comes here, in a process of its own, because VTK ends the whole
process where it finds no OpenGL.  The 3-D images are VTK's; axes, scales and text are matplotlib's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.pictures.outside import is_split, outer_faces
from dea_fenicsx.results.axes import FIXED
from dea_fenicsx.results.components import component
from dea_fenicsx.results.reading import frame_for
from dea_fenicsx.support.errors import InputError

DISPLACEMENT = "displacement_m"
_GREY, _LINE, _COLOURS = "#b8b8b8", "#404040", "viridis"
_WIDTH = 174 / 25.4  # inch: two columns
_DPI = 300
_TALLEST = 1.1 * _WIDTH
"""Largest height of an image in inches."""

_LEAST_HEIGHT = 1.8
"""Smallest height of a picture in inches, in which the label of the colour scale has room."""

_NARROWEST = 4.0
"""Smallest width of a picture in inches, in which its title has room."""

_MOST_PIXELS = 8e6
"""Most pixels of a rendered image; twice as many across as are shown, so that edges are smooth."""


def scalar(
    grid: Any, field: str, axes: tuple[str, str, str] = FIXED
) -> tuple[np.ndarray, str, bool]:
    """A field, or a component by its axes, as one number a node or cell.

    The magnitude of a vector; von Mises' equivalent of a stress.  Regions without an electric
    field (conductors) become NaN in pictures of it, and are shown in grey.

    Returns
    -------
    values, name with the unit as suffix, whether they are nodal
    """
    part = component(field, [*grid.point_data, *grid.cell_data], axes)
    whole = field if part is None else part[0]
    nodal = whole in grid.point_data
    if not nodal and whole not in grid.cell_data:
        names = ", ".join(sorted([*grid.point_data, *grid.cell_data]))
        raise InputError(f"There is no field {field!r} in the results; there are: {names}.")
    values = np.array(grid.point_data[whole] if nodal else grid.cell_data[whole], dtype=float)
    name = field
    if part is not None:
        values = values[:, part[1]]
    elif values.ndim > 1 and values.shape[1] == 9:
        stress = values.reshape(-1, 3, 3)
        deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
        values = np.sqrt(1.5 * np.einsum("nij,nij->n", deviator, deviator))
        name = "von_Mises_stress_Pa"
    elif values.ndim > 1:
        values = np.linalg.norm(values, axis=1)
    if "V_per_m" in field and values.any():
        regions = np.asarray(grid.cell_data["region"])
        if nodal:  # each node belongs to cells of one region
            table = grid.cells_dict.popitem()[1]
            of_nodes = np.zeros(grid.n_points, dtype=regions.dtype)
            of_nodes[table.ravel()] = np.repeat(regions, table.shape[1])
            regions = of_nodes
        for region in np.unique(regions):
            if not values[regions == region].any():
                values[regions == region] = np.nan
    return values, name, nodal


# ------------------------------------------------------------------------ images


@dataclass(frozen=True)
class _Image:
    """A rendered image and where it lies, in metres, in the plane of the camera."""

    pixels: np.ndarray
    extent: tuple[float, float, float, float]


def _shoot(
    draw: Callable[[Any], None], bounds: Any, right: np.ndarray, up: np.ndarray, width_inch: float,
    dpi: int, margin: float = 0.03,
) -> _Image:  # fmt: skip
    """Render in parallel projection; `bounds` (n, 3) are points that must be seen."""
    import pyvista

    across, along = bounds @ right, bounds @ up
    low, high = np.array([across.min(), along.min()]), np.array([across.max(), along.max()])
    pad = margin * (high - low).max()
    low, high = low - pad, high + pad
    width, height = high - low
    size = _pixels(width, height, width_inch, dpi)
    normal = np.cross(right, up)
    depth = bounds @ normal
    focus = (low[0] + high[0]) / 2 * right + (low[1] + high[1]) / 2 * up + depth.mean() * normal
    reach = 2 * max(np.ptp(depth), width, height)
    plotter = pyvista.Plotter(off_screen=True, window_size=list(size), lighting="light kit")
    plotter.background_color = "white"
    draw(plotter)
    camera = plotter.camera
    camera.focal_point = focus
    camera.position = focus + reach * normal
    camera.up = up
    camera.parallel_projection = True
    camera.parallel_scale = height / 2
    plotter.renderer.ResetCameraClippingRange()
    image = plotter.screenshot(None, return_img=True)
    plotter.close()
    image = image[: size[1] // 2 * 2, : size[0] // 2 * 2]
    total = np.full((size[1] // 2, size[0] // 2, image.shape[2]), 2, dtype=np.uint16)  # rounds
    for row in (0, 1):
        for column in (0, 1):
            total += image[row::2, column::2]
    return _Image((total // 4).astype(np.uint8), (low[0], high[0], low[1], high[1]))


def _pixels(width: float, height: float, width_inch: float, dpi: int) -> tuple[int, int]:
    """Pixels across and along of an image with the sides of a view, twice as many as are shown."""
    inches = min(width_inch, _TALLEST * width / height)
    across = inches * 2 * dpi
    across = min(across, (_MOST_PIXELS * width / height) ** 0.5)
    return max(round(across), 16), max(round(across * height / width), 16)


def _edges(surface: Any) -> Any:
    """Sharp edges, free edges and borders of regions of a surface, as lines."""
    import pyvista

    parts = pyvista.MultiBlock()
    regions = np.asarray(surface.cell_data["region"])
    for region in np.unique(regions):
        part = surface.extract_cells(np.flatnonzero(regions == region))
        part = _surface(part, 0)
        parts.append(
            part.extract_feature_edges(
                40, manifold_edges=False, non_manifold_edges=False, clear_data=True
            )
        )
    return parts.combine()


def _warped(grid: Any, factor: float) -> Any:
    moved = grid.copy()
    if factor:
        moved.points = grid.points + factor * np.asarray(grid.point_data[DISPLACEMENT])
    return moved


def _surface(mesh: Any, subdivision: int) -> Any:
    """The outer surface; curved faces are split `subdivision` times."""
    # not pyvista's extract_surface, whose choice of algorithm is about to change
    import pyvista
    from vtkmodules.vtkFiltersGeometry import vtkDataSetSurfaceFilter

    if is_split(mesh):
        mesh = outer_faces(mesh)
    algorithm = vtkDataSetSurfaceFilter()
    algorithm.SetInputData(mesh)
    algorithm.SetNonlinearSubdivisionLevel(subdivision)
    algorithm.Update()
    return pyvista.wrap(algorithm.GetOutput())


def _section(grid: Any) -> Any:
    """The undeformed device cut by the plane y = middle, or one side of it if it has a hole there.

    The plane lies a little off the middle, where cell faces are likely to lie.
    """
    low, high = np.array(grid.bounds).reshape(3, 2).T
    middle = (low + high) / 2
    cut = grid.slice(normal="y", origin=middle + np.array([0, 2e-3, 0]) * (high - low))
    if cut.n_cells == 0:
        return None
    cut = cut.triangulate()
    x = np.asarray(cut.points)[cut.faces.reshape(-1, 4)[:, 1:], 0] - middle[0]
    # the side x < 0: at x > 0 lie the ends of a helical device, where nothing is typical
    left = x.max(axis=1) < -0.01 * (high[0] - low[0])
    if left.any() and (left | (x.min(axis=1) > 0)).all():
        cut = _surface(cut.extract_cells(np.flatnonzero(left)), 0)
    return cut


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


def points_seen(frame: Any, warp: float) -> tuple[np.ndarray, np.ndarray]:
    """Points of the device and of its section, deformed and not, shapes (n, 3)."""
    grid = frame.grid
    outside = np.vstack([_surface(_warped(grid, warp), 3).points, np.asarray(grid.points)])
    section = None if frame.flat else _section(grid)
    if section is None:
        return outside, np.empty((0, 3))
    return outside, np.vstack([_warped(section, warp).points, section.points])


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
    frame = frame_for(folder, step, field)
    grid = frame.grid
    values, name, nodal = scalar(grid, field, words.axes)
    (grid.point_data if nodal else grid.cell_data)["shown"] = values
    if view is None:
        view = View(limits_of(values, name), *points_seen(frame, warp), _DPI)
    low, high = view.limits
    text, divisor = words.label(name, max(abs(low), abs(high)))
    grey = "" if np.isfinite(values).all() else ", no field in grey"
    _compose(
        _panels(frame, nodal, warp, view, words.axes),
        (low / divisor, high / divisor),
        text,
        words.title(frame.time) + grey,
        path,
        view.dpi,
    )


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


def _painter(
    surface: Any, lines: Any, view: View, nodal: bool, lit: bool
) -> Callable[[Any], None]:
    """What draws a surface in the colours of its field, and lines in red over it."""

    def paint(plotter: Any) -> None:
        plotter.add_mesh(
            surface, scalars="shown", preference="point" if nodal else "cell", cmap=_COLOURS,
            clim=view.limits, nan_color=_GREY, show_scalar_bar=False,
            ambient=0.5 if lit else 1.0, diffuse=0.55 if lit else 0.0, specular=0.0,
        )  # fmt: skip
        plotter.add_mesh(_edges(surface), color=_LINE, line_width=3)
        if lines is not None:
            plotter.add_mesh(lines, color="#d62728", line_width=3)

    return paint


def _panels(
    frame: Any, nodal: bool, warp: float, view: View, axes: tuple[str, str, str]
) -> list[_Panel]:
    """Images of the deformed device and of its section, each over the undeformed edges."""
    grid = frame.grid
    x, y, z = np.eye(3)
    whole = _surface(_warped(grid, warp), 3)
    outline = _edges(_surface(grid, 3)) if warp else None
    if frame.flat:
        paint = _painter(whole, outline, view, nodal, lit=False)
        return [_Panel(_shoot(paint, view.outside, x, y, _WIDTH, view.dpi), axes[:2])]
    right, up = np.array([1, 1, 0]) / 2**0.5, np.array([-1, 1, 2]) / 6**0.5
    paint = _painter(whole, outline, view, nodal, lit=True)
    panels = [_Panel(_shoot(paint, view.outside, right, up, _WIDTH / 2, view.dpi, 0.01), ())]
    section = _section(grid)
    if section is not None:
        seen = view.section
        nearer = -1e-2 * (seen.max() - seen.min()) * y  # in front of the section
        edges = _edges(section).translate(nearer) if warp else None
        paint = _painter(_warped(section, warp), edges, view, nodal, lit=False)
        middle = 1e3 * (grid.bounds[2] + grid.bounds[3]) / 2
        above = f"section y = {round(middle, 4) + 0.0:g} mm"
        panels.append(_Panel(_shoot(paint, seen, x, z, _WIDTH / 2, view.dpi), ("x", "z"), above))
    return panels


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
                # Numbers below a narrow image would run into each other.
                rows, columns, *_ = panel.image.pixels.shape
                axis.locator_params(axis="x", nbins=max(1, min(6, 12 * columns // rows)))
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
