"""What a user meets beside the mechanics: fits, names, titles, curves, hand-over, messages."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import dea_fenicsx as dea
from dea_fenicsx.cli import main as cli
from dea_fenicsx.materials import TestData, fit, read_cycles, read_data
from dea_fenicsx.materials.fitted import with_spread
from dea_fenicsx.materials.stretches import nominal_stress

LAM = np.linspace(1.05, 3.0, 15)


def curves(model, tests=("uniaxial", "equibiaxial"), noise=0.0) -> list[TestData]:
    rng = np.random.default_rng(1)
    return [
        TestData(t, LAM, nominal_stress(model, t, LAM) * (1 + noise * rng.standard_normal(15)))
        for t in tests
    ]


def cost(found) -> float:
    """The sum that is minimised, which is the same for all models."""
    return sum(r**2 for r in found.residual.values())


# --------------------------------------------------------------------------- fits

TRUTHS = {
    "gent": dea.Gent(5e4, 60.0), "steep": dea.Ogden((1e3,), (5.0,)),
    "negative": dea.Ogden((-3e4,), (-3.0,)), "soft": dea.Ogden((2e5,), (0.5,)),
}  # fmt: skip


@pytest.mark.parametrize("truth", TRUTHS)
@pytest.mark.parametrize("tests", [("uniaxial",), ("equibiaxial",), ("uniaxial", "planar")])
def test_a_model_never_fits_worse_than_its_special_case(truth, tests):
    """Also where the best constants of all have a negative initial shear modulus."""
    data = curves(TRUTHS[truth], tests, 0.02)
    plain = fit(dea.NeoHookean, data)
    for model in (dea.MooneyRivlin, dea.Yeoh):
        found = fit(model, data)
        assert found.model.faults() == []
        assert cost(found) <= cost(plain) * (1 + 1e-9)
        assert found.r_squared >= plain.r_squared - 1e-9


@pytest.mark.parametrize("start", [(1e5, 2.0), (1e5, 0.2), (-1e5, -2.0), (1e5, -2.0)])
@pytest.mark.parametrize("alpha", [5.0, 0.5, -0.3, -3.0])
def test_an_exponent_of_ogden_crosses_zero(start, alpha):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the stresses are small
        truth = dea.Ogden((1e3 / alpha,), (alpha,))
        found = fit(dea.Ogden((start[0],), (start[1],)), curves(truth))
    assert found.model.alpha == pytest.approx((alpha,), rel=1e-6)
    assert found.model.mu == pytest.approx((1e3 / alpha,), rel=1e-6)


def test_a_printed_fit_has_uncertainties_and_digits_that_mean_something():
    text = str(fit(dea.MooneyRivlin, curves(dea.MooneyRivlin(4e4, 5e3), noise=0.02)))
    assert " ± " in text and "kPa" in text and text.startswith("MooneyRivlin(C10 = ")
    digits = [word for word in text.replace("(", " ").split() if len(word.strip("0.,;)")) > 8]
    assert not [word for word in digits if any(c.isdigit() for c in word)]
    assert repr(fit(dea.Gent, curves(dea.NeoHookean(4e4)))).startswith("Gent(mu = 40")


@pytest.mark.parametrize(("value", "deviation", "told"), [
    (42.3456, 1.234, "42.3 ± 1.2"), (419.77, 16.2, "420 ± 16"), (4197.7, 162.0, "4200 ± 160"),
    (4.736097, 0.0684, "4.736 ± 0.068"), (3.14159265, float("inf"), "3.142 ± inf"),
    (-2.3946, 0.149, "-2.39 ± 0.15"), (1.0, 0.0996, "1.00 ± 0.10"), (5.0, 0.0, "5 ± 0"),
])  # fmt: skip
def test_a_number_ends_where_its_uncertainty_ends(value, deviation, told):
    assert with_spread(value, deviation) == told


@pytest.mark.parametrize("text", [
    "1.5,2.25\n2.5,3.5\n", "stretch,stress\n1.5, 2.25\n2.5, 3.5\n", "1.5;2.25\n2.5;3.5\n",
    "1,5;2,25\n2,5;3,5\n", "1,5 2,25\n2,5 3,5\n", "1.5\t2.25\n2.5\t3.5\n", "1,5\t2,25\n2,5\t3,5\n",
    '"a";"b"\n"1,5";"2,25"\n"2,5";"3,5"\n', "# made 2020\n1.5 2.25\n2.5 3.5\n",
])  # fmt: skip
def test_the_separator_of_a_file_is_found(tmp_path, text):
    file = tmp_path / "curve.csv"
    file.write_text(text)
    found = read_data(file, "uniaxial", 0, 1, unit=1e3)
    assert found.stretch == pytest.approx([1.5, 2.5])
    assert found.stress == pytest.approx([2250.0, 3500.0])


def test_the_separator_of_cycles_is_found(tmp_path):
    file = tmp_path / "cycles.txt"
    file.write_text("fast;0,1;1,0;0\nfast;0,1;1,5;2\nfast;0,1;1,2;1\n")
    (found,) = read_cycles(file, "uniaxial", (0, 1, 2, 3))
    assert found.stretch[found.measured][-1] == pytest.approx(1.2)


def test_a_file_without_numbers_is_told(tmp_path):
    file = tmp_path / "curve.csv"
    file.write_text("a,b\n")
    with pytest.raises(dea.InputError, match="whatever sign separates"):
        read_data(file, "uniaxial", 0, 1, unit=1.0)


# --------------------------------------------------------------------------- materials, meshes


def test_a_rubber_with_several_sets_is_answered_by_what_they_are_for():
    with pytest.raises(dea.InputError, match=r"nearest is 'vhb4910-wang2016' .slow"):
        dea.materials.get("vhb-4910")
    with pytest.raises(dea.InputError, match=r"'sylgard-186' .*'sylgard-184' "):
        dea.materials.get("Sylgard")
    with pytest.raises(dea.InputError, match="nearest is 'elastosil-2030'"):
        dea.materials.get("elastosl-2030")
    assert all(dea.materials.preset(name).use for name in dea.materials.list())


def test_the_table_of_materials_has_a_head_and_a_legend(capsys):
    assert cli(["materials"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["name", "model", "modulus", "eps_r", "mark", "for"]
    for mark in ("S", "M", "D"):
        assert any(line.startswith(f"  {mark}  ") for line in lines)


@pytest.mark.parametrize(("name", "text", "told"), [
    ("bad.geo", "Point(1) = {0,0,0\n", "syntax error.*look at the script"),
    ("bad.step", "nonsense", "write it anew as STEP"),
    ("bad.msh", "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\nx", "write it anew"),
])  # fmt: skip
def test_what_gmsh_cannot_read_is_told_by_its_kind(tmp_path, name, text, told):
    (tmp_path / name).write_text(text)
    with pytest.raises(dea.InputError, match=told) as caught:
        dea.device(tmp_path / name)
    assert "must be a .msh, .geo or STEP" not in str(caught.value)


def test_a_device_is_made_by_either_name():
    from dea_fenicsx.geometry import BoxStack, Layer

    stack = BoxStack(1e-3, None, [Layer("film", 1e-3)], divisions=(1,))
    new = dea.device(stack)
    with pytest.warns(PendingDeprecationWarning, match="dea_fenicsx.device"):
        old = dea.read_gmsh(stack)
    assert old.regions == new.regions and old.surfaces == new.surfaces
    with pytest.raises(dea.InputError, match="device takes no keyword"):
        dea.device(stack, curve=False)
