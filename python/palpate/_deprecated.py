"""Warnings of old names, which still work."""

from __future__ import annotations

import warnings


def warn_renamed(old: str, current: str) -> None:
    """Warns the caller of the calling function that a name has changed."""
    message = f"{old} is now {current}; the old name still works"
    warnings.warn(message, DeprecationWarning, stacklevel=3)
