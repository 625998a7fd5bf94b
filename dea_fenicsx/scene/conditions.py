"""What a user may impose on a device: potentials, supports, stretches and loads.

Each condition is one noun that names where it acts.  What can be ramped carries the name of its
ramp (``"voltage"``, ``"stretch"``, ``"load"`` unless told otherwise); its value is reached at ramp
factor 1.  All of them are gathered here from the modules of their kinds.
"""

from dea_fenicsx.scene.body_forces import BodyForce, Centrifugal, Gravity
from dea_fenicsx.scene.cavity import Cavity
from dea_fenicsx.scene.condition import Condition, Load, Prescribed, Support
from dea_fenicsx.scene.electrodes import ChargedElectrode, Electrode, Ground, ThinFilm
from dea_fenicsx.scene.elements import Discretisation
from dea_fenicsx.scene.graded import Graded
from dea_fenicsx.scene.loads import AxialForce, DeadLoad, DeadPressure, FollowerPressure, Torque
from dea_fenicsx.scene.membrane_pressure import MembranePressure
from dea_fenicsx.scene.obstacles import Obstacle
from dea_fenicsx.scene.periodic import MeanStrain, Periodic
from dea_fenicsx.scene.prescribed import AxialStretch, Displacement, PreStretch, Stretch, Twist
from dea_fenicsx.scene.rigid import Force, Moment, Rigid, Turn
from dea_fenicsx.scene.sources import Source
from dea_fenicsx.scene.springs import ElasticFoundation, Spring
from dea_fenicsx.scene.supports import Clamp, Fix, FreeBody
from dea_fenicsx.scene.taper import Taper
from dea_fenicsx.scene.temperature import Temperature
from dea_fenicsx.scene.torsion import TorsionSpring

__all__ = [
    "AxialForce", "AxialStretch", "BodyForce", "Cavity", "Centrifugal", "ChargedElectrode", "Clamp",
    "Condition", "DeadLoad", "DeadPressure", "Discretisation", "Displacement", "ElasticFoundation",
    "Electrode", "Fix", "FollowerPressure", "Force", "FreeBody", "Graded", "Gravity", "Ground",
    "Load",
    "MeanStrain", "MembranePressure", "Moment", "Obstacle", "Periodic", "PreStretch",
    "Prescribed", "Rigid", "Source", "Spring", "Stretch", "Support", "Taper", "Temperature",
    "ThinFilm", "Torque", "TorsionSpring", "Turn", "Twist",
]  # fmt: skip
