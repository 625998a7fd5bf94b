"""Section 5.2.2: one storey of the Kresling box by finite elements, small displacements.

Sizes that the thesis does not give: hinges 2 mm wide, panels of 2.1 GPa (PETG).
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from dea_fenicsx.geometry import KreslingCell
from dea_fenicsx.materials import Material, NeoHookean, bulk_modulus_of
from dea_fenicsx.measure.observables import Reaction
from dea_fenicsx.mesh.device import device as device_of
from dea_fenicsx.origami import INCH
from dea_fenicsx.path.items import Ramp
from dea_fenicsx.run.session import solve
from dea_fenicsx.scene.conditions import Clamp, Displacement
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.thesis.systems.kresling import EDGE, FLAT, HEIGHT, SIDE
from dea_fenicsx.thesis.table import ASSUMED, WRONG, Row, answer, computed

PANEL, POISSON, HINGE, THICKNESS = 2.1e9, 0.38, 2e-3, 0.02 * INCH
SMALL = 1e-6 * HEIGHT


def stiffness(young: float, panel: float) -> float:
    """Of the storey with free twist in N/m, for Young's moduli of hinges and panels in Pa."""
    cell = KreslingCell(SIDE, HEIGHT, np.pi / 4, THICKNESS, HINGE, along=2, strip=2)
    mu = panel / (2 * (1 + POISSON))
    rubber = Material(NeoHookean(young / 3))
    scene = Scene(
        device_of(cell, MPI.COMM_SELF),
        {"panel": Material(NeoHookean(mu), bulk_modulus=bulk_modulus_of(mu, POISSON)),
         "side": rubber, "edge": rubber, "diagonal": rubber},
        supports=[Clamp("bottom")],
        prescribed=[Displacement("top", "z", -SMALL)],
    )  # fmt: skip
    run = solve(scene, Ramp("stretch", steps=1), {"force": Reaction("top", "z")}, quiet=True,
                stability="never")  # fmt: skip
    return -run["force_N"] / SMALL


def rows() -> list[Row]:
    s = "kresling_cell_fea"
    stiff, soft = (stiffness(young, PANEL) for young in (100e6, 50e6))
    rigid = [stiffness(young, 1e3 * PANEL) for young in (100e6, 50e6)]
    meet = float(FLAT.at_twist(FLAT.contact_twist).height)
    return [
        answer(s, "force_profile", stiff, ASSUMED,
               "the slope at rest, free twist, with hinges of 100 MPa, 2 mm wide, and panels of "
               "2.1 GPa, none of them printed.  A linear solution gives a line for any storey; at "
               "large displacements the force is none"),
        answer(s, "stiffness_drop_hinge_half", 1 - soft / stiff, WRONG,
               f"hinges alone (rigid panels) {1 - rigid[1] / rigid[0]:.3f}; 0.30 takes two springs "
               "of K_hinge/K_panel = 4/3, and so panels that bend as much as hinges: not "
               "\"primarily rotation about hinges\""),
        answer(s, "stroke", EDGE - meet, WRONG,
               "the most there can be with panels of 2.75 in: they meet on the axis at a height of "
               f"{meet / INCH:.4f} in.  A storey of 1.65 in turned by 45 deg has the stroke of "
               "1.4 in, with edges of 2.011 in"),
        computed(s, "stiffness_hinges_50_MPa", soft, "N/m"),
        computed(s, "stiffness_rigid_panels", rigid[0], "N/m", "hinges of 100 MPa"),
    ]  # fmt: skip
