"""Strategies of hypothesis that draw sketches of scenes and paths.

Most are sensible devices under moderate loads; a part draws supports and loads at random, so that
contradictions and loose devices are among them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from dea_fenicsx.materials import EPSILON_0

from .sketch import Call, Part, Sketch, call

MU, EPS_R, SIZE = 5e4, 3.0, 1e-3
"""Modulus (Pa), relative permittivity and thickness (m) from which the others are drawn."""


def rounded(low: float, high: float) -> st.SearchStrategy[float]:
    """A number of three digits between two of the same sign, evenly in its logarithm."""
    span = math.log(high / low)
    return st.integers(0, 200).map(lambda k: float(f"{low * math.exp(span * k / 200):.3g}"))


def signed(low: float, high: float) -> st.SearchStrategy[float]:
    return st.tuples(st.sampled_from((1.0, -1.0)), rounded(low, high)).map(lambda t: t[0] * t[1])


MODELS = ("NeoHookean", "Gent", "MooneyRivlin", "Yeoh", "Ogden", "ArrudaBoyce")
FLAT_MODELS = ("NeoHookean", "Gent", "MooneyRivlin")


@st.composite
def elastic(draw: Any, model: str, terms: int) -> Call:
    """A model with constants at which its stress grows with its stretch in shear."""
    mu = draw(rounded(0.3 * MU, 3 * MU))
    if model == "NeoHookean":
        return call(model, mu=mu)
    if model == "Gent":
        return call(model, mu=mu, Jm=draw(rounded(4.0, 120.0)))
    if model == "MooneyRivlin":
        share = draw(st.sampled_from((0.0, 0.05, 0.2, 0.5, 1.0)))
        return call(model, C10=mu / 2 * (1 - share), C01=mu / 2 * share)
    if model == "Yeoh":
        soft = draw(st.sampled_from((0.0, -0.02, 0.05)))
        return call(model, C10=mu / 2, C20=soft * mu / 2, C30=2e-3 * mu)
    if model == "ArrudaBoyce":
        return call(model, mu=mu, lam_m=draw(rounded(1.5, 6.0)))
    alphas = draw(st.permutations((1.3, 2.0, 3.5, -1.5, -2.0)))[:terms]
    shares = (1.0,) if terms == 1 else (0.8, 0.2)
    # the initial shear modulus is sum mu alpha/2: each term gets its share of it
    return call(model, mu=tuple(2 * mu * s / a for s, a in zip(shares, alphas, strict=True)),
                alpha=tuple(alphas))  # fmt: skip


KINEMATICS = ("ThreeD", "PlaneStrain", "Axisymmetric", "GeneralisedPlaneStrain", "Helical")


@dataclass
class Site:
    """What the strategies need to know of the device that they dress."""

    kin: str
    length: float
    width: float | None
    x0: float
    height: float
    parts: tuple[Part, ...]

    @property
    def axes(self) -> str:
        return {"Axisymmetric": "rz", "ThreeD": "xyz", "Helical": "rtz"}.get(self.kin, "xy")

    @property
    def through(self) -> str:
        """The axis through the layers."""
        return "y" if self.kin in ("PlaneStrain", "GeneralisedPlaneStrain") else "z"

    @property
    def faces(self) -> list[str]:
        """Facet groups from the bottom up."""
        inner = [f"interface_{k}" for k in range(1, len(self.parts))]
        return ["bottom", *inner, "top"]

    @property
    def sides(self) -> list[str]:
        return ["x_min", "x_max"] + (["y_min", "y_max"] if self.kin == "ThreeD" else [])

    def unit(self, part: Part) -> float:
        """The voltage T sqrt(mu/eps) of a layer; a free film is pulled in at 0.69 of it."""
        eps = (part.eps_r or EPS_R) * EPSILON_0
        wall = self.length if self.kin == "Helical" else part.thickness
        return wall * math.sqrt(modulus(part) / eps)


def modulus(part: Part) -> float:
    return float(part.elastic.make().shear_modulus())


@st.composite
def sketches(draw: Any, small: bool = False) -> Sketch:
    """A random sketch; `small` keeps to few kinds of forms, in the plane, for a quick suite."""
    kin = draw(st.sampled_from(("PlaneStrain", "Axisymmetric", "GeneralisedPlaneStrain")
                               if small else (*KINEMATICS, "ThreeD")))  # fmt: skip
    flat = kin != "ThreeD"
    model = draw(st.sampled_from(FLAT_MODELS[:2] if small else MODELS))
    terms = draw(st.integers(1, 2)) if model == "Ogden" else 1
    count = draw(st.integers(1, 2 if kin == "Helical" or small else 3))
    passive = draw(st.booleans()) and count > 1 and kin != "Helical"
    bulky = not small and draw(st.integers(0, 4)) == 0
    dry = draw(st.integers(0, 4)) == 0  # no electrode at all
    parts = []
    for k in range(count):
        base = draw(elastic(model, terms))
        live = not dry and not (passive and k == draw(st.integers(0, count - 1)))
        mu = float(base.make().shear_modulus())
        parts.append(
            Part(
                thickness=draw(rounded(0.2 * SIZE, SIZE)), cells=draw(st.integers(1, 2)),
                elastic=base, eps_r=draw(st.sampled_from((EPS_R, 2.0, 9.0))) if live else None,
                bulk=float(f"{draw(rounded(1.0, 1e4)) * mu:.3g}") if bulky else None,
            )
        )  # fmt: skip
    height = sum(p.thickness for p in parts)
    length = draw(rounded(height, 6 * height))
    x0 = 0.0
    if kin == "Helical" or (kin == "Axisymmetric" and draw(st.booleans())):
        x0 = draw(rounded(0.5 * length, 3 * length))
    site = Site(kin, length, None if flat else draw(rounded(height, 4 * height)), x0, height,
                tuple(parts))  # fmt: skip
    pattern, supports, prescribed = draw(held(site))
    loads = draw(loaded(site, pattern))
    if kin == "Helical":
        supports, prescribed, loads = draw(wound(site))
        pattern = "coil"
    if kin == "GeneralisedPlaneStrain":
        more = draw(sliced(site))
        loads = [*loads, *(c for c in more if c.name == "AxialForce")]
        prescribed = [*prescribed, *(c for c in more if c.name == "AxialStretch")]
    electrodes = [] if dry else draw(electrified(site))
    if not (prescribed or loads or any(e.args.get("volts", 1) for e in electrodes)):
        where, size = "x_max" if kin == "Helical" else "top", draw(signed(0.01, 0.3)) * MU
        loads = [call("DeadPressure", where=where, pascal=float(f"{size:.3g}"))]
    sketch = Sketch(
        kinematics=draw(embedding(site)), length=site.length, width=site.width, x0=x0,
        divisions=tuple(draw(st.integers(1, 3)) for _ in range(1 if flat else 2)),
        parts=site.parts, electrodes=tuple(electrodes), supports=tuple(supports),
        prescribed=tuple(prescribed), loads=tuple(loads), path=(), kind=pattern,
    )  # fmt: skip
    return Sketch(**{**sketch.__dict__, "path": draw(paths(sketch))})


@st.composite
def embedding(draw: Any, site: Site) -> Call:
    if site.kin in ("PlaneStrain", "GeneralisedPlaneStrain"):
        return call(site.kin, depth=1e-3)
    if site.kin == "Helical":
        return call(site.kin, pitch=draw(st.sampled_from((0.0, 1.0, 2.0, -1.0))) * site.height)
    return call(site.kin)


@st.composite
def held(draw: Any, site: Site) -> tuple[str, list[Call], list[Call]]:
    """How a device is held: the pattern's name, supports and prescribed displacements."""
    x, z, kin = site.axes[0], site.through, site.kin
    axis = [call("Fix", where="x_min", axes="r")] if kin == "Axisymmetric" and not site.x0 else []
    planes = [call("Fix", where="bottom", axes=z), *axis]
    if kin != "Axisymmetric":
        planes.append(call("Fix", where="x_min", axes="x"))
    if kin == "ThreeD":
        planes.append(call("Fix", where="y_min", axes="y"))
    patterns = {
        "planes": planes,
        "cantilever": [call("Clamp", where="x_max" if axis else "x_min"), *axis],
        "stood": [call("Clamp", where="bottom"), *axis],
        "bridge": [call("Clamp", where="x_min"), call("Clamp", where="x_max")],
        "pressed": [call("Clamp", where="x_min"),
                    call("Fix", where="x_max", axes=site.axes.replace(x, ""))],
        "free": [call("FreeBody")],
        "half free": [call("Fix", where="x_min", axes=x), call("FreeBody")],
    }
    names = ["planes", "planes", "cantilever", "stood", "bridge", "free", "half free", "wild"]
    names += [] if kin == "Axisymmetric" else ["pressed", "pressed"]
    pattern = draw(st.sampled_from(names))
    prescribed: list[Call] = []
    if pattern == "wild":
        some = st.sampled_from([*site.sides, *site.faces])
        supports = [
            call("Clamp", where=draw(some)) if draw(st.booleans())
            else call("Fix", where=draw(some), axes=draw(st.sampled_from(site.axes)))
            for _ in range(draw(st.integers(1, 4)))
        ]  # fmt: skip
    else:
        supports = patterns[pattern]
    if pattern in ("planes", "cantilever", "stood", "wild") and draw(st.integers(0, 2)) == 0:
        where = draw(st.sampled_from(("x_max", "top")))
        along = draw(st.sampled_from(site.axes)) if pattern == "wild" else (
            x if where == "x_max" and not axis else z
        )  # fmt: skip
        span = site.length if along == x else site.height
        if draw(st.booleans()) and along in "xyz":
            prescribed = [call("Displacement", where=where, axes=along,
                               metres=float(f"{draw(signed(0.02, 0.4)) * span:.3g}"))]  # fmt: skip
        else:
            prescribed = [call("Stretch", where=where, axes=along,
                               stretch=1 + draw(signed(0.05, 0.5)))]  # fmt: skip
    if pattern == "pressed":
        share = draw(rounded(0.01, 0.15)) * draw(st.sampled_from((-1, -1, -1, 1)))
        prescribed = [call("Displacement", where="x_max", axes=x,
                           metres=float(f"{share * site.length:.3g}"))]  # fmt: skip
    plain = all(p.bulk is None for p in site.parts)
    if kin in ("ThreeD", "PlaneStrain") and plain and draw(st.integers(0, 9)) == 0:
        prescribed = [*prescribed, call("PreStretch", where="part0", x=draw(rounded(0.8, 1.5)),
                                        z=1.0)]  # fmt: skip
    return pattern, supports, prescribed


@st.composite
def loaded(draw: Any, site: Site, pattern: str) -> list[Call]:
    """Surface loads; on a free body they have a resultant, which must be refused."""
    chance = {"free": 8, "half free": 8}.get(pattern, 1)
    loads: list[Call] = []
    follow = site.kin != "GeneralisedPlaneStrain" or pattern == "wild"
    for _ in range(draw(st.integers(0, 2)) if draw(st.integers(0, chance)) < 2 else 0):
        where = draw(st.sampled_from(["x_max", "top"] if pattern != "wild"
                                     else [*site.sides, *site.faces]))  # fmt: skip
        kind = draw(st.sampled_from(("DeadLoad", "DeadLoad", "DeadPressure")
                                    + ("FollowerPressure",) * follow))  # fmt: skip
        ramp = draw(st.sampled_from(("load", "load", "load 2")))
        size = float(f"{draw(signed(2e-3, draw(st.sampled_from((0.05, 0.3, 1.0))))) * MU:.3g}")
        if kind == "DeadLoad":
            a = draw(st.integers(0, len(site.axes) - 1))
            pascal = tuple(size if k == a else 0.0 for k in range(len(site.axes)))
            loads.append(call(kind, where=where, pascal=pascal, ramp=ramp))
        else:
            on = f"part{len(site.parts) - 1}" if where.startswith("interface") else None
            loads.append(call(kind, where=where, pascal=size, ramp=ramp, on=on))
    return loads


@st.composite
def sliced(draw: Any, site: Site) -> list[Call]:
    """What acts on a slice along its depth."""
    choice = draw(st.integers(0, 2))
    if choice == 0:
        return []
    if choice == 1:
        return [call("AxialStretch", stretch=1 + draw(signed(0.02, 0.3)), ramp="stretch")]
    force = draw(signed(0.02, 0.5)) * MU * site.length * site.height
    return [call("AxialForce", newtons=float(f"{force:.3g}"))]


@st.composite
def wound(draw: Any, site: Site) -> tuple[list[Call], list[Call], list[Call]]:
    """Supports, prescribed values and loads of a helical cell."""
    supports = draw(st.sampled_from((
        [call("FreeBody")], [call("Fix", where="x_min", axes="tz")], [call("Clamp", where="x_min")],
    )))  # fmt: skip
    prescribed, loads = [], []
    radius = site.x0 + site.length
    area = math.pi * (radius**2 - site.x0**2)
    choice = draw(st.integers(0, 3))
    if choice == 1:
        twist = draw(signed(0.05, 0.4)) / radius
        prescribed.append(call("Twist", radians_per_metre=float(f"{twist:.3g}")))
    elif choice == 2:
        moment = draw(signed(0.02, 0.2)) * MU * area * radius
        loads.append(call("Torque", newton_metres=float(f"{moment:.3g}")))
    choice = draw(st.integers(0, 3))
    if choice == 1:
        prescribed.append(call("AxialStretch", stretch=1 + draw(signed(0.02, 0.3))))
    elif choice == 2:
        loads.append(call("AxialForce", newtons=float(f"{draw(signed(.02, .3)) * MU * area:.3g}")))
    if draw(st.integers(0, 2)) == 0:
        loads.append(call("DeadPressure", where="x_max",
                          pascal=float(f"{draw(signed(5e-3, 0.2)) * MU:.3g}")))  # fmt: skip
    return supports, prescribed, loads


@st.composite
def electrified(draw: Any, site: Site) -> list[Call]:
    """Electrodes on the faces of the dielectric layers; one of them at least is grounded."""
    high = draw(st.sampled_from((0.3, 0.5, 0.8, 1.3)))
    if site.kin == "Helical":
        volts = draw(signed(0.05, high)) * min(map(site.unit, site.parts))
        return [call("Electrode", where="x_max", volts=float(f"{volts:.3g}")),
                call("Electrode", where="x_min", volts=0.0)]  # fmt: skip
    live = [k for k, p in enumerate(site.parts) if p.eps_r is not None]
    if not live:
        return []
    if draw(st.integers(0, 9)) == 0:
        return [draw(thin_film(site, live, high))]
    faces = sorted({f for k in live for f in (k, k + 1)})
    ground = draw(st.sampled_from(faces))
    found = [call("Electrode", where=site.faces[ground], volts=0.0)]
    for f in faces:
        beside = [k for k in live if f in (k, k + 1)]
        unit = min(site.unit(site.parts[k]) for k in beside)
        if f == ground or (draw(st.integers(0, 3)) == 0 and len(found) > 1):
            continue
        size = draw(signed(0.1, high))
        kind = draw(st.integers(0, 11))
        if kind == 0:
            part = site.parts[beside[0]]
            area = site.length * (site.width or 1e-3)
            if site.kin == "Axisymmetric":
                area = math.pi * ((site.x0 + site.length) ** 2 - site.x0**2)
            charge = size * unit * (part.eps_r or 1) * EPSILON_0 * area / part.thickness
            found.append(call("ChargedElectrode", where=site.faces[f],
                              coulombs=float(f"{charge:.3g}")))  # fmt: skip
            continue
        ramp = "voltage 2" if kind == 1 else "voltage"
        taper = None
        if kind == 2:
            taper = call("Taper", start=site.x0 + 0.3 * site.length, end=site.x0 + site.length,
                         along=site.axes[0])  # fmt: skip
        found.append(call("Electrode", where=site.faces[f], volts=float(f"{size * unit:.3g}"),
                          ramp=ramp, taper=taper))  # fmt: skip
    return found


@st.composite
def thin_film(draw: Any, site: Site, live: list[int], high: float) -> Call:
    k = draw(st.sampled_from(live))
    start = sum(p.thickness for p in site.parts[:k])
    volts = draw(signed(0.05, high)) * site.unit(site.parts[k])
    return call("ThinFilm", where=f"part{k}", volts=float(f"{volts:.3g}"), start=start,
                end=start + site.parts[k].thickness, along=site.through)  # fmt: skip


@st.composite
def paths(draw: Any, sketch: Sketch) -> tuple[tuple[tuple[str, ...], float, int], ...]:
    """One ramp of all, or one for each name in some order, and at times a way back.

    A third of the paths goes far beyond the moderate loads, towards instability and loss.
    """
    defaults = {"Electrode": "voltage", "ThinFilm": "voltage", "ChargedElectrode": "charge",
                "DeadLoad": "load", "DeadPressure": "load", "FollowerPressure": "load",
                "AxialForce": "load", "Torque": "load", "PreStretch": "prestretch"}  # fmt: skip
    driven = [*sketch.prescribed, *sketch.loads,
              *(e for e in sketch.electrodes if e.args.get("volts", 1.0))]  # fmt: skip
    names = list(dict.fromkeys(c.ramp or defaults.get(c.name, "stretch") for c in driven))
    steps, far = st.integers(1, 4), st.sampled_from((1.0, 1.0, 1.0, 1.0, 3.0, 8.0))
    if not names:
        return (((), 1.0, 1),)
    if len(names) == 1 or draw(st.booleans()):
        found = [(tuple(names), draw(far), draw(steps))]
    else:
        found = [((name,), 1.0, draw(steps)) for name in draw(st.permutations(names))]
        found[-1] = (found[-1][0], draw(far), found[-1][2])
    if draw(st.integers(0, 4)) == 0:
        found.append((found[-1][0], draw(st.sampled_from((0.0, 0.5, -0.5))), draw(steps)))
    return tuple(found)


@contextmanager
def _nothing_read_from_code() -> Iterator[None]:
    """Keep hypothesis from drawing numbers that it finds in the code of the modules loaded.

    A seed would draw other sketches after any change of the package.
    """
    try:
        # there is no public switch for this, and not every release does it
        from hypothesis.internal.conjecture import providers

        usual, cache = providers._get_local_constants, providers.CONSTANTS_CACHE.cache
        nothing = providers.Constants()
    except (ImportError, AttributeError):
        yield
        return
    cache.clear()
    providers._get_local_constants = lambda: nothing
    try:
        yield
    finally:
        providers._get_local_constants = usual
        cache.clear()


def drawn(count: int, number: int, small: bool = False) -> list[Sketch]:
    """`count` different sketches of a seed, always the same ones with one hypothesis release.

    Hypothesis likes to change a little of what it has drawn before, so that many of its sketches
    share their box: of these the first counts.
    """
    found: dict[str, Sketch] = {}
    round_ = 0
    while len(found) < count:

        @seed(number * 1000 + round_)
        @settings(max_examples=count, database=None, deadline=None, phases=[Phase.generate],
                  suppress_health_check=list(HealthCheck))  # fmt: skip
        @given(sketches(small=small))
        def keep(sketch: Sketch) -> None:
            found.setdefault(f"{sketch.kinematics} {sketch.length} {sketch.parts}", sketch)

        with _nothing_read_from_code():
            keep()
        round_ += 1
    return list(found.values())[:count]
