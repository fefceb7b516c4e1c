"""Exceptions of the library."""

from __future__ import annotations


class Error(Exception):
    """Base class of all exceptions of Palpate; the message states the problem and how to fix it."""


class InputError(Error, ValueError):
    """Invalid argument, scene or mesh."""


class FileError(Error, OSError):
    """File that cannot be read or written, or is invalid for its format."""


class MissingFileError(FileError, FileNotFoundError):
    """Missing file."""


class DeviceError(Error, RuntimeError):
    """No usable graphics adapter, or the device rejected the work or was lost."""


class SolverError(Error, RuntimeError):
    """Failed simulation; the body keeps its last valid state.

    Attributes:
        solver: name of the time integrator.
        step: number of the failed step, counted from 1.
        time: simulated time of the last valid state, s.
    """

    def __init__(self, what: str, *, solver: str = "", step: int = 0, time: float = 0.0) -> None:
        super().__init__(what)
        self.solver = solver
        self.step = step
        self.time = time
