"""Section 4.3.3 at small loads: a periodic cell of the helix, electrodes stiffer than elastomer."""

from __future__ import annotations

from functools import cache

from mpi4py import MPI

from dea_fenicsx.conditions import DeadPressure, FreeBody
from dea_fenicsx.geometry import HelicalCell
from dea_fenicsx.kinematics import Helical
from dea_fenicsx.materials import Conductor, IdealDielectric, Material, NeoHookean
from dea_fenicsx.materials.material import bulk_modulus_of
from dea_fenicsx.mesh import read_gmsh
from dea_fenicsx.overall import OverallContraction
from dea_fenicsx.run import solve
from dea_fenicsx.scene import Scene
from dea_fenicsx.solver import NewtonOptions
from dea_fenicsx.stepping import Ramp
from dea_fenicsx.thesis.table import Row, computed

STRAIN = 1e-5
RATIOS = {0.406: (1, 10, 100, 1000, 1e5), 0.495: (1000, 1e5)}


@cache
def strains(nu: float) -> list[float]:
    """Mean axial strain over p/E for each ratio of the moduli, electrode over elastomer.

    Rings instead of a helix (c = 0), as in an axisymmetric model; the helix changes it by less
    than 0.4 %.
    """
    cell = HelicalCell(radial=12, rim=3, grading_rim=3, grading_through=3)
    device = read_gmsh(cell, MPI.COMM_SELF)
    mu = 1e5
    pressure = STRAIN * 2 * mu * (1 + nu)
    found = []
    for ratio in RATIOS[nu]:
        metal = Material(NeoHookean(ratio * mu), Conductor(), bulk_modulus_of(ratio * mu, nu))
        rubber = Material(NeoHookean(mu), IdealDielectric(1.0), bulk_modulus_of(mu, nu))
        scene = Scene(
            device,
            {"elastomer": rubber, "electrode_a": metal, "electrode_b": metal},
            supports=[FreeBody()],
            loads=[DeadPressure(f"electrode_{e}_active", pressure) for e in "ab"],
            kinematics=Helical(0.0),
        )
        # rounding in stiff electrodes is felt in the soft elastomer
        run = solve(scene, Ramp("load", steps=1), {"c": OverallContraction()}, quiet=True,
                    stability="never", options=NewtonOptions(tolerance=1e-7))  # fmt: skip
        found.append(-run["c"] / STRAIN)
    return found


def rows() -> list[Row]:
    note = (
        "mean axial strain over p/E with electrodes {} times stiffer; converged by two independent "
        "methods"
    )
    return [
        computed("hdea_two_turn", f"reference.axisym_fe_ezE_over_p_nu0p{str(nu)[2:]}", strains(nu),
                 "-", note.format(", ".join(f"{r:g}" for r in ratios)))
        for nu, ratios in RATIOS.items()
    ]  # fmt: skip
