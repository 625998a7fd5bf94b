"""The load that an imperfect device bears, against the bar on a spring that Koiter's law is for."""

import numpy as np
import pytest

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer
from dea_fenicsx.run import knocking_down

L, WIDTH, STIFFNESS = 1e-2, 4e-3, 1e-2


def bar(spring=STIFFNESS):
    """A bar on a hinge, with a spring across at its upper end, under a force of k L."""
    mesh = BoxStack(WIDTH, None, [Layer("bar", L)], divisions=1)
    return dea.Scene(
        dea.read_gmsh(mesh), {"bar": dea.Material(dea.NeoHookean(1e6))},
        supports=[dea.Rigid("bottom", held="xy"), dea.Rigid("top"), dea.Spring("top", spring, "x")],
        loads=[dea.Force("top", (0.0, -STIFFNESS * L))], kinematics=dea.PlaneStrain(1e-2),
    )  # fmt: skip


def test_a_bar_on_a_spring_is_knocked_down_as_its_closed_form(tmp_path):
    """P/(k L) = (1 - s^(2/3))^(3/2) with the sine s of the tilt.

    The size is the largest displacement, at the corners of the upper end.
    """
    path = dea.Trace("load", first=0.3, longest=1.0, steps=14)
    sizes = L * np.array([1e-2, 1e-3])
    found = dea.knock_down(bar(), path, sizes, out=tmp_path, quiet=True)
    assert found.perfect == pytest.approx(1, rel=1e-3)
    exact = (1 - (sizes / np.hypot(L, WIDTH / 2)) ** (2 / 3)) ** 1.5
    assert found.ratios == pytest.approx(exact, rel=1e-3)
    assert found.reasons == ("", "")
    slope = np.log((1 - exact[0]) / (1 - exact[1])) / np.log(10)
    assert found.exponent == pytest.approx(slope, rel=1e-2)
    assert slope == pytest.approx(2 / 3, rel=0.02)
    assert dea.read_summary(tmp_path / "perfect")["knock_down_ratios"] == list(found.ratios)


def waves(positions):
    return np.sin(1e3 * positions[:2])


def test_a_size_without_a_load_says_why(tmp_path, monkeypatch):
    """The path of the imperfect bar ends before its limit point."""
    path = dea.Trace("load", first=0.3, longest=1.0, steps=14)
    solve, calls = knocking_down.solve, []

    def shorter(scene, items, *rest, **options):
        calls.append(scene)
        if len(calls) > 1:
            items = [dea.Trace("load", first=0.1, longest=0.1, steps=2)]
        return solve(scene, items, *rest, **options)

    monkeypatch.setattr(knocking_down, "solve", shorter)
    found = dea.knock_down(bar(), path, [1e-4], out=tmp_path, quiet=True)
    assert found.loads == (None,) and found.exponent is None
    assert found.reasons == (knocking_down.NONE_ON_PATH,)
    assert dea.read_summary(tmp_path / "perfect")["knock_down_reasons"] == list(found.reasons)


def test_wrong_calls_are_refused():
    trace = dea.Trace("load", steps=2)
    for path, sizes, options, words in (
        (dea.Ramp("load"), [1e-5], {}, "must end by a Trace"),
        (trace, 1e-5, {}, "needs a list of lengths"),
        (trace, None, {}, "needs a list of lengths"),
        (trace, [0.0], {}, "leave the perfect device out"),
        (trace, [1e-5], {}, "give it out=, or a shape"),
        (trace, [1e-5], {"shape": lambda x: x}, r"must give finite ones of shape \(2, n\)"),
        (trace, [1e-5], {"shape": waves}, "no limit point and no bifurcation"),
        (trace, [1e-5], {"shape": waves, "stability": "never"}, 'needs stability="every"'),
    ):
        with pytest.raises(dea.InputError, match=words):
            dea.knock_down(bar(), path, sizes, quiet=True, **options)
