"""What can go wrong, each with its exit status.

Every message is one sentence: what is wrong, where, and what would be right.  Errors are raised on
all ranks together, so that no rank is left waiting; only rank 0 prints.
"""

from __future__ import annotations


class DeaError(Exception):
    """Base of all errors that are meant for the user."""

    exit_status = 1


class InputError(DeaError, ValueError):
    """The user's input cannot be used; nothing was computed and nothing on disk was touched."""

    exit_status = 2


class EquilibriumLost(DeaError):
    """The path ended because no equilibrium was found beyond a load: pull-in, as a rule.

    All steps up to the last converged one are on disk.
    """

    exit_status = 3


class SolverError(DeaError):
    """The numerics failed in a way that says nothing about the device."""

    exit_status = 4
