"""Scenes: description of a body, its simulation and its picture."""

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
from ._deprecated import warn_renamed
from ._errors import InputError
from ._mesh import Mesh, PathOf
from ._transfer import entry_of, with_opacity

#: Extension of scene files; other files become ``[mesh] file``.
_SCENE = ".toml"


@dataclass(frozen=True)
class Material:
    """Material of a body, in SI units; docs/reference/scene/material.md has the defaults.

    Attributes:
        young: Young's modulus, Pa.
        poisson: Poisson's ratio, for finite elements.
        density: density, kg/m³.
        model: ``neo-hookean``, ``corotated`` or ``springs``.
        volume: volumetric formulation: ``per-tet``, or ``averaged`` for Poisson's ratios near 1/2.
        order: 1 (linear tets) or 2 (quadratic tets, which need far fewer tets for the same error). Of
            ten-node tets in files, 1 uses the corners and 2 the mid-edge nodes, too.
        damping_ratio: damping ratio at the frequency ``damping_hz``; 1 is critical damping.
        damping_hz: reference frequency of ``damping_ratio``, Hz.
        stiffness: stiffness of each spring, N/m, instead of ``young``.
        damping: damping of each spring, N·s/m.
        tissues: regions of other tissues, by tissue name: a list of regions (names or labels), or a
            table with some of ``regions``, ``young``, ``poisson``, ``density`` and ``rigid``.
    """

    young: float | None = None
    poisson: float | None = None
    density: float | None = None
    model: str | None = None
    volume: str | None = None
    order: int | None = None
    damping_ratio: float | None = None
    damping_hz: float | None = None
    stiffness: float | None = None
    damping: float | None = None
    tissues: Mapping[str, Any] = field(default_factory=dict)

    def entries(self) -> dict[str, Any]:
        """Returns the entries of ``[material]`` of a scene."""
        own = {k: v for k, v in self.__dict__.items() if k != "tissues" and v is not None}
        return {**own, **self.tissues}


@dataclass(frozen=True)
class Body:
    """A mesh with its material, supports and loads.

    Attributes:
        mesh: mesh, or path of a mesh, a volume or a surface.
        material: material of the body.
        pin: regions of fixed nodes, each with the keys of ``[[pin]]`` of a scene:
            ``{"axis": "z", "below": 0.05}`` is the lowest 5 %.
        force: forces distributed over regions of nodes: ``{"on": {...}, "total": [x, y, z]}``, N.
        gravity: gravity, m/s²; default: chosen from the stiffness without other loads, else the earth's.
        unit: length unit of the mesh: ``"mm"``, or metres as a number.
        entries: other entries of a scene.
    """

    mesh: Mesh | PathOf
    material: Material = Material()
    pin: Sequence[Mapping[str, Any]] = ()
    force: Sequence[Mapping[str, Any]] = ()
    gravity: Sequence[float] | None = None
    unit: str | float | None = None
    entries: Mapping[str, Any] = field(default_factory=dict)

    def scene(self) -> Scene:
        """Returns the scene of this body."""
        scene = Scene.from_any(self.mesh)
        own: dict[str, Any] = {
            "material": self.material.entries(),
            "pin": list(self.pin) or None,
            "force": list(self.force) or None,
            "solver.gravity": self.gravity,
            "mesh.unit": self.unit,
        }
        return scene.updated(own).updated(self.entries)


class Scene:
    """Entries of a scene file as a dictionary of dictionaries, optionally with a mesh in memory.

    Args:
        entries: entries of a scene file (see ``docs/reference/scene/``), by table.
        folder: folder of relative paths; default: the current folder.
        mesh: mesh in memory, instead of that of ``[mesh]``.
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
        """Reads a scene file."""
        file = Path(path)
        return Scene(json.loads(_palpate.read_toml(fspath(file))), folder=file.parent)

    @staticmethod
    def from_any(body: BodyLike) -> Scene:
        """Converts a mesh, a body, a scene or the path of a file to a scene."""
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
            "expected a palpate.Mesh, Body or Scene, or the path of a file, got "
            f"{type(body).__name__}"
        )

    @staticmethod
    def of(body: BodyLike) -> Scene:
        """Old name of :meth:`from_any`."""
        warn_renamed("Scene.of", "Scene.from_any")
        return Scene.from_any(body)

    def with_(self, changes: Mapping[str, Any]) -> Scene:
        """Old name of :meth:`updated`."""
        warn_renamed("Scene.with_", "Scene.updated")
        return self.updated(changes)

    def updated(self, changes: Mapping[str, Any]) -> Scene:
        """Returns a copy with changed entries, by dotted names:
        ``scene.updated({"material.muscle.young": 3e4, "solver.dt": None})``; ``None`` removes an entry,
        a dictionary is merged into the existing table.
        """
        scene = Scene(self.entries, folder=self.folder, mesh=self.mesh)
        for name, value in changes.items():
            table = scene.entries
            *tables, last = name.split(".")
            for part in tables:
                inner = table.setdefault(part, {})
                if not isinstance(inner, dict):
                    raise InputError(f"{name}: {part} is not a table in this scene")
                table = inner
            if value is None:
                table.pop(last, None)
            elif isinstance(value, Mapping) and isinstance(table.get(last, {}), dict):
                table[last] = {**table.get(last, {}), **copy.deepcopy(dict(value))}
            else:
                table[last] = copy.deepcopy(value)
        return scene

    def write(self, path: PathOf) -> None:
        """Writes a scene file; a mesh in memory is written to a ``.vtu`` file in its folder."""
        file = Path(path)
        scene = self.in_files(file.parent, f"{file.stem}.vtu")
        text = _palpate.to_toml(scene.json())
        part = file.with_name(f".{file.name}.part")
        part.write_text(text, encoding="utf-8")
        part.replace(file)

    def in_files(self, folder: PathOf, name: str = "mesh.vtu") -> Scene:
        """Returns a copy with absolute paths; a mesh in memory is written to a file in ``folder``."""
        entries = _absolute(self.entries, self.folder)
        if self.mesh is not None:
            file = Path(folder).resolve() / name
            self.mesh.write(file)
            entries.setdefault("mesh", {})["file"] = fspath(file)
        return Scene(entries, folder=folder)

    def load_mesh(self) -> Mesh:
        """Loads the mesh: reads it, generates it, or meshes a volume or surface."""
        if self.mesh is not None:
            return self.mesh
        return Mesh._load(self.entries.get("mesh", {}), self.folder, None)

    def json(self) -> str:
        """Returns the entries as JSON."""
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
    """Returns the changes of a scene (see :meth:`Scene.updated`) for the arguments of a picture."""
    if cmap is not None and transfer is not None:
        raise InputError("cmap and transfer are both given; remove one of them")
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
        # The range belongs to the scene's own field.
        changes["picture.range"] = None
    if camera is not None:
        changes["camera"] = Camera.from_any(camera).entries()
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
    """Converts numpy values and paths to JSON types, and drops None."""
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
    """Makes strings absolute that are the path of a file in ``folder``."""
    if isinstance(value, Mapping):
        return {k: _absolute(v, folder) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_absolute(v, folder) for v in value]
    if isinstance(value, (str, PathLike)) and "{" not in str(value):
        path = folder / value
        if path.suffix and path.is_file():
            return fspath(path.resolve())
    return value
