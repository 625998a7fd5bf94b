"""Tables 5.2 and 5.5: what the printed constants imply, and where they contradict one another."""

from __future__ import annotations

from dea_fenicsx.materials import MooneyRivlin, Ogden
from dea_fenicsx.thesis.table import ASSUMED, REPRODUCED, WRONG, Row, answer, computed
from dea_fenicsx.thesis.table import printed_numbers as printed

TWO, FIVE = "materials.table_5_2", "materials.table_5_5"


def _values(system: str, name: str) -> list[float]:
    value = printed()[(system, name)]["printed"]
    return value if isinstance(value, list) else [value]


def poisson(mu: float, kappa: float) -> float:
    """Poisson's ratio of shear and bulk modulus."""
    return (3 * kappa - 2 * mu) / (2 * (3 * kappa + mu))


def rows() -> list[Row]:
    C10, D1, G, K = (_values(TWO, n)[0] for n in ("C10", "D1", "G", "K"))
    ogden = list(zip(_values(FIVE, "ogden_mu"), (1.13, 1.445, 1.95), strict=True))
    mooney = [
        MooneyRivlin(a, b).shear_modulus()
        for a, b in zip(_values(FIVE, "mooney_C10"), _values(FIVE, "mooney_C01"), strict=True)
    ]
    clash = "two sets that exclude one another: 2 C10 = 0.5 MPa against G, 2/D1 = 2.5 MPa against K"
    slip = "9 to 11 times the modulus of the other models; a tenth fits: a slip of the point"
    return [
        answer(TWO, "C10", G / 2, WRONG, clash + "; ours: C10 that matches G"),
        answer(TWO, "D1", 2 / K, WRONG, clash + "; ours: D1 that matches K"),
        answer(TWO, "G", 2 * C10, WRONG, clash + "; ours: G that matches C10"),
        answer(TWO, "K", 2 / D1, WRONG, clash + "; ours: K that matches D1"),
        computed(TWO, "nu_from_C10_D1", poisson(2 * C10, 2 / D1), "-"),
        computed(TWO, "nu_from_G_K", poisson(G, K), "-"),
        answer(FIVE, "neo_hookean_mu", _values(FIVE, "neo_hookean_mu"), REPRODUCED,
               "input, taken as printed"),
        answer(FIVE, "gent_mu", _values(FIVE, "gent_mu"), REPRODUCED, "input, taken as printed"),
        answer(FIVE, "ogden_mu", [Ogden.from_eq76(m, a).shear_modulus() for m, a in ogden], ASSUMED,
               "ours: initial shear modulus in the convention of eq 76; in Abaqus's it is mu"),
        answer(FIVE, "mooney_C10", [m / 2 for m in mooney], WRONG,
               slip + "; ours: half the initial shear modulus C10 + C01"),
        answer(FIVE, "mooney_C01", [m / 20 for m in mooney], WRONG,
               slip + "; ours: the same over 10"),
        computed(FIVE, "G0_mooney_as_printed", mooney, "Pa"),
        computed(FIVE, "G0_mooney_divided_by_10", [m / 10 for m in mooney], "Pa"),
    ]  # fmt: skip
