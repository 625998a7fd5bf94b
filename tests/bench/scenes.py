"""Ten fixed scenes, built from public names only, so that they run on older and newer commits.

Each function takes `fine`: True for the scene that is counted, False for the same forms on a few
cells, which compiles them.  Do not change a scene: its counts would no longer tell what the code
does.  Add another one instead.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import (
    HDEA,
    BoxStack,
    DiskStack,
    HelicalCell,
    Layer,
    MembraneDisc,
    StiffenedSection,
)
from tests.bench.tetrahedra import write_box


@dataclass
class Case:
    """A scene with its path.

    Attributes
    ----------
    scene, path, record
        As `dea.solve` takes them.
    value
        Column of the history whose last value is compared.
    options
        Further arguments of `dea.solve`.
    """

    scene: Any
    path: Any
    record: dict[str, Any]
    value: str
    options: dict[str, Any] = field(default_factory=dict)


def device(geometry: Any) -> Any:
    return dea.read_gmsh(geometry, MPI.COMM_SELF)


def bender(fine: bool) -> Case:
    """The bender of the page of short scripts, in plane strain, on a finer mesh."""
    through = 6 if fine else 1
    layers = [Layer(name, 0.5e-3, through) for name in ("passive", "active")]
    strip = BoxStack(20e-3, None, layers, 120 if fine else 4, grading=4, ends="start")
    scene = dea.Scene(
        device(strip),
        materials={"active": dea.Material(dea.NeoHookean(80e3), dea.IdealDielectric(eps_r=2.8)),
                   "passive": dea.Material(dea.NeoHookean(80e3))},
        electrodes=[dea.Electrode("top", volts=8e3), dea.Ground("interface_1")],
        supports=[dea.Clamp("x_min")],
        kinematics=dea.PlaneStrain(depth=5e-3),
    )  # fmt: skip
    return Case(scene, dea.Ramp(steps=8), {"tip": dea.MeanDisplacement("x_max", "y")}, "tip_m")


def strip(fine: bool) -> Case:
    """A bilayer strip of hexahedra; large enough for a factor of blocks in single precision."""
    through = 2 if fine else 1
    layers = [Layer(name, 0.5e-3, through) for name in ("passive", "active")]
    box = BoxStack(20e-3, 5e-3, layers, (24, 8) if fine else (2, 1))
    silicone = dea.Material(dea.Gent(80e3, 90.0), dea.IdealDielectric(eps_r=2.8))
    scene = dea.Scene(
        device(box),
        materials={"passive": dea.Material(dea.NeoHookean(200e3)), "active": silicone},
        electrodes=[dea.Electrode("top", volts=6e3), dea.Ground("interface_1")],
        supports=[dea.Clamp("x_min")],
    )
    record = {"tip": dea.MeanDisplacement("x_max", "z")}
    return Case(scene, dea.Ramp(steps=1), record, "tip_m")


def membrane_disc(cells: tuple[int, int, int], layers: int, stretch: float, volts: float) -> Any:
    """Half a membrane disc on its middle plane: pulled at its rim, with a tapered electrode."""
    electrode, taper, half = 4e-3, 3e-3, 0.5e-3
    disc = MembraneDisc(12e-3, electrode, half, taper=taper, cells=cells, layers=layers, grading=4)
    section = device(disc)
    film = dea.Material(dea.Gent(50e3, 120.0), dea.IdealDielectric(eps_r=4.7))
    edge = dea.Taper(electrode, electrode + taper)
    return dea.Scene(
        section,
        materials=dict.fromkeys(section.regions, film),
        electrodes=[dea.Electrode(("top_active", "top_edge"), volts, taper=edge),
                    dea.Ground("bottom")],
        supports=[dea.Fix("bottom", "z"), dea.Fix("axis", "r")],
        prescribed=[dea.Stretch("rim", "r", stretch)],
        kinematics=dea.Axisymmetric(),
    )  # fmt: skip


def membrane(fine: bool) -> Case:
    """A membrane disc that is stretched, then driven."""
    scene = membrane_disc(*(((48, 24, 48), 5) if fine else ((2, 1, 2), 1)), 3.0, 2e3)
    path = [dea.Ramp("stretch", steps=6), dea.Ramp("voltage", steps=6)]
    return Case(scene, path, {"electrode": dea.Area("top_active")}, "electrode_m2")


def limit_point(fine: bool) -> Case:
    """A membrane disc that is stretched, then followed by arc length through its largest voltage.

    It ends behind the limit point, at a given area of the electrode.
    """
    scene = membrane_disc(*(((16, 8, 16), 2) if fine else ((2, 1, 2), 1)), 2.0, 4e3)
    trace = dea.Trace("voltage", first=0.3, until=("electrode_m2", 6e-4))
    record = {"electrode": dea.Area("top_active")}
    path = [dea.Ramp("stretch", steps=4), trace]
    return Case(scene, path, record, "voltage_V", {"stability": "every"})


def tetrahedra(fine: bool) -> Case:
    """A compressible box of tetrahedra on a dead load, then under voltage."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "box.msh"
        write_box(file, (4e-3, 2e-3, 1e-3), (8, 4, 3) if fine else (2, 1, 1))
        box = device(file)
    film = dea.Material(dea.Gent(60e3, 80.0), dea.IdealDielectric(eps_r=3.0), bulk_modulus=3e6)
    scene = dea.Scene(
        box,
        materials={"film": film},
        electrodes=[dea.Electrode("top", volts=8e3), dea.Ground("bottom")],
        supports=[dea.Clamp("x_min")],
        loads=[dea.DeadLoad("x_max", (2e3, 0.0, 1e3))],
    )
    path = [dea.Ramp("load", steps=3), dea.Ramp("voltage", steps=3)]
    return Case(scene, path, {"end": dea.MeanDisplacement("x_max", "z")}, "end_m")


def helical_cell(fine: bool) -> Case:
    """One pitch of a long helix, free to lengthen and twist, under torque, force and voltage."""
    cell = HelicalCell(radial=24, rim=4, through=8) if fine else HelicalCell(
        radial=1, rim=1, through=2)  # fmt: skip
    rubber = dea.Material(dea.NeoHookean(73.7e3), dea.IdealDielectric(eps_r=4.7))
    soft = dea.Material(dea.NeoHookean(73.7e3), dea.Conductor())
    scene = dea.Scene(
        device(cell),
        materials={"elastomer": rubber, "electrode_a": soft, "electrode_b": soft},
        electrodes=[dea.Electrode("electrode_a", volts=6e3), dea.Ground("electrode_b")],
        supports=[dea.FreeBody()],
        loads=[dea.Torque(1e-3), dea.AxialForce(0.5)],
        kinematics=dea.Helical(cell.pitch),
    )
    record = {"contraction": dea.OverallContraction(), "twist": dea.OverallTwist()}
    path = [dea.Ramp("load", steps=4), dea.Ramp("voltage", steps=6)]
    return Case(scene, path, record, "twist_rad_per_m")


def long_section(fine: bool) -> Case:
    """A stiffened film in generalised plane strain: pre-stretched, pulled along, a thin field."""
    cells, through = ((60, 30, 60), 6) if fine else ((2, 1, 2), 1)
    section = StiffenedSection(length=20e-3, strip=(8e-3, 12e-3), thickness=0.2e-3,
                               stiffener=50e-6, cells=cells, through=through)  # fmt: skip
    scene = dea.Scene(
        device(section),
        materials={"film": dea.Material(dea.NeoHookean(25e3), dea.IdealDielectric(eps_r=4.7)),
                   "stiffener": dea.Material(dea.MooneyRivlin(3e4, 2e4))},
        electrodes=[dea.ThinFilm("film", 2e3, start=0.0, end=0.2e-3, along="y")],
        supports=[dea.Clamp("x_min"), dea.Clamp("x_max")],
        prescribed=[dea.PreStretch("film", x=2.0, z=1.0), dea.AxialStretch(1.1)],
        kinematics=dea.GeneralisedPlaneStrain(25e-3),
    )  # fmt: skip
    record = {"sag": dea.MeanDisplacement("back", "y"), "force": dea.OverallForce()}
    path = [dea.Ramp("prestretch", steps=4), dea.Ramp("stretch", steps=2),
            dea.Ramp("voltage", steps=4)]  # fmt: skip
    return Case(scene, path, record, "force_N")


def charged(fine: bool) -> Case:
    """An electrode of given charge between two films, which is then pulled while it floats."""
    through = 6 if fine else 1
    films = [Layer(name, 1e-3, through) for name in ("film", "other")]
    pair = BoxStack(10e-3, None, films, 80 if fine else 2, grading=3.0)
    elastic = dea.Yeoh(2e4, 5e2, 10.0)
    scene = dea.Scene(
        device(pair),
        materials={"film": dea.Material(elastic, dea.IdealDielectric(3.0)),
                   "other": dea.Material(elastic, dea.IdealDielectric(3.0), bulk_modulus=4e6)},
        electrodes=[dea.ChargedElectrode("interface_1", 6e-9), dea.Ground(("bottom", "top"))],
        supports=[dea.Clamp("bottom")],
        loads=[dea.DeadLoad("top", (0.0, 8e3))],
        kinematics=dea.PlaneStrain(depth=10e-3),
    )  # fmt: skip
    record = {"floats": dea.Potential("interface_1"), "up": dea.MeanDisplacement("top", "y")}
    path = [dea.Ramp("charge", steps=6), dea.Ramp("load", steps=6)]
    return Case(scene, path, record, "floats_V")


def inflated_plate(fine: bool) -> Case:
    """A plate clamped at its rim, blown up by a pressure that follows it, and then driven."""
    around, radial, through = (16, 4, 2) if fine else (4, 1, 1)
    plate = DiskStack(10e-3, [Layer("film", 1e-3, through)], angular=around, radial=radial)
    film = dea.Material(dea.Ogden((3e4, 500.0), (1.8, 4.0)), dea.IdealDielectric(eps_r=3.0))
    scene = dea.Scene(
        device(plate),
        materials={"film": film},
        electrodes=[dea.Electrode("top", volts=3e3), dea.Ground("bottom")],
        supports=[dea.Clamp("side")],
        loads=[dea.FollowerPressure("bottom", 400.0)],
    )
    path = [dea.Ramp("load", steps=4), dea.Ramp("voltage", steps=2)]
    return Case(scene, path, {"top": dea.LargestDisplacement("top", "z")}, "top_m")


def free_helix(fine: bool) -> Case:
    """A free helical actuator that is pulled at both ends, then driven."""
    helix = HDEA(turns=1, angular=8, radial=3, rim=1, through=1) if fine else HDEA(
        turns=1, angular=4, radial=1, rim=1, through=1)  # fmt: skip
    rubber = dea.Material(dea.NeoHookean(73.7e3), dea.IdealDielectric(eps_r=4.7))
    soft = dea.Material(dea.NeoHookean(73.7e3), dea.Conductor())
    scene = dea.Scene(
        device(helix),
        materials={"elastomer": rubber, "electrode_a": soft, "electrode_b": soft},
        electrodes=[dea.Electrode("electrode_a", volts=6e3), dea.Ground("electrode_b")],
        supports=[dea.FreeBody()],
        loads=[dea.DeadLoad("top", (0.0, 0.0, 500.0)), dea.DeadLoad("bottom", (0.0, 0.0, -500.0))],
    )
    record = {"contraction": dea.Contraction(("bottom", "top"), "z"),
              "q": dea.Charge("electrode_a")}  # fmt: skip
    path = [dea.Ramp("load", steps=2), dea.Ramp("voltage", steps=3)]
    return Case(scene, path, record, "contraction")


SCENES: dict[str, Callable[[bool], Case]] = {
    "plane-strain bender": bender,
    "strip of hexahedra": strip,
    "axisymmetric membrane": membrane,
    "compressible tetrahedra": tetrahedra,
    "helical cell": helical_cell,
    "generalised plane strain": long_section,
    "charged electrode": charged,
    "limit point by arc length": limit_point,
    "follower pressure": inflated_plate,
    "free helix": free_helix,
}
"""By the name in the JSON file."""
