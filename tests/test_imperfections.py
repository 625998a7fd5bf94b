"""Imperfect strips, whose amplitude depends on the size of the imperfection; random shapes."""

import numpy as np
import pytest
from test_branches import DEFLECTION, EULER, SLENDER, H, strip

import dea_fenicsx as dea


@pytest.fixture(scope="module")
def perfect(tmp_path_factory):
    """The strip traced to its arch, with a landing at 1.2 times Euler's voltage."""
    out = tmp_path_factory.mktemp("perfect")
    path = dea.Trace("voltage", first=0.5, switch=0.05, until=("voltage_V", 1.3 * EULER), steps=60,
                     at=(1.2,))  # fmt: skip
    run = dea.solve(strip(), path, DEFLECTION, out=out, stability="every", quiet=True)
    rows = {row["event"]: row for row in run.history}
    return out, rows["bifurcation"]["voltage_V"], abs(rows["landed"]["middle_m"])


def amplitudes(out, size, factors):
    """Amplitude of an imperfect strip at some voltages, over Euler's.

    It is the distance from the perfect strip: the mode is largest in the middle.
    """
    scene = strip()
    scene = dea.Scene(
        dea.imperfect(scene.device, dea.ModeShape(out), size), scene.materials,
        electrodes=scene.electrodes, supports=scene.supports, kinematics=scene.kinematics,
    )  # fmt: skip
    run = dea.solve(scene, dea.Ramp("voltage", to=factors[-1], at=factors, steps=8), DEFLECTION,
                    stability="never", quiet=True)  # fmt: skip
    volts, middle = run.column("voltage_V"), abs(run.column("middle_m")) + size
    return [float(middle[np.argmin(abs(volts - f * EULER))]) for f in factors]


def test_amplitudes_tend_to_the_perfect_branch(perfect):
    """In proportion to the size away from the bifurcation, as its cube root there.

    The amplitude a of a pitchfork obeys (q - q_c) a - c a^3 + k d = 0 with the size d.
    """
    out, critical, arch = perfect
    factors = [0.7, critical / EULER, 1.2]
    sizes = H * np.array([8e-3, 1e-3])
    low, at, high = np.transpose([amplitudes(out, size, factors) for size in sizes])
    assert low[0] / low[1] == pytest.approx(8, rel=0.01)
    assert at[0] / at[1] == pytest.approx(2, rel=0.01)
    above = high - arch
    assert above[1] > 0
    assert above[0] / above[1] == pytest.approx(8, rel=0.05)


def test_the_side_is_that_of_the_size(perfect):
    out, _, _ = perfect
    device = strip().device
    up, down = (dea.imperfect(device, dea.ModeShape(out), s * 1e-3 * H) for s in (1, -1))
    mean = (up.mesh.geometry.x + down.mesh.geometry.x) / 2
    assert mean == pytest.approx(device.mesh.geometry.x, abs=1e-15)
    change = up.mesh.geometry.x - device.mesh.geometry.x
    assert device.length * np.linalg.norm(change, axis=1).max() == pytest.approx(1e-3 * H)


def test_random_shapes_repeat():
    device = strip().device
    shapes = [dea.RandomShape("y", SLENDER * H / 3, seed=s, dim=2) for s in (1, 1, 2)]
    one, same, other = (
        dea.imperfect(device, s, 1e-2 * H).mesh.geometry.x - device.mesh.geometry.x for s in shapes
    )
    assert np.array_equal(one, same)
    assert not np.allclose(one, other, atol=1e-3 * abs(one).max())
    assert not one[:, 0].any()
    assert one[:, 1].any()


def test_wrong_imperfections_are_refused(tmp_path):
    device = strip().device
    for shape, size, words in (
        (dea.ModeShape(tmp_path), 1e-6, "There are 0 modes"),
        (lambda X: 0 * X[:2], 1e-6, "is 0 at all nodes"),
        (lambda X: X, 1e-6, r"must give finite ones of shape \(2, n\)"),
        (np.sin, float("nan"), "finite number"),
        ("mode", 1e-6, "needs ModeShape, RandomShape or a function"),
    ):
        with pytest.raises(dea.InputError, match=words):
            dea.imperfect(device, shape, size)
