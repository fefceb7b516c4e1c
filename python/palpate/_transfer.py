"""Colour and opacity of a scalar."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from typing import Any

import numpy as np

from . import _palpate
from ._errors import InputError

#: Extinction over the range of a scalar where a colour map says nothing of it: as that of the
#: colour maps that ship.
_RAMP: list[list[float]] = [[0.0, 0.0], [1.0, 6.0]]
_COLOURS = 64
#: The share of the mesh's extent that an opacity is that of, and the most that one is taken for.
_WAY = 0.1
_MOST_OPACITY = 0.9999


@dataclass(frozen=True)
class TransferFunction:
    """Colour and extinction as piecewise linear functions of a scalar.

    Attributes:
        colour: rows of scalar, red, green and blue (0 to 1).
        extinction: rows of scalar and extinction per unit of length of the mesh.
        relative: the scalar runs from 0 to 1 over the field's range instead, and extinction is per
            extent of the mesh (the longest side of its bounds).
    """

    colour: Sequence[Sequence[float]]
    extinction: Sequence[Sequence[float]]
    relative: bool = False

    @staticmethod
    def presets() -> list[str]:
        """The names of those that ship, which may be given wherever a transfer function is."""
        return _palpate.presets()

    @staticmethod
    def read(path: str | PathLike[str]) -> TransferFunction:
        """From a JSON file, as the command line has them."""
        with open(path, encoding="utf-8") as file:
            try:
                own = json.load(file)
                return TransferFunction(
                    own["colour"], own["extinction"], own.get("relative", False)
                )
            except (ValueError, KeyError, TypeError) as why:
                raise InputError(f"{fspath(path)}: no transfer function ({why})") from None

    @staticmethod
    def from_cmap(cmap: Any, extinction: Sequence[Sequence[float]] | None = None) -> TransferFunction:
        """The colours of a colour map of matplotlib, by name or as it is.

        Args:
            cmap: a name, or anything that maps numbers from 0 to 1 to red, green, blue and opacity.
            extinction: rows of scalar (0 to 1 over the field's range) and extinction per extent of
                the mesh; default: a ramp.
        """
        if isinstance(cmap, str):
            name = cmap
            try:
                import matplotlib
            except ImportError:
                raise InputError(
                    f'"{name}" is none of the transfer functions that ship '
                    f"({', '.join(_palpate.presets())}); with matplotlib installed its colour maps "
                    "are known too"
                ) from None
            try:
                cmap = matplotlib.colormaps[name]
            except KeyError:
                raise InputError(
                    f'"{name}" is neither one of the transfer functions that ship '
                    f"({', '.join(_palpate.presets())}) nor a colour map of matplotlib"
                ) from None
        shares = [n / (_COLOURS - 1) for n in range(_COLOURS)]
        colour = [[s, *(float(c) for c in cmap(s)[:3])] for s in shares]
        ramp = _RAMP if extinction is None else [[float(v) for v in row] for row in extinction]
        return TransferFunction(colour, ramp, relative=True)

    def entry(self) -> str:
        """What stands at ``transfer`` in a scene."""
        return json.dumps(
            {
                "colour": [[float(v) for v in row] for row in self.colour],
                "extinction": [[float(v) for v in row] for row in self.extinction],
                "relative": self.relative,
            }
        )


def with_opacity(transfer: Any, opacity: Any) -> TransferFunction:
    """The colours of ``transfer`` (a colour map's name, a colour map, or a relative
    :class:`TransferFunction`; default: viridis) with an opacity as pyvista's ``add_volume`` has it."""
    extinction = _extinction(opacity)
    if isinstance(transfer, TransferFunction):
        if not transfer.relative:
            raise InputError("opacity: it runs over the field's range, and this transfer function does not")
        return TransferFunction(transfer.colour, extinction, relative=True)
    return TransferFunction.from_cmap("viridis" if transfer is None else transfer, extinction)


def _extinction(opacity: Any) -> list[list[float]]:
    """Rows of scalar (0 to 1 over the range) and extinction per extent of the mesh."""
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
                f"opacity: {opacity!r} is not known; give linear, linear_r, geom, geom_r, sigmoid, "
                "sigmoid_N, foreground, a number or a list of numbers from 0 to 1"
            )
        hides = hides[::-1] if reversed_ else hides
    else:
        given = np.asarray(opacity)
        levels = np.atleast_1d(given).astype(np.float64) / (255.0 if given.dtype == np.uint8 else 1.0)
        if levels.ndim != 1 or levels.size == 0 or not ((levels >= 0.0) & (levels <= 1.0)).all():
            raise InputError(f"opacity: a number or a list of numbers from 0 to 1 is expected, not {opacity!r}")
        hides = np.interp(shares, np.linspace(0.0, 1.0, levels.size), levels)
    extinction = -np.log1p(-np.minimum(hides, _MOST_OPACITY)) / _WAY
    return [[float(s), float(e)] for s, e in zip(shares, extinction)]


def entry_of(transfer: Any) -> str:
    """What stands in a scene for a transfer function: a preset's name, a file, one of these, or a
    colour map of matplotlib."""
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
        "transfer: a palpate.TransferFunction, the name of a preset or of a colour map, or a JSON "
        f"file is expected, not {transfer!r}"
    )
