"""A script that opens a run in ParaView: warped, coloured, with the load of each step."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.pictures.curves import axis_label, spoken, write_whole
from dea_fenicsx.results.history import field_times
from dea_fenicsx.results.reading import (
    field_names,
    frame_times,
    load_columns,
    read_history,
    read_summary,
)
from dea_fenicsx.support.errors import InputError

FIELD = "field_strength_V_per_m"
DISPLACEMENT = "displacement_m"

_MACRO = '''\
"""Open this run in ParaView: the device warped by its displacement, coloured by a field.

    paraview --script=view.py        to look at it; play runs through the steps
    pvpython view.py picture.png     a picture of the last step
"""

import itertools
import os
import sys

import numpy as np
from paraview.simple import *

FOLDER = {folder!r}  # where the run was when this was written
FIELD, LABEL = {field!r}, {label!r}
WARP = 1.0
LOADS = {loads!r}

here = os.path.dirname(os.path.abspath(globals().get("__file__", FOLDER + "/view.py")))
if os.path.exists(os.path.join(here, "fields.xdmf")):
    FOLDER = here


def fit(view, sources):
    """Fill the view with the boxes around some sources; ParaView itself fits a sphere."""
    camera = GetActiveCamera()
    into = np.array(camera.GetDirectionOfProjection())
    right = np.cross(into, camera.GetViewUp())
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(right, into)])
    boxes = [np.reshape(s.GetDataInformation().GetBounds(), (3, 2)) for s in sources]
    corners = np.array([corner for box in boxes for corner in itertools.product(*box)])
    seen = corners @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    middle = np.array(view.CameraFocalPoint)
    shift = axes.T @ ((low + high) / 2 - axes @ middle)
    view.CameraFocalPoint = list(middle + shift)
    view.CameraPosition = list(np.array(view.CameraPosition) + shift)
    width, height = (high - low) / 2
    across = width * view.ViewSize[1] / view.ViewSize[0]
    view.CameraParallelScale = max(1.15 * height, 1.35 * across)  # room for the scale of colours


run = Xdmf3ReaderS(registrationName="run", FileName=[os.path.join(FOLDER, "fields.xdmf")])
run.UpdatePipelineInformation()
GetAnimationScene().UpdateAnimationUsingDataTimeSteps()

view = GetActiveViewOrCreate("RenderView")
view.ViewSize = [1600, 900]
view.UseColorPaletteForBackground = 0
view.Background = [1.0, 1.0, 1.0]
view.OrientationAxesLabelColor = [0.0, 0.0, 0.0]

# The surface is extracted here, not by the representation: that of ParaView 5.11 colours the parts
# of a curved face by the wrong cell.
at_rest = ExtractSurface(registrationName="at rest", Input=run)
at_rest.NonlinearSubdivisionLevel = 3
edges = FeatureEdges(registrationName="undeformed", Input=at_rest)
edges.ManifoldEdges = edges.NonManifoldEdges = 0
edges.FeatureAngle = 40.0
undeformed = Show(edges, view)
ColorBy(undeformed, None)
undeformed.AmbientColor = undeformed.DiffuseColor = [0.84, 0.15, 0.16]
undeformed.LineWidth = 2.0

warped = WarpByVector(registrationName="warped", Input=run)
warped.Vectors = ["POINTS", {displacement!r}]
warped.ScaleFactor = WARP
surface = ExtractSurface(registrationName="device", Input=warped)
surface.NonlinearSubdivisionLevel = 3
device = Show(surface, view)
ColorBy(device, ("CELLS", FIELD))
colours = GetColorTransferFunction(FIELD)
colours.ApplyPreset("Viridis (matplotlib)", True)
device.RescaleTransferFunctionToDataRangeOverTime()
device.SetScalarBarVisibility(view, True)
bar = GetScalarBar(colours, view)
bar.Title, bar.ComponentTitle = LABEL, ""
bar.TitleColor = bar.LabelColor = [0.0, 0.0, 0.0]

load = PythonAnnotation(registrationName="load", Input=run)
load.Expression = repr(LOADS) + "[int(t_index)]"
text = Show(load, view)
text.Color = [0.0, 0.0, 0.0]
text.FontSize = 20

scene = GetAnimationScene()
scene.GoToLast()
SetActiveSource(warped)
view.CameraParallelProjection = 1
Render()  # the first one places the camera by itself
x0, x1, y0, y1, z0, z1 = run.GetDataInformation().GetBounds()
if z1 == z0:
    view.ResetActiveCameraToNegativeZ()
else:
    view.ResetActiveCameraToPositiveY()
    camera = GetActiveCamera()
    camera.Azimuth(-35)
    camera.Elevation(30)
view.ResetCamera()
for source in (at_rest, surface):
    source.UpdatePipeline(view.ViewTime)
fit(view, [at_rest, surface])
Render()
if len(sys.argv) > 1 and sys.argv[-1].endswith(".png"):
    SaveScreenshot(sys.argv[-1], view, ImageResolution=[1600, 900])
'''


def loads(folder: Path) -> list[str]:
    """What stands in the picture of each step on disk: "step 3: voltage 2 kV"."""
    times = frame_times(folder)
    texts = [f"time {t:.4g}" for t in times]
    with suppress(InputError, KeyError, TypeError, ValueError, OverflowError):
        history = read_history(folder)
        summary: dict[str, Any] = {}
        with suppress(InputError):
            summary = read_summary(folder)
        columns = load_columns(history, summary)[::-1]
        shown = np.array(field_times(history))
        for k, time in enumerate(times):
            row = int(np.argmin(np.abs(shown - time)))
            parts = [
                " ".join(spoken(name.removesuffix("_factor"), float(history[name][row])))
                for name in columns
            ]
            texts[k] = ", ".join([f"step {int(history['step'][row])}", *parts])
    return texts


def write(folder: str | os.PathLike) -> Path:
    """Write view.py into a results folder and return its path.

    Raises
    ------
    InputError
        If there are no fields, or the folder cannot be written.
    """
    place = Path(folder).resolve()
    names = field_names(place)
    field = FIELD if FIELD in names else "J"
    largest = 0.0
    with suppress(InputError, KeyError, TypeError, ValueError):
        largest = float(np.nanmax(read_history(place)["max_field_V_per_m"]))
    words = axis_label(field, largest)[0].rsplit(" (", 1)[0]
    text = _MACRO.format(
        folder=str(place), field=field, displacement=DISPLACEMENT,
        label=f"{words} (V/m)" if field == FIELD else "J (-)", loads=loads(place),
    )  # fmt: skip
    return write_whole(place / "view.py", lambda file: file.write_text(text, "utf-8"))
