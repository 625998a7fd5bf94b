"""Sources: electrodes that are fed through a wire, with a resistance and a switch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dea_fenicsx.scene.condition import Setting
from dea_fenicsx.scene.declarations import Declaration, Feed, FloatingPotential
from dea_fenicsx.scene.electrodes import Conducting
from dea_fenicsx.support.errors import InputError
from dea_fenicsx.support.type_checks import is_number
from dea_fenicsx.support.units import in_si
from dea_fenicsx.support.validation import finite, is_positive


@dataclass(frozen=True)
@in_si(volts="V", ohms="ohm", amperes="A")
class Source(Conducting):
    """An equipotential that a source of given voltage feeds through a wire with a switch.

    An ideal source (`ohms` = 0) with its switch closed is an `Electrode`.  With an open switch the
    electrode keeps its charge, and its potential floats.  Through a resistance charge flows while
    time passes, in a `March`; a ramp takes no time, and lets none pass.

    Parameters
    ----------
    where
        Name of a facet group or of a conducting region, or several names.
    volts
        Voltage of the source in V at ramp factor 1.
    ramp
        Name of the ramp that drives it.
    ohms
        Series resistance in ohm, of the source and of its wire.
    amperes
        Largest current in A that the source gives or takes, None for no limit.  It needs a
        resistance.
    closed
        Whether the switch is closed at first.  `Open` and `Close` in a path move it.
    """

    volts: float
    ramp: str = "voltage"
    ohms: float = 0.0
    amperes: float | None = None
    closed: bool = True
    floats = True

    @property
    def given_volts(self) -> float:
        return self.volts

    def _check_values(self, scene: Setting) -> None:
        finite(self.volts, f"The voltage of source {self.label!r}")
        finite(self.ohms, f"The resistance of source {self.label!r}")
        if self.ohms < 0:
            raise InputError(
                f"The resistance of source {self.label!r} is {self.ohms:g} ohm, but must be >= 0."
            )
        if self.amperes is None:
            return
        if not is_number(self.amperes) or not is_positive(self.amperes):
            raise InputError(
                f"The largest current of source {self.label!r} is {self.amperes!r}, but must be a "
                "number > 0 in A, or None."
            )
        if self.ohms == 0:
            raise InputError(
                f"Source {self.label!r} has a largest current but no resistance; give ohms=... as "
                "well, such as that of its leads."
            )

    def declarations(self, scene: Setting) -> Sequence[Declaration]:
        feed = Feed(self.volts, self.ohms, self.amperes, self.closed)
        return [FloatingPotential(self.names, 0.0, self.ramp, feed)]
