"""The Kresling spiral box of thesis chapter 5 in closed form: kinematics, pattern, actuation.

    storey = Kresling(side=2.125 * INCH, edge=2.75 * INCH, stiffness=17 * POUND_FORCE / INCH)
    storey.strain_free, storey.barrier(), storey.snap_forces()
    storey.at(height)                         # twist, strain, energy, force

NumPy and SciPy only; nothing here needs a mesh.
"""

from dea_fenicsx.origami.kresling import Kresling, State, strokes, torque_as_printed
from dea_fenicsx.units import INCH, POUND_FORCE

__all__ = ["Kresling", "State", "strokes", "torque_as_printed", "INCH", "POUND_FORCE"]
