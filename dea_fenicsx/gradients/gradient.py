"""What a derivation gives: the derivatives by the names of the variables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Gradient(Mapping[str, float]):
    """The derivatives of an observable, or of a critical load, by the names of the variables.

    Attributes
    ----------
    what
        The observable's name, or what the critical load is.
    value
        Its value, in SI units.
    derivatives
        Its derivative by each variable, in SI units: by a voltage per V, by the factor of another
        ramp, by a thickness per m.
    method
        ``"adjoint"``: exact, from one linear solve for all variables.  ``"direct"``: from one
        linear solve for each variable, and differences of the observable along the change of the
        state.  ``"replay"``: by differences of marches that are gone over again, with the lengths
        of all steps held.
    residual
        Largest residual of the linear solves, relative to the right-hand side; of a replay how far
        the recorded state is missed by the same march, relative to its largest value.
    """

    what: str
    value: float
    derivatives: Mapping[str, float]
    method: str
    residual: float

    def __getitem__(self, name: str) -> float:
        return self.derivatives[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.derivatives)

    def __len__(self) -> int:
        return len(self.derivatives)
