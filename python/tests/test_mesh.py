"""Meshes: numpy, files, meshio, pyvista, errors."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

import palpate


def test_mesh_arrays_round_trip() -> None:
    nodes = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], dtype=np.float32)
    tets = np.array([[0, 1, 2, 3], [1, 2, 3, 4]], dtype=np.int32)
    mesh = palpate.Mesh(
        nodes,
        tets,
        point_data={"T": np.arange(5.0), "u": np.ones((5, 3), np.float32)},
        cell_data={"label": np.array([3, 7], np.int16)},
        region_names={3: "fat"},
        length_unit=1e-3,
    )
    assert np.array_equal(mesh.nodes, nodes) and mesh.tets.shape == (2, 4)
    assert mesh.point_data["T"].dtype == np.float64 and mesh.point_data["u"].shape == (5, 3)
    assert mesh.point_data["u"].dtype == np.float32
    assert mesh.cell_data["label"].tolist() == [3, 7] and mesh.cell_data["label"].dtype == np.int16
    assert mesh.region_names == {3: "fat"} and mesh.length_unit == 1e-3
    # The second tet comes turned inside out, and is mended.
    corners = mesh.nodes[mesh.tets]
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6
    assert (volumes > 0).all() and np.isclose(volumes.sum(), mesh.volume)


def test_pickle_round_trips(limb: palpate.Mesh) -> None:
    other = pickle.loads(pickle.dumps(limb))
    assert np.array_equal(other.nodes, limb.nodes) and np.array_equal(other.tets, limb.tets)
    assert other.region_names == limb.region_names
    for name, values in limb.cell_data.items():
        assert np.array_equal(other.cell_data[name], values)


@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".msh", ".mesh"])
def test_files_match_command_line(
    suffix: str, limb: palpate.Mesh, limb_file: Path, tmp_path: Path, run
) -> None:
    limb.write(tmp_path / f"ours{suffix}")
    run("convert", limb_file, tmp_path / f"theirs{suffix}")
    ours, theirs = (tmp_path / f"{who}{suffix}" for who in ("ours", "theirs"))
    assert ours.read_bytes() == theirs.read_bytes()


def test_meshio_and_pyvista_round_trip(limb: palpate.Mesh) -> None:
    for other in (
        palpate.Mesh.from_meshio(limb.to_meshio()),
        palpate.Mesh.from_pyvista(limb.to_pyvista()),
    ):
        assert np.array_equal(other.nodes, limb.nodes) and np.array_equal(other.tets, limb.tets)
        assert set(other.point_data) == set(limb.point_data)
        assert np.array_equal(other.cell_data["label"], limb.cell_data["label"])


def test_real_files_match_meshio_and_pyvista(data: Path) -> None:
    import meshio
    import pyvista

    tried = 0
    for path in sorted((data / "tet").rglob("*.vt[ku]")):
        try:
            theirs = meshio.read(path)
        except Exception:
            # What it cannot read, pyvista can.
            grid = pyvista.read(path)
            if not isinstance(grid, pyvista.UnstructuredGrid) or 10 not in grid.cells_dict:
                continue
            mesh = palpate.Mesh.from_pyvista(grid)
        else:
            if "tetra" not in {block.type for block in theirs.cells}:
                continue
            mesh = palpate.Mesh.from_meshio(theirs)
        ours = palpate.Mesh.read(path)
        if len(ours.tets) != len(mesh.tets):
            # Other cells were cut into tets.
            continue
        tried += 1
        assert np.isclose(ours.volume, mesh.volume, rtol=1e-6), path
        assert set(mesh.point_data) <= set(ours.point_data), path
    assert tried >= 3


def test_mesh_rejects_invalid_input(tmp_path: Path) -> None:
    with pytest.raises(palpate.InputError, match="node 9, but there are only 4"):
        palpate.Mesh(np.eye(4)[:, :3], [[0, 1, 2, 9]])
    with pytest.raises(palpate.InputError, match="node indices must be ≥ 0"):
        palpate.Mesh(np.eye(4)[:, :3], [[0, 1, 2, -1]])
    with pytest.raises(ValueError, match="shape"):
        palpate.Mesh(np.zeros(3), [[0, 1, 2, 3]])
    with pytest.raises(palpate.InputError, match='field "T" has 3 values'):
        palpate.Mesh(np.eye(4)[:, :3], [[0, 1, 2, 3]], point_data={"T": [1.0, 2.0, 3.0]})
    with pytest.raises(FileNotFoundError):
        palpate.Mesh.read(tmp_path / "nothing.vtu")
    damaged = tmp_path / "damaged.vtu"
    damaged.write_text("<VTKFile")
    with pytest.raises(palpate.FileError, match="damaged.vtu"):
        palpate.Mesh.read(damaged)
    with pytest.raises(palpate.InputError, match="no generator|generat"):
        palpate.Mesh.generate("elephant")


def test_segmentation_is_meshed() -> None:
    root = Path(__file__).resolve().parents[2]
    seen: list[str] = []
    mesh = palpate.Mesh.make(
        root / "data/knee.nrrd", labels="all", tets=4000, progress=lambda what, _: seen.append(what)
    )
    assert 2000 < len(mesh.tets) < 12000 and "femur bone" in mesh.region_names.values() and seen
    with pytest.raises(RuntimeError, match="enough"):
        palpate.Mesh.make(root / "data/knee.nrrd", tets=40000, progress=stop)


def stop(what: str, share: float) -> None:
    raise RuntimeError("enough")


def test_pieces_read_in_vtk_and_round_trip(limb: palpate.Mesh, tmp_path: Path) -> None:
    pyvista = pytest.importorskip("pyvista")
    index = tmp_path / "limb.pvtu"
    limb.write(index, pieces=5)
    theirs = pyvista.read(index)
    own = theirs.cell_data["vtkGhostType"] == 0
    assert own.sum() == len(limb.tets) < theirs.n_cells
    # Each tet is some piece's own, once, where it is in the whole.
    numbers = theirs.cell_data["GlobalElementIds"][own]
    assert np.array_equal(np.sort(numbers), np.arange(len(limb.tets)))
    centres = theirs.cell_centers().points[own]
    assert np.allclose(centres, limb.nodes[limb.tets].mean(axis=1)[numbers])
    again = palpate.Mesh.read(index)
    assert np.array_equal(again.nodes, limb.nodes) and np.array_equal(again.tets, limb.tets)
    assert {f.name for f in again.fields()} == {f.name for f in limb.fields()}
