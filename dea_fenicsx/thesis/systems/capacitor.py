"""Section 3.1, the parallel plate: the stress between plates that stretch, from the energy."""

from __future__ import annotations

from dea_fenicsx.thesis.table import REPRODUCED, Row, answer


def pressures() -> tuple[float, float]:
    """Thickness stress over eps E^2: plates of fixed area, and plates that stretch.

    Both by differentiation of -C V^2/2 at constant voltage, C = eps A/t; the area A of stretching
    plates grows as 1/t, since the volume is kept.
    """

    def energy(t: float, area: float) -> float:
        return -area / t / 2

    h = 1e-5
    fixed = (energy(1 + h, 1.0) - energy(1 - h, 1.0)) / (2 * h)
    stretching = (energy(1 + h, 1 / (1 + h)) - energy(1 - h, 1 / (1 - h))) / (2 * h)
    return round(fixed, 8), round(stretching, 8)


def rows() -> list[Row]:
    fixed, stretching = (f"{p:g}*" if p != 1 else "" for p in pressures())
    system = "maxwell_parallel_plate"
    return [
        answer(system, "maxwell_stress_rigid", f"{fixed}eps0*E^2", REPRODUCED,
               "for plates of fixed area (eq 4); not what drives a stretchable film"),
        answer(system, "maxwell_stress_DE", f"{stretching}eps_r*eps0*E^2", REPRODUCED,
               "eq 33 and 46; twice eq 4, since the area grows as the film thins"),
    ]  # fmt: skip
