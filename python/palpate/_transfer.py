"""Transfer functions: colour and extinction of a scalar."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from typing import Any

import numpy as np

from . import _palpate
from ._errors import InputError

#: Extinction over the range of a scalar for colour maps without one: as that of the built-in
#: presets.
_RAMP: list[list[float]] = [[0.0, 0.0], [1.0, 6.0]]
_COLOURS = 64
#: Path length to which an opacity refers, over the mesh's extent, and the largest opacity.
_WAY = 0.1
_MOST_OPACITY = 0.9999


@dataclass(frozen=True)
class TransferFunction:
    """Colour and extinction as piecewise linear functions of a scalar.

    Attributes:
        colour: rows of scalar, red, green and blue (0 to 1).
        extinction: rows of scalar and extinction per unit of length of the mesh.
        relative: whether scalars run from 0 to 1 over the field's range, and extinction is per extent
            of the mesh (the longest side of its bounds).
    """

    colour: Sequence[Sequence[float]]
    extinction: Sequence[Sequence[float]]
    relative: bool = False

    @staticmethod
    def presets() -> list[str]:
        """Returns the names of the built-in presets, which can be used as transfer functions."""
        return _palpate.presets()

    @staticmethod
    def read(path: str | PathLike[str]) -> TransferFunction:
        """Reads a JSON file, as used by the command line."""
        with open(path, encoding="utf-8") as file:
            try:
                own = json.load(file)
                return TransferFunction(
                    own["colour"], own["extinction"], own.get("relative", False)
                )
            except (ValueError, KeyError, TypeError) as why:
                raise InputError(f"{fspath(path)}: invalid transfer function ({why})") from None

    @staticmethod
    def from_cmap(cmap: Any, extinction: Sequence[Sequence[float]] | None = None) -> TransferFunction:
        """Converts a colour map of matplotlib.

        Args:
            cmap: name, or a callable that maps numbers from 0 to 1 to red, green, blue and opacity.
            extinction: rows of scalar (0 to 1 over the field's range) and extinction per extent of
                the mesh; default: a ramp.
        """
        if isinstance(cmap, str):
            name = cmap
            try:
                import matplotlib
            except ImportError:
                raise InputError(
                    f'unknown transfer function "{name}"; presets are '
                    f"{', '.join(_palpate.presets())} (install matplotlib to use its colour maps, too)"
                ) from None
            try:
                cmap = matplotlib.colormaps[name]
            except KeyError:
                raise InputError(
                    f'unknown transfer function "{name}"; use a preset '
                    f"({', '.join(_palpate.presets())}) or a colour map of matplotlib"
                ) from None
        shares = [n / (_COLOURS - 1) for n in range(_COLOURS)]
        colour = [[s, *(float(c) for c in cmap(s)[:3])] for s in shares]
        ramp = _RAMP if extinction is None else [[float(v) for v in row] for row in extinction]
        return TransferFunction(colour, ramp, relative=True)

    def entry(self) -> str:
        """Returns the value of ``transfer`` in a scene."""
        return json.dumps(
            {
                "colour": [[float(v) for v in row] for row in self.colour],
                "extinction": [[float(v) for v in row] for row in self.extinction],
                "relative": self.relative,
            }
        )


def with_opacity(transfer: Any, opacity: Any) -> TransferFunction:
    """Combines the colours of ``transfer`` (a colour map, its name, or a relative
    :class:`TransferFunction`; default: viridis) with an opacity as in pyvista's ``add_volume``."""
    extinction = _extinction(opacity)
    if isinstance(transfer, TransferFunction):
        if not transfer.relative:
            raise InputError("opacity requires a relative transfer function, because it runs over the field's range")
        return TransferFunction(transfer.colour, extinction, relative=True)
    return TransferFunction.from_cmap("viridis" if transfer is None else transfer, extinction)


def _extinction(opacity: Any) -> list[list[float]]:
    """Returns rows of scalar (0 to 1 over the range) and extinction per extent of the mesh."""
    shares = np.linspace(0.0, 1.0, _COLOURS)
    if isinstance(opacity, str):
        name, _, steep = opacity.partition("_")
        reversed_ = steep == "r"
        if name == "linear" and steep in ("", "r"):
            hides = shares
        elif name == "geom" and steep in ("", "r"):
            hides = np.geomspace(1e-6 / 255.0, 1.0, _COLOURS)
        elif name == "sigmoid" and (steep == "" or steep.isdigit() and int(steep) > 0):
            reach = float(steep or 10)
            hides = 1.0 / (1.0 + np.exp(-reach * (2.0 * shares - 1.0)))
        elif opacity == "foreground":
            hides = np.where(shares > 0.0, 1.0, 0.0)
        else:
            raise InputError(
                f"unknown opacity {opacity!r}; use linear, linear_r, geom, geom_r, sigmoid, "
                "sigmoid_N, foreground, a number or a list of numbers from 0 to 1"
            )
        hides = hides[::-1] if reversed_ else hides
    else:
        given = np.asarray(opacity)
        levels = np.atleast_1d(given).astype(np.float64) / (255.0 if given.dtype == np.uint8 else 1.0)
        if levels.ndim != 1 or levels.size == 0 or not ((levels >= 0.0) & (levels <= 1.0)).all():
            raise InputError(f"opacity must be a number or a list of numbers in [0, 1], got {opacity!r}")
        hides = np.interp(shares, np.linspace(0.0, 1.0, levels.size), levels)
    extinction = -np.log1p(-np.minimum(hides, _MOST_OPACITY)) / _WAY
    return [[float(s), float(e)] for s, e in zip(shares, extinction)]


def entry_of(transfer: Any) -> str:
    """Returns the scene entry of a transfer function: a preset's name, a JSON file, a
    :class:`TransferFunction`, or a colour map of matplotlib."""
    if isinstance(transfer, TransferFunction):
        return transfer.entry()
    if isinstance(transfer, PathLike):
        return str(fspath(transfer))
    if isinstance(transfer, str):
        if transfer in _palpate.presets() or transfer.endswith(".json") or "{" in transfer:
            return transfer
        return TransferFunction.from_cmap(transfer).entry()
    if callable(transfer):
        return TransferFunction.from_cmap(transfer).entry()
    raise InputError(
        "transfer must be a palpate.TransferFunction, the name of a preset or colour map, or a JSON "
        f"file, got {transfer!r}"
    )
