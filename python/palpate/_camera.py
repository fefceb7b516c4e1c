"""The camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ._deprecated import warn_renamed
from ._errors import InputError

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Camera:
    """Camera, in the mesh's unit.

    Attributes:
        eye: position of the camera.
        look_at: point at the centre of the picture.
        up: up direction of the picture; default: that of the current camera.
        fov: vertical field of view of a perspective camera, degrees.
        orthographic: height of the view of an orthographic camera, instead of ``fov``.
    """

    eye: Vector
    look_at: Vector
    up: Vector | None = None
    fov: float = 30.0
    orthographic: float | None = None

    @staticmethod
    def from_any(view: Any) -> Camera:
        """Converts a camera: a :class:`Camera`, a ``pyvista.Camera``, or a ``camera_position`` of three
        vectors (position, focal point, up) with pyvista's field of view of 30 degrees.
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
                "camera must be a palpate.Camera, a pyvista camera, or position, focal point and up, "
                f"got {view!r}"
            ) from None

    @staticmethod
    def of(view: Any) -> Camera:
        """Old name of :meth:`from_any`."""
        warn_renamed("Camera.of", "Camera.from_any")
        return Camera.from_any(view)

    def entries(self) -> dict[str, Any]:
        """Returns the entries of ``[camera]`` of a scene."""
        own: dict[str, Any] = {"eye": self.eye, "look_at": self.look_at}
        if self.up is not None:
            own["up"] = self.up
        if self.orthographic is None:
            own["fov"] = self.fov
        else:
            own["orthographic"] = self.orthographic
        return own


#: A :class:`Camera`, pyvista's, or three vectors; converted by :meth:`Camera.from_any`.
CameraLike = Any


def _vector(values: Sequence[float]) -> Vector:
    x, y, z = (float(v) for v in values)
    return (x, y, z)
