"""The spiral box in closed form: against corner coordinates, complex steps and peaks
that were found apart.

Numbers in inch and lbf belong to chapter 5 of J. Park's thesis (2019) and were computed
independently of this package.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest

import dea_fenicsx as dea
import dea_fenicsx.origami
from dea_fenicsx.origami import (
    INCH,
    POUND_FORCE,
    Box,
    CreasePattern,
    Kresling,
    SmoothFold,
    blocked_force,
    fold_angles,
    least_fold_width,
    strokes,
    table_of_angles,
    vertices,
    voltage_to_block,
)
from dea_fenicsx.origami.picture import write_folding
from dea_fenicsx.thesis import errata

# in inch and lbf: all formulas hold in any consistent units
A, B, H, K = 2.125, 2.75, 1.65, 17.0
READINGS = {
    "printed held": errata.PrintedKresling(A, H, K, H, twist="held"),
    "printed free": errata.PrintedKresling(A, H, K, H),
    "right held": Kresling(A, H, K, H, twist="held"),
    "right free, vertical": Kresling(A, H, K, H),
    "right free, 1.65": Kresling(A, B, K, H),
    "right free, flat": Kresling(A, B, K),
    "six sides": Kresling(1.0, 1.9, 2.0, sides=6),
}
FLAT = READINGS["right free, flat"]


def energy(s: Kresling, height, twist=None):
    """U from coordinates of the corners; analytic, so that complex steps give its derivatives."""
    n, R = s.sides, s.radius
    if twist is None and s.twist == "held":
        twist = s.rest_twist
    if not s.is_solid:
        phi = np.arcsin(np.sqrt(s.edge**2 - height**2) / R) if twist is None else twist
        c = np.sqrt(height**2 + R**2 * np.sin(phi + np.pi / 2) ** 2)
    else:
        phi = 2 * np.arcsin(np.sqrt(s.edge**2 - height**2) / (2 * R)) if twist is None else twist
        angle = phi + 2 * np.pi / n
        c = np.sqrt((R * np.cos(angle) - R) ** 2 + (R * np.sin(angle)) ** 2 + height**2)
    return s.stiffness / 2 * (c - s.rest_diagonal) ** 2


@pytest.mark.parametrize("name", READINGS)
def test_force_and_torque_are_derivatives_of_the_energy(name):
    s = READINGS[name]
    top = s.edge if s.twist == "free" else 1.5 * s.height
    heights = np.linspace(s.lowest + 0.02, top - 0.02, 23)
    state, step = s.at(heights), 1e-30
    assert state.energy == pytest.approx(energy(s, heights), rel=1e-10, abs=1e-14)
    scale = abs(state.force).max()
    force = -energy(s, heights + 1j * step).imag / step
    assert state.force == pytest.approx(force, rel=1e-10, abs=1e-12 * scale)
    partial = -energy(s, heights + 1j * step, state.twist).imag / step
    assert state.partial_force == pytest.approx(partial, rel=1e-10, abs=1e-12 * scale)
    torque = -energy(s, heights, state.twist + 1j * step).imag / step
    assert state.partial_torque == pytest.approx(torque, rel=1e-10, abs=1e-12 * scale)
    assert np.all(state.torque == (state.partial_torque if s.twist == "held" else 0))
    assert state.energy_density == pytest.approx(state.strain**2 / 2)


def test_flat_cell():
    (first, deployed), (second, folded) = FLAT.strain_free
    assert (first, deployed) == (0, 2.75)
    assert np.degrees(second) == pytest.approx(90, abs=1e-12)
    assert folded == pytest.approx(1.74553, abs=5e-6)
    assert FLAT.rest_diagonal == pytest.approx(np.hypot(A, B), rel=1e-14)
    for height in (deployed, folded):
        assert float(FLAT.at(height).strain) == pytest.approx(0, abs=1e-15)
    barrier = FLAT.barrier()
    assert barrier.strain == pytest.approx(0.0746, abs=5e-5)
    assert barrier.strain == pytest.approx(np.sqrt(1 + np.sqrt(2) * A**2 / (A**2 + B**2)
                                           - A**2 / (A**2 + B**2)) - 1, rel=1e-12)  # fmt: skip
    assert np.degrees(barrier.twist) == pytest.approx(45, abs=1e-12)
    assert barrier.force == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("s", [FLAT, READINGS["six sides"]])
def test_snap_forces(s):
    push, pull = s.snap_forces()
    # pushed from the vertical: k a^2 b cos^2(pi/n)/c0^2, by expansion of the energy in the twist
    start = s.stiffness * s.side**2 * s.edge * np.cos(np.pi / s.sides) ** 2 / s.rest_diagonal**2
    assert push == pytest.approx(start, rel=1e-12)
    way = np.linspace(s.barrier().height, s.height, 20001)[1:-1]
    assert pull == pytest.approx(s.at(way).force.min(), rel=1e-6)
    assert s.at(s.edge).force == pytest.approx(start, rel=1e-12)


def test_second_state_that_leans_the_other_way():
    s = READINGS["right free, 1.65"]
    (other, height), (rest, _) = s.strain_free
    assert other == pytest.approx(np.pi / 2 - rest)
    assert float(s.at_twist(other).strain) == pytest.approx(0, abs=1e-14)
    assert height == pytest.approx(float(s.at_twist(other).height))
    assert s.snap_forces()[0] == np.inf


# peak force by eq 72a and by the energy (lbf), twist of collapse (deg)
PEAKS = {
    "printed held": (4.23, 4.23, 0.0),
    "right held": (2.54, 2.54, 0.0),
    "right free, 1.65": (1.957, 3.216, 38.31),
    "right free, flat": (2.189, 3.560, 42.43),
}


@pytest.mark.parametrize("name", PEAKS)
def test_peaks_that_were_found_apart(name):
    s = READINGS[name]
    partial, force, twist = PEAKS[name]
    assert s.peak("partial_force")[1] == pytest.approx(partial, abs=6e-3 if twist == 0 else 6e-4)
    assert s.peak()[1] == pytest.approx(force, abs=6e-3 if twist == 0 else 6e-4)
    assert np.degrees(s.at(s.lowest).twist - s.rest_twist) == pytest.approx(twist, abs=6e-3)


def test_printed_readings_that_lead_nowhere():
    assert READINGS["printed free"].lowest == pytest.approx(0.682, abs=5e-4)
    vertical = READINGS["right free, vertical"]
    assert vertical.at(vertical.height).force == pytest.approx(8.75, abs=6e-3)
    assert vertical.peak("partial_force")[1] <= 0
    assert np.degrees(vertical.at(0.0).twist) == pytest.approx(66.6, abs=6e-3)


CURVES = {  # loss of height 0, 0.2, ... 1.6 in
    "right free, 1.65": {
        "twist": [0.0, 7.9523, 15.072, 21.386, 26.861, 31.414, 34.923, 37.249, 38.272],
        "strain": [0, -0.030625, -0.061473, -0.091401, -0.1192, -0.14355, -0.16304, -0.17629,
                   -0.18219],
        "energy": [0, 0.093609, 0.37717, 0.83381, 1.4182, 2.0568, 2.6532, 3.1018, 3.3131],
        "partial_force": [0, 0.77876, 1.3919, 1.7956, 1.9556, 1.8521, 1.4902, 0.90958, 0.18937],
    },
    "right free, flat": {
        "twist": [0.0, 8.3815, 15.891, 22.59, 28.474, 33.481, 37.505, 40.414, 42.071],
        "strain": [0, -0.029685, -0.060137, -0.090222, -0.11879, -0.14459, -0.16628, -0.18244,
                   -0.19182],
        "energy": [0, 0.090469, 0.37127, 0.83568, 1.4487, 2.1464, 2.8384, 3.417, 3.7776],
        "partial_force": [0, 0.80381, 1.4636, 1.9312, 2.1668, 2.1424, 1.8496, 1.3108, 0.58721],
    },
    "printed held": {
        "strain": [0, -0.064313, -0.12417, -0.17859, -0.22642, -0.26639, -0.29714, -0.31743,
                   -0.32632],
        "force": [0, 1.6943, 3.0126, 3.8808, 4.2295, 4.0125, 3.2342, 1.9765, 0.41172],
    },
}  # fmt: skip


@pytest.mark.parametrize("name", CURVES)
def test_curves_of_figure_5_2(name):
    s = READINGS[name]
    state = s.at(s.height - np.linspace(0, 1.6, 9))
    for quantity, expected in CURVES[name].items():
        found = getattr(state, quantity)
        if quantity == "twist":
            found = np.degrees(found - s.rest_twist)
        assert found == pytest.approx(expected, rel=5e-5, abs=1e-12)


def test_printed_torque():
    s = READINGS["right held"]
    state = s.at(1.2)
    literal = s.radius**2 * K * (np.pi / 4 + np.pi / 4) * (1 - s.rest_diagonal / state.diagonal)
    assert errata.torque_as_printed(s, state) == pytest.approx(literal, rel=1e-12)


def test_what_has_moved_is_found_with_one_warning():
    with pytest.warns(DeprecationWarning, match=r"thesis\.errata") as told:
        found = dea_fenicsx.origami.torque_as_printed
    assert found is errata.torque_as_printed and len(told) == 1


# ------------------------------------------------------------------ the solid


def crossings(s: Kresling, phi: float) -> int:
    """How often a crease pierces a panel."""
    v, n = vertices(s, phi), s.sides
    after = [(i + 1) % n for i in range(n)]
    panels = [(v[0, i], v[1, i], v[1, j]) for i, j in enumerate(after)]
    panels += [(v[0, i], v[0, j], v[1, j]) for i, j in enumerate(after)]
    creases = [(v[0, i], v[1, k]) for i, j in enumerate(after) for k in (i, j)]
    count = 0
    for p, q in creases:
        for a, b, c in panels:
            matrix = np.column_stack([q - p, a - b, a - c])
            if abs(np.linalg.det(matrix)) > 1e-12:
                t, u, w = np.linalg.solve(matrix, a - p)
                e = 1e-9
                count += e < t < 1 - e and u > e and w > e and u + w < 1 - e
    return count


@pytest.mark.parametrize("s", [FLAT, READINGS["six sides"]])
def test_panels_pierce_each_other_beyond_contact(s):
    for share in (0.1, 0.5, 0.99):
        assert crossings(s, share * s.contact_twist) == 0
    assert crossings(s, 1.01 * s.contact_twist) > 0
    assert s.rest_twist == s.contact_twist


def test_corners_and_folds():
    phi = np.radians([0.0, 20.0, 60.0, 89.9999])
    v = vertices(FLAT, phi)
    assert v.shape == (4, 2, 4, 3)
    state = FLAT.at_twist(phi)
    edge = np.linalg.norm(v[:, 1, 0] - v[:, 0, 0], axis=-1)
    diagonal = np.linalg.norm(v[:, 1, 1] - v[:, 0, 0], axis=-1)
    assert edge == pytest.approx(np.full(4, B), rel=1e-13)
    assert diagonal == pytest.approx(state.diagonal, rel=1e-13)
    assert np.linalg.norm(v[:, :, 1] - v[:, :, 0], axis=-1) == pytest.approx(np.full((4, 2), A))
    folds = {k: np.degrees(f) for k, f in fold_angles(FLAT, phi).items()}
    assert [folds[k][0] for k in ("diagonal", "edge", "side")] == pytest.approx([0, 90, 0])
    assert np.all(folds["diagonal"][1:] < 0)  # valley
    assert np.all(folds["edge"] > 0) and np.all(folds["side"][1:] > 0)  # mountains
    assert folds["edge"][-1] == pytest.approx(180, abs=1e-3)
    # gamma from the normal of the panel that stands on the base
    n = np.cross(v[2, 0, 1] - v[2, 0, 0], v[2, 1, 1] - v[2, 0, 0])
    gamma = np.pi - np.arccos(-n[2] / np.linalg.norm(n))
    assert state.panel_angle[2] == pytest.approx(gamma, rel=1e-12)
    assert FLAT.at(FLAT.height).panel_angle == pytest.approx(np.arcsin(FLAT.height / B))


def test_folding_opens_elsewhere(tmp_path):
    meshio = pytest.importorskip("meshio")
    series = json.loads(write_folding(FLAT, np.radians([0, 30, 60]), tmp_path).read_text("utf-8"))
    assert [f["time"] for f in series["files"]] == pytest.approx([0, 30, 60])
    mesh = meshio.read(tmp_path / series["files"][1]["name"])
    assert mesh.points == pytest.approx(vertices(FLAT, np.radians(30)).reshape(-1, 3), abs=1e-8)
    strain = np.ravel(mesh.cell_data["diagonal_strain"])
    assert strain == pytest.approx(np.full(8, FLAT.at_twist(np.radians(30)).strain), rel=1e-8)


# ------------------------------------------------------------------ pattern


def test_smooth_fold_of_the_thesis():
    fold = SmoothFold((0.0, 0.0), (3.0, 4.0), 0.05, (0.6, 0.6))
    points = [(0.38, 0.465), (2.66, 3.505), (2.62, 3.535), (0.34, 0.495)]
    assert fold.corners == pytest.approx(np.array(points), abs=1e-12)
    assert fold.length == pytest.approx(3.8, abs=1e-12)
    assert least_fold_width(0.02 * INCH) == pytest.approx(0.798e-3, abs=5e-7)


@pytest.mark.parametrize("stiffeners", ["fold", "panels"])
def test_pattern_as_drawn(tmp_path, stiffeners):
    p = CreasePattern(A * INCH, B * INCH, fold=2e-3, stiffeners=stiffeners, alternate=True)
    assert p.size == pytest.approx((8.5 * INCH, 11 * INCH), rel=1e-12)
    root = ET.parse(p.write_svg(tmp_path / "p.svg", margin=0.0)).getroot()
    assert root.get("width") == "215.9mm" and root.get("height") == "279.4mm"
    drawn = {}
    for group in root.findall("{*}g"):
        texts = [path.get("d") for path in group.findall("{*}path")]
        drawn[group.get("id")] = [
            np.array(t.replace("M", "").replace("L", "").split(), float).reshape(-1, 2)
            for t in texts
        ]
    assert {k: len(v) for k, v in drawn.items()} == {
        "stiffener": 16 if stiffeners == "fold" else 32, "mountain": 6, "valley": 16, "cut": 1,
    }  # fmt: skip
    xs = sorted(line[0, 0] for line in drawn["mountain"] if np.ptp(line[:, 0]) == 0)
    assert np.diff([0.0, *xs, 215.9]) == pytest.approx(np.full(4, 53.975), rel=1e-9)
    for lines in drawn["valley"]:
        assert np.linalg.norm(np.diff(lines, axis=0)) == pytest.approx(88.2741, abs=1e-4)
    for name, lines in p.lines().items():  # before rounding for the file
        if name == "valley":
            spans = np.array([np.abs(np.diff(line, axis=0)[0]) for line in lines])
            assert spans == pytest.approx(np.tile([A * INCH, B * INCH], (16, 1)), rel=1e-12)


def test_panels_stand_back_from_the_creases():
    p = CreasePattern(fold=4e-3, stiffeners="panels")
    below, above = p.panels
    distance = (p.height * below[:, 0] - p.side * below[:, 1]) / p.diagonal
    assert distance[[0, 2]] == pytest.approx([2e-3, 2e-3], rel=1e-12)
    assert below[:2, 1] == pytest.approx([2e-3, 2e-3], rel=1e-12)
    assert p.side - below[1:, 0] == pytest.approx([2e-3, 2e-3], rel=1e-12)
    assert above == pytest.approx([p.side, p.height] - below)
    with_tab = CreasePattern(tab=8e-3, storeys=2)
    assert with_tab.size[0] == pytest.approx(4 * with_tab.side + 8e-3)
    assert len(with_tab.lines()["mountain"]) == 5


# ------------------------------------------------------------------ box

VOLTS = np.array([0.0, 1e3, 2e3, 4e3])
LAW = table_of_angles(VOLTS, np.radians([54.0, 50.0, 45.0, 31.0]))


def test_table_5_3():
    printed = Box(LAW, H, "proportional").stroke(VOLTS)
    assert printed == pytest.approx([0, 0.12222, 0.275, 0.70278], abs=5e-6)
    assert Box(LAW, H).stroke(VOLTS) == pytest.approx([0, 0.08764, 0.20785, 0.59957], abs=5e-6)
    long = Box(LAW, H, panel=B, storeys=3)
    assert np.degrees(long.gamma(VOLTS[0])) == pytest.approx(36.87, abs=5e-3)
    assert long.total_height(VOLTS) + long.stroke(VOLTS) == pytest.approx(np.full(4, 3 * H))
    shares = strokes(1.65, 1.65 - 0.7027, 0.7027 / 4)
    assert list(shares.values()) == pytest.approx([0.426, 0.742, 4.0], abs=5e-4)


# Table 5.1 with its angle as the twist at rest: height 1.65, edge hypot(1.65, 2 R sin 22.5 deg)
TURNED = Kresling(A, float(np.hypot(H, np.sqrt(2) * A * np.sin(np.pi / 8))), height=H)


def test_box_of_a_kresling_storey():
    """Corners of the storey, not its formulas, say how its panels stand and how high it is."""
    box = Box(LAW, H, "storey", storey=TURNED, storeys=2)
    assert box.turn(0.0) == pytest.approx(np.pi / 4, abs=1e-7)
    assert np.degrees(box.gamma(VOLTS)) == pytest.approx(57.22092 - np.array([0, 4, 9, 23]))
    for volts in VOLTS[1:]:
        below, above = vertices(TURNED, box.turn(volts))
        normal = np.cross(below[1] - below[0], above[1] - below[0])
        gamma = np.arccos(normal[2] / np.linalg.norm(normal))  # of the panel that stands below
        assert gamma == pytest.approx(box.gamma(volts), abs=1e-9)
        assert above[0, 2] == pytest.approx(box.storey_height(volts), rel=1e-12)
        assert np.linalg.norm(above[0] - below[0]) == pytest.approx(TURNED.edge, rel=1e-9)
    assert box.total_height(VOLTS) + box.stroke(VOLTS) == pytest.approx(np.full(4, 2 * H))


@pytest.mark.parametrize("box", [
    Box(LAW, H), Box(LAW, H, "proportional"), Box(LAW, H, panel=B),
    Box(LAW, H, "storey", storey=TURNED),
])  # fmt: skip
def test_force_of_moments_by_virtual_work(box):
    v, dv, moment = 1500.0, 0.5, 0.3
    dh = box.storey_height(v + dv) - box.storey_height(v - dv)
    dgamma = box.gamma(v + dv) - box.gamma(v - dv)
    assert box.force(moment, v) * dh == pytest.approx(4 * moment * dgamma, rel=1e-6)


def test_blocked_force():
    film = {"eps_r": 4.7, "thickness": 50e-6, "layers": 3}
    assert blocked_force(4e3, width=A * INCH, **film) == pytest.approx(2.156, abs=6e-4)
    assert blocked_force(4e3, width=B * INCH, **film) == pytest.approx(2.790, abs=6e-4)
    per = blocked_force(VOLTS, 4.7, 50e-6, A * INCH)
    assert blocked_force(VOLTS, 4.7, 50e-6, A * INCH, 10, 4) == pytest.approx(40 * per)
    volts = voltage_to_block(4.175 * POUND_FORCE, width=A * INCH, **film)
    assert blocked_force(volts, width=A * INCH, **film) == pytest.approx(18.571, abs=5e-4)


def test_quantities_with_units():
    pint = pytest.importorskip("pint")
    u = pint.UnitRegistry()
    s = Kresling(2.125 * u.inch, 2.75 * u.inch, 17 * u.lbf / u.inch)
    assert s.stiffness == pytest.approx(2977.16, abs=5e-3)
    assert s.stiffness == pytest.approx(17 * POUND_FORCE / INCH, rel=1e-9)
    assert s.at(1 * u.inch).height == pytest.approx(INCH)
    assert s.peak()[1] / POUND_FORCE == pytest.approx(FLAT.peak()[1], rel=1e-8)
    assert CreasePattern(2.125 * u.inch, 2.75 * u.inch, fold=1 * u.mm).fold == 1e-3
    force = blocked_force(4 * u.kV, 4.7, 50 * u.um, 2.125 * u.inch, 3)
    assert force == pytest.approx(2.156, abs=6e-4)
    with pytest.raises(dea.InputError, match="must be a stiffness"):
        Kresling(0.1, 0.2, 3 * u.newton)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Kresling(2.0, 1.9), "cannot close: cells 2 m wide must be at least 2 m high"),
        (lambda: Kresling(2.0, -1.0), "edge is -1.0, but must be finite and positive"),
        (lambda: Kresling(2.0, 3.0, sides=2), "3 or more"),
        (lambda: Kresling(2.0, 3.0, twist="fixed"), "must be one of"),
        (lambda: Kresling(2.0, 3.0, height=3.5), "at most the edge"),
        (lambda: Kresling(2.0, 3.0, height=0.1), "does not lean down to 0.1 m"),
        (lambda: errata.PrintedKresling(2.0, 3.0), "give a height"),
        (lambda: FLAT.at([1.0, 2.8]), "between 0 and 2.75 m"),
        (lambda: FLAT.at_twist(2.5), "too short for a twist of 143.2"),
        (lambda: READINGS["right held"].at_twist(0.1), "give heights instead"),
        (lambda: READINGS["right free, vertical"].barrier(), "has one"),
        (lambda: vertices(READINGS["printed free"], 0.1), "no solid"),
        (lambda: SmoothFold((0, 0), (1, 0), 0.1, (0.5, 0.5)), "nothing is left"),
        (lambda: CreasePattern(0.05, 0.04), "pattern cannot close"),
        (lambda: CreasePattern(thickness=0.508e-3, fold=0.05e-3), "at least 0.000797965 m wide"),
        (lambda: CreasePattern(stiffeners="fold", offset=0.1e-3), "outside its cell"),
        (lambda: CreasePattern(stiffeners="panels", fold=36e-3), "no panel between"),
        (lambda: CreasePattern(stiffeners="rims"), "must be in"),
        (lambda: Box(LAW, H, panel=1.0), "do not reach up"),
        (lambda: Box(LAW, H, "linear"), "must be one of"),
        (lambda: Box(LAW, H, "storey"), "go together"),
        (lambda: Box(LAW, 2.0, "storey", storey=TURNED), "height is 2 m, but that of the storey"),
        (lambda: Box(LAW, H, "storey", storey=READINGS["right held"]), "free twist"),
        (lambda: Box(LAW, H).turn(0.0), "only a storey turns"),
        (lambda: Box(LAW, FLAT.height, "storey", storey=FLAT).turn(4e3), "stand between 39.4"),
        (lambda: Box(LAW, H).gamma(5e3), "from 0 to 4000 V only"),
        (lambda: Box(lambda v: 0.5 - v, H).gamma(1.0), "beyond 0 to 90"),
        (lambda: table_of_angles([0, 0], [1, 2]), "must rise"),
        (lambda: blocked_force(1e3, 4.7, 0.0, 1.0), "must be positive"),
    ],
)
def test_bad_input(make, words):
    with pytest.raises(dea.InputError, match=words):
        make()


def test_the_old_option_for_the_printed_chords_still_works():
    """``Kresling(chords="printed")`` is a storey of the errata, with one DeprecationWarning."""
    new = errata.PrintedKresling(A, H, K, H)
    with pytest.warns(DeprecationWarning, match="errata") as seen:
        old = Kresling(A, H, K, H, chords="printed")
    assert len(seen) == 1 and seen[0].filename == __file__
    assert type(old) is errata.PrintedKresling and old.lowest == new.lowest
    heights = np.linspace(old.lowest + 0.02, H - 0.02, 5)
    assert np.array_equal(old.at(heights).force, new.at(heights).force)
    with pytest.warns(DeprecationWarning):
        assert Kresling(A, H, K, H, 4, "held", "printed").twist == "held"
