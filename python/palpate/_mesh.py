"""Tetrahedral meshes."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _palpate
from ._deprecated import warn_renamed
from ._errors import InputError

#: Callback with the current stage and its completed fraction.
Progress = Callable[[str, float], None]
Points = npt.NDArray[np.float64]
PathOf = str | PathLike[str]

#: VTK cell type of a tetrahedron.
_VTK_TETRA = 10


@dataclass(frozen=True)
class Field:
    """Field at the nodes or in the tets of a mesh.

    Attributes:
        name: name in files.
        in_tets: whether there is one value per tet instead of one per node.
        values: shape (n,) for scalars, (n, components) otherwise.
    """

    name: str
    in_tets: bool
    values: npt.NDArray[Any]


class Mesh:
    """Immutable tetrahedral mesh with fields, regions and a length unit.

    Tets are reoriented to positive volume; degenerate tets, duplicate tets and unused nodes are
    removed. :attr:`notes` lists the repairs.

    Args:
        nodes: node positions, shape (n, 3).
        tets: node indices of each tet, counted from 0, shape (m, 4); or (m, 10) for ten-node tets in the
            order of VTK and meshio, which make a mesh of :attr:`order` 2.
        point_data: fields at the nodes by name, shape (n,) or (n, components).
        cell_data: fields in the tets by name; the field ``label`` holds region labels.
        region_names: names of regions by label.
        length_unit: metres per unit of the mesh, if known.
        frame: frame of reference of ``nodes``, if known: ``"ras"``, or ``"lps"``, which is converted
            to RAS.
    """

    def __init__(
        self,
        nodes: npt.ArrayLike,
        tets: npt.ArrayLike,
        *,
        point_data: Mapping[str, npt.ArrayLike] | None = None,
        cell_data: Mapping[str, npt.ArrayLike] | None = None,
        region_names: Mapping[int, str] | None = None,
        length_unit: float | None = None,
        frame: str | None = None,
    ) -> None:
        given = [(k, False, v) for k, v in (point_data or {}).items()]
        given += [(k, True, v) for k, v in (cell_data or {}).items()]
        fields = []
        for name, in_tets, values in given:
            array = np.asarray(values)
            if array.ndim == 0 or array.dtype.kind not in "fiub":
                raise InputError(f"field {name!r} must be an array of numbers")
            rows = array.reshape(len(array), -1).astype(np.float64)
            fields.append((str(name), in_tets, rows, array.dtype.name))
        self._native = _palpate.Mesh(
            _floats(nodes, "nodes"),
            _integers(tets, "tets"),
            fields,
            {int(k): str(v) for k, v in (region_names or {}).items()},
            length_unit,
            frame,
        )

    @classmethod
    def _of(cls, native: _palpate.Mesh) -> Mesh:
        mesh = cls.__new__(cls)
        mesh._native = native
        return mesh

    @classmethod
    def read(cls, path: PathOf) -> Mesh:
        """Reads a VTK, VTU, Gmsh, TetGen, Medit or Abaqus file; other cells are divided into tets. The
        pieces of a .pvtu are merged. Ten-node tets make a mesh of :attr:`order` 2."""
        return cls._of(_palpate.Mesh.read(fspath(path)))

    @classmethod
    def generate(cls, name: str, tets: int | None = None) -> Mesh:
        """Generates a built-in mesh (see :meth:`generators`) of about ``tets`` tets."""
        return cls._load({"generate": name, "tets": tets}, Path(), None)

    @staticmethod
    def generators() -> list[str]:
        """Returns the names of the mesh generators."""
        return _palpate.generators()

    @classmethod
    def make(
        cls,
        path: PathOf,
        *,
        tets: int | None = None,
        edge: float | str | None = None,
        labels: str | list[int] | None = None,
        progress: Progress | None = None,
        **more: Any,
    ) -> Mesh:
        """Meshes a volume (segmentation, CT, MRI) or a closed surface.

        Args:
            path: file, or folder of DICOM slices.
            tets: approximate number of tets; default 50,000.
            edge: edge length at boundaries, in the file's unit, instead of ``tets``.
            labels: ``"all"``, or the labels that become regions.
            progress: called with the current stage and its completed fraction.
            more: other keys of ``[mesh]`` of a scene: ``above``, ``between``, ``grading``,
                ``min_island``, ``unit``, ``volume`` (one of several in the file, from 0),
                ``frame`` (``"ras"`` or ``"lps"``, for a surface that does not state its own).
        """
        entries = {"file": fspath(path), "tets": tets, "edge": edge, "labels": labels, **more}
        return cls._load(entries, Path(), progress)

    @classmethod
    def _load(cls, entries: Mapping[str, Any], folder: Path, progress: Progress | None) -> Mesh:
        own = {k: v for k, v in entries.items() if v is not None}
        text = json.dumps({"mesh": own})
        return cls._of(_palpate.load_mesh(text, fspath(folder), progress))

    def write(self, path: PathOf, *, pieces: int | None = None) -> list[str]:
        """Writes the mesh in the format of the file extension. Returns the dropped data.

        Args:
            path: file; with ``pieces`` an index, .pvtu.
            pieces: number of pieces, partitioned by a k-d tree; each is a .vtu in the folder of the index that
                can be rendered separately (:func:`palpate.dask.render_pieces`).
        """
        if pieces is None:
            return self._native.write(fspath(path))
        if pieces < 1 or pieces != int(pieces):
            raise InputError(f"pieces must be an integer ≥ 1, got {pieces}")
        _palpate.write_pieces(self._native, fspath(path), int(pieces))
        return []

    @property
    def nodes(self) -> Points:
        """Node positions, shape (n, 3)."""
        return self._native.nodes()

    @property
    def tets(self) -> npt.NDArray[np.uint32]:
        """Node indices of each tet, shape (m, 4)."""
        return self._native.tets()

    @property
    def order(self) -> int:
        """Order of the elements: 1, or 2 for ten-node tets, whose pieces each eight of :attr:`tets` are.
        A mesh of order 2 is written as ten-node tets."""
        return self._native.order()

    @property
    def point_data(self) -> dict[str, npt.NDArray[Any]]:
        """Fields at the nodes, by name."""
        return {f.name: f.values for f in self.fields() if not f.in_tets}

    @property
    def cell_data(self) -> dict[str, npt.NDArray[Any]]:
        """Fields in the tets, by name."""
        return {f.name: f.values for f in self.fields() if f.in_tets}

    def fields(self) -> list[Field]:
        """Returns all fields."""
        fields = []
        for n, (name, in_tets, components, kind) in enumerate(self._native.fields()):
            values = self._native.field(n).astype(kind)
            shape = (-1,) if components == 1 else (-1, components)
            fields.append(Field(name, in_tets, values.reshape(shape)))
        return fields

    @property
    def region_names(self) -> dict[int, str]:
        """Names of regions by label (value of the cell field ``label``)."""
        return self._native.region_names()

    @property
    def length_unit(self) -> float | None:
        """Metres per unit of the mesh, if known."""
        return self._native.length_unit()

    @property
    def frame(self) -> str | None:
        """Frame of reference of the nodes, ``"RAS"``, if known; LPS is converted on reading."""
        return self._native.frame()

    @property
    def notes(self) -> list[str]:
        """Repairs and warnings, one sentence each."""
        return self._native.notes()

    @property
    def volume(self) -> float:
        """Volume, in cubic units of the mesh."""
        return self._native.volume()

    @property
    def bounds(self) -> tuple[list[float], list[float]]:
        """Lower and upper corner of the bounding box."""
        return self._native.bounds()

    def with_nodes(self, nodes: npt.ArrayLike) -> Mesh:
        """Returns a copy of the mesh with these node positions, shape (n, 3)."""
        return Mesh._of(self._native.moved(_floats(nodes, "nodes")))

    def moved(self, nodes: npt.ArrayLike) -> Mesh:
        """Old name of :meth:`with_nodes`."""
        warn_renamed("Mesh.moved", "Mesh.with_nodes")
        return self.with_nodes(nodes)

    @classmethod
    def from_meshio(cls, mesh: Any) -> Mesh:
        """Converts a ``meshio.Mesh``; cells other than tets are dropped. Ten-node tets are converted if
        there are no others."""
        blocks = [n for n, block in enumerate(mesh.cells) if block.type == "tetra"]
        if not blocks:
            blocks = [n for n, block in enumerate(mesh.cells) if block.type == "tetra10"]
        if not blocks:
            kinds = ", ".join(sorted({block.type for block in mesh.cells})) or "none"
            raise InputError(f"the meshio mesh must have cells of type tetra or tetra10, got {kinds}")
        return cls(
            mesh.points,
            np.concatenate([mesh.cells[n].data for n in blocks]),
            point_data=mesh.point_data,
            cell_data={
                name: np.concatenate([np.asarray(values[n]) for n in blocks])
                for name, values in mesh.cell_data.items()
            },
        )

    def to_meshio(self) -> Any:
        """Converts the mesh to a ``meshio.Mesh``."""
        import meshio

        return meshio.Mesh(
            self.nodes,
            [("tetra", self.tets.astype(np.int64))],
            point_data=self.point_data,
            cell_data={name: [values] for name, values in self.cell_data.items()},
        )

    @classmethod
    def from_pyvista(cls, grid: Any) -> Mesh:
        """Converts a ``pyvista.UnstructuredGrid``; cells other than tets are dropped."""
        tets = grid.cells_dict.get(_VTK_TETRA)
        if tets is None or len(tets) == 0:
            raise InputError("the pyvista grid has no tetrahedra; convert it with pyvista's triangulate()")
        own = np.asarray(grid.celltypes) == _VTK_TETRA
        return cls(
            grid.points,
            tets,
            point_data={name: grid.point_data[name] for name in grid.point_data},
            cell_data={name: np.asarray(grid.cell_data[name])[own] for name in grid.cell_data},
        )

    def to_pyvista(self) -> Any:
        """Converts the mesh to a ``pyvista.UnstructuredGrid``."""
        import pyvista

        grid = pyvista.UnstructuredGrid({_VTK_TETRA: self.tets.astype(np.int64)}, self.nodes)
        for field in self.fields():
            (grid.cell_data if field.in_tets else grid.point_data)[field.name] = field.values
        return grid

    def __reduce__(self) -> tuple[Callable[[int, bytes], Mesh], tuple[int, bytes]]:
        return (_unpickled, self._native.to_bytes())

    def __repr__(self) -> str:
        nodes, tets = self._native.counts()
        names = ", ".join(f.name for f in self.fields())
        return f"<palpate.Mesh of {tets} tets and {nodes} nodes; fields: {names or 'none'}>"


def _unpickled(order: int, content: bytes) -> Mesh:
    return Mesh._of(_palpate.Mesh.from_bytes(order, content))


def _floats(values: npt.ArrayLike, what: str) -> Points:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 2:
        raise InputError(f"{what} must have shape (n, 3), got {array.shape}")
    return np.ascontiguousarray(array)


def _integers(values: npt.ArrayLike, what: str) -> npt.NDArray[np.int64]:
    array = np.asarray(values)
    if array.ndim != 2 or array.dtype.kind not in "iu":
        raise InputError(
            f"{what} must be integers of shape (n, 4), got {array.dtype} {array.shape}"
        )
    return np.ascontiguousarray(array, dtype=np.int64)
