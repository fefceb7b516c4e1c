"""Quantities of a body and the parameters they depend on, for :meth:`palpate.Simulator.gradient`
and :meth:`palpate.Simulator.gradient_of_motion`.

Directions are along the axes of the mesh and need not be unit vectors: forces and displacements are
multiplied by them, derivatives are by their multiple. Tets are given by their indices, by ``region`` (a
label of the mesh's regions), or not at all for the whole body. Tools are given by their number among
the scene's tools without mass, from 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Union

import numpy as np
import numpy.typing as npt

from ._errors import InputError

__all__ = [
    "Amplitude",
    "DampingTime",
    "Density",
    "Displacement",
    "ElasticEnergy",
    "Gradient",
    "Gravity",
    "InitialPosition",
    "InitialVelocity",
    "LargestDisplacement",
    "Load",
    "MassDamping",
    "Parameter",
    "PinReaction",
    "Poisson",
    "Quantity",
    "RegionForce",
    "RestPosition",
    "Stress",
    "Support",
    "ToolForce",
    "ToolFriction",
    "ToolPosition",
    "ToolRotation",
    "Volume",
    "VonMises",
    "Young",
]

Vector = Sequence[float]


@dataclass(frozen=True)
class ToolForce:
    """Force of the body on a tool along a direction, N."""

    tool: int
    direction: Vector


@dataclass(frozen=True)
class PinReaction:
    """Force of the body and its loads on the supports of fixed nodes along a direction, N."""

    nodes: npt.ArrayLike
    direction: Vector


@dataclass(frozen=True)
class RegionForce:
    """Force of the rest of the body on a rigid region, given by its label, along a direction, N."""

    region: int
    direction: Vector


@dataclass(frozen=True)
class Displacement:
    """Sum of the displacements of nodes along a direction, each times its weight (default: 1), in the
    mesh's unit."""

    nodes: npt.ArrayLike
    direction: Vector
    weights: npt.ArrayLike | None = None


@dataclass(frozen=True)
class LargestDisplacement:
    """Largest distance of a node from its rest position, in the mesh's unit."""


@dataclass(frozen=True)
class Volume:
    """Volume of tets, in the mesh's unit cubed."""

    tets: npt.ArrayLike | None = None
    region: int | None = None


@dataclass(frozen=True)
class Stress:
    """Component a·σ b of the Cauchy stress in the middle of a tet, Pa."""

    tet: int
    a: Vector
    b: Vector


@dataclass(frozen=True)
class VonMises:
    """Von Mises stress in the middle of a tet, Pa."""

    tet: int


@dataclass(frozen=True)
class ElasticEnergy:
    """Elastic energy, J."""


@dataclass(frozen=True)
class Young:
    """Young's modulus of the material of tets, Pa; of uniform springs their stiffness, N/m."""

    tets: npt.ArrayLike | None = None
    region: int | None = None


@dataclass(frozen=True)
class Poisson:
    """Poisson's ratio of tets."""

    tets: npt.ArrayLike | None = None
    region: int | None = None


@dataclass(frozen=True)
class Density:
    """Density of tets, kg/m³."""

    tets: npt.ArrayLike | None = None
    region: int | None = None


@dataclass(frozen=True)
class Load:
    """Force on a node along a direction, N."""

    node: int
    direction: Vector


@dataclass(frozen=True)
class Gravity:
    """Gravity along a direction, m/s²."""

    direction: Vector


@dataclass(frozen=True)
class Amplitude:
    """Amplitude of a pressure (Pa) or of a muscle, by its number among the scene's pressures, followed
    by its muscles."""

    number: int


@dataclass(frozen=True)
class ToolPosition:
    """Position of a tool along a direction, in the mesh's unit."""

    tool: int
    direction: Vector


@dataclass(frozen=True)
class ToolRotation:
    """Rotation of a tool about an axis through the origin of its shape, rad."""

    tool: int
    axis: Vector


@dataclass(frozen=True)
class ToolFriction:
    """Coefficient of friction of a tool that has friction; of a motion."""

    tool: int


@dataclass(frozen=True)
class DampingTime:
    """Time of stiffness-proportional damping, s, of a body that has some; of a motion."""


@dataclass(frozen=True)
class MassDamping:
    """Rate of mass-proportional damping of finite elements, 1/s; of a motion."""


@dataclass(frozen=True)
class Support:
    """Position of fixed nodes along a direction, in the mesh's unit."""

    nodes: npt.ArrayLike
    direction: Vector


@dataclass(frozen=True)
class RestPosition:
    """Rest position of a node along a direction, in the mesh's unit. In a motion the displacements at its
    start stay."""

    node: int
    direction: Vector


@dataclass(frozen=True)
class InitialPosition:
    """Position of a free node at the start of a motion along a direction, in the mesh's unit."""

    node: int
    direction: Vector


@dataclass(frozen=True)
class InitialVelocity:
    """Velocity of a free node at the start of a motion along a direction, in the mesh's unit per second."""

    node: int
    direction: Vector


Quantity = Union[
    ToolForce,
    PinReaction,
    RegionForce,
    Displacement,
    LargestDisplacement,
    Volume,
    Stress,
    VonMises,
    ElasticEnergy,
]

Parameter = Union[
    Young,
    Poisson,
    Density,
    Load,
    Gravity,
    Amplitude,
    ToolPosition,
    ToolRotation,
    ToolFriction,
    DampingTime,
    MassDamping,
    Support,
    RestPosition,
    InitialPosition,
    InitialVelocity,
]


@dataclass(frozen=True)
class Gradient:
    """A quantity and its derivatives.

    Attributes:
        value: the quantity.
        derivatives: its derivative by each parameter, shape (n,).
        imbalance: net force on the free nodes over the loads; the derivatives are in error by about as
            much. In a motion: the largest net force of a step over its largest force.
        iterations: iterations of conjugate gradients, without those of steps.
    """

    value: float
    derivatives: npt.NDArray[np.float64]
    imbalance: float
    iterations: int


# Kind, indices or a number (none for all tets), weights, directions, and the label of a region.
Item = tuple[str, Union[list[int], None], list[float], list[tuple[float, float, float]], Union[int, None]]


def item_of(given: Any) -> Item:
    """Returns a quantity or parameter in the form of the native module."""
    kind = type(given).__name__
    if kind not in __all__ or kind in ("Gradient", "Parameter", "Quantity"):
        raise InputError(
            f"{given!r} is not a quantity or parameter of palpate.gradients, such as Young(region=1)"
        )
    fields = vars(given)
    numbers: npt.ArrayLike = next((fields[name] for name in _NUMBERS if fields.get(name) is not None), [])
    if fields.get("tets") is not None and fields.get("region") is not None:
        raise InputError(f"{kind} takes tets or a region, not both")
    indices = _integers(numbers, kind)
    given_weights = fields.get("weights")
    weights = np.ones(len(indices)) if given_weights is None else np.asarray(given_weights, dtype=np.float64)
    if weights.shape != (len(indices),):
        raise InputError(f"{kind} has {len(indices)} nodes, but weights of shape {weights.shape}")
    vectors = [_vector(fields[name], name) for name in _VECTORS if name in fields]
    of_all_tets = "tets" in fields and fields["tets"] is None
    return (kind, None if of_all_tets else indices, weights.tolist(), vectors, fields.get("region"))


_NUMBERS = ("nodes", "tets", "node", "tet", "tool", "number")
_VECTORS = ("direction", "axis", "a", "b")


def _integers(given: npt.ArrayLike, kind: str) -> list[int]:
    array = np.atleast_1d(np.asarray(given))
    if array.size == 0:
        return []
    if array.dtype.kind not in "iu" or array.ndim != 1 or array.min() < 0 or array.max() >= 2**32:
        raise InputError(f"the indices of {kind} must be integers ≥ 0 in one dimension, got {given!r}")
    return [int(n) for n in array]


def _vector(given: Vector, name: str) -> tuple[float, float, float]:
    array = np.asarray(given, dtype=np.float64)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InputError(f"{name} must be three finite numbers, got {given!r}")
    x, y, z = array.tolist()
    return (x, y, z)
