"""One step of time of a viscous branch with any spring, at many points.

A step whose rule gives the length h and the history H (see `viscous_history`) ends at the C_v with
determinant 1 at which

    W(C C_v^-1) + eta/(2 h) tr(H C_v^-1)

is stationary at given viscosity eta.  This is C_v - h dC_v/dt = H up to a multiple of C_v, which
keeps the determinant; for a neo-Hookean spring it is the closed form of `Maxwell` branches.  Both
parts are convex along the geodesics C_v^-1 = P exp(t X) P^T of the positive tensors if W is convex
in the logarithmic stretches.  So Newton's method with a line search finds the only minimum.

A viscosity that depends on stress and strain is found by a bracketed Newton iteration over the
logarithm of h/tau, with tau = eta over the spring's modulus, around that minimisation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dea_fenicsx.materials.viscous import ViscousBranch
from dea_fenicsx.model.spring_frames import TRACELESS, Frames, matrices, transposed
from dea_fenicsx.model.viscous_history import is_positive, unimodular

MOST_ITERATIONS_OF_FLOW = 60
"""Newton iterations of the minimisation; a few are usual."""

MOST_RATE_ITERATIONS = 60
"""Iterations over the viscosity; the bracket is halved by each of them at least."""

LONGEST_INCREMENT = 1.0
"""Largest norm of X in one iteration."""

LAST_STEP = 1e-8
"""A Newton step below this size is the last: the error after it is about its square."""

LAST_STEP_OF_MANY = 1e-5
"""The same after half of the iterations, where rounding keeps the steps from becoming smaller."""

MOST_HALVINGS = 40
"""How often a step of the minimisation is halved."""

LONGEST_SHARE, APPROACH, MOST_APPROACHES = 100.0, 0.1, 40
"""Where a minimum is approached: the first h/tau, the factor from one to the next, and the most."""

VISCOSITY_TOLERANCE = 1e-13
"""Relative error at which the viscosity is known."""


@dataclass(eq=False)
class LocalState:
    """The end of a step at N points; NaN at points where there is none.

    Attributes
    ----------
    strain
        C_v, shape (N, 6).
    stress
        2 dW/dC in Pa, shape (N, 6).
    moduli
        Twice the derivative of Mandel's vector of the stress by that of C in Pa, the flow
        included, shape (N, 6, 6).
    energy, power
        Energy of the spring in Pa, and dissipation in Pa/s, shape (N,).
    margin
        Distance to the lock-up of the spring's chains.
    """

    strain: np.ndarray
    stress: np.ndarray
    moduli: np.ndarray
    energy: np.ndarray
    power: np.ndarray
    margin: np.ndarray


def flowed(branch: ViscousBranch, span: float, C: np.ndarray, H: np.ndarray) -> LocalState:
    """The end of a step.

    Parameters
    ----------
    branch
        The branch.
    span
        The length h in s; 0 keeps the history.
    C, H
        Cauchy-Green tensor at the end, and the history of the rule, shape (N, 6).
    """
    count = len(C)
    found = LocalState(*(
        np.full(shape, np.nan)
        for shape in ((count, 6), (count, 6), (count, 6, 6), count, count, count)
    ))  # fmt: skip
    finite = np.isfinite(C).all(axis=1) & np.isfinite(H).all(axis=1)
    good = np.flatnonzero(finite)
    good = good[is_positive(C[good]) & is_positive(H[good])]
    if not len(good):
        return found
    frames, share, rate = _solved(branch, span, C[good], H[good])
    mu = branch.mu
    found.strain[good] = np.where(np.isfinite(frames.W)[:, None], frames.strain, np.nan)
    found.stress[good] = mu * frames.stress
    found.moduli[good] = mu * _moduli(branch, frames, share)
    found.energy[good] = mu * frames.W
    found.power[good] = mu * rate * frames.J2
    found.margin[good] = frames.margin(branch.spring)
    return found


def rates(branch: ViscousBranch, C: np.ndarray, strain: np.ndarray) -> tuple[np.ndarray, ...]:
    """dC_v/dt in 1/s, shape (N, 6), and a rate in 1/s at which it changes, shape (N,)."""
    C, v = matrices(C), matrices(strain)
    frames = Frames.of(branch.spring, branch.mu, _root(v), C, v)
    rate = branch.rate(frames.I1, branch.mu**2 * frames.J2)[0]
    stiffness = np.einsum("nii->ni", frames.K).max(axis=1) / 2
    return rate[:, None] * frames.flow, rate * stiffness


def _root(v: np.ndarray) -> np.ndarray:
    """P with P P^T = v^-1 and det P = 1 of positive matrices."""
    values, vectors = np.linalg.eigh(v)
    with np.errstate(invalid="ignore", divide="ignore"):
        P = vectors / np.sqrt(values)[:, None, :]
        return np.asarray(P / np.cbrt(np.abs(np.linalg.det(P)))[:, None, None])


def _solved(
    branch: ViscousBranch, span: float, C: np.ndarray, H: np.ndarray
) -> tuple[Frames, np.ndarray, np.ndarray]:
    """The frames at the end, h over the relaxation time, and one over the latter."""
    nominal = span * branch.rate(3.0, 0.0)[0]
    guess = matrices(unimodular(nominal * C + H))
    C, H = matrices(C), matrices(H)
    if branch.flow is None or span == 0:
        share = np.full(len(C), float(nominal))
        frames = _minimum(branch, share, C, H, _started(branch, share, C, H, guess))
    else:
        frames, share = _with_rate(branch, span, C, H, guess)
    rate = branch.rate(frames.I1, branch.mu**2 * frames.J2)[0]
    return frames, share, rate


def _framed(branch: ViscousBranch, P: np.ndarray, C: np.ndarray, H: np.ndarray) -> Frames:
    return Frames.of(branch.spring, branch.mu, P, C, H)


def _started(
    branch: ViscousBranch, share: np.ndarray, C: np.ndarray, H: np.ndarray, guess: np.ndarray
) -> Frames:
    """Frames at a guess of C_v, or at C itself where the spring would be beyond its lock-up."""
    frames = _framed(branch, _root(guess), C, H)
    beyond = ~np.isfinite(frames.W) & (share > 0)
    if beyond.any():
        P = _root(C[beyond])
        frames.put(beyond, _framed(branch, P, C[beyond], H[beyond]))
    return frames


def _weights(share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the spring and of the history; they stay finite however long the step."""
    return share / (1 + share), 1 / (1 + share)


def _value(frames: Frames, share: np.ndarray) -> np.ndarray:
    """What is to be minimal; at a step of no length the spring has no say."""
    spring, history = _weights(share)
    energy = np.where(spring > 0, spring * frames.W, 0.0)
    return np.asarray(energy + history * np.einsum("nii->n", frames.H) / 2)


def _curvature(frames: Frames, share: np.ndarray) -> np.ndarray:
    spring, history = (w[:, None, None] for w in _weights(share))
    return np.asarray(
        spring * np.where(spring > 0, frames.spring_curvature(), 0.0)
        + history * frames.history_curvature()
    )


def _newton_step(frames: Frames, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Newton's step X, or one down the slope where the curvature is not positive; the gradient."""
    spring, history = (w[:, None] for w in _weights(share))
    slope = spring * np.where(spring > 0, frames.spring_gradient(), 0.0)
    slope = slope + history * frames.history_gradient()
    step = np.full_like(slope, np.nan)
    A = _curvature(frames, share)
    fine = np.isfinite(A).all(axis=(1, 2)) & np.isfinite(slope).all(axis=1)
    step[fine] = -_linear(A[fine], slope[fine][..., None])[..., 0]
    upward = fine & ~(np.einsum("na,na->n", step, slope) < 0)
    size = np.abs(A[upward]).sum(axis=(1, 2))[:, None]
    step[upward] = -slope[upward] / np.maximum(size, 1e-300)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    return step * np.minimum(1.0, LONGEST_INCREMENT / np.maximum(length, 1e-300)), slope


def _linear(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Solutions of small systems, b of shape (N, 5, k); NaN where a matrix is singular."""
    try:
        return np.linalg.solve(A, b)
    except np.linalg.LinAlgError:
        found = np.full_like(b, np.nan)
        for k in range(len(A)):
            if np.linalg.matrix_rank(A[k]) == A.shape[1]:
                found[k] = np.linalg.solve(A[k], b[k])
        return found


def _moved(P: np.ndarray, X: np.ndarray) -> np.ndarray:
    """P exp(X/2) to second order, with determinant 1."""
    Y = np.einsum("na,aij->nij", X, TRACELESS) / 2
    moved = P + P @ (Y + Y @ Y / 2)
    return np.asarray(moved / np.cbrt(np.linalg.det(moved))[:, None, None])


def _minimum(
    branch: ViscousBranch, share: np.ndarray, C: np.ndarray, H: np.ndarray, frames: Frames
) -> Frames:
    """The minimum, sought from the given frames; NaN where it is not found.

    Where Newton's method fails, mostly close to the chains' lock-up, the minimum is approached from
    a relaxed spring: through those of shorter and shorter steps, each from the one before.
    """
    frames = _descended(branch, share, C, H, frames)
    lost = np.flatnonzero(~np.isfinite(frames.W) & (share > 0))
    if not len(lost):
        return frames
    C, H, due = C[lost], H[lost], share[lost]
    part = np.maximum(due, LONGEST_SHARE)
    found = _framed(branch, _root(C), C, H)
    for _ in range(MOST_APPROACHES):
        found = _descended(branch, part, C, H, found)
        if np.all(part == due):
            break
        part = np.maximum(due, part * APPROACH)
    frames.put(lost, found)
    return frames


def _descended(
    branch: ViscousBranch, share: np.ndarray, C: np.ndarray, H: np.ndarray, frames: Frames
) -> Frames:
    """The end of Newton's method from the given frames, which are changed; NaN where it fails."""
    open_ = np.arange(len(C))
    for k in range(MOST_ITERATIONS_OF_FLOW):
        now, part = frames.chosen(open_), share[open_]
        step, slope = _newton_step(now, part)
        least = LAST_STEP if k < MOST_ITERATIONS_OF_FLOW // 2 else LAST_STEP_OF_MANY
        last = np.linalg.norm(step, axis=1) < least
        moved = _searched(branch, now, (C[open_], H[open_], part), (step, slope, last))
        frames.put(open_, moved)
        open_ = open_[~last & np.isfinite(moved.x).all(axis=1)]
        if not len(open_):
            return frames
    for name in ("x", "W", "t", "K"):
        getattr(frames, name)[open_] = np.nan
    return frames


def _searched(
    branch: ViscousBranch, now: Frames, given: tuple[np.ndarray, ...],
    way: tuple[np.ndarray, ...],
) -> Frames:  # fmt: skip
    """The frames after a step, which is halved until the value falls; NaN where it does not."""
    (C, H, share), (step, slope, last) = given, way
    value = _value(now, share)
    room = 1e-13 * (1 + np.abs(value))
    fall = 1e-4 * np.einsum("na,na->n", step, slope)
    after = now.chosen(np.arange(len(C)))
    left, size = np.flatnonzero(np.isfinite(step).all(axis=1)), 1.0
    lost = np.ones(len(C), dtype=bool)
    for _ in range(MOST_HALVINGS):
        trial = _framed(branch, _moved(now.P[left], size * step[left]), C[left], H[left])
        new = _value(trial, share[left])
        lower = new <= value[left] + size * fall[left] + room[left]
        fine = np.isfinite(new) & (last[left] | lower)
        after.put(left[fine], trial.chosen(fine))
        lost[left[fine]] = False
        left, size = left[~fine], size / 2
        if not len(left):
            break
    for name in ("x", "W", "t", "K"):
        getattr(after, name)[lost] = np.nan
    return after


# ---------------------------------------------------------------------- viscosities that depend


def _with_rate(
    branch: ViscousBranch, span: float, C: np.ndarray, H: np.ndarray, guess: np.ndarray
) -> tuple[Frames, np.ndarray]:
    """The frames at the end of a step with a flow law, and h over the relaxation time."""
    share = span * np.broadcast_to(branch.rate(3.0, 0.0)[0], len(C)).astype(float)
    frames = _started(branch, share, C, H, guess)
    y = np.log(_due(branch, span, frames))
    y = np.where(np.isfinite(y), y, np.log(share))
    low, high = np.full(len(C), -np.inf), np.full(len(C), np.inf)
    open_ = np.arange(len(C))
    for _ in range(MOST_RATE_ITERATIONS):
        part = np.exp(y[open_])
        begun = frames.chosen(open_)
        unset = ~np.isfinite(begun.W)
        if unset.any():
            begun.put(unset, _started(
                branch, part[unset], C[open_][unset], H[open_][unset], C[open_][unset]
            ))  # fmt: skip
        now = _minimum(branch, part, C[open_], H[open_], begun)
        frames.put(open_, now)
        gap = y[open_] - np.log(_due(branch, span, now))
        slope = 1 - _log_rate_slope(branch, now, part)
        low[open_] = np.where(gap < 0, y[open_], low[open_])
        high[open_] = np.where(gap > 0, y[open_], high[open_])
        y[open_] = _next(y[open_], gap, slope, low[open_], high[open_])
        open_ = open_[np.abs(gap) > VISCOSITY_TOLERANCE * np.maximum(1, np.abs(y[open_]))]
        if not len(open_):
            break
    return frames, np.exp(y)


def _next(
    y: np.ndarray, gap: np.ndarray, slope: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Newton's next value, or one that halves the bracket where it would leave that."""
    with np.errstate(invalid="ignore", divide="ignore"):
        new = y - np.clip(gap / slope, -3.0, 3.0)
        middle = np.where(np.isfinite(low) & np.isfinite(high), (low + high) / 2, y - gap)
    fine = np.isfinite(new) & (slope > 0) & (new >= low) & (new <= high)
    return np.where(fine, new, middle)


def _due(branch: ViscousBranch, span: float, frames: Frames) -> np.ndarray:
    """h over the relaxation time that the flow law asks for at the frames."""
    return np.asarray(span * branch.rate(frames.I1, branch.mu**2 * frames.J2)[0])


def _rate_slopes(branch: ViscousBranch, frames: Frames) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the logarithm of the rate by X and by Mandel's vector of P^T C P."""
    J2 = branch.mu**2 * frames.J2
    rate, by_strain, by_stress = (r[:, None] for r in branch.rate(frames.I1, J2))
    by_X, by_C = (branch.mu**2 * s for s in frames.J2_slopes())
    by_X = by_strain * frames.I1_slope() + by_stress * by_X
    return by_X / rate, by_stress * by_C / rate


def _log_rate_slope(branch: ViscousBranch, frames: Frames, share: np.ndarray) -> np.ndarray:
    """Derivative of the logarithm of the rate by that of h over the relaxation time."""
    weight = _weights(share)[0][:, None]
    found = np.full(len(share), np.nan)
    A = _curvature(frames, share)
    fine = np.isfinite(A).all(axis=(1, 2))
    push = (weight * frames.spring_gradient())[fine]
    move = -_linear(A[fine], push[..., None])[..., 0]
    found[fine] = np.einsum("na,na->n", _rate_slopes(branch, frames)[0][fine], move)
    return found


def _moduli(branch: ViscousBranch, frames: Frames, share: np.ndarray) -> np.ndarray:
    """2 dS/dC over the modulus, by the implicit function theorem."""
    weight = _weights(share)[0][:, None, None]
    A, mixed, rigid = _curvature(frames, share), frames.mixed(), frames.stiffness()
    push = weight * mixed
    if branch.flow is not None:
        by_X, by_C = _rate_slopes(branch, frames)
        gradient = weight * frames.spring_gradient()[..., None]
        A = A + gradient * by_X[:, None, :]
        push = push + gradient * by_C[:, None, :]
    found = np.full_like(rigid, np.nan)
    fine = np.isfinite(A).all(axis=(1, 2)) & np.isfinite(push).all(axis=(1, 2))
    moved = _linear(A[fine], push[fine])
    found[fine] = rigid[fine] - 4 * transposed(mixed[fine]) @ moved
    if branch.is_variational:
        found = (found + transposed(found)) / 2
    return frames.turned(found)
