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
    softer = scene.updated({"material.young": 1e3, "solver.dt": 0.01, "pin": None})
    assert scene.entries["material"]["young"] == 3e4 and "pin" in scene.entries
    assert softer.entries["material"] == {"young": 1e3, "density": 1000.0}
    assert softer.entries["solver"]["dt"] == 0.01 and "pin" not in softer.entries
    with pytest.raises(palpate.InputError, match="not a table"):
        scene.updated({"material.young.soft": 1.0})


def test_old_names_warn_and_work(bar: palpate.Body) -> None:
    scene = bar.scene()
    with pytest.warns(DeprecationWarning, match="Scene.with_ is now Scene.updated"):
        softer = scene.with_({"material.young": 1e3})
    assert softer.entries == scene.updated({"material.young": 1e3}).entries
    with pytest.warns(DeprecationWarning, match="Scene.of is now Scene.from_any"):
        assert palpate.Scene.of(scene) is scene
    camera = palpate.Camera((0, 0, 1), (0, 0, 0))
    with pytest.warns(DeprecationWarning, match="Camera.of is now Camera.from_any"):
        assert palpate.Camera.of(camera) is camera
    assert isinstance(bar.mesh, palpate.Mesh)
    nodes = bar.mesh.nodes + 1.0
    with pytest.warns(DeprecationWarning, match="Mesh.moved is now Mesh.with_nodes"):
        assert np.array_equal(bar.mesh.moved(nodes).nodes, bar.mesh.with_nodes(nodes).nodes)
    renderer = palpate.Renderer(bar, size=(16, 12))
    with pytest.warns(DeprecationWarning, match="Renderer.shown is now Renderer.field_info"):
        assert renderer.shown == renderer.field_info
    with pytest.warns(DeprecationWarning, match="Renderer.raw is now Renderer.render_float"):
        assert np.array_equal(renderer.raw(), renderer.render_float())


def test_old_keys_are_noted_by_the_renderer(bar: palpate.Body) -> None:
    old = bar.scene().updated({"picture.walk": "planes"})
    notes = palpate.Renderer(old, size=(16, 12)).notes
    assert any("`walk` is now `traversal`" in note for note in notes)
    both = old.updated({"picture.traversal": "planes"})
    with pytest.raises(palpate.InputError, match="has both `traversal`"):
        palpate.Renderer(both, size=(16, 12))


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
