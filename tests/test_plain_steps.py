"""A scene asks its conditions once, and a problem refuses what it can before it compiles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from conftest import block

import dea_fenicsx as dea
from dea_fenicsx.model.forms import Forms
from dea_fenicsx.model.problem import Problem

RUBBER = {"film": dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))}


def counting(cls, asked):
    """A condition that counts how often it is asked for its declarations."""

    @dataclass(frozen=True)
    class Counting(cls):
        def declarations(self, scene):
            asked[cls.__name__] = asked.get(cls.__name__, 0) + 1
            return super().declarations(scene)

    return Counting


def test_each_condition_is_asked_once():
    asked = {}
    clamp, rigid = counting(dea.Clamp, asked), counting(dea.Rigid, asked)
    turn, load = counting(dea.Turn, asked), counting(dea.DeadLoad, asked)
    scene = dea.Scene(
        block((2, 2)), RUBBER, supports=[clamp("x_min"), rigid("x_max", "xy")],
        prescribed=[turn("x_max", 0.1)], loads=[load("top", (0.0, 10.0))],
        kinematics=dea.PlaneStrain(1e-3),
    )  # fmt: skip
    Problem(scene)
    assert asked == dict.fromkeys(("Clamp", "Rigid", "Turn", "DeadLoad"), 1)


def test_a_scene_refuses_folded_cells():
    """A corner inside a square of 3 x 3 cells, pushed over the corner opposite."""
    device = block((3, 3), order=1)
    x = device.mesh.geometry.x
    x[int(np.argmin(np.linalg.norm(x[:, :2] - 1 / 3, axis=1))), 0] += 0.5
    with pytest.raises(dea.InputError, match=r"cells of .* are folded or flat"):
        dea.Scene(device, RUBBER, supports=[dea.Clamp("bottom")], kinematics=dea.PlaneStrain(1e-3))


def test_nodes_that_are_moved_later_are_looked_at():
    """The cells of a device are looked at once, and again after a node has been moved."""
    device = block((3, 3), order=1)
    supports, plane = [dea.Clamp("bottom")], dea.PlaneStrain(1e-3)
    for _ in range(2):
        dea.Scene(device, RUBBER, supports=supports, kinematics=plane)
    assert len(device.checked_cells) == 1
    x = device.mesh.geometry.x
    x[int(np.argmin(np.linalg.norm(x[:, :2] - 1 / 3, axis=1))), 0] += 0.5
    with pytest.raises(dea.InputError, match=r"cells of .* are folded or flat"):
        dea.Scene(device, RUBBER, supports=supports, kinematics=plane)


@pytest.mark.parametrize("force, words", [
    ((1.0, 0.0), "a resultant force of 1e-06 N that nothing bears"),
    ((0.0, 0.0), ""),
])  # fmt: skip
def test_loads_that_nothing_bears_are_refused_before_forms_are_compiled(monkeypatch, force, words):
    """1 Pa on an end of 1 mm x 1 mm is 1e-6 N; an electric load needs no support."""
    compiled, whole = [], Forms.compile

    def counted(forms):
        compiled.append(forms)
        whole(forms)

    monkeypatch.setattr(Forms, "compile", counted)
    scene = dea.Scene(
        block((2, 2)), RUBBER, [dea.Electrode("top", 10.0), dea.Ground("bottom")],
        supports=[dea.FreeBody()], loads=[dea.DeadLoad("x_max", force)],
        kinematics=dea.PlaneStrain(1e-3),
    )  # fmt: skip
    if not words:
        Problem(scene)
        assert len(compiled) == 1
        return
    with pytest.raises(dea.InputError, match=words):
        Problem(scene)
    assert not compiled


def test_the_volts_of_each_ramp():
    """The largest potential of each ramp at factor 1; a ramp of loads has 0."""
    scene = dea.Scene(
        block((2, 2)), RUBBER,
        [dea.Electrode("top", 40.0), dea.Electrode("bottom", -50.0), dea.Electrode("x_max", 0.0)],
        supports=[dea.Clamp("x_min")], loads=[dea.DeadLoad("x_max", (1.0, 0.0))],
        kinematics=dea.PlaneStrain(2e-3),
    )  # fmt: skip
    assert scene.unit_volts == {"load": 0.0, "voltage": -50.0}
