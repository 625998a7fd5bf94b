"""A script that opens a run in ParaView: warped, coloured, with the load of each step."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from dea_fenicsx.pictures.curves import spoken, write_whole
from dea_fenicsx.results.history import field_times
from dea_fenicsx.results.reading import (
    FIELDS_DOCUMENT,
    field_names,
    frame_times,
    load_columns,
    read_history,
    read_summary,
)
from dea_fenicsx.results.untrusted import read_xml
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.files import clean

LABELS = {
    "field_strength_MV_per_m": "Electric field (MV/m)",
    "field_strength_V_per_m": "Electric field (V/m)",
}
COLOUR_FIELDS = tuple(LABELS)
"""Fields that colour the device: the first one that a run has.  Earlier runs have V/m only."""

DISPLACEMENT = "displacement_m"

MOST_CELLS_OF_SPLIT_GRID = 20_000
"""Cells beyond which the script colours by cell: ParaView draws inner faces of split grids too."""

_MACRO = '''\
"""Open this run in ParaView: the device warped by its displacement, coloured by a field.

    paraview --script=view.py        to look at it; play runs through the steps
    pvpython view.py picture.png     a picture of the last step

The time in ParaView is that of a path with time in s; of other paths it is the place on the path,
which is 0 at the beginning, 1 at the end of the first ramp, 2 at the end of the second.
"""

import csv
import itertools
import os
import sys

import numpy as np
from paraview.simple import *

FOLDER = {folder!r}  # where the run was when this was written
FIELD, LABEL = {field!r}, {label!r}
WARP = 1.0
NODAL = {nodal!r}  # whether to colour by nodal.xdmf; devices of many cells are slow with it
REGIONS = {regions!r}  # number of each region in the array "region", and its name
WRITTEN = {written!r}  # what was to be told of each step when this was written
LOADS = {loads!r}  # columns of history.csv that hold the loads, and how they are called

here = os.path.dirname(os.path.abspath(globals().get("__file__", FOLDER + "/view.py")))
if os.path.exists(os.path.join(here, "fields.xdmf")):
    FOLDER = here


def told():
    """What stands in the picture of each step, by the history as it is now."""
    try:
        with open(os.path.join(FOLDER, "history.csv"), newline="") as file:
            rows = list(csv.DictReader(file))
        texts = []
        for row in rows:
            parts = ["step " + row["step"]]
            if "time_s" in row:
                parts.append("time %.4g s" % float(row["time_s"]))
            for column, words in LOADS:
                value = float(row[column] or "nan")
                unit = "V" if column.endswith("_V") else ""
                if unit and abs(value) >= 999.5:
                    value, unit = value / 1e3, "kV"
                parts.append(("%s %.4g %s" % (words, value, unit)).strip())
            texts.append(", ".join(parts))
        return texts
    except (OSError, KeyError, ValueError, TypeError):
        return WRITTEN


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
coloured, where = run, "CELLS"
if NODAL and os.path.exists(os.path.join(FOLDER, "nodal.xdmf")):
    # the fields at nodes, which jump between regions
    coloured, where = Xdmf3ReaderS(
        registrationName="fields at nodes", FileName=[os.path.join(FOLDER, "nodal.xdmf")]
    ), "POINTS"
    coloured.UpdatePipelineInformation()
GetAnimationScene().UpdateAnimationUsingDataTimeSteps()

view = GetActiveViewOrCreate("RenderView")
view.ViewSize = [1600, 900]
view.UseColorPaletteForBackground = 0
view.Background = [1.0, 1.0, 1.0]
view.OrientationAxesLabelColor = [0.0, 0.0, 0.0]

run.UpdatePipeline()
low_z, high_z = run.GetDataInformation().GetBounds()[4:]
REACH = 3 if high_z > low_z else 2  # dimensions of the device

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

warped = WarpByVector(registrationName="warped", Input=coloured)
warped.Vectors = ["POINTS", {displacement!r}]
warped.ScaleFactor = WARP
surface = ExtractSurface(registrationName="device", Input=warped)
surface.NonlinearSubdivisionLevel = 3
device = Show(surface, view)
ColorBy(device, (where, FIELD))
colours = GetColorTransferFunction(FIELD)
colours.ApplyPreset("Viridis (matplotlib)", True)
colours.NanColor = [0.72, 0.72, 0.72]  # parts without a field
device.RescaleTransferFunctionToDataRangeOverTime()
device.SetScalarBarVisibility(view, True)
bar = GetScalarBar(colours, view)
bar.Title, bar.ComponentTitle = LABEL, ""
bar.TitleColor = bar.LabelColor = [0.0, 0.0, 0.0]

# The colours of regions, by name; the region is an array of the device like the fields.
try:
    names = GetColorTransferFunction("region")
    names.InterpretValuesAsCategories = 1
    names.Annotations = [text for tag, name in REGIONS for text in (str(tag), name)]
except Exception as error:
    print("The regions are shown by number only:", error)

# The electrodes, each a block by its name; and all other named surfaces, which are not shown.
try:
    for name, shown_here in (("electrodes", True), ("surfaces", False)):
        document = os.path.join(FOLDER, name + ".xdmf")
        if not os.path.exists(document):
            continue
        parts = XDMFReader(registrationName=name, FileNames=[document])
        moved = WarpByVector(registrationName="warped " + name, Input=parts)
        moved.Vectors = ["POINTS", {displacement!r}]
        moved.ScaleFactor = WARP
        outside = ExtractSurface(registrationName="faces of " + name, Input=moved)
        outline = FeatureEdges(registrationName="outlines of " + name, Input=outside)
        outline.ManifoldEdges = outline.NonManifoldEdges = 0
        for source in (outside, outline) if shown_here else ():
            shown = Show(source, view)
            ColorBy(shown, None)
            shown.AmbientColor = shown.DiffuseColor = [1.0, 0.5, 0.05]
            shown.LineWidth = 4.0
        if shown_here and REACH == 3:
            Hide(outside, view)  # it would hide the field on the device
except Exception as error:
    print("The electrodes are not shown:", error)

texts = told()
load = PythonAnnotation(registrationName="load", Input=run)
# A run that has grown since has more steps than texts; each is then told by its time.
# In this expression "min" would be that of ParaView's arrays, so that a condition stands there.
told_later = "'time %.4g' % t_value"
load.Expression = "%r[int(t_index)] if t_index < %d else %s" % (texts, len(texts), told_later)
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


def loads(folder: Path) -> list[tuple[str, str]]:
    """Columns of a run's history that hold the loads, and how each is called in a picture."""
    with suppress(InputError, KeyError, TypeError, ValueError, OverflowError):
        history = read_history(folder)
        summary: dict[str, Any] = {}
        with suppress(InputError):
            summary = read_summary(folder)
        return [
            (name, spoken(name.removesuffix("_factor"), 0.0)[0])
            for name in load_columns(history, summary)[::-1]
            if history[name].dtype.kind == "f"
        ]
    return []


def written(folder: Path) -> list[str]:
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


def regions(folder: Path) -> list[tuple[int, str]]:
    """Number and name of each region of a run."""
    with suppress(InputError, KeyError, TypeError, ValueError, AttributeError):
        found = read_summary(folder)["settings"]["regions"]
        return sorted((int(tag), clean(name, 100)) for name, tag in found.items())
    return []


def is_small(folder: Path) -> bool:
    """Whether a run's device has so few cells that ParaView can draw the faces inside of it too."""
    try:
        grids = read_xml(folder / FIELDS_DOCUMENT).findall("./Domain/Grid/Grid/Topology")
        return int(grids[-1].attrib["NumberOfElements"]) <= MOST_CELLS_OF_SPLIT_GRID
    except (InputError, IndexError, KeyError, ValueError):
        return False


def write(folder: str | os.PathLike) -> Path:
    """Write view.py into a results folder and return its path.

    The script reads the history when it runs, so that it also shows a run that has grown since.

    Raises
    ------
    InputError
        If there are no fields, or the folder cannot be written.
    """
    place = Path(folder).resolve()
    names = field_names(place)
    field = next((name for name in COLOUR_FIELDS if name in names), "J")
    text = _MACRO.format(
        folder=str(place), field=field, displacement=DISPLACEMENT, label=LABELS.get(field, "J (-)"),
        written=written(place), loads=loads(place), regions=regions(place), nodal=is_small(place),
    )  # fmt: skip
    target = Path(folder) / "view.py"
    return write_whole(target, lambda file: file.write_text(text, "utf-8"))
