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

from dea_fenicsx.results.reading import read_frame
from dea_fenicsx.support.errors import InputError

DISPLACEMENT = "displacement_m"
_GREY, _LINE, _COLOURS = "#b8b8b8", "#404040", "viridis"
_WIDTH = 174 / 25.4  # inch: two columns
_DPI = 300


def scalar(grid: Any, field: str) -> tuple[np.ndarray, str, bool]:
    """A field as one number a node or cell.

    The magnitude of a vector; von Mises' equivalent of a stress.  Regions without an electric
    field (conductors) become NaN in pictures of it, and are shown in grey.

    Returns
    -------
    values, name with the unit as suffix, whether they are nodal
    """
    nodal = field in grid.point_data
    if not nodal and field not in grid.cell_data:
        names = ", ".join(sorted([*grid.point_data, *grid.cell_data]))
        raise InputError(f"There is no field {field!r} in the results; there are: {names}.")
    values = np.asarray(grid.point_data[field] if nodal else grid.cell_data[field], dtype=float)
    name = field
    if values.ndim > 1 and values.shape[1] == 9:
        stress = values.reshape(-1, 3, 3)
        deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
        values = np.sqrt(1.5 * np.einsum("nij,nij->n", deviator, deviator))
        name = "von_Mises_stress_Pa"
    elif values.ndim > 1:
        values = np.linalg.norm(values, axis=1)
    if not nodal and "V_per_m" in field and values.any():
        regions = np.asarray(grid.cell_data["region"])
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
    pixels = int(width_inch * 2 * dpi)
    size = (pixels, max(round(pixels * height / width), 8))
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
    halved = image[: size[1] // 2 * 2, : size[0] // 2 * 2].astype(float)
    halved = (halved[::2, ::2] + halved[1::2, ::2] + halved[::2, 1::2] + halved[1::2, 1::2]) / 4
    return _Image(halved.round().astype(np.uint8), (low[0], high[0], low[1], high[1]))


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
    folder: Path, field: str, step: int, warp: float, path: Path, title: Callable[[float], str],
    label: Callable[[str, float], tuple[str, float]], view: View | None = None,
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
    title
        From the step's time to the text above the picture.
    label
        From a name with its unit and the largest value to the axis label and the divisor.
    view
        Colour scale, frame and resolution; by default what fits this step.
    """
    import matplotlib
    from matplotlib.figure import Figure

    frame = read_frame(folder, step)
    grid = frame.grid
    values, name, nodal = scalar(grid, field)
    (grid.point_data if nodal else grid.cell_data)["shown"] = values
    if view is None:
        view = View(limits_of(values, name), *points_seen(frame, warp), _DPI)
    low, high = view.limits
    text, divisor = label(name, max(abs(low), abs(high)))

    def draw(surface: Any, outline: Any, lit: bool) -> Callable[[Any], None]:
        def act(plotter: Any) -> None:
            plotter.add_mesh(
                surface, scalars="shown", preference="point" if nodal else "cell", cmap=_COLOURS,
                clim=(low, high), nan_color=_GREY, show_scalar_bar=False,
                ambient=0.5 if lit else 1.0, diffuse=0.55 if lit else 0.0, specular=0.0,
            )  # fmt: skip
            plotter.add_mesh(_edges(surface), color=_LINE, line_width=3)
            if warp:
                plotter.add_mesh(outline, color="#d62728", line_width=3)

        return act

    whole = _surface(_warped(grid, warp), 3)
    outline = _edges(_surface(grid, 3))
    seen = view.outside
    section = None if frame.flat else _section(grid)
    panels: list[tuple[_Image, str]] = []
    x, y, z = np.eye(3)
    if frame.flat:
        panels.append((_shoot(draw(whole, outline, False), seen, x, y, _WIDTH, view.dpi), "xy"))
    else:
        iso_right, iso_up = np.array([1, 1, 0]) / 2**0.5, np.array([-1, 1, 2]) / 6**0.5
        act = draw(whole, outline, True)
        image = _shoot(act, seen, iso_right, iso_up, _WIDTH / 2, view.dpi, 0.01)
        panels.append((image, ""))
        if section is not None:
            moved = _warped(section, warp)
            both = view.section
            nearer = -1e-2 * (both.max() - both.min()) * y  # in front of the section
            act = draw(moved, _edges(section).translate(nearer), False)
            panels.append((_shoot(act, both, x, z, _WIDTH / 2, view.dpi), "xz"))

    style = {"font.size": 8, "font.family": "sans-serif", "axes.linewidth": 0.6,
             "xtick.major.width": 0.6, "ytick.major.width": 0.6}  # fmt: skip
    with matplotlib.rc_context(style):
        tallest = max(image.pixels.shape[0] / image.pixels.shape[1] for image, _ in panels)
        height = min(0.8 * _WIDTH / len(panels) * tallest + 0.75, 1.2 * _WIDTH)
        figure = Figure(figsize=(_WIDTH, height), layout="constrained")
        axes = np.atleast_1d(figure.subplots(1, len(panels)))
        for axis, (image, plane) in zip(axes, panels, strict=True):
            axis.imshow(image.pixels, extent=[1e3 * e for e in image.extent])
            if plane:
                axis.set_xlabel(f"{plane[0]} (mm)")
                axis.set_ylabel(f"{plane[1]} (mm)")
                if plane == "xz":
                    middle = 1e3 * (grid.bounds[2] + grid.bounds[3]) / 2
                    axis.set_title(f"section y = {round(middle, 4) + 0.0:g} mm", fontsize=8)
            else:
                axis.set_axis_off()
        scale = matplotlib.cm.ScalarMappable(
            matplotlib.colors.Normalize(low / divisor, high / divisor), _COLOURS
        )
        figure.colorbar(scale, ax=list(axes), label=text, aspect=25)
        grey = "" if np.isfinite(values).all() else ", no field in grey"
        figure.suptitle(title(frame.time) + grey, fontsize=8)
        figure.savefig(path, format="png", dpi=view.dpi)
