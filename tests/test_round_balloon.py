"""The exact round states of a thick sphere under voltage, and the shapes that leave them."""

import math

import numpy as np
import pytest

import dea_fenicsx as dea
from dea_fenicsx import exact

MU, PERMITTIVITY = 1e5, 4.0
UNIT = 1e-3 * math.sqrt(MU / (PERMITTIVITY * 8.8541878128e-12))
"""Voltage A sqrt(mu/eps) in V of an inner radius A of 1 mm."""


def balloon(outer, elastic):
    return exact.RoundBalloon(
        1e-3, outer * 1e-3, dea.Material(elastic, dea.IdealDielectric(PERMITTIVITY))
    )


@pytest.mark.parametrize(
    ("outer", "maximum", "minimum"),
    [(1.05, 1.2844195, 3.72), (1.2, 1.337083, 3.936729), (1.5, 1.4563553, 4.22)],
)
def test_limits_of_gent_spheres(outer, maximum, minimum):
    """Radii at the limits, found by quadrature of the wall's pressure at other places."""
    found = balloon(outer, dea.Gent(MU, 50.0)).limits(5e-3)
    assert [1e3 * s.radius for s in found] == [
        pytest.approx(maximum, abs=1e-6), pytest.approx(minimum, abs=6e-3)
    ]  # fmt: skip
    if outer == 1.2:
        volts = [s.volts / UNIT for s in found]
        assert volts == [pytest.approx(0.137950222, abs=1e-9), pytest.approx(0.07627181, abs=1e-9)]


def test_the_cavity_leaves_the_centre_a_hair_before_the_maximum():
    sphere = balloon(1.2, dea.NeoHookean(MU))
    limit = sphere.limits(4e-3)
    assert len(limit) == 1 and 1e3 * limit[0].radius == pytest.approx(1.32696817, abs=1e-7)
    changes = sphere.shape_changes(4e-3, (1, 2, 3))
    assert [c.mode for c in changes] == [1, 2, 3] and all(c.loses for c in changes)
    assert changes[0].state.radius < limit[0].radius < changes[1].state.radius
    # Elements on a fine mesh find it at 1.32644; so near the maximum V tells a hardly at all.
    assert 1e3 * changes[0].state.radius == pytest.approx(1.32644, abs=2e-5)
    assert changes[0].state.volts / UNIT == pytest.approx(0.13709724, abs=1e-8)
    assert sphere.is_stable(1.32e-3, 1) and not sphere.is_stable(1.33e-3, 1)


def test_a_thin_wall_meets_all_long_shapes_at_its_limits():
    """In a membrane without bending stiffness they come at the maximum, whatever their number."""
    gaps = []
    for outer in (1.1, 1.05):
        sphere = balloon(outer, dea.NeoHookean(MU))
        top = sphere.limits(1.6e-3)[0].radius
        change = sphere.shape_changes(1.6e-3, (2,))[0]
        gaps.append(change.state.radius / top - 1)
    assert np.log2(gaps[0] / gaps[1]) == pytest.approx(2.0, abs=0.3)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: balloon(0.9, dea.NeoHookean(MU)), "larger than the inner"),
        (lambda: balloon(1.2, dea.NeoHookean(MU)).at(0.5e-3), "at least the undeformed"),
        (lambda: balloon(1.2, dea.NeoHookean(MU)).is_stable(2e-3, 0), "at least 1"),
    ],
)  # fmt: skip
def test_what_is_refused(call, words):
    with pytest.raises(dea.InputError, match=words):
        call()
