"""Meshes of ten-node tets."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

import palpate

#: Corners, then the middles of the edges 01, 12, 20, 03, 13 and 23, all curved.
NODES = np.array(
    [
        [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1],
        [0.5, -0.05, 0], [0.55, 0.55, 0], [-0.05, 0.5, 0], [0, -0.05, 0.5], [0.5, 0, 0.55], [0, 0.55, 0.5],
    ]
)  # fmt: skip
#: The order of Gmsh in that of VTK.
OF_GMSH = [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]


def curved() -> palpate.Mesh:
    return palpate.Mesh(NODES, np.arange(10)[np.newaxis], cell_data={"label": [7]}, length_unit=0.1)


def test_ten_node_tets_make_a_mesh_of_order_2(tmp_path: Path) -> None:
    mesh = curved()
    assert mesh.order == 2
    assert np.array_equal(mesh.nodes, NODES)
    assert mesh.tets.shape == (8, 4)
    assert mesh.cell_data["label"].tolist() == [7] * 8
    for name in ("a.vtu", "a.vtk", "a.msh", "a.mesh", "a.inp"):
        mesh.write(tmp_path / name)
        read = palpate.Mesh.read(tmp_path / name)
        assert read.order == 2
        assert np.array_equal(read.tets, mesh.tets)
        assert np.allclose(read.nodes, NODES, rtol=0, atol=1e-14)
    again = pickle.loads(pickle.dumps(mesh))
    assert again.order == 2
    assert np.array_equal(again.tets, mesh.tets)


def test_meshio_tets_keep_their_middles(tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio")
    cells = np.arange(10)[np.newaxis]
    mesh = palpate.Mesh.from_meshio(meshio.Mesh(NODES, [("tetra10", cells)]))
    assert np.array_equal(mesh.tets, curved().tets)
    meshio.Mesh(NODES, [("tetra10", cells)]).write(tmp_path / "m.vtu")
    assert np.array_equal(palpate.Mesh.read(tmp_path / "m.vtu").tets, curved().tets)
    swapped = palpate.Mesh(NODES, cells[:, OF_GMSH])
    assert not np.array_equal(swapped.tets, curved().tets)


def test_order_1_of_a_file_is_its_corners(tmp_path: Path) -> None:
    curved().write(tmp_path / "a.vtu")
    for order, nodes in ((1, 4), (2, 10)):
        scene = {
            "mesh": {"file": str(tmp_path / "a.vtu")},
            "material": {"model": "neo-hookean", "order": order},
        }
        simulator = palpate.Simulator(palpate.Scene(scene), engine="cpu")
        assert len(simulator.mesh.nodes) == nodes
        assert any("--order 2" in note for note in simulator.notes) == (order == 1)
