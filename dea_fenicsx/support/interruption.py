"""Ctrl-C and SIGTERM while a path is followed: an orderly end on all ranks."""

from __future__ import annotations

import ctypes
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from types import FrameType, TracebackType
from typing import Any

import numpy as np
from mpi4py import MPI

from dea_fenicsx.support.agreement import complete
from dea_fenicsx.support.errors import Interrupted

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interruption:
    """Notes a signal and raises `Interrupted` on all ranks at the next call of `check`.

    An exception raised wherever the signal strikes would leave each rank at a place of its own, and
    the others waiting.  `say` is told of the signal as soon as Python notices it: an mpirun may
    leave no time for more.  Python notices a signal between two of its own instructions only, not
    within a factorisation; a second signal ends the process at once, wherever it is.  As a context
    manager it takes the signals over and gives them back; outside Python's main thread it does
    nothing.
    """

    def __init__(self, comm: MPI.Comm, say: Callable[[str], None] = lambda line: None) -> None:
        self.comm, self.say = comm, say
        self.number = 0
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread():
            self._before = {n: signal.signal(n, self._note) for n in SIGNALS}
            for number in SIGNALS:
                _only_once(number)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        # All ranks come here without an error, or none.  A signal may have reached only one rank.
        if error is None and self._on_any_rank():
            raise KeyboardInterrupt  # it came after the last check

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.number = number
        with suppress(RuntimeError):  # the signal has struck within a print
            self.say("Interrupted: the run ends before its next Newton iteration.")

    def check(self) -> None:
        """Raise `Interrupted` if any rank has been sent a signal.  Collective."""
        number = self._on_any_rank()
        if number:
            raise Interrupted(f"Interrupted by {signal.Signals(number).name}")

    def _on_any_rank(self) -> int:
        """The largest number of a signal that any rank has noted; 0 for none.  Collective."""
        if self.comm.size == 1:
            return self.number
        found = np.zeros(1, dtype=np.int32)
        mine = np.array([self.number], dtype=np.int32)
        complete(self.comm, self.comm.Iallreduce(mine, found, op=MPI.MAX))
        return int(found[0])


def _only_once(number: int) -> None:
    """Let a signal's handler serve once; then the signal has its default effect again.

    This is sigaction's SA_RESETHAND, which Python's signal module does not offer.  Linux's struct
    sigaction holds the handler, a mask of 128 bytes and the flags.
    """
    libc = ctypes.CDLL(None)
    action = (ctypes.c_byte * 256)()
    if libc.sigaction(number, None, action) == 0:
        flags = ctypes.c_uint.from_buffer(action, ctypes.sizeof(ctypes.c_void_p) + 128)
        flags.value |= 0x80000000
        libc.sigaction(number, action, None)
