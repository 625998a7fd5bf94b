"""Homogeneous films: every answer has a closed form."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

import dea_fenicsx as dea
from dea_fenicsx.exact import Film, elastic_stress, trace
from dea_fenicsx.geometry import Layer
from dea_fenicsx.materials import EPSILON_0

from hard.table import (  # isort: skip
    COMPLETED, EPS, FAILED, LIMIT, LOST, MU, NOT_REACHED, REFUSED, RUBBER, TIGHT, T, UNIT, Z, case,
    close, film, limit_of, lost, on_the_curve, strip,
)  # fmt: skip

GENT = dea.Gent(MU, 20.0)
MATERIALS = {
    "neo-Hookean": RUBBER,
    "Mooney-Rivlin": dea.MooneyRivlin(2e4, 3e3),
    "Yeoh": dea.Yeoh(3e4, -200.0, 3.0),
    "Ogden": dea.Ogden.from_eq76(9e4, 1.13),
    "Gent": dea.Gent(MU, 60.0),
    "Arruda-Boyce": dea.ArrudaBoyce(4e4, 5.0),
}


def run(scene, path, record=Z, **options):
    return dea.solve(scene, path, record, quiet=True, **options)


# ------------------------------------------------------------------------------ voltage and loads


@case("zero voltage")
def zero_voltage():
    done = run(film(volts=0.0), dea.Ramp("load", steps=3))
    return close(done.column("z"), 1.0, 1e-12, "stretch")


@case("nothing to ramp", REFUSED, "Nothing in the scene can be ramped")
def nothing():
    run(film(volts=0.0, loads=()), dea.Ramp())


@case("reversed polarity")
def polarity():
    there, back = (run(film(volts=v), dea.Ramp(steps=3))["z"] for v in (0.9 * LIMIT, -0.9 * LIMIT))
    return close(there, back, 1e-12, "stretch")


@case("voltage through zero to the other polarity")
def through_zero():
    path = [dea.Ramp("voltage", to, steps=4) for to in (1.0, -1.0)]
    done = run(film(volts=0.9 * LIMIT), path)
    close(done["z"], done.column("z")[4], 1e-9, "stretch")
    return on_the_curve(done, RUBBER)


@case("load reversed half-way")
def reversed_load():
    load = 0.5 * MU
    path = [dea.Ramp("load", to, steps=3) for to in (0.5, -0.5, 1.0)]
    return on_the_curve(run(film(load=load), path), RUBBER, load=load)


@case("voltage step ten times too long", LOST)
def long_step():
    lost(film(volts=10 * LIMIT), dea.Ramp(steps=1), LIMIT, 0.02)


@case("one step to 99.9 % of pull-in")
def one_step():
    return on_the_curve(run(film(volts=0.999 * LIMIT), dea.Ramp(steps=1)), RUBBER)


@case("voltage beyond pull-in", LOST)
def pull_in():
    lost(film(volts=1.2 * LIMIT), dea.Ramp(steps=6), LIMIT, 1e-3)


@case("beyond pull-in from a dead-loaded state", LOST)
def loaded_pull_in():
    load = MU
    limit = limit_of(RUBBER, load=load, highest=3.0)[0]
    path = [dea.Ramp("load", steps=4), dea.Ramp("voltage", steps=5)]
    lost(film(volts=1.3 * limit, load=load), path, limit, 1e-3)


@case("arc length over pull-in")
def over_the_top():
    done = run(film(volts=UNIT), dea.Trace("voltage", until=("z", 0.3)))
    top = next(row for row in done.history if row["event"] == "maximum")
    close(top["voltage_V"], LIMIT, 1e-6, "pull-in")
    return on_the_curve(done, RUBBER)


@case("arc length from a tiny first step", NOT_REACHED, "a longer first one")
def tiny_arc():
    done = run(film(volts=UNIT), dea.Trace("voltage", first=1e-6, until=("z", 0.9)))
    return on_the_curve(done, RUBBER)


@case("a ramp of 1000 steps")
def thousand():
    done = run(film(volts=0.95 * LIMIT), dea.Ramp(steps=1000), stability="never")
    assert len(done.history) == 1001
    return on_the_curve(done, RUBBER)


@case("a ramp to the present value")
def present_value():
    path = [dea.Ramp("voltage", 0.0, 3), dea.Ramp("voltage", 1.0, 2), dea.Ramp("voltage", 1.0, 2)]
    return on_the_curve(run(film(volts=0.9 * LIMIT), path), RUBBER)


@case("several ramps in sequence")
def sequence():
    load = 0.8 * MU
    path = [dea.Ramp("load", 1.0, 2), dea.Ramp("voltage", 1.0, 2), dea.Ramp("load", 0.5, 2),
            dea.Ramp("voltage", 0.0, 2), dea.Ramp("load", 0.0, 2)]  # fmt: skip
    done = run(film(volts=0.3 * UNIT, load=load), path)
    close(done["z"], 1.0, 1e-8, "stretch at the end")
    return on_the_curve(done, RUBBER, load=load)


@case("several ramps at once")
def at_once():
    load = 0.8 * MU
    done = run(film(volts=0.3 * UNIT, load=load), dea.Ramp(steps=3))
    return on_the_curve(done, RUBBER, load=load)


# ----------------------------------------------------------------------------- large deformation


@case("stretch 4 x 4 in one go")
def four_by_four():
    done = run(film(stretch=4.0), dea.Ramp("stretch", steps=1))
    assert done["volume_error"] < 1e-8
    return close(done["z"], 1 / 16, 1e-8, "thickness stretch")


@case("stretch 4 x 4 in one go, then voltage, then back")
def four_and_voltage():
    path = [dea.Ramp("stretch", steps=1), dea.Ramp("voltage", steps=2),
            dea.Ramp(("voltage", "stretch"), 0.0, 4)]  # fmt: skip
    done = run(film(dea.Gent(MU, 120.0), volts=1e3, stretch=4.0), path)
    held = done.column("z")[done.column("time") == 1.0]
    close(held, 1 / 16, 1e-8, "thickness stretch")
    return close(done["z"], 1.0, 1e-8, "stretch after release")


@case("Gent at 99 % of lock-up in one go")
def lock_up():
    lam = brentq(lambda x: 2 * x**2 + x**-4 - 3 - 0.99 * GENT.Jm, 1.5, 5.0, xtol=1e-14)
    done = run(film(GENT, stretch=lam), dea.Ramp("stretch", steps=1),
               {"R": dea.Reaction("x_max", "r"), **Z})  # fmt: skip
    stress = elastic_stress(dea.Material(GENT), lam, lam)[0] / lam
    return close(done["R_N"], 2 * np.pi * T * T * stress, 1e-6, "reaction")


@case("Gent beyond lock-up", LOST)
def beyond_lock_up():
    lam = brentq(lambda x: 2 * x**2 + x**-4 - 3 - GENT.Jm, 1.5, 5.0)
    scene = film(GENT, stretch=3.5)
    lost(scene, dea.Ramp("stretch", steps=5), (lam - 1) / 2.5, 5e-3, ramp="stretch")


@case("Gent pulled by a dead load of 100 moduli")
def pulled_to_lock_up():
    load = 100 * MU
    return on_the_curve(run(film(GENT, load=load), dea.Ramp("load", steps=4)), GENT, load=load)


@case("compressed to 0.2", COMPLETED, "", "neo-Hookean")
@case("Ogden compressed to 0.2", COMPLETED, "", "Ogden")
def compressed(name):
    elastic = MATERIALS[name]
    done = run(film(elastic, stretch=0.2), dea.Ramp("stretch", steps=4),
               {"R": dea.Reaction("x_max", "r"), **Z})  # fmt: skip
    close(done["z"], 25.0, 1e-7, "thickness stretch")
    stress = elastic_stress(dea.Material(elastic), 0.2, 0.2)[0] / 0.2
    return close(done["R_N"], 2 * np.pi * T * T * stress, 1e-6, "reaction")


@case("Ogden at nearly equal stretches", COMPLETED, "", 1 + 1e-7)
@case("Ogden at stretches equal to 1e-4", COMPLETED, "", 1 + 1e-4)
def nearly_equal(lam):
    """Compared in the force, which a cancellation in the eigenvalues would spoil."""
    elastic = MATERIALS["Ogden"]
    done = run(film(elastic, stretch=lam), dea.Ramp("stretch", steps=1),
               {"R": dea.Reaction("x_max", "r")}, options=TIGHT)  # fmt: skip
    stress = elastic_stress(dea.Material(elastic), lam, lam)[0] / lam
    # the residual's tolerance is a share of the modulus, not of this tiny force
    return close(done["R_N"] / (2 * np.pi * T * T * MU), stress / MU, 1e-12 / (lam - 1), "force")


for _name in MATERIALS:

    @case(f"{_name}, pre-stretch and voltage", COMPLETED, "", _name)
    def prestretched(name):
        elastic = MATERIALS[name]
        load = 0.6 * elastic.shear_modulus()
        limit = limit_of(elastic, load=load)[0]
        path = [dea.Ramp("load", steps=2), dea.Ramp("voltage", steps=4)]
        return on_the_curve(run(film(elastic, 0.97 * limit, load), path), elastic, load=load)


# ------------------------------------------------------------------------------ constants, units


for _eps_r in (2.0, 100.0, 1000.0):

    @case(f"eps_r = {_eps_r:g}", COMPLETED, "", _eps_r)
    def permittivity(eps_r):
        eps = eps_r * EPSILON_0
        done = run(film(volts=0.99 * LIMIT * np.sqrt(EPS / eps), eps_r=eps_r), dea.Ramp(steps=4))
        return on_the_curve(done, RUBBER, eps=eps)


for _size, _mu in ((1e-6, MU), (1.0, MU), (T, 1e3), (T, 1e9), (1e-6, 1e9)):

    @case(f"size {_size:g} m, shear modulus {_mu:g} Pa", COMPLETED, "", _size, _mu)
    def units(size, mu):
        elastic = dea.NeoHookean(mu)
        limit = 0.687364819 * size * np.sqrt(mu / EPS)
        done = run(film(elastic, 0.99 * limit, device=strip(size=size)), dea.Ramp(steps=4))
        return on_the_curve(done, elastic, thickness=size)


for _ratio in (2 / 3, 10.0, 1e3, 1e6, 1e9):

    @case(f"bulk to shear modulus {_ratio:.3g}, voltage", COMPLETED, "", _ratio)
    def bulk(ratio):
        volts = 0.5 * UNIT
        scene = film(volts=volts, bulk=ratio * MU)
        done = run(scene, dea.Ramp(steps=4))
        exact = trace(Film(scene.materials["film"], T)).states_at(volts)
        wanted = next(state for state, stable in exact if stable)
        return close(done["z"], wanted.stretches[2], 1e-6, "thickness stretch")


# ------------------------------------------------------------------------------- discretisation


for _label, _elements in {
    "augmentation 0": dea.Discretisation(augmentation=0.0),
    "augmentation 10000": dea.Discretisation(augmentation=1e4),
    "potential of degree 1": dea.Discretisation(potential_degree=1),
    "continuous pressure": dea.Discretisation(pressure="continuous"),
    "quadrature of degree 12": dea.Discretisation(quadrature_degree=12),
}.items():

    @case(_label, COMPLETED, "", _elements)
    def discretised(elements):
        scene = film(volts=0.99 * LIMIT, device=strip((2, 2)), elements=elements)
        return on_the_curve(run(scene, dea.Ramp(steps=4)), RUBBER)


@case("needle cells, 1 : 10000")
def needles():
    device = strip((2, 1), size=1e-2, thickness=1e-6)
    done = run(film(volts=0.99e-3 * LIMIT, device=device), dea.Ramp(steps=4))
    return on_the_curve(done, RUBBER, thickness=1e-6)


@case("layers 1 : 1000 thin")
def thin_layers():
    """Three layers at one field: the stack is homogeneous."""
    parts = [1.0, 1e-3, 1.0]
    layers = [Layer(n, T * p) for n, p in zip(("one", "thin", "two"), parts, strict=True)]
    at = 0.9 * LIMIT * np.cumsum(parts)
    electrodes = [dea.Ground("bottom")]
    electrodes += [dea.Electrode(n, v) for n, v in zip(("interface_1", "interface_2", "top"), at,
                                                       strict=True)]  # fmt: skip
    done = run(film(device=strip(layers=layers), electrodes=electrodes), dea.Ramp(steps=4))
    z = done["z"]
    f = elastic_stress(dea.Material(RUBBER), z**-0.5, z**-0.5)[0]
    return close(EPS * (0.9 * LIMIT / T / z) ** 2, f, 1e-6, "Maxwell stress")


@case("Newton's tolerance below rounding", REFUSED, "tolerance")
def too_tight():
    run(film(volts=0.5 * LIMIT), dea.Ramp(steps=2), options=dea.NewtonOptions(tolerance=1e-20))


@case("Newton's tolerance at rounding", FAILED, "it is rounding")
def tight():
    run(film(volts=0.9 * LIMIT, device=strip((3, 3))), dea.Ramp(steps=1),
        options=dea.NewtonOptions(tolerance=1e-14))  # fmt: skip


@case("one Newton iteration a step", REFUSED, "max_iterations")
def one_iteration():
    options = dea.NewtonOptions(max_iterations=1)
    run(film(volts=0.5 * LIMIT), dea.Ramp(steps=1), options=options)


# ----------------------------------------------------------------------------- charge, electrodes

ELECTRIC = {**Z, "phi": dea.Potential("top"), "Q": dea.Charge("top")}


def charged(coulombs, **changes):
    electrodes = [dea.ChargedElectrode("top", coulombs), dea.Ground("bottom")]
    return film(electrodes=electrodes, **changes)


@case("charge control past pull-in")
def past_by_charge():
    lam = 2.0
    charge = np.pi * T**2 * lam**2 * np.sqrt(EPS * MU * (lam**2 - lam**-4))
    done = run(charged(charge), dea.Ramp("charge", steps=8), ELECTRIC, options=TIGHT)
    stretch = done.column("z") ** -0.5
    assert np.all(np.diff(stretch) > 0), "the stretch does not grow with the charge"
    volts = T * np.sqrt(MU * (stretch[1:] ** 2 - stretch[1:] ** -4) / EPS) / stretch[1:] ** 2
    close(done.column("phi_V")[1:], volts, 1e-7, "potential")
    return close(stretch[-1], lam, 1e-8, "stretch")


@case("open circuit, pulled")
def open_circuit():
    charge, lam = 1e-10, 2.0
    path = [dea.Ramp("charge", steps=2), dea.Ramp("stretch", steps=2)]
    done = run(charged(charge, stretch=lam), path, ELECTRIC)
    return close(done["phi_V"], charge * T / (EPS * np.pi * T**2 * lam**4), 1e-8, "potential")


@case("an electrode left floating, uncharged")
def floating():
    """In the middle of a film it changes nothing and takes half the voltage."""
    layers = [Layer("one", T / 2), Layer("two", T / 2)]
    electrodes = [dea.Ground("bottom"), dea.ChargedElectrode("interface_1", 0.0),
                  dea.Electrode("top", 0.95 * LIMIT)]  # fmt: skip
    scene = film(device=strip(layers=layers), electrodes=electrodes)
    done = run(scene, dea.Ramp("voltage", steps=4), {**Z, "phi": dea.Potential("interface_1")})
    close(done["phi_V"], 0.475 * LIMIT, 1e-8, "potential")
    return on_the_curve(done, RUBBER)


@case("two electrodes at different voltages")
def two_voltages():
    layers = [Layer("one", T / 2), Layer("two", T / 2)]
    electrodes = [dea.Ground("bottom"), dea.Electrode("interface_1", 0.45 * LIMIT, ramp="low"),
                  dea.Electrode("top", 0.9 * LIMIT)]  # fmt: skip
    scene = film(device=strip(layers=layers), electrodes=electrodes)
    return on_the_curve(run(scene, dea.Ramp(steps=4)), RUBBER)


@case("three electrodes, the middle one driven")
def driven_middle():
    """Ground, voltage, ground: each half carries the field of a film of half the thickness."""
    layers = [Layer("one", T / 2), Layer("two", T / 2)]
    electrodes = [dea.Ground(("bottom", "top")), dea.Electrode("interface_1", 0.45 * LIMIT)]
    scene = film(device=strip(layers=layers), electrodes=electrodes)
    return on_the_curve(run(scene, dea.Ramp(steps=4)), RUBBER, thickness=T / 2)


@case("duplicated electrodes", REFUSED, "electrode twice")
def duplicated():
    film(electrodes=[dea.Electrode("top", 1.0), dea.Ground(("bottom", "top"))])


@case("electrodes of different potential that touch", REFUSED, "touch, but have different")
def touching():
    run(film(electrodes=[dea.Electrode("top", 1.0), dea.Ground("x_max")]), dea.Ramp(steps=1))


@case("capacitance at zero voltage")
def no_capacitance():
    done = run(film(volts=100.0), dea.Ramp(steps=1), {"C": dea.Capacitance("top")})
    close(done.column("C_F")[0], EPS * np.pi * T, 1e-9, "capacitance at 0 V")
    return close(done["C_F"], EPS * np.pi * T, 1e-3, "capacitance")


@case("true stress and voltage")
def true_stress():
    s = 0.4 * MU
    scene = film(volts=0.4 * UNIT, loads=[dea.FollowerPressure("x_max", -s)])
    done = run(scene, [dea.Ramp("load", steps=2), dea.Ramp("voltage", steps=2)])
    lam = done["z"] ** -0.5
    maxwell = EPS * (0.4 * UNIT * lam**2 / T) ** 2
    wanted = elastic_stress(dea.Material(RUBBER), lam, lam)[0] - maxwell
    return close(s, wanted, 1e-7, "stress")
