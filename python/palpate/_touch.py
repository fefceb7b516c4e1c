"""An interactive body: a simulator with a fingertip tool, and an orbiting camera.

Presses as the command line and the viewer do, by the library's ``PressSession``; the camera behaves
as the viewer's (``viewer/src/camera_control.rs``).
"""

from __future__ import annotations

from collections.abc import Sequence
from os import fspath

import numpy as np

from . import _palpate
from ._camera import Camera
from ._errors import InputError
from ._mesh import Mesh, Points
from ._scene import BodyLike, Scene
from ._stage import Pick

#: Distance above the surface at which the withdrawn fingertip is taken away, over the radius.
_CLEARANCE = 0.5
#: Depth of a cut, over the diagonal; and radius of the view's tools where there is no fingertip.
_CUT, _RADIUS = 0.1, 0.04
#: Orbit angle of a drag across the whole picture, radians.
_ROUND = np.pi


class Touched:
    """A body with a fingertip tool and an orbiting camera."""

    def __init__(self, body: BodyLike, adapter: str | None = None) -> None:
        self.scene = Scene.from_any(body)
        entries = self.scene.entries
        # Stages of several bodies and grids create their mesh.
        own = bool(entries.get("body") or entries.get("grid"))
        mesh = None if own else self.scene.load_mesh()
        #: Why the body cannot be pressed on, if so.
        self.obstacle: str | None
        self._stage, self.obstacle = _palpate.Stage.interactive(
            self.scene.json(), fspath(self.scene.folder), None if mesh is None else mesh._native, adapter
        )
        self.rest = Mesh._of(self._stage.mesh()) if mesh is None else mesh
        low, high = (np.array(corner) for corner in self.rest.bounds)
        self.bounds = (low, high)
        self.diagonal = float(np.linalg.norm(high - low))
        fingertip = self._stage.fingertip()
        self.radius = _RADIUS * self.diagonal if fingertip is None else fingertip[0]
        self._press: _Press | None = None

    @property
    def camera(self) -> Camera:
        """Current camera."""
        eye, look_at, up, fov, height = self._stage.camera()
        return Camera(eye, look_at, up, 30.0 if fov is None else fov, height)

    @camera.setter
    def camera(self, camera: Camera) -> None:
        fov = camera.fov if camera.orthographic is None else None
        up = self.camera.up if camera.up is None else camera.up
        assert up is not None
        self._stage.set_camera((camera.eye, camera.look_at, up, fov, camera.orthographic))

    def turn(self, across: float, down: float) -> None:
        """Orbits the camera, by fractions of the picture's width and height."""
        view = self.camera
        focus = np.array(view.look_at)
        right, up, _ = _axes(view)
        turned = _about(up, -_ROUND * across) @ _about(right, -_ROUND * down)
        self._look(view, focus, turned @ (np.array(view.eye) - focus), turned @ up)

    def zoom(self, factor: float) -> None:
        """Zooms in by ``factor``."""
        view = self.camera
        focus = np.array(view.look_at)
        away = np.array(view.eye) - focus
        distance = float(np.linalg.norm(away)) / factor
        nearest, farthest = 1e-3 * self.diagonal, 100.0 * self.diagonal
        if view.orthographic is not None:
            height = min(max(view.orthographic / factor, nearest), farthest)
            self.camera = Camera(view.eye, view.look_at, view.up, view.fov, height)
        elif nearest < distance < farthest:
            assert view.up is not None
            self._look(view, focus, away / factor, np.array(view.up))

    def pan(self, across: float, down: float) -> None:
        """Pans the camera, by fractions of the picture's height."""
        view = self.camera
        right, up, _ = _axes(view)
        focus = np.array(view.look_at)
        away = np.array(view.eye) - focus
        height = self._height(view, float(np.linalg.norm(away)))
        self._look(view, focus + height * (down * up - across * right), away, up)

    def _look(self, view: Camera, focus: Points, away: Points, up: Points) -> None:
        eye = focus + away
        self.camera = Camera(_three(eye), _three(focus), _three(up), view.fov, view.orthographic)

    @staticmethod
    def _height(view: Camera, distance: float) -> float:
        """Returns the height of the view at a distance from the eye."""
        if view.orthographic is not None:
            return view.orthographic
        return 2.0 * distance * float(np.tan(np.radians(0.5 * view.fov)))

    def pick(self, x: float, y: float) -> Pick | None:
        """Picks the boundary at fractions of the picture's width and height."""
        width, height = self._stage.size()
        found = self._stage.pick(x * width, y * height)
        return None if found is None else Pick(*found)

    def press(self, x: float, y: float) -> bool:
        """Places the fingertip on the boundary at this point; returns whether the body is hit."""
        if self.obstacle is not None:
            raise InputError(self.obstacle)
        seen = self.pick(x, y)
        if seen is None:
            return False
        self._stage.touch(seen.point)
        view = self.camera
        self._press = _Press(self._height(view, seen.distance), 0.5 * self.diagonal)
        return True

    def press_to(self, depth: float) -> None:
        """Sets the target depth, in heights of the view at the distance of the press point."""
        press = self._press
        if press is not None and not press.withdraws:
            press.target = min(max(depth * press.height, 0.0), press.most)
            press.moves = True

    def let_go(self) -> None:
        """Withdraws the fingertip."""
        if self._press is not None:
            self._press.target = -_CLEARANCE * self.radius
            self._press.withdraws = self._press.moves = True

    @property
    def samples(self) -> list[tuple[float, float, float]]:
        """Simulated time (s), depth (m) and force (N) of each step of the last press."""
        return [] if self.obstacle is not None else self._stage.press_curve()[0]

    @property
    def problem(self) -> str | None:
        """Why the force of the press has no meaning at present, if so."""
        return None if self._press is None else self._stage.press_curve()[1]

    @property
    def pressed(self) -> bool:
        """Whether a press is active."""
        return self._press is not None

    @property
    def moves(self) -> bool:
        """Whether the fingertip is moving."""
        return self._press is not None and self._press.moves

    def step(self, steps: int = 1) -> None:
        """Does a step of the body with the moving fingertip."""
        press = self._press
        if press is None:
            self._stage.run(steps, None)
            return
        depth, done = self._stage.press_towards(press.target, press.withdraws)
        if not done:
            # This is the largest depth.
            press.target = press.most = depth
        press.moves = press.withdraws or depth != press.target
        if press.withdraws and depth <= press.target:
            self._press = None
            self._stage.park()

    def cut(self, way: Sequence[Sequence[float]]) -> bool:
        """Cuts along a stroke that begins on the body, given as points in fractions of the picture's
        width and height; returns whether anything was cut."""
        seen = self.pick(*way[0]) if len(way) > 1 else None
        if seen is None:
            return False
        edges = []
        for x, y in way:
            origin, direction = self.ray(x, y)
            back = _axes(self.camera)[2]
            along = np.dot(np.array(seen.point) - origin, back) / np.dot(direction, back)
            on = origin + along * direction
            edges.append([on - self.radius * direction, on + _CUT * self.diagonal * direction])
        return self._stage.cut(np.array(edges).tolist())

    def ray(self, x: float, y: float) -> tuple[Points, Points]:
        """Returns the origin and the direction of the ray through a point of the picture."""
        view = self.camera
        width, height = self._stage.size()
        right, up, back = _axes(view)
        across, above = (2.0 * x - 1.0) * width / height, 1.0 - 2.0 * y
        eye = np.array(view.eye)
        if view.orthographic is not None:
            half = 0.5 * view.orthographic
            return eye + half * (across * right + above * up), -back
        slope = np.tan(np.radians(0.5 * view.fov))
        direction = slope * (across * right + above * up) - back
        return eye, direction / np.linalg.norm(direction)


class _Press:
    """State of a press; lengths in the mesh's unit."""

    def __init__(self, height: float, most: float) -> None:
        self.height, self.most = height, most
        self.target = 0.0
        self.withdraws = False
        self.moves = True


def _axes(view: Camera) -> tuple[Points, Points, Points]:
    """Returns the unit vectors to the right, up, and towards the eye."""
    back = np.array(view.eye) - np.array(view.look_at)
    back = back / np.linalg.norm(back)
    assert view.up is not None
    right = np.cross(np.array(view.up), back)
    right = right / np.linalg.norm(right)
    return right, np.cross(back, right), back


def _about(axis: Points, angle: float) -> Points:
    """Returns the rotation matrix about an axis."""
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k))


def _three(place: Points) -> tuple[float, float, float]:
    return (float(place[0]), float(place[1]), float(place[2]))
