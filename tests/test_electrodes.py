"""Electrodes: what is refused, what they hold, and devices without any field."""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from mpi4py import MPI

import dea_fenicsx as dea
from dea_fenicsx.geometry import BoxStack, HelicalCell, Layer, MembraneDisc
from dea_fenicsx.materials import EPSILON_0
from dea_fenicsx.model.kernels import measure
from dea_fenicsx.support import compat
from dea_fenicsx.support.compat import dolfinx

pytestmark = pytest.mark.usefixtures("quick_compile")
RUBBER = dea.NeoHookean(5e4)
FILM = dea.Material(RUBBER, dea.IdealDielectric(3.0))
STIFF = dea.Material(dea.NeoHookean(1e12), dea.IdealDielectric(3.0))
SOFT_FILM = dea.Material(dea.NeoHookean(2e4), dea.IdealDielectric(3.0))
SOFT = dea.Material(RUBBER)
CONDUCTOR = dea.Material(RUBBER, dea.Conductor())
EPS = 3.0 * EPSILON_0
PLANE = dea.PlaneStrain(1e-3)
SAME = [dea.Electrode("top", 5e3), dea.Electrode("bottom", 5e3)]
ROUND = [dea.Fix("bottom", "z"), dea.Fix("x_min", "r")]


def box(*layers, length=1e-3, width=None, divisions=(2,), comm=MPI.COMM_SELF):
    """Layers of 1 mm unless a name comes with a thickness."""
    made = [Layer(*(layer if isinstance(layer, tuple) else (layer, 1e-3))) for layer in layers]
    return dea.read_gmsh(BoxStack(length, width, made, divisions=divisions), comm)


def scene(device, materials, electrodes, kinematics=PLANE, supports=None, **more):
    supports = [dea.Clamp("bottom")] if supports is None else supports
    return dea.Scene(device, materials, electrodes, supports, kinematics=kinematics, **more)


def solve(given, record, path=None, **options):
    return dea.solve(given, path or dea.Ramp(steps=1), record, quiet=True, **options)


def cell(electrodes):
    """A free helical cell of two electrodes."""
    geometry = HelicalCell(radial=3, rim=1, through=1)
    given = {"elastomer": FILM, "electrode_a": CONDUCTOR, "electrode_b": CONDUCTOR}
    device = dea.read_gmsh(geometry, MPI.COMM_SELF)
    return scene(device, given, electrodes, dea.Helical(geometry.pitch), [dea.FreeBody()])


# ------------------------------------------------------------------------------- what is refused


@pytest.fixture(scope="module")
def two():
    return box("a", "b")


@pytest.fixture(scope="module")
def three():
    return box("low", "film", "high", divisions=(3,))


def refuse(make, *words):
    with pytest.raises(dea.InputError) as caught:
        make()
    text = str(caught.value)
    assert text.endswith(".") and "\n" not in text and len(text) < 400
    assert all(word in text for word in words), text


@pytest.mark.parametrize("electrode", [
    dea.Electrode("top", 5e3), dea.Ground("top"), dea.ChargedElectrode("top", 1e-12),
])  # fmt: skip
def test_electrode_on_no_dielectric(three, electrode):
    """It is named, and so are its neighbour and where a dielectric would be."""
    materials = {"low": SOFT, "film": FILM, "high": SOFT}
    live = [electrode, dea.Electrode("interface_2", 1e3), dea.Ground("interface_1")]
    refuse(lambda: scene(three, materials, live), "'top'", "no dielectric", "'high'", "film")
    # part of it on a dielectric is enough
    whole = dea.Electrode(("top", "interface_2"), 1e3)
    scene(three, materials, [whole, dea.Ground("interface_1")])


def test_conductor_on_no_dielectric(three):
    materials = {"low": FILM, "film": SOFT, "high": CONDUCTOR}
    live = [dea.Electrode("high", 1e3), dea.Ground("bottom")]
    refuse(lambda: scene(three, materials, live), "'high'", "no dielectric", "'film'", "low")
    scene(three, materials | {"film": FILM}, live)


def test_edge_of_a_dielectric_is_no_place_for_an_electrode(three):
    """The top of the middle layer and the side of the upper one have a line in common, no facet."""
    materials = {"low": FILM, "film": SOFT, "high": SOFT}
    live = [dea.Electrode("interface_2", 1e3), dea.Ground("bottom")]
    refuse(lambda: scene(three, materials, live), "'interface_2'", "no dielectric")
    scene(three, materials, [dea.Electrode("x_max", 1e3), dea.Ground("x_min")])


def test_charge_without_a_potential_to_compare_with(three):
    """A floating electrode needs a given potential on the dielectrics that it can reach."""
    apart = {"low": FILM, "film": SOFT, "high": FILM}
    live = [dea.ChargedElectrode("top", 1e-12), dea.Ground("bottom")]
    refuse(lambda: scene(three, apart, live), "'top'", "not defined", "Ground")
    scene(three, apart, [*live, dea.Ground("interface_2")])
    # through a dielectric, a conductor that floats or an electrode on both sides it is reached
    scene(three, dict.fromkeys(apart, FILM), live)
    floating = dea.ChargedElectrode("film", 0.0)
    scene(three, apart | {"film": CONDUCTOR}, [*live, floating])
    joined = dea.ChargedElectrode(("interface_1", "interface_2"), 0.0)
    scene(three, apart, [*live, joined])


@pytest.mark.parametrize(
    ("name", "start", "end"),
    [("a", 0.0, 1.0), ("a", 0.0, 2e-3), ("b", 0.0, 1e-3), ("b", 1e-3, 2.00001e-3),
     ("b", 1.1e-3, 2e-3), ("a", 0.0, 1e-4), (("a", "b"), 0.0, 1e-3)],
)  # fmt: skip
def test_thin_film_that_spans_elsewhere(two, name, start, end):
    film = dea.ThinFilm(name, 5e3, start=start, end=end, along="y")
    refuse(lambda: scene(two, {"a": FILM, "b": FILM}, [film]), "spans y", "two faces")


def test_thin_film_of_two_layers(two):
    """Two layers of one permittivity may be one film, of two permittivities they are none."""
    film = dea.ThinFilm(("a", "b"), 5e3, start=2e-3, end=0.0, along="y")
    scene(two, {"a": FILM, "b": SOFT_FILM}, [film])
    other = dea.Material(RUBBER, dea.IdealDielectric(5.0))
    refuse(lambda: scene(two, {"a": FILM, "b": other}, [film]), "one permittivity", "50 %")


def test_thin_film_that_is_not_flat(three):
    """Two films with a gap are not one, and a film that leans is none."""
    films = {"low": FILM, "film": SOFT, "high": FILM}
    film = dea.ThinFilm(("low", "high"), 5e3, start=0.0, end=3e-3, along="y")
    refuse(lambda: scene(three, films, [film]), "not one flat film")
    leaning = box("a", divisions=(4,))
    x = leaning.mesh.geometry.x
    x[:, 1] += 0.2 * x[:, 0]
    film = dea.ThinFilm("a", 5e3, start=0.0, end=1.2e-3, along="y")
    refuse(lambda: scene(leaning, {"a": FILM}, [film]), "not one flat film", "100 %")


@pytest.mark.parametrize(
    ("tapers", "words"),
    [
        ((dea.Taper(0.5, 1.0, "x"),), "has no effect"),
        ((dea.Taper(1e-3, 2e-3, "x"),), "has no effect"),
        ((dea.Taper(-2e-3, -1e-3, "x"),), "0 V everywhere"),
        ((dea.Taper(3e-3, 2e-3, "x"),), "0 V everywhere"),
        ((dea.Taper(0, 4e-4, "x"), dea.Taper(1e-3, 6e-4, "x")), "0 V everywhere"),
    ],
)
def test_taper_that_lies_elsewhere(two, tapers, words):
    materials = {"a": FILM, "b": FILM}
    live = [dea.Electrode("top", 1e3, taper=tapers), dea.Ground("bottom")]
    refuse(lambda: scene(two, materials, live), "'top'", words)
    live[0] = dea.Electrode("top", 1e3, taper=(dea.Taper(4e-4, 0, "x"), dea.Taper(6e-4, 1e-3, "x")))
    scene(two, materials, live)


def test_electrodes_that_meet_at_zero(two):
    """Where both give 0 V they may meet, whatever drives them, and in any order."""
    films = [dea.ThinFilm("a", 3e3, ramp="left", start=1e-3, end=0.0, along="y"),
             dea.ThinFilm("b", 2e3, ramp="right", start=1e-3, end=2e-3, along="y")]  # fmt: skip
    ground = dea.Ground("interface_1")
    for live in ([*films, ground], [ground, *films]):
        given = scene(two, {"a": STIFF, "b": STIFF}, live)
        names = {"a": "a", "b": "b", "0": "interface_1"}
        run = solve(given, {key: dea.Charge(name) for key, name in names.items()})
        assert run["a_C"] == pytest.approx(EPS * 3e3 * 1e-3, rel=1e-6)
        assert run["b_C"] == pytest.approx(EPS * 2e3 * 1e-3, rel=1e-6)
        # the ground is the other face of both
        assert run["0_C"] == pytest.approx(-EPS * 5e3 * 1e-3, rel=1e-6)


# ------------------------------------------------------------------------- charges and potentials


@pytest.mark.parametrize("cells", [1, 3])
def test_thin_films_that_share_a_face(cells):
    """Each has its own charge eps V A/T and its own voltage, whatever the mesh."""
    device = box(("a", 1e-3), ("b", 5e-4), divisions=(cells,))
    films = [dea.ThinFilm("a", 5e3, start=0.0, end=1e-3, along="y"),
             dea.ThinFilm("b", 5e3, start=1.5e-3, end=1e-3, along="y")]  # fmt: skip
    run = solve(scene(device, {"a": STIFF, "b": STIFF}, films), {
        "V": dea.Potential("a"), "a": dea.Charge("a"), "b": dea.Charge("b"),
        "both": dea.Charge(("a", "b", "a")), "C": dea.Capacitance("b"),
    })  # fmt: skip
    q = EPS * 5e3 * 1e-3
    assert run["V_V"] == 5e3
    found = [run[f"{name}_C"] for name in ("a", "b", "both")]
    assert found == pytest.approx([q, 2 * q, 3 * q], rel=1e-6, abs=0)
    assert run.column("C_F") == pytest.approx([2 * EPS * 1e-3] * 2, rel=1e-6, abs=0)


def test_thin_film_beside_a_full_field():
    """An electrode on a film's face is one conductor with it, and holds both charges."""
    device = box("a", "b")
    film = dea.ThinFilm("a", 5e3, start=0.0, end=1e-3, along="y")
    live = [film, dea.Electrode("interface_1", 5e3), dea.Ground("top"), dea.Ground("bottom")]
    names = ("a", "interface_1", "top", "bottom")
    run = solve(scene(device, {"a": STIFF, "b": STIFF}, live), {n: dea.Charge(n) for n in names})
    q = EPS * 5e3 * 1e-3
    found = [run[f"{name}_C"] for name in names]
    assert found == pytest.approx([q, 2 * q, -q, -q], rel=1e-6, abs=0)


@pytest.fixture(scope="module")
def disc():
    return dea.read_gmsh(
        MembraneDisc(12e-3, 4e-3, 0.5e-3, taper=2e-3, cells=(2, 2, 2)), MPI.COMM_SELF
    )


def on_disc(disc, electrodes):
    supports = [dea.Fix("bottom", "z"), dea.Fix("axis", "r"), dea.Fix("rim", "r")]
    return scene(disc, dict.fromkeys(disc.regions, FILM), electrodes, dea.Axisymmetric(), supports)


def test_electrodes_that_touch_count_their_nodes_once(disc):
    """One electrode of two groups, or two of one: the same sum, and none is left over."""
    split = [dea.Electrode("top_active", 2e3), dea.Electrode("top_edge", 2e3), dea.Ground("bottom")]
    apart = solve(on_disc(disc, split), {
        "a": dea.Charge("top_active"), "e": dea.Charge("top_edge"), "g": dea.Charge("bottom"),
        "all": dea.Charge(("top_active", "top_edge", "bottom")),
    })  # fmt: skip
    one = [dea.Electrode(("top_active", "top_edge"), 2e3), dea.Ground("bottom")]
    whole = solve(on_disc(disc, one), {"q": dea.Charge("top_active")})
    q = whole["q_C"]
    assert apart["a_C"] + apart["e_C"] == pytest.approx(q, rel=1e-12)
    assert apart["g_C"] == pytest.approx(-q, rel=1e-9)
    assert abs(apart["all_C"]) < 1e-9 * q
    assert 0 < apart["e_C"] < q


def energy_of(problem):
    """The potential energy of all regions in J, without loads."""
    weight = problem.scene.kinematics.weight(ufl.SpatialCoordinate(problem.mesh))
    dx = measure(problem.scene.device, [k.cells for k in problem.kernels],
                 problem.scene.elements.quadrature_degree)  # fmt: skip
    total = sum(s.energy * weight * dx(k) for k, s in enumerate(problem.states))
    form = compat.compile_form(total)
    unit = problem.scales.stress * problem.scales.volume
    return lambda: float(dolfinx.fem.assemble_scalar(form)) * unit


def driven_pair(kinematics):
    """Two dielectric layers: the middle is driven, the top floats with a charge, below is ground.

    The driven electrode tapers off where the kinematics lets it lie on a plane.
    """
    space = isinstance(kinematics, dea.ThreeD)
    device = box("a", "b", width=1e-3 if space else None, divisions=(2, 1) if space else (3,))
    second = kinematics.axes[-1]
    supports = [dea.Fix("bottom", second), dea.Fix("x_min", kinematics.axes[0])]
    supports += [dea.Fix("y_min", "y")] if space else []
    live = [dea.Electrode("interface_1", 6e3, taper=dea.Taper(4e-4, 9e-4, kinematics.axes[0])),
            dea.ChargedElectrode("top", 3e-12, ramp="voltage"), dea.Ground("bottom")]  # fmt: skip
    return scene(device, {"a": FILM, "b": FILM}, live, kinematics, supports)


KINEMATICS = [dea.ThreeD(), PLANE, dea.GeneralisedPlaneStrain(1e-3), dea.Axisymmetric(), "helical"]


@pytest.mark.parametrize("kinematics", KINEMATICS, ids=str)
def test_charge_does_work_with_the_voltage(kinematics):
    """-dPi/dV by a finite difference, which is exact: Pi is quadratic in the potential."""
    if kinematics == "helical":
        live = "electrode_a"
        given = cell([dea.Electrode(live, 3e3), dea.Ground("electrode_b")])
    else:
        given, live = driven_pair(kinematics), "interface_1"
    run = solve(given, {"q": dea.Charge(live), "V": dea.Potential(live)})
    problem = run.problem
    electrode = given.electrodes[0]
    energy = energy_of(problem)
    dofs = problem.conditions.electrode_dofs[live]
    state = problem.state
    found = []
    for sign in (1, -1):  # all of the electrode moves by 1 % of its potential
        changed = state.values.copy()
        changed[dofs] *= 1 + sign * 0.01
        problem.commit(state.with_values(changed))
        found.append(energy())
    problem.commit(state)
    charge = -(found[0] - found[1]) / (0.02 * electrode.volts)
    assert run["V_V"] == electrode.volts
    assert run["q_C"] == pytest.approx(charge, rel=1e-8)


# ------------------------------------------------------------------------------------ capacitance


def film_capacitance(comm):
    """A held film's capacitance at 0 V and above, before and after a stretch; a floating one's."""
    device = box("film", divisions=(4,), comm=comm)
    found = []
    for live, ramp in ((dea.Electrode("top", 2e3), "voltage"),
                       (dea.ChargedElectrode("top", 1e-13), "charge")):  # fmt: skip
        given = scene(device, {"film": FILM}, [live, dea.Ground("bottom")], dea.Axisymmetric(),
                      ROUND, prescribed=[dea.Stretch("x_max", "r", 1.5)])  # fmt: skip
        path = [dea.Ramp("stretch", steps=2), dea.Ramp(ramp, steps=3)]
        path.append(dea.Ramp(ramp, to=0, steps=1))
        run = solve(given, {"C": dea.Capacitance("top")}, path)
        found.append([float(c) for c in run.column("C_F")])
    return found


def check_film_capacitance(found):
    # eps pi R^2 lam^2 / (T lam^-2); a held film does not thin by its field
    at_rest, stretched = (EPS * np.pi * 1e-3 * lam**4 for lam in (1.0, 1.5))
    for columns in found:
        assert columns[0] == pytest.approx(at_rest, rel=1e-9, abs=0)
        assert columns[2:] == pytest.approx([stretched] * 5, rel=1e-8, abs=0)


def test_capacitance_at_zero_volts():
    check_film_capacitance(film_capacitance(MPI.COMM_SELF))


def on_few_cells(comm):
    """What else is measured by all ranks, some of which may have no cell."""
    device = box("a", "b", divisions=(1,), comm=comm)
    films = [dea.ThinFilm("a", 5e3, start=0.0, end=1e-3, along="y"),
             dea.ThinFilm("b", 5e3, start=2e-3, end=1e-3, along="y")]  # fmt: skip
    shared = solve(scene(device, {"a": STIFF, "b": STIFF}, films), {"q": dea.Charge("a")})
    taper = dea.Taper(2e-4, 8e-4, "x")
    live = [dea.Electrode("top", 5e3, taper=taper), dea.Ground(("interface_1", "bottom"))]
    tapered = solve(scene(device, {"a": STIFF, "b": STIFF}, live), {"V": dea.Potential("top")})
    quiet = solve(scene(device, {"a": STIFF, "b": STIFF}, SAME), {"q": dea.Charge("top")})
    return film_capacitance(comm), [float(shared["q_C"]), tapered["V_V"], float(quiet["q_C"])]


@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [2, 3])
def test_on_ranks(on_ranks, ranks):
    capacitances, (shared, volts, quiet) = on_ranks("test_electrodes", "on_few_cells", ranks)
    check_film_capacitance(capacitances)
    assert shared == pytest.approx(EPS * 5e3 * 1e-3, rel=1e-6)
    assert volts == 5e3
    assert abs(quiet) < 1e-20


def test_capacitance_goes_on_from_zero(two):
    """The limit is that of the ramp: an electrode of opposite voltage on it counts, too."""
    live = [dea.Electrode("top", 3e3), dea.Electrode("interface_1", -1e3), dea.Ground("bottom")]
    run = solve(scene(two, {"a": STIFF, "b": STIFF}, live),
                {"C": dea.Capacitance("top"), "D": dea.Capacitance("interface_1")})  # fmt: skip
    one = EPS * 1e-3
    assert run.column("C_F") == pytest.approx([4 / 3 * one] * 2, rel=1e-6, abs=0)
    assert run.column("D_F") == pytest.approx([5 * one] * 2, rel=1e-6, abs=0)


def test_capacitance_beside_a_dielectric_that_no_electrode_touches():
    """Its potential is not determined, and does not matter; an empty charge has a capacitance."""
    device = box("film", "spacer", "pad", divisions=(3,))
    given = scene(device, {"film": STIFF, "spacer": SOFT, "pad": FILM},
                  [dea.ChargedElectrode("interface_1", 0.0), dea.Ground("bottom")],
                  loads=[dea.DeadLoad("top", (0.0, 10.0))])  # fmt: skip
    run = solve(given, {"C": dea.Capacitance("interface_1")}, dea.Ramp("load", steps=1))
    assert run.column("C_F") == pytest.approx([EPS * 1e-3] * 2, rel=1e-6, abs=0)


def test_capacitance_of_a_helical_cell():
    """At 0 V it is the limit of what it is just above, tied ends and all."""
    live = [dea.Electrode("electrode_a", 100.0), dea.Ground("electrode_b")]
    C = solve(cell(live), {"C": dea.Capacitance("electrode_a")}).column("C_F")
    assert C[0] == pytest.approx(C[1], rel=1e-5)
    assert C[0] != C[1]


def test_a_ground_has_no_capacitance(two):
    live = [dea.Electrode("top", 0.0, ramp="mine"), dea.Electrode("bottom", 1e3)]
    given = scene(two, {"a": FILM, "b": FILM}, live)
    with pytest.raises(dea.InputError, match="grounded"):
        solve(given, {"C": dea.Capacitance("top")})


# ---------------------------------------------------------------------------- without any field


NO_FIELD = {
    "two of one": SAME,
    "one alone": SAME[:1],
    "two ramps": [dea.Electrode("top", 5e3, ramp="a"), dea.Electrode("bottom", 5e3, ramp="b")],
    "one floats": [SAME[0], dea.ChargedElectrode("bottom", 0.0)],
}


@pytest.mark.parametrize("name", NO_FIELD)
def test_no_field(name):
    """No charge and no motion, to rounding; 5 kV over the film would bring 4e-10 C."""
    device = box("film")
    given = scene(device, {"film": FILM}, NO_FIELD[name], dea.Axisymmetric(), ROUND)
    run = solve(given, {"l": dea.MeanStretch(("bottom", "top"), "z"), "q": dea.Charge("top")},
                dea.Ramp(steps=2))  # fmt: skip
    assert np.abs(run.column("q_C")).max() < 1e-20
    assert np.abs(run.column("l") - 1).max() < 1e-12


@pytest.mark.parametrize("kinematics", KINEMATICS, ids=str)
def test_no_field_in_any_kinematics(kinematics):
    if kinematics == "helical":
        live = [dea.Electrode("electrode_a", 5e3), dea.Electrode("electrode_b", 5e3)]
        given, name = cell(live), "electrode_a"
    else:
        space = isinstance(kinematics, dea.ThreeD)
        device = box("film", width=1e-3 if space else None, divisions=(2, 2) if space else (2,))
        supports = [dea.Clamp("bottom")]
        given, name = scene(device, {"film": FILM}, SAME, kinematics, supports), "top"
    run = solve(given, {"q": dea.Charge(name)}, dea.Ramp(steps=2))
    assert np.abs(run.column("q_C")).max() < 1e-20
    assert run.column("min_J") == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("tolerance", [1e-10, 1e-13])
def test_loads_without_a_field(tolerance):
    """They stretch the film as if there were no electrodes, at any tolerance."""
    load = dea.DeadLoad("x_max", (2e4, 0.0))
    given = scene(box("film"), {"film": FILM}, SAME, dea.Axisymmetric(), ROUND, loads=[load])
    run = solve(given, {"u": dea.MeanDisplacement("x_max", "r"), "q": dea.Charge("top")},
                options=dea.NewtonOptions(tolerance=tolerance))  # fmt: skip
    lam = 1 + run["u_m"] / 1e-3
    assert 5e4 * (lam - lam**-5) == pytest.approx(2e4, rel=1e-9)
    assert abs(run["q_C"]) < 1e-20


@pytest.mark.parametrize("difference", [1e-3, 1e-6, 0.0])
def test_potentials_that_differ_by_little(difference):
    """The charge of a small difference is right as far as the numbers hold it."""
    live = [SAME[0], dea.Electrode("bottom", 5e3 - difference)]
    run = solve(scene(box("film"), {"film": FILM}, live, dea.Axisymmetric(), ROUND),
                {"q": dea.Charge("top")})  # fmt: skip
    assert run["q_C"] == pytest.approx(EPS * np.pi * 1e-3 * difference, rel=1e-4, abs=1e-24)


def test_there_and_back():
    """To full voltage, to the opposite one and to zero: mirrored charges, and none in the end."""
    live = [dea.Electrode("top", 4e3), dea.Electrode("bottom", -4e3)]
    given = scene(box("film"), {"film": FILM}, live, dea.Axisymmetric(), ROUND)
    path = [dea.Ramp(to=t, steps=2) for t in (1.0, -1.0, 0.0)]
    run = solve(given, {"q": dea.Charge("top"), "g": dea.Charge("bottom"),
                        "l": dea.MeanStretch(("bottom", "top"), "z")}, path)  # fmt: skip
    q, g, lam = (run.column(n) for n in ("q_C", "g_C", "l"))
    assert q[2] == pytest.approx(EPS * np.pi * 8e3 * 1e-3 / lam[2] ** 2, rel=1e-8)
    assert q[4] == pytest.approx(-q[2], rel=1e-8)
    assert q[3] == pytest.approx(0, abs=1e-20) and q[6] == pytest.approx(0, abs=1e-20)
    assert g == pytest.approx(-q, rel=1e-8, abs=1e-20)
    assert lam[[3, 6]] == pytest.approx(1, abs=1e-9)


def test_a_quiet_film_beside_an_active_one(two):
    """Both faces of one film are at 5 kV: its charge is that of the other film alone."""
    live = [dea.Electrode("top", 5e3), dea.Electrode("interface_1", 5e3), dea.Ground("bottom")]
    run = solve(scene(two, {"a": STIFF, "b": STIFF}, live),
                {n: dea.Charge(n) for n in ("top", "interface_1", "bottom")})  # fmt: skip
    q = EPS * 5e3 * 1e-3
    found = [run[f"{n}_C"] for n in ("top", "interface_1", "bottom")]
    assert found == pytest.approx([0, q, -q], rel=1e-6, abs=1e-9 * q)


def test_a_run_without_field_says_so(capfd):
    given = scene(box("film"), {"film": FILM}, SAME, dea.Axisymmetric(), ROUND)
    dea.solve(given, dea.Ramp(steps=1))
    assert "there is no field" in capfd.readouterr().out
