"""Quantities of pint are taken wherever a number with a unit is; a wrong dimension is refused."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import fields

import pytest

import dea_fenicsx as dea
from dea_fenicsx import exact
from dea_fenicsx.geometry import HDEA, BoxStack, DiskStack, Layer
from dea_fenicsx.materials import TestData, bulk_modulus_of
from dea_fenicsx.support import units

pint = pytest.importorskip("pint")
ureg = pint.UnitRegistry()
Q = ureg.Quantity

LAYERS = [Layer("film", 1e-3)]
RUBBER = dea.Material(dea.NeoHookean(5e4), dea.IdealDielectric(3.0))

# how to make one of each, and what each of its fields with a unit expects
MAKERS = {
    "Electrode": (lambda **k: dea.Electrode("top", **k), {"volts": "V"}),
    "ChargedElectrode": (lambda **k: dea.ChargedElectrode("top", **k), {"coulombs": "C"}),
    "Stretch": (lambda **k: dea.Stretch("top", "x", **k), {"stretch": ""}),
    "Displacement": (lambda **k: dea.Displacement("top", "x", **k), {"metres": "m"}),
    "DeadPressure": (lambda **k: dea.DeadPressure("top", **k), {"pascal": "Pa"}),
    "FollowerPressure": (lambda **k: dea.FollowerPressure("top", **k), {"pascal": "Pa"}),
    "PlaneStrain": (dea.PlaneStrain, {"depth": "m"}),
    "NeoHookean": (dea.NeoHookean, {"mu": "Pa"}),
    "MooneyRivlin": (dea.MooneyRivlin, {"C10": "Pa", "C01": "Pa"}),
    "Yeoh": (dea.Yeoh, {"C10": "Pa", "C20": "Pa", "C30": "Pa"}),
    "Gent": (dea.Gent, {"mu": "Pa", "Jm": ""}),
    "ArrudaBoyce": (dea.ArrudaBoyce, {"mu": "Pa", "lam_m": ""}),
    "Breakdown": (dea.Breakdown, {"field": "V/m", "exponent": ""}),
    "IdealDielectric": (dea.IdealDielectric, {"eps_r": "", "breakdown": "V/m"}),
    "Material": (lambda **k: dea.Material(dea.NeoHookean(5e4), **k), {"bulk_modulus": "Pa"}),
    "Layer": (lambda **k: Layer("film", **k), {"thickness": "m"}),
    "BoxStack": (lambda **k: BoxStack(layers=LAYERS, **k),
                 {"length": "m", "width": "m", "x0": "m"}),
    "DiskStack": (lambda **k: DiskStack(layers=LAYERS, **k), {"radius": "m"}),
    "HDEA": (HDEA, {"outer_radius": "m", "inner_radius": "m", "inset": "m", "elastomer": "m",
                    "electrode": "m"}),
    "Dead": (exact.Dead, {"pascal": "Pa"}),
    "TrueStress": (exact.TrueStress, {"pascal": "Pa"}),
    "Held": (exact.Held, {"stretch": ""}),
    "Film": (lambda **k: exact.Film(RUBBER, **k), {"thickness": "m"}),
    "Source": (lambda **k: dea.Source("top", **k), {"volts": "V", "ohms": "ohm", "amperes": "A"}),
    "Conductivity": (dea.Conductivity, {"siemens_per_metre": "S/m", "field": "V/m"}),
    "Maxwell": (dea.Maxwell, {"mu": "Pa", "tau": "s"}),
    "March": (dea.March, {"seconds": "s"}),
    "Inertia": (dea.Inertia, {"drag": "1/s"}),
    "Constant": (dea.Constant, {"value": ""}),
    "Rise": (dea.Rise, {"to": "", "seconds": "s", "start": "s", "low": ""}),
    "Step": (dea.Step, {"to": "", "at": "s", "low": ""}),
    "Sine": (dea.Sine, {"hertz": "Hz", "amplitude": "", "mean": "", "phase": "rad"}),
    "Chirp": (dea.Chirp, {"low": "Hz", "high": "Hz", "seconds": "s", "amplitude": "", "mean": ""}),
}  # fmt: skip
# two ways to write the same, and what is something else
WRITTEN = {
    "V": ("2 kV", 2000.0), "C": ("3 nC", 3e-9), "m": ("4 mm", 4e-3), "Pa": ("50 kPa", 5e4),
    "V/m": ("60 V/um", 6e7), "": ("250 percent", 2.5),
    "ohm": ("3 Mohm", 3e6), "A": ("4 uA", 4e-6), "S/m": ("5 pS/m", 5e-12), "s": ("2 min", 120.0),
    "Hz": ("3 kHz", 3e3), "1/s": ("6 / min", 0.1), "rad": ("90 degree", 1.5707963267948966),
}  # fmt: skip
WRONG = {"V": "2 mm", "C": "3 V", "m": "4 kPa", "Pa": "5 kN", "V/m": "6 kV", "": "7 mm",
         "ohm": "2 V", "A": "3 V", "S/m": "4 S", "s": "5 V", "Hz": "6 s", "1/s": "7 s",
         "rad": "8 s"}  # fmt: skip
NUMBERS = {"inner_radius": 1e-3, "outer_radius": 9e-3, "inset": 1e-4, "radius": 9e-3}


def values(wanted: dict[str, str]) -> dict[str, float]:
    """A number that is right for each field."""
    return {name: NUMBERS.get(name, WRITTEN[unit][1]) for name, unit in wanted.items()}


CASES = [(kind, name) for kind, (_, wanted) in MAKERS.items() for name in wanted]


@pytest.mark.parametrize(("kind", "name"), CASES)
def test_a_quantity_is_its_si_number(kind, name):
    make, wanted = MAKERS[kind]
    given = values(wanted)
    unit = wanted[name]
    number = given[name]
    quantity = Q(number, unit or "dimensionless").to(Q(WRITTEN[unit][0]).units)
    made = make(**given | {name: quantity})
    assert type(getattr(made, name)) is float
    assert getattr(made, name) == pytest.approx(number, rel=1e-14)
    plain = make(**given)
    others = [f.name for f in fields(made) if f.name not in (name, "layers", "material")]
    assert all(getattr(made, n) == getattr(plain, n) for n in others)


@pytest.mark.parametrize(("kind", "name"), CASES)
def test_a_wrong_dimension_is_refused(kind, name):
    make, wanted = MAKERS[kind]
    wrong = Q(WRONG[wanted[name]])
    with pytest.raises(dea.InputError, match=re.escape(f"{kind}: {name} is {wrong}")) as caught:
        make(**values(wanted) | {name: wrong})
    message = str(caught.value)
    assert message.endswith(units.DIMENSIONS[wanted[name]] + ".")
    assert "\n" not in message


def test_lists_and_arrays_of_quantities():
    assert dea.DeadLoad("top", (Q("1 kPa"), 2.0, Q("3 Pa"))).pascal == (1e3, 2.0, 3.0)
    assert dea.DeadLoad("top", Q([1, 0, 0], "kPa")).pascal == (1e3, 0.0, 0.0)
    with pytest.raises(dea.InputError, match="pressure or stress in Pa"):
        dea.DeadLoad("top", (Q("1 kPa"), Q("2 mm"), 0.0))
    curve = TestData("uniaxial", Q([110, 120], "percent"), Q([1, 2], "kPa"))
    assert curve.stretch.tolist() == pytest.approx([1.1, 1.2])
    assert curve.stress.tolist() == [1e3, 2e3]
    ogden = dea.Ogden.from_abaqus((Q("1 kPa"), Q("2 kPa")), (1.3, 5.0))
    assert ogden == dea.Ogden.from_abaqus((1e3, 2e3), (1.3, 5.0))
    with pytest.raises(dea.InputError, match="Ogden: mu"):
        dea.Ogden((Q("1 mm"),), (2.0,))


def test_tables_and_landings_in_time():
    """The unit of an array is no ornament: minutes must not be taken for seconds."""
    wave = dea.Table(Q([0, 1, 2], "minute"), [0, 1, 0])
    assert (wave.times, wave(90.0)) == ((0.0, 60.0, 120.0), 0.5)
    assert dea.Table([Q("0 s"), Q("1 ms")], [0, 1]).times == (0.0, 1e-3)
    assert dea.March(1.0, at=Q([0.1, 0.2], "ms")).at == pytest.approx((1e-4, 2e-4))
    with pytest.raises(dea.InputError, match="Table: times"):
        dea.Table(Q([0, 1], "V"), [0, 1])
    with pytest.raises(dea.InputError, match="Table: values"):
        dea.Table([0, 1], Q([0, 1], "kV"))


def test_each_unit_is_in_words():
    with pytest.raises(ValueError, match="DIMENSIONS"):
        units.in_si(volts="furlong")


@pytest.mark.parametrize(
    ("text", "unit", "number"),
    [("90 degree", "rad", 1.5707963267948966), ("180 degree/m", "rad/m", 3.141592653589793),
     ("2 mN", "N", 2e-3), ("3 N*mm", "N*m", 3e-3)],
)  # fmt: skip
def test_angles_forces_torques(text, unit, number):
    assert units.si(Q(text), unit, "x") == pytest.approx(number, rel=1e-14)
    with pytest.raises(dea.InputError, match="x is 1 kelvin"):
        units.si(Q("1 K"), unit, "x")


def test_functions_take_quantities():
    assert bulk_modulus_of(Q("10 kPa"), 0.45) == pytest.approx(bulk_modulus_of(1e4, 0.45))
    volts = exact.activation_voltage(RUBBER, Q("1 mm"), 0.1)
    assert volts == pytest.approx(exact.activation_voltage(RUBBER, 1e-3, 0.1))
    with pytest.raises(dea.InputError, match="mesh unit is 1 second"):
        dea.read_gmsh("nothing.msh", unit=Q("1 s"))


def test_plain_values_pass_untouched():
    text = dea.Electrode("top", "2 kV")  # type: ignore[arg-type]  # the scene refuses it
    assert text.volts == "2 kV"
    assert dea.Material(dea.NeoHookean(5e4)).bulk_modulus is None
    listed = [1.0, 2.0]
    assert units.si(listed, "m", "x") is listed


def test_a_wrong_law_in_place_of_a_number():
    law = dea.Breakdown(Q("30 MV/m"), 0.5)
    assert dea.IdealDielectric(3.0, law).breakdown is law


def test_pint_is_not_imported():
    code = "import sys, dea_fenicsx as d; d.Electrode('top', 1.0); print('pint' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                          env={"PYTHONPATH": ":".join(p for p in sys.path if p)})  # fmt: skip
    assert done.stdout.strip() == "False"
