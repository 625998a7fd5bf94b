"""Pictures of finished or running runs, made from their results files alone.

`curve` draws columns of history.csv against each other, `deformed` the device in colours.  By hand:

    python -m dea_fenicsx.pictures curve FOLDER --x voltage_V --y contraction
    python -m dea_fenicsx.pictures render FOLDER --field field_strength_V_per_m --warp 5

Needs matplotlib, and neither a screen nor OpenGL.  This room imports `results` and
the rooms before it, and never DOLFINx.
"""

from dea_fenicsx.pictures.command import main
from dea_fenicsx.pictures.curves import axis_label, bare, curve, spoken
from dea_fenicsx.pictures.diagram import diagram
from dea_fenicsx.pictures.drawing import animated, deformed
from dea_fenicsx.pictures.export import export
from dea_fenicsx.pictures.fidelity import ladder
from dea_fenicsx.pictures.report import report

__all__ = [
    "animated", "axis_label", "bare", "curve", "deformed", "diagram", "export", "ladder", "main",
    "report", "spoken",
]  # fmt: skip
