"""Scenes as dictionaries."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import palpate

ROOT = Path(__file__).resolve().parents[2]


def test_shipped_scenes_round_trip(tmp_path: Path) -> None:
    scenes = sorted((ROOT / "data/scenes").glob("*.toml"))
    assert len(scenes) > 5
    for path in scenes:
        scene = palpate.Scene.read(path)
        scene.write(tmp_path / path.name)
        again = palpate.Scene.read(tmp_path / path.name)
        assert again.entries.keys() == scene.entries.keys(), path


def test_updated_returns_copy(bar: palpate.Body) -> None:
    scene = bar.scene()
    softer = scene.with_({"material.young": 1e3, "solver.dt": 0.01, "pin": None})
    assert scene.entries["material"]["young"] == 3e4 and "pin" in scene.entries
    assert softer.entries["material"] == {"young": 1e3, "density": 1000.0}
    assert softer.entries["solver"]["dt"] == 0.01 and "pin" not in softer.entries
    with pytest.raises(palpate.InputError, match="not a table"):
        scene.with_({"material.young.soft": 1.0})


def test_mesh_in_memory_is_written_beside_scene(bar: palpate.Body, tmp_path: Path) -> None:
    bar.scene().write(tmp_path / "bar.toml")
    scene = palpate.Scene.read(tmp_path / "bar.toml")
    assert (tmp_path / "bar.vtu").is_file()
    assert isinstance(bar.mesh, palpate.Mesh)
    assert np.array_equal(scene.load_mesh().nodes, bar.mesh.nodes)


def test_scene_rejects_invalid_input(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text("[mesh]\ngenerate = \"bar\"\ntest = 5\n")
    with pytest.raises(palpate.FileError, match="line 3"):
        palpate.Scene.read(wrong)
    with pytest.raises(FileNotFoundError):
        palpate.Scene.read(tmp_path / "none.toml")
    with pytest.raises(palpate.InputError, match="`test`"):
        palpate.render(palpate.Scene({"mesh": {"generate": "bar", "test": 5}}))
