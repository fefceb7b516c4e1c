"""Scenes: everything that a picture or a motion is made of."""

from __future__ import annotations

import copy
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Union

import numpy as np

from . import _palpate
from ._camera import Camera, CameraLike
from ._errors import InputError
from ._mesh import Mesh, PathOf
from ._transfer import entry_of, with_opacity

#: Files that hold a mesh, a volume or a surface under ``[mesh] file``.
_SCENE = ".toml"


@dataclass(frozen=True)
class Material:
    """What a body is made of, in SI units; what is left out is chosen as the guide tells.

    Attributes:
        young: Young's modulus, Pa.
        poisson: Poisson's ratio, of elements.
        density: kg/m³.
        model: ``neo-hookean``, ``corotated`` or ``springs``.
        volume: ``averaged`` where Poisson's ratio nears 1/2, or ``per-tet``.
        damping_ratio: 1 just does not swing, at the frequency ``damping_hz``.
        damping_hz: Hz.
        stiffness: of every spring, N/m, in place of ``young``.
        damping: of every spring, N·s/m.
        tissues: regions made of something else, by tissue: a list of regions (names or labels), or a
            table with some of ``regions``, ``young``, ``poisson``, ``density`` and ``rigid``.
    """

    young: float | None = None
    poisson: float | None = None
    density: float | None = None
    model: str | None = None
    volume: str | None = None
    damping_ratio: float | None = None
    damping_hz: float | None = None
    stiffness: float | None = None
    damping: float | None = None
    tissues: Mapping[str, Any] = field(default_factory=dict)

    def entries(self) -> dict[str, Any]:
        """What stands in ``[material]`` of a scene."""
        own = {k: v for k, v in self.__dict__.items() if k != "tissues" and v is not None}
        return {**own, **self.tissues}


@dataclass(frozen=True)
class Body:
    """A mesh, what it is made of, and what holds and pulls it.

    Attributes:
        mesh: a mesh, or the path of a mesh, a volume or a surface.
        material: its material.
        pin: groups of nodes that stay where they are, each as ``[[pin]]`` of a scene has them:
            ``{"axis": "z", "below": 0.05}`` is the lowest 5 %.
        force: forces shared by groups of nodes: ``{"on": {...}, "total": [x, y, z]}``, N.
        gravity: m/s²; default: what the guide tells.
        unit: what one unit of the mesh is: ``"mm"``, or metres as a number.
        entries: anything else that a scene has.
    """

    mesh: Mesh | PathOf
    material: Material = Material()
    pin: Sequence[Mapping[str, Any]] = ()
    force: Sequence[Mapping[str, Any]] = ()
    gravity: Sequence[float] | None = None
    unit: str | float | None = None
    entries: Mapping[str, Any] = field(default_factory=dict)

    def scene(self) -> Scene:
        """The scene of this body alone."""
        scene = Scene.of(self.mesh)
        own: dict[str, Any] = {
            "material": self.material.entries(),
            "pin": list(self.pin) or None,
            "force": list(self.force) or None,
            "solver.gravity": self.gravity,
            "mesh.unit": self.unit,
        }
        return scene.with_(own).with_(self.entries)


class Scene:
    """The entries of a scene file, as a dictionary of dictionaries, and a mesh of its own if it has
    one in memory.

    Args:
        entries: as in a scene file (``docs/guide.md`` has them), by table.
        folder: what paths in it are relative to; default: where Python was started.
        mesh: a mesh in place of that of ``[mesh]``.
    """

    def __init__(
        self,
        entries: Mapping[str, Any] | None = None,
        *,
        folder: PathOf | None = None,
        mesh: Mesh | None = None,
    ) -> None:
        self.entries: dict[str, Any] = copy.deepcopy(dict(entries or {}))
        self.folder = Path(folder or "")
        self.mesh = mesh

    @staticmethod
    def read(path: PathOf) -> Scene:
        """A scene file."""
        file = Path(path)
        return Scene(json.loads(_palpate.read_toml(fspath(file))), folder=file.parent)

    @staticmethod
    def of(body: BodyLike) -> Scene:
        """The scene of whatever is a body."""
        if isinstance(body, Scene):
            return body
        if isinstance(body, Body):
            return body.scene()
        if isinstance(body, Mesh):
            return Scene(mesh=body)
        if isinstance(body, (str, PathLike)):
            path = Path(body)
            if path.suffix.lower() == _SCENE:
                return Scene.read(path)
            return Scene({"mesh": {"file": fspath(path)}})
        raise InputError(
            "a palpate.Mesh, Body or Scene, or the path of a file, is expected, not "
            f"{type(body).__name__}"
        )

    def with_(self, changes: Mapping[str, Any]) -> Scene:
        """The same scene with some entries changed, by dotted names:
        ``scene.with_({"material.muscle.young": 3e4, "solver.dt": None})``; ``None`` leaves an entry
        out, a dictionary is laid over what is there.
        """
        scene = Scene(self.entries, folder=self.folder, mesh=self.mesh)
        for name, value in changes.items():
            table = scene.entries
            *tables, last = name.split(".")
            for part in tables:
                inner = table.setdefault(part, {})
                if not isinstance(inner, dict):
                    raise InputError(f"{name}: {part} is no table in this scene")
                table = inner
            if value is None:
                table.pop(last, None)
            elif isinstance(value, Mapping) and isinstance(table.get(last, {}), dict):
                table[last] = {**table.get(last, {}), **copy.deepcopy(dict(value))}
            else:
                table[last] = copy.deepcopy(value)
        return scene

    def write(self, path: PathOf) -> None:
        """Writes a scene file; a mesh in memory becomes a ``.vtu`` file beside it."""
        file = Path(path)
        scene = self.in_files(file.parent, f"{file.stem}.vtu")
        text = _palpate.to_toml(scene.json())
        part = file.with_name(f".{file.name}.part")
        part.write_text(text, encoding="utf-8")
        part.replace(file)

    def in_files(self, folder: PathOf, name: str = "mesh.vtu") -> Scene:
        """The same scene with its mesh in a file of ``folder``, if it has one in memory, and paths
        that are found from anywhere."""
        entries = _absolute(self.entries, self.folder)
        if self.mesh is not None:
            file = Path(folder).resolve() / name
            self.mesh.write(file)
            entries.setdefault("mesh", {})["file"] = fspath(file)
        return Scene(entries, folder=folder)

    def load_mesh(self) -> Mesh:
        """Its mesh: read, generated or made of a volume or surface."""
        if self.mesh is not None:
            return self.mesh
        return Mesh._load(self.entries.get("mesh", {}), self.folder, None)

    def json(self) -> str:
        """Its entries as JSON."""
        return json.dumps(_plain(self.entries))

    def __repr__(self) -> str:
        return f"<palpate.Scene: {', '.join(self.entries) or 'no entries'}; mesh: {self.mesh!r}>"


BodyLike = Union[Mesh, Body, Scene, PathOf]


def picture_entries(
    *,
    field: str | None = None,
    clim: Sequence[float] | None = None,
    cmap: Any = None,
    transfer: Any = None,
    opacity: Any = None,
    size: Sequence[int] | None = None,
    camera: CameraLike | None = None,
    light: Any = None,
    shadows: float | None = None,
    clip: Sequence[Sequence[float]] = (),
    slice: Sequence[Sequence[float]] = (),
    iso: Sequence[Any] = (),
    **picture: Any,
) -> dict[str, Any]:
    """Changes of a scene (see :meth:`Scene.with_`) for the arguments that pictures take."""
    if cmap is not None and transfer is not None:
        raise InputError("give either cmap or transfer")
    shown = cmap if transfer is None else transfer
    if opacity is not None:
        shown = with_opacity(shown, opacity)
    given: dict[str, Any] = {
        "field": field,
        "range": None if clim is None else [float(v) for v in clim],
        "transfer": None if shown is None else entry_of(shown),
        "size": None if size is None else [int(n) for n in size],
        **picture,
    }
    changes = {f"picture.{name}": v for name, v in given.items() if v is not None}
    if field is not None and clim is None:
        # That of the scene's own field.
        changes["picture.range"] = None
    if camera is not None:
        changes["camera"] = Camera.of(camera).entries()
    changes.update({k: v for k, v in [("light.from", light), ("light.shadows", shadows)] if v is not None})
    planes = [{"clip": list(p)} for p in clip] + [{"slice": list(p)} for p in slice]
    if planes:
        changes["plane"] = planes
    if iso:
        changes["isosurface"] = [
            i if isinstance(i, Mapping) else {"value": float(i)} for i in iso
        ]
    return changes


def _plain(value: Any) -> Any:
    """Without what JSON does not know: numpy's numbers and arrays, paths, nothing."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items() if v is not None}
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, PathLike):
        return fspath(value)
    return value


def _absolute(value: Any, folder: Path) -> Any:
    """With strings that are the path of a file in ``folder`` made absolute."""
    if isinstance(value, Mapping):
        return {k: _absolute(v, folder) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_absolute(v, folder) for v in value]
    if isinstance(value, (str, PathLike)) and "{" not in str(value):
        path = folder / value
        if path.suffix and path.is_file():
            return fspath(path.resolve())
    return value
