"""Simulation and rendering of bodies."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from os import fspath
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _palpate
from ._camera import Camera, CameraLike
from ._deprecated import warn_renamed
from ._errors import InputError
from ._mesh import Mesh, PathOf, Points, Progress, _floats
from ._scene import BodyLike, Scene, picture_entries
from .gradients import Gradient, Parameter, Quantity, item_of

Picture = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Pick:
    """Point of the boundary that is visible at a pixel.

    Attributes:
        node: nearest node.
        tet: tet of the visible face.
        face: face of the tet, by its opposite corner, 0 to 3.
        point: position, in the mesh's unit.
        distance: distance from the eye, in the mesh's unit.
    """

    node: int
    tet: int
    face: int
    point: tuple[float, float, float]
    distance: float


@dataclass(frozen=True)
class Reaction:
    """Force and moment of a body on a support or a tool.

    Attributes:
        force: force, N, shape (3,).
        moment: moment, N·m, shape (3,): about the origin; for tools about their centre.
    """

    force: Points
    moment: Points


class Grab:
    """Grabbed nodes; see :meth:`Simulator.grab`."""

    def __init__(self, stage: _palpate.Stage, native: _palpate.Grab) -> None:
        self._stage = stage
        self._native = native

    def move_to(self, target: Sequence[float]) -> None:
        """Moves the target, which the nodes follow during the next step."""
        x, y, z = (float(v) for v in target)
        self._stage.set_target(self._native, (x, y, z))

    def release(self) -> int:
        """Releases the nodes and returns their number."""
        return self._stage.release(self._native)


class Simulator:
    """Simulated body.

    Args:
        body: body to simulate.
        solver: time integrator: ``implicit``, ``explicit``, ``symplectic``, ``verlet``,
            ``velocity-verlet``, and for finite elements on the CPU ``bdf2`` and ``midpoint``; default:
            the scene's, or implicit.
        engine: engine of the time steps: ``gpu``, ``cpu``, or ``auto``, which uses a GPU if there is one.
        dt: time step, s; default: chosen for the integrator.
        gravity: gravity, m/s².
        precision: ``single``, or ``double`` on the CPU, which :meth:`gradient` requires.
        adapter: graphics adapter: part of its name, its index, or ``cpu``.
    """

    def __init__(
        self,
        body: BodyLike,
        *,
        solver: str | None = None,
        engine: str | None = None,
        dt: float | None = None,
        gravity: Sequence[float] | None = None,
        precision: str = "single",
        adapter: str | None = None,
    ) -> None:
        if precision not in ("single", "double"):
            raise InputError(f"precision must be single or double, got {precision!r}")
        scene = Scene.from_any(body)
        named = scene.entries.get("solver", {}).get("name")
        given = {"name": solver or named or "implicit", "engine": engine, "dt": dt, "gravity": gravity}
        own = {f"solver.{name}": v for name, v in given.items() if v is not None}
        self.scene = scene.updated(own)
        self._stage = stage_of(self.scene, adapter)
        if precision == "double":
            _palpate.use_double_precision(self._stage)

    @property
    def notes(self) -> list[str]:
        """Notes of automatic choices, one sentence each."""
        return self._stage.notes()

    @property
    def mesh(self) -> Mesh:
        """Mesh at rest, including cuts."""
        return Mesh._of(self._stage.mesh())

    @property
    def deformed(self) -> Mesh:
        """Mesh in its current configuration, with the fields ``displacement`` and ``velocity``."""
        return Mesh._of(self._stage.deformed_mesh())

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self._stage.time()[0]

    @property
    def dt(self) -> float:
        """Time step, s."""
        dt = self._stage.time()[1]
        assert dt is not None
        return dt

    @property
    def engine(self) -> str:
        """Engine of the time steps: ``gpu`` or ``cpu``."""
        return self._stage.engine()[0]

    @property
    def solver(self) -> str:
        """Time integrator."""
        return self._stage.engine()[1]

    def advance(self, steps: int = 1, progress: Progress | None = None) -> None:
        """Does ``steps`` steps. Ctrl-C, or an exception raised by ``progress``, cancels between two
        steps; completed steps are kept.

        Raises:
            SolverError: a step failed; the last valid state is kept.
        """
        self._stage.run(_count(steps, "steps"), progress)

    @property
    def positions(self) -> Points:
        """Copy of the node positions, in the mesh's unit, shape (n, 3)."""
        return self._stage.positions()

    @positions.setter
    def positions(self, positions: npt.ArrayLike) -> None:
        self._stage.pose(_floats(positions, "positions"))

    @property
    def velocities(self) -> Points:
        """Copy of the node velocities, in the mesh's unit per second, shape (n, 3)."""
        return self._stage.velocities()

    @velocities.setter
    def velocities(self, velocities: npt.ArrayLike) -> None:
        self._stage.set_velocities(_floats(velocities, "velocities"))

    @property
    def masses(self) -> npt.NDArray[np.float64]:
        """Mass of each simulated node, kg."""
        return self._stage.masses()

    def forces(self) -> Points:
        """Returns the force on each node without support reactions, N, shape (n, 3); CPU engine only.
        NaN on nodes of rigid regions."""
        return self._stage.forces()

    def set_forces(self, forces: npt.ArrayLike) -> None:
        """Sets external forces on each node, N, shape (n, 3), from the next step on."""
        self._stage.set_forces(_floats(forces, "forces"))

    def set_gravity(self, gravity: Sequence[float]) -> None:
        """Sets gravity, m/s², from the next step on."""
        x, y, z = (float(v) for v in gravity)
        self._stage.set_gravity((x, y, z))

    def field(self, name: str, at_nodes: bool = False) -> npt.NDArray[np.float64]:
        """Computes ``displacement`` (the mesh's unit), ``von_mises``, ``stress_1`` to ``stress_3`` (Pa),
        ``strain``, ``J`` or ``energy_density`` (J/m³) of the current configuration, per tet or per
        node."""
        return self._stage.field(name, at_nodes)

    def pin(self, nodes: npt.ArrayLike) -> None:
        """Fixes nodes at their current positions."""
        array = np.asarray(nodes)
        if array.dtype.kind not in "iu":
            raise InputError(f"nodes must be integers, got {array.dtype}")
        if array.size and array.min() < 0:
            raise InputError("nodes must be ≥ 0 (indices are counted from 0)")
        self._stage.pin([int(n) for n in array.ravel()])

    def grab(
        self,
        centre: Sequence[float],
        radius: float,
        *,
        spring: float | None = None,
        limit: float = float("inf"),
    ) -> Grab:
        """Grabs the nodes within ``radius`` of ``centre``: they follow the target exactly, or with
        ``spring`` (N/m) are pulled by at most ``limit`` (N)."""
        x, y, z = (float(v) for v in centre)
        pull = None if spring is None else (float(spring), float(limit))
        return Grab(self._stage, self._stage.grab((x, y, z), float(radius), pull))

    def cut(self, edges: Sequence[Sequence[Sequence[float]]]) -> bool:
        """Cuts the body along the surface swept by a straight edge, given by its end points ``edges``,
        shape (k, 2, 3). Returns whether anything was cut."""
        array = np.asarray(edges, dtype=np.float64)
        if array.ndim != 3 or array.shape[1:] != (2, 3):
            raise InputError(f"edges must have shape (k, 2, 3), got {array.shape}")
        return self._stage.cut(array.tolist())

    def restart(self) -> None:
        """Resets the body to its rest state; loads and supports are kept."""
        self._stage.restart()

    def report(self) -> dict[str, Any]:
        """Returns energies (J), volume ratio, largest displacement and number of inverted tets."""
        report: dict[str, Any] = json.loads(self._stage.report())
        return report

    def reactions(self) -> dict[str, Reaction]:
        """Returns the reactions of the body on each of its pins, moves, grabs and tools."""
        return {
            name: Reaction(np.array(force), np.array(moment))
            for name, force, moment in self._stage.reactions()
        }

    def gradient(self, quantity: Quantity, parameters: Sequence[Parameter]) -> Gradient:
        """Returns a quantity of the body at rest and its derivatives by parameters, all of them by one
        linear solve. The body must be at rest, so take long steps before; friction has no part in it.

        For example, the force of the body on its first tool, by the stiffness of a region::

            from palpate.gradients import ToolForce, ToolPosition, Young
            found = simulator.gradient(ToolForce(0, (0, 0, 1)), [Young(region=1), ToolPosition(0, (0, 0, -1))])

        Args:
            quantity: quantity, such as :class:`palpate.gradients.ToolForce`.
            parameters: parameters, such as :class:`palpate.gradients.Young`.
        """
        found = _palpate.gradient(self._stage, item_of(quantity), [item_of(p) for p in parameters])
        return Gradient(*found)

    def gradient_of_motion(
        self,
        steps: int,
        quantity: Quantity,
        parameters: Sequence[Parameter],
        *,
        integral: bool = False,
        progress: Progress | None = None,
    ) -> Gradient:
        """Does ``steps`` steps, and returns a quantity of this motion and its derivatives by
        parameters, by one linear solve for each step. Moves, paths of tools, and pressures and
        activations over time go on; a derivative by one of them is that by a shift of its whole path.

        Args:
            steps: number of steps.
            quantity: quantity, such as :class:`palpate.gradients.Displacement`.
            parameters: parameters, such as :class:`palpate.gradients.Young`.
            integral: whether the quantity is integrated over time, rather than that at the end.
            progress: called with the completed fraction. Ctrl-C, or an exception it raises, cancels.
        """
        found = _palpate.gradient_of_motion(
            self._stage,
            _count(steps, "steps"),
            integral,
            item_of(quantity),
            [item_of(p) for p in parameters],
            progress,
        )
        return Gradient(*found)

    def __repr__(self) -> str:
        engine, solver = self._stage.engine()
        return f"<palpate.Simulator, {solver} on the {engine}, at {self.time:.4g} s>"


class Renderer:
    """Renders successive pictures of a body.

    Args:
        body: body to render; a :class:`Simulator` is rendered in its current configuration.
        adapter: graphics adapter, unless ``body`` is a simulator.
        picture: as in :func:`render`.
    """

    def __init__(
        self, body: BodyLike | Simulator, *, adapter: str | None = None, **picture: Any
    ) -> None:
        changes = picture_entries(**picture)
        self._simulator = body if isinstance(body, Simulator) else None
        if isinstance(body, Simulator):
            self._stage = body._stage
            self.scene = body.scene.updated(changes)
            self._notes = self._stage.set_looks(self.scene.json(), fspath(self.scene.folder))
            if "picture.size" in changes:
                self._stage.set_size(changes["picture.size"])
            if "camera" in changes:
                self.camera = Camera(**changes["camera"])
        else:
            self.scene = Scene.from_any(body).updated(changes)
            self._stage = stage_of(self.scene, adapter)
            self._notes = self._stage.notes()

    @property
    def notes(self) -> list[str]:
        """Notes of automatic choices, one sentence each."""
        return self._notes

    @property
    def camera(self) -> Camera:
        """Camera; can be set to a :class:`Camera` or one of pyvista's."""
        eye, look_at, up, fov, height = self._stage.camera()
        return Camera(eye, look_at, up, 30.0 if fov is None else fov, height)

    @camera.setter
    def camera(self, camera: CameraLike) -> None:
        own = Camera.from_any(camera)
        fov = own.fov if own.orthographic is None else None
        up = self._stage.camera()[2] if own.up is None else own.up
        self._stage.set_camera((own.eye, own.look_at, up, fov, own.orthographic))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture, pixels."""
        width, height = self._stage.size()
        return (width, height)

    @size.setter
    def size(self, size: Sequence[int]) -> None:
        width, height = size
        self._stage.set_size((_count(width, "width"), _count(height, "height")))

    @property
    def field_info(self) -> tuple[str, tuple[float, float]]:
        """Name and range of the rendered field."""
        return self._stage.shown()

    @property
    def shown(self) -> tuple[str, tuple[float, float]]:
        """Old name of :attr:`field_info`."""
        warn_renamed("Renderer.shown", "Renderer.field_info")
        return self.field_info

    def set_positions(self, positions: npt.ArrayLike) -> None:
        """Sets the node positions, shape (n, 3), in the mesh's unit."""
        self._stage.pose(_floats(positions, "positions"))

    def render(self) -> Picture:
        """Renders the picture, shape (height, width, 4): red, green, blue and opacity, as in a PNG."""
        self._set_displayed_time()
        width, height = self._stage.size()
        return self._stage.rgba().reshape(height, width, 4)

    def render_float(self) -> npt.NDArray[np.float32]:
        """Renders the picture as 32-bit floats, as in an EXR: shape (height, width, 4), premultiplied by
        opacity, or (height, width, 1) in modes of one channel, such as thickness."""
        width, height = self._stage.size()
        values, channels = self._stage.raw()
        return values.reshape(height, width, channels)

    def raw(self) -> npt.NDArray[np.float32]:
        """Old name of :meth:`render_float`."""
        warn_renamed("Renderer.raw", "Renderer.render_float")
        return self.render_float()

    def save(self, path: PathOf) -> None:
        """Renders the picture to a .png or .exr file."""
        self._set_displayed_time()
        self._stage.save(fspath(path))

    def _set_displayed_time(self) -> None:
        """Sets the displayed time of the picture to the simulated time."""
        if self._simulator is not None:
            self._stage.set_displayed_time(self._simulator.time, self._simulator.dt)

    def pick(self, x: float, y: float) -> Pick | None:
        """Picks the boundary at a point of the picture, in pixels from the upper left."""
        found = self._stage.pick(float(x), float(y))
        return None if found is None else Pick(*found)


def render(
    body: BodyLike,
    *,
    field: str | None = None,
    clim: Sequence[float] | None = None,
    cmap: Any = None,
    transfer: Any = None,
    opacity: Any = None,
    size: Sequence[int] | None = None,
    camera: CameraLike | None = None,
    progress: Progress | None = None,
    adapter: str | None = None,
    **picture: Any,
) -> Picture:
    """Renders a picture of a body, identical to that of ``palpate render``.

    A scene with a solver is simulated first, for its number of steps.

    Args:
        body: mesh, body, scene, or path of a file.
        field: rendered field; default: the regions, the first scalar, or the depth below the surface.
        clim: range of the field; values outside are clamped.
        cmap: preset or colour map of matplotlib; same as ``transfer``.
        transfer: :class:`TransferFunction`, name of a preset, or JSON file.
        opacity: opacity over the field's range, as in pyvista's ``add_volume``: ``linear``, ``geom``,
            ``sigmoid``, ``sigmoid_5`` …, ``foreground``, a number or a list of numbers from 0 to 1. It
            refers to a path length of a tenth of the body's extent, in the colours of ``cmap``.
        size: width and height in pixels; default 1024 by 768.
        camera: :class:`Camera`, camera of pyvista, or its ``camera_position``.
        progress: called with the completed fraction of steps.
        adapter: graphics adapter: part of its name, its index, or ``cpu``.
        picture: other keys of ``[picture]`` of a scene (``mode``, ``background``, ``legend``,
            ``hide``, …), ``light`` and ``shadows``, and lists of planes ``clip`` and ``slice`` (a
            point and a normal, six numbers each) and of isosurfaces ``iso`` (values, or tables).

    Returns:
        Shape (height, width, 4), uint8: red, green, blue, opacity.
    """
    renderer = Renderer(
        body,
        adapter=adapter,
        field=field,
        clim=clim,
        cmap=cmap,
        transfer=transfer,
        opacity=opacity,
        size=size,
        camera=camera,
        **picture,
    )
    steps = renderer._stage.steps()
    if steps > 0:
        renderer._stage.run(steps, progress)
        renderer._stage.frame(np.zeros((0, 3)))
    return renderer.render()


def stage_of(scene: Scene, adapter: str | None) -> _palpate.Stage:
    mesh = None if scene.mesh is None else scene.mesh._native
    return _palpate.Stage(scene.json(), fspath(scene.folder), mesh, adapter)


def _count(number: int, what: str) -> int:
    if number < 0 or number != int(number) or number >= 2**32:
        raise InputError(f"{what} must be an integer ≥ 0, got {number}")
    return int(number)
