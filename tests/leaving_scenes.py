"""A square column whose two buckling modes are neutral at once, and what ranks are compared by."""

import numpy as np
from test_branches import DEFLECTION, EULER, strip

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer

SIDE, HEIGHT = 1e-3, 1e-2
MIDDLE = {
    axis: dea.AtPoint((SIDE / 2, SIDE / 2, HEIGHT / 2), "displacement", axis) for axis in "xy"
}


def column():
    """Clamped at both ends and pressed together by a tenth of its height."""
    mesh = BoxStack(SIDE, SIDE, [Layer("column", HEIGHT, 4)], divisions=(1, 1))
    return dea.Scene(
        dea.read_gmsh(mesh), {"column": dea.Material(dea.NeoHookean(1e5))},
        supports=[dea.Clamp("bottom"), dea.Fix("top", "xy")],
        prescribed=[dea.Displacement("top", "z", -0.1 * HEIGHT)],
    )  # fmt: skip


def bent(along):
    """Where its middle moves, over its side, if it leaves the straight branch along a shape."""
    path = dea.Trace("stretch", first=0.3, steps=5, switch=0.3, along=along)
    run = dea.solve(column(), path, MIDDLE, quiet=True, stability="every")
    return np.array([run["x_m"], run["y_m"]]) / SIDE, run


def on_all_ranks(comm):
    """What the test of ranks compares: a column, a diagram, and equilibria found by deflation."""
    path = dea.Trace("voltage", first=0.5, until=("voltage_V", 1.2 * EULER), steps=30)
    found = dea.branches(strip(), path, DEFLECTION, most=1, quiet=True)
    run = dea.solve(strip(), dea.Ramp("voltage", to=1.2, steps=2), DEFLECTION, quiet=True)
    others = dea.deflate(run, DEFLECTION, most=2)
    return {
        "diagonal": bent((1.0, 1.0))[0].tolist(),
        "arch": [float(found["branch_1"].column("middle_m")[-1])],
        "critical": [part["to"] for part in found["first"].intervals],
        "deflated": [one.values["middle_m"] for one in others],
        "counts": [one.negative_modes for one in others],
    }
