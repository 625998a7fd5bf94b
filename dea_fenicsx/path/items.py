"""The items of a path, as a user writes them: ramps of the load, traces of a branch, marches."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from dea_fenicsx.drives.waves import Constant, Function, Wave
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.scene.sources import Source
from dea_fenicsx.support.type_checks import is_number, plain_numbers
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import known

Response = Literal["instantaneous", "relaxed"]
RESPONSES: tuple[Response, ...] = get_args(Response)

Turn = Literal["follow", "pass", "end"]
TURNS: tuple[Turn, ...] = get_args(Turn)

Loss = Literal["end", "unstable", "snap", "motion"]
LOSSES: tuple[Loss, ...] = get_args(Loss)


GENERALISED_ALPHA, CONSERVING = INERTIAL_SCHEMES = ("generalised-alpha", "energy-conserving")
"""Schemes by which a body moves with inertia."""


@dataclass(frozen=True)
@in_si(drag="1/s", velocity="m/s")
class Inertia:
    """How inertia is taken in a `March`.

    Parameters
    ----------
    spectral_radius
        Share of an infinitely fast oscillation that one step of the generalised-alpha method
        leaves, from 0 (it is gone at once) to below 1 (nothing is damped).
    tolerance
        Largest estimated error of a step in the displacement, root mean square, as a share of the
        device's largest extent; for steps whose length is adapted.
    drag
        Force per mass against the velocity, over the velocity, in 1/s: damping that is
        proportional to the mass.
    velocity
        Velocity in m/s where the march begins: one number for each axis; or a function that takes
        undeformed positions in m, of shape (3, n), and gives numbers of shape (axes, n).  None goes
        on with the velocity of the march before, or begins at rest.
    scheme
        ``"generalised-alpha"``, or ``"energy-conserving"``: a step changes the sum of kinetic and
        total potential energy by the work of loads that change alone, and a free body keeps its
        momentum and its angular momentum.  Nothing is damped, and the spectral radius is not used.
    """

    spectral_radius: float = 0.8
    tolerance: float = 1e-6
    drag: float = 0.0
    velocity: tuple[float, ...] | Callable[[Any], Any] | None = None
    scheme: str = GENERALISED_ALPHA


@dataclass(frozen=True)
@plain_numbers
class InMotion:
    """How a ramp that loses equilibrium goes on in motion, at constant load, until it rests.

    The body starts from rest a little way behind the limit point.  It needs a density in each
    region, and damping: viscous branches, or a drag.

    Parameters
    ----------
    inertia
        The drag, and how the motion is computed.  The body starts from rest, so that a velocity
        may not be given.
    seconds
        Longest time in s that the body has to come to rest; None takes 10000 times the time scale
        of the motion and 100000 times the longest relaxation time.
    rest
        Share of its largest speed, and of its largest acceleration, below which the body is at
        rest.  Equilibrium is then found by Newton's method, to the tolerance of the ramp.
    compare
        Whether the state to which the device snaps statically is found as well, so that the summary
        tells how far the two are apart.
    """

    inertia: Inertia = field(default_factory=lambda: Inertia(0.0, 1e-4))
    seconds: float | None = None
    rest: float = 1e-4
    compare: bool = True


@dataclass(frozen=True)
@plain_numbers
class Ramp:
    """Bring one or more ramps of the scene to a factor, in steps.

    Parameters
    ----------
    what
        Name or names of the ramps (``"voltage"``, ``"stretch"``, ``"load"`` or your own); empty
        for all of the scene.  Ramps that are not named keep their present factor.
    to
        Factor at the end; 1 is the value written in the scene.
    steps
        Number of equal steps; each of their ends is landed on exactly.
    at
        Factors to land on instead, in the order of travel.  Between them the step size is adapted;
        the first step is a `steps`-th of the ramp.
    snap
        True is the same as ``at_loss="snap"``.
    response
        How viscous branches take part, which must be said where there are some: with
        ``"instantaneous"`` their viscous strains stay as they are, as in a ramp that takes no
        time; with ``"relaxed"`` they carry no stress, as in a ramp that takes forever.
    at_loss
        What happens at a limit point, where equilibrium is lost.  With ``"end"`` the ramp ends
        there with `EquilibriumLost`.  With ``"unstable"`` it also ends at the first state beyond
        which nothing rests: at a bifurcation that makes the branch unstable, with `StabilityLost`.
        This needs ``stability="every"``.  Otherwise the load stays constant, as the voltage of a
        battery does.  With ``"snap"`` the device snaps to the next stable state of the branch at
        this load.  With ``"motion"``, or an `InMotion`, it moves with its inertia until its
        damping has brought it to rest.  Then the ramp goes on.
    """

    what: str | tuple[str, ...] = ()
    to: float = 1.0
    steps: int = 10
    at: tuple[float, ...] | None = None
    snap: bool = False
    response: Response | None = None
    at_loss: Loss | InMotion = "end"

    @property
    def loss(self) -> Loss | InMotion:
        """What happens where equilibrium is lost."""
        if self.at_loss == "motion":
            return InMotion()
        return "snap" if self.snap else self.at_loss

    def goals(self, scene: Scene) -> dict[str, float]:
        """Factor at the end of each ramp of the scene that this one moves."""
        return dict.fromkeys(self.names(scene), float(self.to))

    def names(self, scene: Scene) -> tuple[str, ...]:
        """Names of the scene's ramps that this one moves."""
        if not self.what:
            return scene.ramps
        return (self.what,) if isinstance(self.what, str) else tuple(self.what)

    def label(self, scene: Scene) -> str:
        return "+".join(self.names(scene))

    def words(self, scene: Scene) -> str:
        """What it does, in words."""
        if self.at is not None:
            return f"ramp of {self.label(scene)} to {self.to:g}"
        return f"ramp of {self.label(scene)} to {self.to:g} in {self.steps} steps"


MOST_SHAPES = 8
"""Most shapes of one state along which a trace may leave its branch."""


@dataclass(frozen=True)
@plain_numbers
class Trace:
    """Follow the branch in one ramp of the scene by arc length, through limit points.

    Parameters
    ----------
    what
        Name of the ramp, such as ``"voltage"``.
    first
        Load factor of the first step; negative to start backwards.
    steps
        Most steps that are taken, events included.
    until
        A column of the history and a value.  The trace ends where the column has this value.
    longest
        Longest step in units of arc, of 5 % stretch each.
    at
        Load factors to land on exactly, each time that the branch passes one.
    switch
        Length of a step, in units of arc, along the null vector of the first bifurcation: the
        trace goes on along the branch that lies there, and the sign chooses the side.  0 stays on
        the branch.  Needs ``stability="every"``.
    response
        How viscous branches take part, as of a `Ramp`.
    leave
        Number of the bifurcation of this trace at which `switch` leaves the branch; those before
        it are passed.  With several numbers the branch that was taken is left again:
        ``leave=(2, 1)`` leaves at the second bifurcation, and then at the first one on the branch
        that begins there.
    along
        The direction in which the branch is left, at the last bifurcation of `leave`: None is its
        null vector.  Where several modes are neutral at once, numbers are factors of their null
        vectors, whose largest displacements are 1, in the order that `path.leaving` tells.  A
        function of undeformed positions in m, of shape (3, n), gives displacements of shape
        (axes, n), of which the part in the null vectors is taken.  What lies there is found by
        equilibrium: where no branch has this direction, the trace comes to one nearby.
    at_turn
        What happens where the branch turns aside because another branch almost crosses it, as in
        an imperfect structure or on a mesh that is not quite symmetric.  By default a stable branch
        is followed.  An unstable one goes straight on where an equilibrium lies near; elsewhere it
        is followed, and the log says so.  With a word the softest shapes are watched, which takes
        time, and a turn has the event ``"turn aside"`` in the history.  ``"follow"`` follows it.
        ``"pass"`` goes straight on over the gap, and ends the trace with an error where no way
        leads on.  ``"end"`` ends it with an error at once.  Near a limit point a change of the
        shape may then be taken for a turn.
    """

    what: str
    first: float = 0.05
    steps: int = 200
    until: tuple[str, float] | None = None
    longest: float = 4.0
    at: tuple[float, ...] = ()
    switch: float = 0.0
    response: Response | None = None
    leave: int | tuple[int, ...] = 1
    along: tuple[float, ...] | Callable[[Any], Any] | None = None
    at_turn: Turn | None = None

    @property
    def exits(self) -> tuple[int, ...]:
        """Numbers of the bifurcations at which the branch is left, each counted from the last."""
        if not self.switch:
            return ()
        return self.leave if isinstance(self.leave, tuple) else (self.leave,)

    def names(self, scene: Scene) -> tuple[str, ...]:
        return (self.what,)

    def label(self, scene: Scene) -> str:
        return self.what

    def words(self, scene: Scene) -> str:
        """What it does, in words."""
        end = f" until {self.until[0]} = {self.until[1]:g}" if self.until else ""
        return f"trace of {self.what}{end}, at most {self.steps} steps"


@dataclass(frozen=True)
@in_si(seconds="s", at="s")
class March:
    """Let time pass, with loads that may change in it.

    Without inertia each instant is in equilibrium, and viscous branches flow.  A jump of a drive
    meets the instantaneous response; it is a ramp of its own, in no time.  With inertia the body
    moves, and after a jump of a drive it has another acceleration.

    Parameters
    ----------
    seconds
        How long the march lasts, in s.
    drive
        Factor of ramps of the scene over time since the beginning of the march: a wave such as
        ``dea.Sine(hertz=2)``, a number, or any function of the time in s.  A ramp that is not named
        keeps its factor.
    steps
        Number of equal steps; None chooses their length by the estimated error.
    tolerance
        Largest estimated error of a step in the viscous strains C_v: root mean square over the
        viscous regions and their branches, weighted by the moduli of the branches over the sum of
        all moduli.
    at
        Times in s since the beginning of the march at which a step ends.
    order
        2 for BDF2, whose first steps are of SDIRK2; 1 for backward Euler; 3 for BDF3, which needs
        fewer steps for a tolerance below 1e-5.  Order 3 is for viscous strains in steps whose
        length is adapted; charge keeps to order 2.
    inertia
        Whether the body has inertia, for which each region needs a density; or an `Inertia`.
    """

    seconds: float
    drive: Mapping[str, Wave | float | Callable[[float], float]] = field(default_factory=dict)
    steps: int | None = None
    tolerance: float = 1e-5
    at: tuple[float, ...] = ()
    order: int = 2
    inertia: bool | Inertia = False

    @property
    def moving(self) -> Inertia | None:
        """How inertia is taken, or None."""
        if isinstance(self.inertia, Inertia):
            return self.inertia
        return Inertia() if self.inertia else None

    @property
    def waves(self) -> dict[str, Wave]:
        """The drive as waves."""
        return {name: _as_wave(value) for name, value in self.drive.items()}

    def names(self, scene: Scene) -> tuple[str, ...]:
        """Names of the scene's ramps that may move."""
        return tuple(self.drive)

    def label(self, scene: Scene) -> str:
        return "march"

    def words(self, scene: Scene) -> str:
        """What it does, in words."""
        return f"march of {self.seconds:g} s"


@dataclass(frozen=True)
@plain_numbers
class Open:
    """Open the switch in the wire of a `Source`: its electrode keeps its charge from now on.

    Parameters
    ----------
    where
        The electrode, by a name that its source has.
    """

    where: str

    def names(self, scene: Scene) -> tuple[str, ...]:
        return ()

    def label(self, scene: Scene) -> str:
        return f"open {self.where}"

    def words(self, scene: Scene) -> str:
        """What it does, in words."""
        return f"the switch of {self.where} opens"


@dataclass(frozen=True)
@plain_numbers
class Close:
    """Close the switch in the wire of a `Source`.

    An ideal source is set to the electrode's potential first, so that nothing jumps, and is then
    ramped to a factor; charge comes and goes without loss.  A source behind a resistor is set to
    the factor at once, and the charge flows in the next `March`.

    Parameters
    ----------
    where
        The electrode, by a name that its source has.
    to
        Factor of the source's ramp afterwards; 0 discharges the electrode.
    steps
        Number of steps of the ramp of an ideal source.
    response
        How viscous branches take part in this ramp, as of a `Ramp`.
    """

    where: str
    to: float = 1.0
    steps: int = 10
    response: Response | None = None

    def names(self, scene: Scene) -> tuple[str, ...]:
        return (fed(scene, self.where).ramp,)

    def label(self, scene: Scene) -> str:
        return f"close {self.where}"

    def words(self, scene: Scene) -> str:
        """What it does, in words."""
        return f"the switch of {self.where} closes"

    def ramp(self, scene: Scene) -> Ramp:
        """The ramp of an ideal source that follows."""
        return Ramp(self.names(scene), self.to, self.steps, response=self.response)


def fed(scene: Scene, where: str) -> Source:
    """The source of an electrode, by one of its names.

    Raises
    ------
    InputError
        If no source feeds an electrode of this name.
    """
    sources = [e for e in scene.electrodes if isinstance(e, Source)]
    for source in sources:
        if where in (source.label, *source.names):
            return source
    known(where, [s.label for s in sources], "source", "the scene")
    raise AssertionError


Switch = Open | Close
Item = Ramp | Trace | March | Open | Close
"""An item of a path."""


def _as_wave(value: Wave | float | Callable[[float], float]) -> Wave:
    if isinstance(value, Wave):
        return value
    return Constant(float(value)) if is_number(value) else Function(value)  # type: ignore[arg-type]
