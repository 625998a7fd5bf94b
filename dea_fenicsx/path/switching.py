"""Switches in the wires of sources, opened and closed in the course of a path."""

from __future__ import annotations

from dataclasses import replace

from dea_fenicsx.model.circuits import Wire
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.path.items import Close, Switch, fed


def move_switch(problem: Problem, item: Switch) -> None:
    """Open or close a switch in the present state.  Collective.

    The factor of a source that is closed becomes that of the electrode's potential, if the source
    is ideal, and else the one that the item gives.
    """
    scene, memory = problem.scene, problem.charges
    source = fed(scene, item.where)
    wire = next(w for w in problem.circuits.wires if w.label == source.label)
    state = problem.state
    history = memory.refreshed(problem.histories[memory.NAME], state.time)
    closed = isinstance(item, Close)
    state = replace(
        state, history={**state.history, memory.NAME: history.switched(wire.number, closed)}
    )
    if isinstance(item, Close):
        factor = potential_of(problem, wire) / source.volts if wire.is_ideal else item.to
        state = problem.under(state, {source.ramp: factor})
    problem.commit(state)


def potential_of(problem: Problem, wire: Wire) -> float:
    """The present potential in V of a fed electrode.  Collective."""
    values = problem.w.x.array[wire.dofs[:1]]
    found = next(v[0] for v in problem.comm.allgather(values) if len(v))
    return float(found) * problem.scales.potential
