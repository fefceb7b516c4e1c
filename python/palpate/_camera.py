"""The view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ._errors import InputError

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Camera:
    """An eye, what it looks at and which way is up, in the mesh's unit.

    Attributes:
        eye: where the eye is.
        look_at: the point in the middle of the picture.
        up: the direction that is up in the picture; default: that of the view there was.
        fov: the vertical opening angle of a perspective camera, degrees.
        orthographic: the height of the view of an orthographic one, in place of ``fov``.
    """

    eye: Vector
    look_at: Vector
    up: Vector | None = None
    fov: float = 30.0
    orthographic: float | None = None

    @staticmethod
    def of(view: Any) -> Camera:
        """A camera as it is, or as pyvista has it: its ``Camera``, or a ``camera_position`` of
        three points (position, focal point, up), whose opening angle is pyvista's 30 degrees.
        """
        if isinstance(view, Camera):
            return view
        if hasattr(view, "focal_point"):
            parallel = bool(view.parallel_projection)
            return Camera(
                eye=_vector(view.position),
                look_at=_vector(view.focal_point),
                up=_vector(view.up),
                fov=float(view.view_angle),
                orthographic=2.0 * float(view.parallel_scale) if parallel else None,
            )
        try:
            eye, look_at, up = view
            return Camera(_vector(eye), _vector(look_at), _vector(up))
        except (TypeError, ValueError):
            raise InputError(
                "camera: a palpate.Camera, a pyvista camera, or position, focal point and up "
                f"are expected, not {view!r}"
            ) from None

    def entries(self) -> dict[str, Any]:
        """What stands in ``[camera]`` of a scene."""
        own: dict[str, Any] = {"eye": self.eye, "look_at": self.look_at}
        if self.up is not None:
            own["up"] = self.up
        if self.orthographic is None:
            own["fov"] = self.fov
        else:
            own["orthographic"] = self.orthographic
        return own


#: A :class:`Camera`, pyvista's, or three points; checked by :meth:`Camera.of`.
CameraLike = Any


def _vector(values: Sequence[float]) -> Vector:
    x, y, z = (float(v) for v in values)
    return (x, y, z)
