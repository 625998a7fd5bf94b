"""Elastic models that change another one by a factor, and leave its directions as they are."""

from __future__ import annotations

from typing import Any

from dea_fenicsx.materials.base import Elastic, Strain, is_compressible, is_isotropic


class Wrapped:
    """Base of a model with a field ``model``: where that one is defined, and its directions."""

    model: Elastic

    @property
    def compressible(self) -> bool:
        return is_compressible(self.model)

    @property
    def isotropic(self) -> bool:
        return is_isotropic(self.model)

    @property
    def fibres(self) -> Any:
        """See `Reinforced`."""
        return self.model.fibres  # type: ignore[attr-defined]

    def is_mirrored(self, *given: Any) -> bool:
        """See `Reinforced`."""
        return bool(self.model.is_mirrored(*given))  # type: ignore[attr-defined]

    def check_axes(self) -> None:
        """See `Reinforced`."""
        self.model.check_axes()  # type: ignore[attr-defined]

    def chain_margin(self, s: Strain) -> Any | None:
        return self.model.chain_margin(s)
