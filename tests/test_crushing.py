"""A ramp that presses a part to zero thickness ends in the same way for any number of steps."""

from __future__ import annotations

import pytest
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, Layer

STRETCH = 0.511
GONE = 1 / (1 - STRETCH)
"""Factor of the stretch, 1 + f (0.511 - 1), at which nothing is left of the thickness."""

LAYERS = [Layer("soft", 0.811e-3, divisions=2), Layer("middle", 0.245e-3), Layer("stiff", 0.237e-3)]
MOONEY = [dea.MooneyRivlin(*c) for c in ((7125.0, 375.0), (0.0, 21150.0), (0.0, 59000.0))]
NEO_HOOKE = [dea.NeoHookean(mu) for mu in (14e3, 42e3, 118e3)]
YEOH = [dea.Yeoh(c, 0.0, 0.0) for c in (7e3, 21e3, 59e3)]
PLANE, AXISYMMETRIC, SPACE = dea.PlaneStrain(1e-3), dea.Axisymmetric(), dea.ThreeD()


def pressed(kinematics, models, comm=MPI.COMM_SELF, supports=(), bulk=None):
    """Layers of which the lowest and the highest face stay flat, and approach each other."""
    up, out = {"PlaneStrain": "yx", "Axisymmetric": "zr"}.get(type(kinematics).__name__, "zx")
    width = 5.52e-3 if kinematics is SPACE else None
    divisions = (1, 1) if width else (1,)
    layers = LAYERS[: len(models)]
    held = [dea.Fix("bottom", up), dea.Fix("x_min", out), *supports]
    if width:
        held.append(dea.Fix("y_min", "y"))
    return dea.Scene(
        dea.read_gmsh(BoxStack(5.52e-3, width, layers, divisions), comm),
        {layer.name: dea.Material(model, bulk_modulus=bulk)
         for layer, model in zip(layers, models, strict=True)},
        supports=held, prescribed=[dea.Stretch("top", up, STRETCH)], kinematics=kinematics,
    )  # fmt: skip


def end_of(scene, steps, to=8.0):
    try:
        dea.solve(scene, dea.Ramp("stretch", to, steps=steps), quiet=True)
    except dea.DeaError as error:
        return error
    return None


def check_crushed(error):
    assert isinstance(error, dea.EquilibriumLost), str(error)
    assert "crushed to zero thickness" in str(error), str(error)
    assert error.ramps == ()  # it is no pull-in
    assert error.reached["stretch"] < GONE <= error.failed["stretch"]
    assert error.reached["stretch"] > 0.98 * GONE


@pytest.mark.parametrize("steps", [1, 2, 3, 4, 7, 8, 12])
def test_the_end_is_the_same_for_any_number_of_steps(quick_compile, steps):
    """With four steps Newton's method once came to rest, with two it turned cells inside out."""
    check_crushed(end_of(pressed(PLANE, MOONEY), steps))


@pytest.mark.parametrize("steps", [1, 5])
@pytest.mark.parametrize(("kinematics", "models"), [
    (PLANE, NEO_HOOKE[:1]), (PLANE, YEOH), (AXISYMMETRIC, MOONEY), (AXISYMMETRIC, NEO_HOOKE[:1]),
    (SPACE, NEO_HOOKE[:1]),
])  # fmt: skip
def test_other_kinematics_and_models(quick_compile, kinematics, models, steps):
    check_crushed(end_of(pressed(kinematics, models), steps))


@pytest.mark.parametrize("steps", [1, 4])
def test_a_compressible_part_is_crushed_between_walls(quick_compile, steps):
    """Its volume goes to zero with its thickness."""
    check_crushed(end_of(pressed(PLANE, NEO_HOOKE[:1], supports=[dea.Fix("x_max", "x")],
                                 bulk=1e5), steps))  # fmt: skip


def test_a_lock_up_is_none(quick_compile):
    """Chains lock long before the thickness is gone, and that is said."""
    error = end_of(pressed(PLANE, [dea.Gent(5e4, 20.0)]), 3)
    assert isinstance(error, dea.EquilibriumLost)
    assert "lock-up" in str(error) and "crushed" not in str(error)


def crushed_on(comm):
    """Where the last steps lie depends on rounding, so the ends differ a little."""
    for steps in (2, 4):
        check_crushed(end_of(pressed(PLANE, MOONEY, comm), steps))
    return "crushed"


@pytest.mark.slow
@pytest.mark.mpi
def test_two_ranks_say_the_same(quick_compile, on_ranks):
    assert on_ranks("test_crushing", "crushed_on", 2) == "crushed"
