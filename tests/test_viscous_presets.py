"""Presets with viscous branches: the constants of their sources, and what they predict."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import dea_fenicsx as dea
from dea_fenicsx.exact import Film, instantaneous, relaxed, trace
from dea_fenicsx.materials import names, preset, rate_errors, read_cycles

VISCOUS = [name for name in names() if dea.materials.get(name).viscous]
HOSSAIN = "vhb4910_cyclic_hossain2012.csv"


def test_there_are_several_of_both_tapes():
    assert len([n for n in VISCOUS if n.startswith("vhb4910")]) >= 2
    assert any(n.startswith("vhb4905") for n in VISCOUS)
    assert all(name.endswith("-viscous") for name in VISCOUS)


@pytest.mark.parametrize("name", VISCOUS)
def test_constants_make_sense_and_have_a_source(name):
    found = preset(name)
    assert not found.material.faults()
    assert found.mark in "SD" and found.source and found.note
    tau = [b.tau for b in found.material.viscous]
    assert tau == sorted(tau)
    assert "Maxwell" in str(found)


def test_wang_as_printed():
    """Limits of the free film: reference, two independent computations."""
    film = Film(dea.materials.get("vhb4910-wang2016-viscous"), 1e-3)
    unit = math.sqrt(15.36e3 / film.permittivity) * 1e-3
    for response, due in ((relaxed, 0.69519), (instantaneous, 1.56015)):
        assert trace(response(film)).event("pull-in").voltage / unit == pytest.approx(due, abs=6e-6)
    assert film.material.dielectric.permittivity() == pytest.approx(4.8 * dea.materials.EPSILON_0)


def test_published_constants_meet_the_published_tests():
    """Root mean square errors in nine cyclic tests, whose stresses are of 18 to 50 kPa."""
    from conftest import ROOT

    tests = read_cycles(ROOT / "demos" / "fit_viscous_data" / HOSSAIN, "uniaxial", (0, 1, 2, 3))
    for name in ("vhb4910-wang2016-viscous", "vhb4910-hossain2012-viscous"):
        errors = rate_errors(dea.materials.get(name), tests)
        assert np.all(errors < 5.7e3)
        assert errors.mean() < 3.0e3


def test_presets_without_branches_are_as_before():
    old = dea.materials.get("vhb4910-wang2016")
    assert not old.viscous and old.elastic.form == "series"


def test_the_command_tells_the_branches(capsys):
    from dea_fenicsx.cli.materials import _page, told

    one = told("vhb4910-wang2016-viscous")
    assert json.loads(json.dumps(one))["viscous"][1] == {"mu": 26530.0, "tau": 6.56}
    assert "26.53 kPa, tau 6.56 s" in _page(one)
