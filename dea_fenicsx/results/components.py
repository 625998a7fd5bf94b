"""Components of the fields in files, named by their axes.

A displacement along x is "displacement_x_m", the stress on a face across x along z is
"cauchy_stress_xz_Pa".  Of a body of revolution the axes are r, z and hoop; there the hoop stress is
"cauchy_stress_hoop_Pa", and with another axis it is "cauchy_stress_r_hoop_Pa".
"""

from __future__ import annotations

from collections.abc import Collection

TENSORS = {"cauchy_stress_Pa": ("cauchy_stress", "Pa")}
"""Fields of nine numbers, the rows of a symmetric tensor: beginning and unit of the name."""

VECTORS = {
    "displacement_m": ("displacement", "m"),
    "electric_field_V_per_m": ("electric_field", "V_per_m"),
}
"""Fields of three numbers: beginning and unit of the name."""


def component(
    name: str, fields: Collection[str], axes: tuple[str, str, str]
) -> tuple[str, int] | None:
    """The field that a name is a component of, and the column in it; None if there is none.

    Parameters
    ----------
    name
        For example "cauchy_stress_xx_Pa".
    fields
        Names of the fields that are there.
    axes
        Names of the axes by which components are ordered.
    """
    for field in fields:
        if field in VECTORS:
            start, unit = VECTORS[field]
            for k, axis in enumerate(axes):
                if name == f"{start}_{axis}_{unit}":
                    return field, k
        if field in TENSORS:
            start, unit = TENSORS[field]
            for i, row in enumerate(axes):
                for j, column in enumerate(axes):
                    if name == f"{start}_{pair(row, column)}_{unit}":
                        return field, 3 * i + j
    return None


def pair(row: str, column: str) -> str:
    """Two axes in the name of a component: "xz", "rr", "hoop", "r_hoop"."""
    if len(row) == len(column) == 1:
        return row + column
    return row if row == column else f"{row}_{column}"


def column_names(field: str, axes: tuple[str, str, str]) -> list[str]:
    """What the columns of a field are called by its axes; empty for a field of one number."""
    if field in VECTORS:
        return list(axes)
    if field in TENSORS:
        return [pair(row, column) for row in axes for column in axes]
    return []
