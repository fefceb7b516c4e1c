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
from ._errors import InputError

#: Told what is being done, and the fraction of it that is done.
Progress = Callable[[str, float], None]
Points = npt.NDArray[np.float64]
PathOf = str | PathLike[str]

#: meshio's and VTK's number of a tet.
_VTK_TETRA = 10


@dataclass(frozen=True)
class Field:
    """Values at the nodes or in the tets of a mesh.

    Attributes:
        name: as in files.
        in_tets: whether they are one a tet, and not one a node.
        values: shape (n,) of scalars, (n, components) of others.
    """

    name: str
    in_tets: bool
    values: npt.NDArray[Any]


class Mesh:
    """A tetrahedral mesh with fields, regions and a unit; it does not change.

    Tets are turned to positive orientation, flat ones, repeated ones and nodes of no tet are left
    out; :attr:`notes` tells what was.

    Args:
        nodes: positions, shape (n, 3).
        tets: four indices of nodes a tet, counted from 0, shape (m, 4).
        point_data: fields at the nodes by name, shape (n,) or (n, components).
        cell_data: fields in the tets by name; the field ``label`` numbers regions.
        region_names: names of regions by their label.
        length_unit: metres in one unit of the mesh, where that is known.
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
    ) -> None:
        given = [(k, False, v) for k, v in (point_data or {}).items()]
        given += [(k, True, v) for k, v in (cell_data or {}).items()]
        fields = []
        for name, in_tets, values in given:
            array = np.asarray(values)
            if array.ndim == 0 or array.dtype.kind not in "fiub":
                raise InputError(f"field {name!r}: an array of numbers is expected")
            rows = array.reshape(len(array), -1).astype(np.float64)
            fields.append((str(name), in_tets, rows, array.dtype.name))
        self._native = _palpate.Mesh(
            _floats(nodes, "nodes"),
            _integers(tets, "tets"),
            fields,
            {int(k): str(v) for k, v in (region_names or {}).items()},
            length_unit,
        )

    @classmethod
    def _of(cls, native: _palpate.Mesh) -> Mesh:
        mesh = cls.__new__(cls)
        mesh._native = native
        return mesh

    @classmethod
    def read(cls, path: PathOf) -> Mesh:
        """A VTK, VTU, Gmsh, TetGen, Medit or Abaqus file of tets (other cells are cut into tets); of a
        mesh in pieces (.pvtu) all of them, as one."""
        return cls._of(_palpate.Mesh.read(fspath(path)))

    @classmethod
    def generate(cls, name: str, tets: int | None = None) -> Mesh:
        """A mesh that ships as a generator (:meth:`generators` names them), of about ``tets`` tets."""
        return cls._load({"generate": name, "tets": tets}, Path(), None)

    @staticmethod
    def generators() -> list[str]:
        """The names that :meth:`generate` knows."""
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
            path: the file, or a folder of DICOM slices.
            tets: about how many tets; default 50,000.
            edge: how long edges at boundaries are, in the file's unit, in place of ``tets``.
            labels: ``"all"``, or those that become regions.
            progress: told what is being done and the fraction of it that is done.
            more: what else ``[mesh]`` of a scene has: ``above``, ``between``, ``grading``,
                ``min_island``, ``unit``.
        """
        entries = {"file": fspath(path), "tets": tets, "edge": edge, "labels": labels, **more}
        return cls._load(entries, Path(), progress)

    @classmethod
    def _load(cls, entries: Mapping[str, Any], folder: Path, progress: Progress | None) -> Mesh:
        own = {k: v for k, v in entries.items() if v is not None}
        text = json.dumps({"mesh": own})
        return cls._of(_palpate.load_mesh(text, fspath(folder), progress))

    def write(self, path: PathOf, *, pieces: int | None = None) -> list[str]:
        """Writes it in the format of the file's extension. Returns what that has no place for.

        Args:
            path: the file; with ``pieces`` an index, .pvtu.
            pieces: into how many it is cut, along a k-d tree; each is a .vtu beside the index, with
                what it has to know to be drawn by itself (:func:`palpate.dask.render_pieces`).
        """
        if pieces is None:
            return self._native.write(fspath(path))
        if pieces < 1 or pieces != int(pieces):
            raise InputError(f"pieces: a whole number from 1 on is expected, not {pieces}")
        _palpate.write_pieces(self._native, fspath(path), int(pieces))
        return []

    @property
    def nodes(self) -> Points:
        """Positions, shape (n, 3)."""
        return self._native.nodes()

    @property
    def tets(self) -> npt.NDArray[np.uint32]:
        """Four indices of nodes a tet, shape (m, 4)."""
        return self._native.tets()

    @property
    def point_data(self) -> dict[str, npt.NDArray[Any]]:
        """Fields at the nodes, by name."""
        return {f.name: f.values for f in self.fields() if not f.in_tets}

    @property
    def cell_data(self) -> dict[str, npt.NDArray[Any]]:
        """Fields in the tets, by name."""
        return {f.name: f.values for f in self.fields() if f.in_tets}

    def fields(self) -> list[Field]:
        """All fields."""
        fields = []
        for n, (name, in_tets, components, kind) in enumerate(self._native.fields()):
            values = self._native.field(n).astype(kind)
            shape = (-1,) if components == 1 else (-1, components)
            fields.append(Field(name, in_tets, values.reshape(shape)))
        return fields

    @property
    def region_names(self) -> dict[int, str]:
        """Names of regions, by their value in the cell field ``label``."""
        return self._native.region_names()

    @property
    def length_unit(self) -> float | None:
        """Metres in one unit of the mesh, where that is known."""
        return self._native.length_unit()

    @property
    def notes(self) -> list[str]:
        """What was repaired or is odd, a sentence each."""
        return self._native.notes()

    @property
    def volume(self) -> float:
        """Its volume, in cubic units of the mesh."""
        return self._native.volume()

    @property
    def bounds(self) -> tuple[list[float], list[float]]:
        """The lower and the upper corner of its box."""
        return self._native.bounds()

    def moved(self, nodes: npt.ArrayLike) -> Mesh:
        """The same mesh with its nodes elsewhere, shape (n, 3)."""
        return Mesh._of(self._native.moved(_floats(nodes, "nodes")))

    @classmethod
    def from_meshio(cls, mesh: Any) -> Mesh:
        """A ``meshio.Mesh``; its cells that are no tets are left out."""
        blocks = [n for n, block in enumerate(mesh.cells) if block.type == "tetra"]
        if not blocks:
            kinds = ", ".join(sorted({block.type for block in mesh.cells})) or "none"
            raise InputError(f"the meshio mesh has no cells of type tetra ({kinds})")
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
        """As a ``meshio.Mesh``."""
        import meshio

        return meshio.Mesh(
            self.nodes,
            [("tetra", self.tets.astype(np.int64))],
            point_data=self.point_data,
            cell_data={name: [values] for name, values in self.cell_data.items()},
        )

    @classmethod
    def from_pyvista(cls, grid: Any) -> Mesh:
        """A ``pyvista.UnstructuredGrid``; its cells that are no tets are left out."""
        tets = grid.cells_dict.get(_VTK_TETRA)
        if tets is None or len(tets) == 0:
            raise InputError("the pyvista grid has no tetrahedra; see pyvista's triangulate()")
        own = np.asarray(grid.celltypes) == _VTK_TETRA
        return cls(
            grid.points,
            tets,
            point_data={name: grid.point_data[name] for name in grid.point_data},
            cell_data={name: np.asarray(grid.cell_data[name])[own] for name in grid.cell_data},
        )

    def to_pyvista(self) -> Any:
        """As a ``pyvista.UnstructuredGrid``."""
        import pyvista

        grid = pyvista.UnstructuredGrid({_VTK_TETRA: self.tets.astype(np.int64)}, self.nodes)
        for field in self.fields():
            (grid.cell_data if field.in_tets else grid.point_data)[field.name] = field.values
        return grid

    def __reduce__(self) -> tuple[Callable[[bytes], Mesh], tuple[bytes]]:
        return (_unpickled, (self._native.to_bytes(),))

    def __repr__(self) -> str:
        nodes, tets = self._native.counts()
        names = ", ".join(f.name for f in self.fields())
        return f"<palpate.Mesh of {tets} tets and {nodes} nodes; fields: {names or 'none'}>"


def _unpickled(content: bytes) -> Mesh:
    return Mesh._of(_palpate.Mesh.from_bytes(content))


def _floats(values: npt.ArrayLike, what: str) -> Points:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 2:
        raise InputError(f"{what}: an array of shape (n, 3) is expected, not {array.shape}")
    return np.ascontiguousarray(array)


def _integers(values: npt.ArrayLike, what: str) -> npt.NDArray[np.int64]:
    array = np.asarray(values)
    if array.ndim != 2 or array.dtype.kind not in "iu":
        raise InputError(
            f"{what}: whole numbers of shape (n, 4) are expected, not {array.dtype} {array.shape}"
        )
    return np.ascontiguousarray(array, dtype=np.int64)
