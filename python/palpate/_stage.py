"""Bodies that move, and pictures of them."""

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
from ._errors import InputError
from ._mesh import Mesh, PathOf, Points, Progress, _floats
from ._scene import BodyLike, Scene, picture_entries

Picture = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Pick:
    """What a pixel shows of a body's boundary.

    Attributes:
        node: the nearest node.
        tet: the tet whose face is seen.
        face: which of its faces, opposite corner 0 to 3.
        point: where, in the mesh's unit.
        distance: how far from the eye, in the mesh's unit.
    """

    node: int
    tet: int
    face: int
    point: tuple[float, float, float]
    distance: float


@dataclass(frozen=True)
class Reaction:
    """What a body exerts on something that holds it or presses on it.

    Attributes:
        force: N, shape (3,).
        moment: N·m, shape (3,): about the origin, of tools about their middle.
    """

    force: Points
    moment: Points


class Grab:
    """Nodes that were taken hold of; see :meth:`Simulator.grab`."""

    def __init__(self, stage: _palpate.Stage, native: _palpate.Grab) -> None:
        self._stage = stage
        self._native = native

    def move_to(self, target: Sequence[float]) -> None:
        """Moves what it follows; the nodes come after with the next step."""
        x, y, z = (float(v) for v in target)
        self._stage.set_target(self._native, (x, y, z))

    def release(self) -> int:
        """Lets go. How many nodes these were."""
        return self._stage.release(self._native)


class Simulator:
    """A body that moves.

    Args:
        body: what is simulated.
        solver: ``implicit``, ``explicit``, ``symplectic``, ``verlet``, ``velocity-verlet``, and of
            elements on the processor ``bdf2`` and ``midpoint``; default: the scene's, or implicit.
        engine: ``gpu``, ``cpu``, or ``auto``, which takes a GPU where there is one.
        dt: the step, s; default: what suits the scheme.
        gravity: m/s².
        adapter: which graphics adapter: a part of its name, its index, or ``cpu``.
    """

    def __init__(
        self,
        body: BodyLike,
        *,
        solver: str | None = None,
        engine: str | None = None,
        dt: float | None = None,
        gravity: Sequence[float] | None = None,
        adapter: str | None = None,
    ) -> None:
        scene = Scene.of(body)
        named = scene.entries.get("solver", {}).get("name")
        given = {"name": solver or named or "implicit", "engine": engine, "dt": dt, "gravity": gravity}
        own = {f"solver.{name}": v for name, v in given.items() if v is not None}
        self.scene = scene.with_(own)
        self._stage = stage_of(self.scene, adapter)

    @property
    def notes(self) -> list[str]:
        """What was assumed, a sentence each."""
        return self._stage.notes()

    @property
    def mesh(self) -> Mesh:
        """The mesh at rest, as cuts have left it."""
        return Mesh._of(self._stage.mesh())

    @property
    def deformed(self) -> Mesh:
        """The mesh where it is now, with the fields ``displacement`` and ``velocity``."""
        return Mesh._of(self._stage.deformed_mesh())

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self._stage.time()[0]

    @property
    def dt(self) -> float:
        """The step, s."""
        dt = self._stage.time()[1]
        assert dt is not None
        return dt

    @property
    def engine(self) -> str:
        """What computes the steps: ``gpu`` or ``cpu``."""
        return self._stage.engine()[0]

    @property
    def solver(self) -> str:
        """By which scheme it steps."""
        return self._stage.engine()[1]

    def advance(self, steps: int = 1, progress: Progress | None = None) -> None:
        """Does ``steps`` steps. Ctrl-C, or what ``progress`` raises, ends it between two steps; those
        that are done stay done.

        Raises:
            SolverError: a step failed; the last good state stays.
        """
        self._stage.run(_count(steps, "steps"), progress)

    @property
    def positions(self) -> Points:
        """Where the nodes are, in the mesh's unit, shape (n, 3): a copy."""
        return self._stage.positions()

    @positions.setter
    def positions(self, positions: npt.ArrayLike) -> None:
        self._stage.pose(_floats(positions, "positions"))

    @property
    def velocities(self) -> Points:
        """Velocities of the nodes, in the mesh's unit a second, shape (n, 3): a copy."""
        return self._stage.velocities()

    @velocities.setter
    def velocities(self, velocities: npt.ArrayLike) -> None:
        self._stage.set_velocities(_floats(velocities, "velocities"))

    @property
    def masses(self) -> npt.NDArray[np.float64]:
        """Mass of every node that is simulated, kg."""
        return self._stage.masses()

    def forces(self) -> Points:
        """The force on every node, N, shape (n, 3), but for that of what holds nodes still; of a body
        on the processor. NaN on nodes of rigid regions."""
        return self._stage.forces()

    def set_forces(self, forces: npt.ArrayLike) -> None:
        """Forces from outside on every node, N, shape (n, 3), from the next step on."""
        self._stage.set_forces(_floats(forces, "forces"))

    def set_gravity(self, gravity: Sequence[float]) -> None:
        """Gravity, m/s², from the next step on."""
        x, y, z = (float(v) for v in gravity)
        self._stage.set_gravity((x, y, z))

    def field(self, name: str, at_nodes: bool = False) -> npt.NDArray[np.float64]:
        """``displacement`` (the mesh's unit), ``von_mises``, ``stress_1`` to ``stress_3`` (Pa),
        ``strain``, ``J`` or ``energy_density`` (J/m³) where the body is: one a tet, or one a node."""
        return self._stage.field(name, at_nodes)

    def pin(self, nodes: npt.ArrayLike) -> None:
        """Has nodes stay where they are."""
        array = np.asarray(nodes)
        if array.dtype.kind not in "iu":
            raise InputError(f"nodes: whole numbers are expected, not {array.dtype}")
        if array.size and array.min() < 0:
            raise InputError("nodes: they are counted from 0")
        self._stage.pin([int(n) for n in array.ravel()])

    def grab(
        self,
        centre: Sequence[float],
        radius: float,
        *,
        spring: float | None = None,
        limit: float = float("inf"),
    ) -> Grab:
        """Takes hold of the nodes within ``radius`` of ``centre``: they follow exactly, or with
        ``spring`` (N/m) are pulled by at most ``limit`` (N)."""
        x, y, z = (float(v) for v in centre)
        pull = None if spring is None else (float(spring), float(limit))
        return Grab(self._stage, self._stage.grab((x, y, z), float(radius), pull))

    def cut(self, edges: Sequence[Sequence[Sequence[float]]]) -> bool:
        """Cuts the body along what a straight edge sweeps as it goes from one pair of ends to the
        next: ``edges`` has shape (k, 2, 3). Whether anything was cut."""
        array = np.asarray(edges, dtype=np.float64)
        if array.ndim != 3 or array.shape[1:] != (2, 3):
            raise InputError(f"edges: shape (k, 2, 3) is expected, not {array.shape}")
        return self._stage.cut(array.tolist())

    def restart(self) -> None:
        """Puts the body back to where it rested; what acts on it stays."""
        self._stage.restart()

    def report(self) -> dict[str, Any]:
        """Energies (J), the ratio of volumes, the largest displacement, tets turned inside out."""
        report: dict[str, Any] = json.loads(self._stage.report())
        return report

    def reactions(self) -> dict[str, Reaction]:
        """What the body exerts on each of its pins, moves, grabs and tools."""
        return {
            name: Reaction(np.array(force), np.array(moment))
            for name, force, moment in self._stage.reactions()
        }

    def __repr__(self) -> str:
        engine, solver = self._stage.engine()
        return f"<palpate.Simulator, {solver} on the {engine}, at {self.time:.4g} s>"


class Renderer:
    """Pictures of a body, one after the other.

    Args:
        body: what is drawn; a :class:`Simulator` is drawn where it is.
        adapter: which graphics adapter, where there is no simulator yet.
        picture: as :func:`render` has them.
    """

    def __init__(
        self, body: BodyLike | Simulator, *, adapter: str | None = None, **picture: Any
    ) -> None:
        changes = picture_entries(**picture)
        self._simulator = body if isinstance(body, Simulator) else None
        if isinstance(body, Simulator):
            self._stage = body._stage
            self.scene = body.scene.with_(changes)
            self._notes = self._stage.set_looks(self.scene.json(), fspath(self.scene.folder))
            if "picture.size" in changes:
                self._stage.set_size(changes["picture.size"])
            if "camera" in changes:
                self.camera = Camera(**changes["camera"])
        else:
            self.scene = Scene.of(body).with_(changes)
            self._stage = stage_of(self.scene, adapter)
            self._notes = self._stage.notes()

    @property
    def notes(self) -> list[str]:
        """What was assumed, a sentence each."""
        return self._notes

    @property
    def camera(self) -> Camera:
        """The view; a :class:`Camera` or one of pyvista's may be set."""
        eye, look_at, up, fov, height = self._stage.camera()
        return Camera(eye, look_at, up, 30.0 if fov is None else fov, height)

    @camera.setter
    def camera(self, camera: CameraLike) -> None:
        own = Camera.of(camera)
        fov = own.fov if own.orthographic is None else None
        up = self._stage.camera()[2] if own.up is None else own.up
        self._stage.set_camera((own.eye, own.look_at, up, fov, own.orthographic))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        width, height = self._stage.size()
        return (width, height)

    @size.setter
    def size(self, size: Sequence[int]) -> None:
        width, height = size
        self._stage.set_size((_count(width, "width"), _count(height, "height")))

    @property
    def shown(self) -> tuple[str, tuple[float, float]]:
        """The field that is seen, and its range."""
        return self._stage.shown()

    def set_positions(self, positions: npt.ArrayLike) -> None:
        """Puts the nodes where another program has them, shape (n, 3), in the mesh's unit."""
        self._stage.pose(_floats(positions, "positions"))

    def render(self) -> Picture:
        """The picture, shape (height, width, 4): red, green, blue and opacity, as in a PNG."""
        self._tell_time()
        width, height = self._stage.size()
        return self._stage.rgba().reshape(height, width, 4)

    def raw(self) -> npt.NDArray[np.float32]:
        """The picture's values as in an EXR, shape (height, width, 4), premultiplied by opacity; or
        (height, width, 1) of lengths and the like."""
        width, height = self._stage.size()
        values, channels = self._stage.raw()
        return values.reshape(height, width, channels)

    def save(self, path: PathOf) -> None:
        """Draws the picture into a .png or .exr file."""
        self._tell_time()
        self._stage.save(fspath(path))

    def _tell_time(self) -> None:
        """Has the picture tell the simulator's time to a step."""
        if self._simulator is not None:
            self._stage.tell_time(self._simulator.time, self._simulator.dt)

    def pick(self, x: float, y: float) -> Pick | None:
        """What of the boundary is seen at a point of the picture, in pixels from its upper left."""
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
    """The picture that ``palpate render`` makes of a body: the same bytes.

    A scene with a solver is simulated first, for as many steps as it says.

    Args:
        body: a mesh, a body, a scene, or the path of a file.
        field: the field that is seen; default: the regions, the first scalar, or the depth below
            the surface.
        clim: its smallest and largest value, which stand for what is beyond them.
        cmap: a transfer function that ships, or a colour map of matplotlib; the same as ``transfer``.
        transfer: a :class:`TransferFunction`, the name of one that ships, or a JSON file.
        opacity: as pyvista's ``add_volume`` has it, over the field's range: ``linear``, ``geom``,
            ``sigmoid``, ``sigmoid_5`` …, ``foreground``, a number or a list of numbers from 0 to 1. It
            is what a way of a tenth of the body's extent hides, in the colours of ``cmap``.
        size: width and height in pixels; default 1024 by 768.
        camera: a :class:`Camera`, a camera of pyvista's, or its ``camera_position``.
        progress: told of steps, as a fraction.
        adapter: which graphics adapter: a part of its name, its index, or ``cpu``.
        picture: anything that ``[picture]`` of a scene has (``mode``, ``background``, ``legend``,
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
        raise InputError(f"{what}: a whole number from 0 on is expected, not {number}")
    return int(number)
