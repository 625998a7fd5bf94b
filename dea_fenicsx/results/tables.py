"""A run and its history as tables of HTML, for notebooks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

WORK_AND_PLACES = (
    "min_J", "volume_error", "residual", "newton_iterations", "krylov_iterations",
    "factorisations", "retries", "inertia", "inertia_is_of_this_step", "negative_modes", "wall_s",
    "max_field_x_m", "max_field_y_m", "max_field_z_m",
)  # fmt: skip
"""Columns that tables leave out: what a step took, and places."""

MOST_ROWS = 12
"""Most steps that a table shows: the first and the last ones."""


def run_html(run: Any) -> str:
    """A run: how it ended, where its files are, its events and its steps."""
    summary = run.summary
    status = str(summary.get("status", "running"))
    lines = [f"<b>{escape(status)}</b>, {max(len(run.history) - 1, 0)} steps"]
    if "wall_s" in summary:
        lines[0] += f", {summary['wall_s']:.3g} s"
    if run.out is not None:
        lines.append(f"results: {escape(str(run.out))}")
    if summary.get("message"):
        lines.append(escape(str(summary["message"])))
    events = [f"{e['event']} at step {e['step']}" for e in summary.get("events", ())]
    if events:
        lines.append(f"events: {escape(', '.join(events))}")
    return f"<div>{'<br>'.join(lines)}</div>{history_html(run.history)}"


def history_html(rows: Sequence[Mapping[str, Any]]) -> str:
    """The steps of a history: the first and the last ones, without the columns of work."""
    if not rows:
        return "<div>no steps</div>"
    names = [name for name in rows[0] if name not in WORK_AND_PLACES]
    half = MOST_ROWS // 2
    left_out = len(rows) - MOST_ROWS
    shown = list(rows) if left_out <= 0 else [*rows[:half], None, *rows[-half:]]
    head = "".join(f"<th>{escape(name)}</th>" for name in names)
    body = []
    for row in shown:
        if row is None:
            body.append(f'<tr><td colspan="{len(names)}">{left_out} more steps</td></tr>')
        else:
            cells = "".join(f"<td>{escape(_cell(row[name]))}</td>" for name in names)
            body.append(f"<tr>{cells}</tr>")
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table>"


def _cell(value: Any) -> str:
    """A value in a few digits; nothing where there is none."""
    if value is None or value != value:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
