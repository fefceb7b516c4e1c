"""An interactive body: a simulator with a fingertip tool, and an orbiting camera.

Behaves as the viewer (`viewer/src/body_session.rs`, `camera_control.rs`): a body without supports
lies on a table, the fingertip advances by a small fraction of its radius per step, and stops when a
step fails.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from . import _palpate
from ._camera import Camera
from ._errors import InputError, SolverError
from ._mesh import Mesh, Points
from ._scene import BodyLike, Scene
from ._stage import Pick, stage_of

#: Fraction of the height of a body without supports that is fixed to the table.
_TABLE = 0.04
#: Default time step, s.
_STEP = 0.02
#: Radius of the fingertip over the body's diagonal, and at least over the mean edge length.
_RADIUS, _EDGES = 0.04, 1.5
#: Largest advance per step, over the radius; withdrawal is eight times as fast.
_STRIDE = 0.06
#: Distance of its parking position, in diagonals of the body.
_AWAY = 20.0
#: Depth of a cut, over the diagonal.
_CUT = 0.1
#: Orbit angle of a drag across the whole picture, radians.
_ROUND = np.pi
#: Corners of the faces of a tet, opposite corners 0 to 3, counter-clockwise seen from outside.
_FACES = ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))


class Touched:
    """A body with a fingertip tool and an orbiting camera."""

    def __init__(self, body: BodyLike, adapter: str | None = None) -> None:
        self.scene = Scene.from_any(body)
        entries = self.scene.entries
        made: _palpate.Stage | None = None
        if entries.get("body") or entries.get("grid"):
            # The stage creates their mesh.
            made = stage_of(self.scene, adapter)
            self.rest = Mesh._of(made.mesh())
        else:
            self.rest = self.scene.load_mesh()
        low, high = (np.array(corner) for corner in self.rest.bounds)
        self.bounds = (low, high)
        self.diagonal = float(np.linalg.norm(high - low))
        self.radius = max(_RADIUS * self.diagonal, _EDGES * _mean_edge(self.rest))
        self._away = 0.5 * (low + high) + _AWAY * self.diagonal
        #: Index of the fingertip among the tools, or the reason why there is none.
        self.finger: int | str
        moving, self.finger = self._with_finger()
        try:
            self._stage = made or stage_of(moving, adapter)
        except InputError as why:
            if isinstance(self.finger, str):
                raise
            # Some bodies can be rendered but not pressed.
            self.finger = str(why)
            moving = self.scene
            self._stage = stage_of(moving, adapter)
        self.moving = moving
        self._press: _Press | None = None
        #: Simulated time (s), depth (m) and force (N) of each step of the last press.
        self.samples: list[tuple[float, float, float]] = []

    def _with_finger(self) -> tuple[Scene, int | str]:
        entries = self.scene.entries
        if any(entries.get(name) for name in ("body", "grid", "cage")):
            return self.scene, "pressing requires a scene of one tetrahedral body, without [[body]], [grid] and [cage]"
        scene = self.scene.updated({"mesh.file": None, "mesh.generate": None})
        scene.mesh = self.rest
        if "name" not in entries.get("solver", {}):
            scene = scene.updated(
                {
                    "solver": {
                        "name": "implicit",
                        "gravity": [0.0, 0.0, 0.0],
                        "dt": _STEP,
                        "tolerance": 0.01,
                        **entries.get("solver", {}),
                    }
                }
            )
            if not entries.get("pin") and not entries.get("move"):
                scene = scene.updated({"pin": [{"name": "table", "axis": "z", "below": _TABLE}]})
        tools: list[Any] = list(entries.get("tool", []))
        dynamic = {"mass", "spring_stiffness", "spring"}
        number = sum(dynamic.isdisjoint(tool) for tool in tools)
        finger = {
            "name": "finger",
            "sphere": {"radius": self.radius},
            "at": self._away.tolist(),
            "colour": [0.87, 0.72, 0.62],
        }
        return scene.updated({"tool": [*tools, finger]}), number

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
        if isinstance(self.finger, str):
            raise InputError(self.finger)
        seen = self.pick(x, y)
        if seen is None:
            return False
        spot = np.array(seen.point)
        out = self._outward(seen, spot)
        start = -0.02 * self.radius
        self._stage.lead_tool(self.finger, _three(spot + (self.radius - start) * out), True)
        self.samples = []
        view = self.camera
        self._press = _Press(spot, out, start, self._height(view, seen.distance))
        return True

    def press_to(self, depth: float) -> None:
        """Sets the target depth, in heights of the view at the distance of the press point."""
        press = self._press
        if press is not None and not press.ends:
            press.goal = min(max(depth * press.height, 0.0), press.most, 0.5 * self.diagonal)

    def let_go(self) -> None:
        """Withdraws the fingertip."""
        if self._press is not None:
            self._press.goal = -0.5 * self.radius
            self._press.ends = True

    @property
    def problem(self) -> str | None:
        """Why the force of the press has no meaning at present, if so."""
        if self._press is None:
            return None
        return _palpate.contact_problem([(depth, force) for _, depth, force in self.samples])

    @property
    def pressed(self) -> bool:
        """Whether a press is active."""
        return self._press is not None

    @property
    def moves(self) -> bool:
        """Whether the fingertip is moving."""
        press = self._press
        return press is not None and (press.ends or press.goal != press.gone)

    def step(self, steps: int = 1) -> None:
        """Does a step of the body with the moving fingertip."""
        press = self._press
        if press is None or isinstance(self.finger, str):
            self._stage.run(steps, None)
            return
        most = _STRIDE * self.radius
        before = press.gone
        press.gone += min(max(press.goal - press.gone, -8.0 * most), most)
        try:
            place = press.spot + (self.radius - press.gone) * press.out
            self._stage.lead_tool(self.finger, _three(place), False)
            self._stage.run(1, None)
        except SolverError:
            if press.gone <= before:
                raise
            # The step failed: this is the largest depth.
            press.gone = press.goal = press.most = before
            place = press.spot + (self.radius - before) * press.out
            self._stage.lead_tool(self.finger, _three(place), False)
            return
        force = float(np.dot(self._stage.tool_force(self.finger), press.out))
        unit = self.rest.length_unit or 1.0
        self.samples.append((self._stage.time()[0], unit * press.gone, force))
        if press.ends and press.gone <= press.goal:
            self._press = None
            self._stage.lead_tool(self.finger, _three(self._away), True)

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

    def _outward(self, seen: Pick, spot: Points) -> Points:
        """Returns the mean outward normal of the front-facing boundary within a fingertip radius of a
        pick."""
        x = self._stage.positions()
        tets = self._stage.mesh().tets()
        corners = tets[seen.tet][list(_FACES[seen.face])]
        sight = spot - np.array(self.camera.eye)
        faces = _boundary(tets)
        a, b, c = (x[faces[:, n]] for n in range(3))
        normals = np.cross(b - a, c - a)
        near = np.linalg.norm((a + b + c) / 3.0 - spot, axis=1) <= self.radius
        out = normals[near & (normals @ sight < 0.0)].sum(axis=0)
        if not out.any():
            own = x[corners]
            out = np.cross(own[1] - own[0], own[2] - own[0])
        return np.asarray(out / np.linalg.norm(out))


class _Press:
    """State of a press; lengths in the mesh's unit."""

    def __init__(self, spot: Points, out: Points, gone: float, height: float) -> None:
        self.spot, self.out, self.gone, self.height = spot, out, gone, height
        self.goal = 0.0
        self.most = float("inf")
        self.ends = False


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


def _boundary(tets: Any) -> Any:
    """Returns the boundary faces, shape (n, 3)."""
    faces = np.concatenate([tets[:, list(face)] for face in _FACES])
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return faces[first[count == 1]]


def _mean_edge(mesh: Mesh) -> float:
    faces = _boundary(mesh.tets)
    x = mesh.nodes
    sides = [np.linalg.norm(x[faces[:, a]] - x[faces[:, b]], axis=1) for a, b in ((0, 1), (1, 2), (2, 0))]
    return float(np.mean(sides))
