"""What can go wrong, in the library's own words."""

from __future__ import annotations


class Error(Exception):
    """Anything that Palpate refuses or fails at: what happened, where, and what to do."""


class InputError(Error, ValueError):
    """An argument, a scene or a mesh that makes no sense."""


class FileError(Error, OSError):
    """A file that cannot be read or written, or is not what its format promises."""


class MissingFileError(FileError, FileNotFoundError):
    """A file that is not there."""


class DeviceError(Error, RuntimeError):
    """No graphics adapter can be used, or the device refused the work or was lost."""


class SolverError(Error, RuntimeError):
    """A simulation failed; the body stays in its last good state.

    Attributes:
        solver: the scheme's name.
        step: the step at which it failed, counted from 1.
        time: the simulated time of the last good state, s.
    """

    def __init__(self, what: str, *, solver: str = "", step: int = 0, time: float = 0.0) -> None:
        super().__init__(what)
        self.solver = solver
        self.step = step
        self.time = time
