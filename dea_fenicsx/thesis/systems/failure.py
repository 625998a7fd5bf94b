"""Section 5.5: the four failure modes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dea_fenicsx.exact import MODES, Film, Held, failure_map, trace
from dea_fenicsx.materials import Breakdown, IdealDielectric, Material, get
from dea_fenicsx.thesis.table import MISSING, REPRODUCED, WRONG, Row, answer


def rows() -> list[Row]:
    s = "failure_modes"
    film = Film(get("vhb-thesis-gent-2p125"), 1e-3)
    equal = trace(film).event("lock-up")
    shear = trace(Film(film.material, 1e-3, second=Held(1.0))).event("lock-up")
    assert equal and shear
    return [
        answer(s, "modes", len(MODES), REPRODUCED, ", ".join(MODES)),
        answer(s, "breakdown_strength", None, MISSING,
               "no breakdown field is given; failure_map.png assumes 30.6 lam^1.13 MV/m, whose "
               "origin was not found"),
        answer(s, "stretch_limit_gent_equi", float(equal.stretches[0]), REPRODUCED, "J_m = 120"),
        answer(s, "stretch_limit_gent_pure_shear", float(shear.stretches[0]), REPRODUCED,
               "J_m = 120, other side held at 1"),
        answer(s, "local_maximum", "electromechanical instability", WRONG,
               "a maximum of the voltage is the electromechanical instability; loss of tension is "
               "zero stress, breakdown a field"),
    ]  # fmt: skip


def draw(out: Path) -> None:
    """Failure map of a Gent film, equi-biaxial, with an assumed breakdown law."""
    import matplotlib.pyplot as plt

    elastic = get("vhb-thesis-gent-2p125").elastic
    material = Material(elastic, IdealDielectric(4.7, Breakdown(30.6e6, 1.13)))
    found = failure_map(material, 1e-3, np.linspace(1.0, 8.0, 1401))
    fig, axes = plt.subplots(1, 3, figsize=(16, 4.5))
    for ax, plane in zip(axes, ("voltage-stretch", "voltage-charge", "force-stretch"), strict=True):
        found.draw(ax, plane)
    axes[0].set_ylim(0, 30)
    axes[1].set(xlim=(0, 40), ylim=(0, 30))
    axes[2].set_ylim(-100, 400)
    fig.tight_layout()
    fig.savefig(out / "failure_map.png", dpi=130)
    plt.close(fig)
