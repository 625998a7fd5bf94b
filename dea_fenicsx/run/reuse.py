"""Problems of runs that are gone, kept for a run of the same scene with other constants or volts.

A design search, a fit and a loop over moduli or voltages solve one scene again and again.  Most of
a small run's time goes into its forms, its spaces and the analysis of its factor, all of which stay
the same.  So the last few small problems are kept.  One is used again if nobody can see it any
more: its run has been deleted, and neither a script nor a script's own observable has ever had it.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from dea_fenicsx.materials import Material
from dea_fenicsx.materials.base import shape
from dea_fenicsx.materials.viscous import Branch, Maxwell
from dea_fenicsx.mesh.cell_quality import digest_of_nodes
from dea_fenicsx.mesh.device import Device
from dea_fenicsx.model.problem import Problem
from dea_fenicsx.results.finished import Run
from dea_fenicsx.scene.electrodes import Electrode
from dea_fenicsx.scene.scene import Scene
from dea_fenicsx.solvers.linear import MOST_UNKNOWNS_LENT
from dea_fenicsx.solvers.newton import NewtonSolver
from dea_fenicsx.solvers.options import NewtonOptions

MOST_PROBLEMS_KEPT = 3
"""Number of problems that are kept: in a loop the last run is still there while the next begins."""

MOST_UNKNOWNS_REUSED = 20_000
"""Unknowns up to which a problem is kept; it then takes some ten MB, with its factor."""

MOST_CHANGE = 100.0
"""Largest change of the smallest shear modulus, by which stresses are made dimensionless."""


@dataclass(eq=False)
class _Kept:
    """A problem with its solver and its run.

    The number is the same on all ranks of its device, and `nodes` is the digest of their
    coordinates.
    """

    number: int
    solver: NewtonSolver
    options: NewtonOptions
    run: weakref.ref[Run]
    nodes: str

    def is_free(self) -> bool:
        """Whether nobody on this rank can see the problem any more, and its nodes are in place."""
        problem = self.solver.problem
        if self.run() is not None or problem.handed_out:
            return False
        return self.nodes == digest_of_nodes(problem.scene.device)


_kept: list[_Kept] = []
_runs: weakref.WeakKeyDictionary[Device, int] = weakref.WeakKeyDictionary()
"""Number of runs of each device.  A rank may have solved other devices alone."""


_lent: weakref.ref[Run] | None = None
"""The last run that still has its solver."""


def lend(run: Run, solver: NewtonSolver) -> None:
    """Leave a run its solver, if that is not too large, until the next run begins."""
    global _lent
    if solver.problem.unknowns <= MOST_UNKNOWNS_LENT and solver.options.keep_factor:
        run.lent, _lent = solver, weakref.ref(run)


def take_back() -> None:
    """Let the memory of the last run's solver go, unless it has served for derivatives."""
    global _lent
    if _lent and (run := _lent()):
        run.lent = None
    _lent = None


def clear() -> None:
    """Let all kept problems go."""
    _kept.clear()


def keep(run: Run, solver: NewtonSolver, observables: Iterable[Any]) -> None:
    """Keep the problem of a run that has ended, for when the run is gone.

    Parameters
    ----------
    run
        The run.
    solver
        Its solver.
    observables
        What has measured its states; a script's own may still hold the problem.
    """
    problem = solver.problem
    own = all(type(o).__module__.startswith("dea_fenicsx.") for o in observables)
    device = problem.scene.device
    number = _runs[device] = _runs.get(device, 0) + 1
    if problem.unknowns > MOST_UNKNOWNS_REUSED or not own:
        return
    if solver.options.factor == "auto" and solver.factor_kind == "multigrid":
        return  # the next run may need a factor
    nodes = digest_of_nodes(device)
    _kept.append(_Kept(number, solver, solver.options, weakref.ref(run), nodes))
    del _kept[:-MOST_PROBLEMS_KEPT]


def solver_for(
    scene: Scene, options: NewtonOptions | None, released: bool = False
) -> NewtonSolver:
    """A solver with the problem of a scene: a kept one with the scene's constants, or a new one.

    With `released` a free body is held by its inertia alone.  Collective.
    """
    chosen = options or NewtonOptions()
    take_back()
    _kept[:] = [kept for kept in _kept if not kept.solver.problem.handed_out]
    usable = {
        kept.number: kept for kept in _kept
        if kept.options == chosen and _is_like(kept.solver.problem, scene)
        and kept.solver.problem.released == released and kept.is_free()
    }  # fmt: skip
    # ranks may differ in what a script still holds
    everyone = scene.device.comm.allgather(list(usable))
    common = set(everyone[0]).intersection(*everyone[1:])
    if not common:
        return NewtonSolver(Problem(scene, released), options)
    kept = usable[min(common)]
    _kept.remove(kept)
    kept.solver.problem.reuse(scene)
    kept.solver.renew()
    return kept.solver


def _is_like(problem: Problem, new: Scene) -> bool:
    """Whether a scene differs from that of a problem by constants and voltages at most."""
    old = problem.scene
    if old.device is not new.device or set(old.materials) != set(new.materials):
        return False
    if not _have_like_electrodes(problem, new):
        return False
    others = ("device", "materials", "electrodes")
    names = [f.name for f in fields(Scene) if f.name not in others]
    if any(_plain(getattr(old, name)) != _plain(getattr(new, name)) for name in names):
        return False
    if any(_calls_script(getattr(new, name)) for name in (*names, "electrodes")):
        return False
    if any(_kind(old.materials[r]) != _kind(m) for r, m in new.materials.items()):
        return False
    moduli = [
        min((m.elastic.shear_modulus() for m in s.solids.values()), default=1.0) for s in (old, new)
    ]
    if len(new.solids) < len(new.materials) and moduli[0] != moduli[1]:
        return False  # The stiffness of air follows the smallest modulus.
    return bool(abs(np.log(moduli[0] / moduli[1])) < np.log(MOST_CHANGE))


def _have_like_electrodes(problem: Problem, new: Scene) -> bool:
    """Whether the electrodes of a scene differ from those of a problem by voltages at most."""
    old = problem.scene
    if list(old.electrodes) == list(new.electrodes):
        return True
    if len(old.electrodes) != len(new.electrodes) or not problem.conditions.takes_volts(old):
        return False
    return all(map(_differ_by_volts, old.electrodes, new.electrodes))


def _differ_by_volts(old: Any, new: Any) -> bool:
    """Whether two electrodes are the same, but for their voltages, neither of which is 0.

    An electrode of 0 V has no ramp.
    """
    if old == new:
        return True
    if type(old) is not Electrode or type(new) is not Electrode or not old.volts * new.volts:
        return False
    return replace(new, volts=old.volts) == old


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, list | tuple) else value


def _calls_script(value: Any) -> bool:
    """Whether a part of a scene has a function of a script.

    The same function may give other values now, since a variable that it reads may have changed.
    """
    if isinstance(value, Mapping):
        return any(map(_calls_script, value.values()))
    if isinstance(value, list | tuple | set | frozenset):
        return any(map(_calls_script, value))
    if is_dataclass(value) and not isinstance(value, type):
        return any(_calls_script(getattr(value, f.name)) for f in fields(value))
    return callable(value)


def _kind(material: Material) -> tuple[Any, ...]:
    """What of a material shapes the forms: its models and how many constants they have."""
    if material.is_air:
        return (material,)
    elastic, electric = material.elastic, material.electric
    return type(elastic), shape(elastic), type(electric), _shape_of_field(material), (
        material.bulk_modulus is None
    ), tuple(map(_branch_kind, material.viscous)), material.density, (
        material.thermal, material.damage
    )  # fmt: skip


def _shape_of_field(material: Material) -> Any:
    """What shapes the energy of the field, and how charges leak and lag; None without a field."""
    if not material.is_dielectric:
        return None
    dielectric = material.dielectric
    return dielectric.form(), dielectric.conductivity_law(), dielectric.relaxation_terms()


def _branch_kind(branch: Branch) -> tuple[Any, ...]:
    """What of a viscous branch shapes the forms, and the names of its constants."""
    if isinstance(branch, Maxwell):
        return (Maxwell,)
    return type(branch.spring), shape(branch.spring), type(branch.flow)
