"""Sections 3.2 to 3.5: the neo-Hookean cube, stretched to 2 and then by voltage to 2.5."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dea_fenicsx.exact import Dead, Film, trace
from dea_fenicsx.materials import EPSILON_0, IdealDielectric, Material, NeoHookean
from dea_fenicsx.thesis.table import ASSUMED, MISSING, REPRODUCED, WRONG, Row, answer, computed

MU, EDGE = 50e3, 1e-4
PRINTED_P, PRINTED_PHI = 1550.0, 7867.0


def film() -> Film:
    """The cube with the thesis's permittivity of vacuum, 8.85e-12 F/m."""
    return Film(Material(NeoHookean(MU), IdealDielectric(2.86 * 8.85e-12 / EPSILON_0)), EDGE)


def real_roots(P: float, phi: float) -> list[float]:
    """Real roots of eq 17, Phi lam^8 - mu lam^6 + P lam^5 + mu = 0, in rising order."""
    roots = np.roots([phi, 0, -MU, P, 0, 0, 0, 0, MU])
    return sorted(float(r.real) for r in roots if abs(r.imag) < 1e-6)


def rows() -> list[Row]:
    free = film()
    loaded = free.prestretched(2.0, 2.0)
    branch = trace(loaded)
    (state,) = branch.at_stretch(2.5)
    peak = branch.event("pull-in")
    printed = trace(Film(free.material, EDGE, Dead(PRINTED_P), Dead(PRINTED_P)))
    (as_printed,) = printed.at_stretch(2.5)
    printed_peak = printed.event("pull-in")
    free_peak = trace(free).event("pull-in")
    assert peak and printed_peak and free_peak
    phi = free.permittivity * (1763.0 / EDGE) ** 2
    stable = [s.stretches[0] for s, ok in printed.states_at(as_printed.voltage) if ok]
    live = [s.stretches[0] for s, _ in branch.states_at(PRINTED_PHI, "pressure")]
    start = printed.stretches[0, 0]
    s = "cube"
    return [
        answer(s, "prestress_P", loaded.first.pascal, WRONG,  # type: ignore[union-attr]
               f"a dead load mu (lam - lam^-5) holds stretch 2; 1550 Pa holds {start:.4f} only"),
        answer(s, "voltage", as_printed.voltage, ASSUMED,
               "with P = 1550 Pa in eq 17; an unstable state beyond the pull-in at "
               f"{printed_peak.voltage:.0f} V, {printed_peak.stretches[0]:.3f}"),
        answer(s, "pressure_for_voltage", phi, ASSUMED,
               "is eps (V/T)^2 at 1763 V with the undeformed thickness; the true Maxwell "
               f"pressure at 2.5 is {as_printed.maxwell / 1e3:.1f} kPa"),
        answer(s, "roots", real_roots(PRINTED_P, PRINTED_PHI), WRONG,
               "roots of eq 17 with the printed 1550 and 7867 Pa; no one pair of values gives all "
               "four printed roots"),
        answer(s, "rejection_of_root", stable[0], WRONG,
               "the rejected root is the stable state, the accepted 2.5 the unstable one"),
        answer(s, "abaqus_agreement", live[0], WRONG,
               "7867 Pa as a live pressure on the film under the dead load for 2 gives this "
               "stretch, not 2.5"),
        answer(s, "fig_3_5_curve", None, MISSING, "plot only; see cube.png"),
        computed(s, "corrected.P_dead", loaded.first.pascal, "Pa"),  # type: ignore[union-attr]
        computed(s, "corrected.V_at_2p5", state.voltage, "V"),
        computed(s, "corrected.true_pressure_at_2p5", state.maxwell, "Pa"),
        computed(s, "corrected.nominal_Phi_at_2p5", state.maxwell / 2.5**4, "Pa"),
        computed(s, "corrected.peak_stretch", peak.stretches[0], "-"),
        computed(s, "corrected.peak_V", peak.voltage, "V"),
        computed(s, "corrected.no_prestretch_peak_stretch", free_peak.stretches[0], "-"),
        computed(s, "corrected.no_prestretch_peak_V", free_peak.voltage, "V"),
        computed(s, "corrected.P1550_peak_stretch", printed_peak.stretches[0], "-"),
        computed(s, "corrected.P1550_peak_V", printed_peak.voltage, "V"),
        answer("mesh_refinement", "stress_difference", 0.0, REPRODUCED,
               "the field is homogeneous, so any mesh gives it exactly; says nothing on "
               "convergence"),
        answer("mesh_refinement", "cell_count_ratio", (1e-4 / 5e-5) ** 3, REPRODUCED),
    ]  # fmt: skip


def draw(out: Path) -> None:
    """Voltage over stretch for the corrected and the printed dead load, and none."""
    import matplotlib.pyplot as plt

    free = film()
    fig, ax = plt.subplots()
    for label, f in (
        ("dead load 98 437.5 Pa (stretch 2)", free.prestretched(2.0, 2.0)),
        ("dead load 1550 Pa, as printed", Film(free.material, EDGE, Dead(1550.0), Dead(1550.0))),
        ("no load", free),
    ):
        branch = trace(f, max_stretch=5.0)
        (line,) = ax.plot(branch.stretches[0], branch.voltage, label=label)
        peak = branch.event("pull-in")
        if peak:
            ax.plot(peak.stretches[0], peak.voltage, "o", color=line.get_color())
    ax.set_xlabel("in-plane stretch")
    ax.set_ylabel("voltage in V")
    ax.legend()
    fig.savefig(out / "cube.png", dpi=150)
    plt.close(fig)
