"""Presses, tuning and studies."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import palpate


def test_press_matches_command_line(tmp_path: Path, run) -> None:
    ball = palpate.Mesh.generate("ball", tets=1500)
    ball.write(tmp_path / "ball.vtu")
    # So shallow that the press is valid.
    flags = ["--size", "160x120", "--engine", "cpu", "--depth", "0.002"]
    run("press", tmp_path / "ball.vtu", "--out", tmp_path / "out", *flags)
    with open(tmp_path / "out/press.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    shares: list[float] = []
    found = palpate.press(
        ball, size=(160, 120), engine="cpu", depth=0.002, progress=lambda _, s: shares.append(s)
    )
    assert found.failure is None and shares[-1] == 1.0
    assert np.array_equal(found.depth, [float(r["depth_m"]) for r in rows])
    assert np.array_equal(found.force, [float(r["force_n"]) for r in rows])
    assert np.array_equal(found.loading, [r["phase"] == "load" for r in rows])
    assert found.report["max_force_n"] == found.force.max()
    assert found.pressed.shape == (120, 160, 4) and not np.array_equal(found.rest, found.pressed)
    from PIL import Image

    found.save(tmp_path / "ours")
    for name in ("rest.png", "pressed.png"):
        ours, theirs = (np.asarray(Image.open(tmp_path / of / name).convert("RGBA")) for of in ("ours", "out"))
        assert np.array_equal(ours, theirs)
    assert np.array_equal(found.pressed, np.asarray(Image.open(tmp_path / "ours/pressed.png")))
    with open(tmp_path / "ours/press.csv", newline="") as file:
        own = list(csv.DictReader(file))
    assert [r["phase"] for r in own] == [r["phase"] for r in rows]
    assert [float(r["force_n"]) for r in own] == [float(r["force_n"]) for r in rows]
    assert [float(r["force_error_n"]) for r in own] == [float(r["force_error_n"]) for r in rows]
    assert found.force_error is not None
    assert found.force_error.max() > 0
    assert np.isclose(found.report["max_force_error_n"], found.force_error.max(), rtol=1e-12)
    assert found.report["error_parts"]["max_force_n"]["mesh"] > 0
    shown, scene = (
        palpate.press(ball, size=(160, 120), engine="cpu", depth=0.002, errors=False, **looks).pressed
        for looks in ({"show": "displacement"}, {"scene_view": True})
    )
    assert not np.array_equal(shown, found.pressed) and not np.array_equal(scene, found.pressed)
    with pytest.raises(palpate.InputError, match="displacement or stress"):
        palpate.press(ball, size=(32, 24), show="wind")
    with pytest.raises(RuntimeError, match="enough"):
        palpate.press(ball, size=(32, 24), progress=stop)
    with pytest.raises(palpate.InputError):
        palpate.press(ball, radius=-1.0)


#: Bodies on which the command, the window and this package must agree, as in the viewer's test.
BODIES = [("box", 1500), ("ball", 1500), ("breast", 4000), ("limb", 4000)]


@pytest.mark.parametrize(("name", "tets"), BODIES)
def test_view_measures_force_of_press(name: str, tets: int) -> None:
    from palpate._touch import Touched

    # Views have linear tets by default, measured presses quadratic ones.
    scene = palpate.Scene({"mesh": {"generate": name, "tets": tets}, "material": {"order": 1}})
    touched = Touched(scene)
    seen = touched.pick(0.5, 0.5)
    assert seen is not None
    found = palpate.press(scene, at=seen.point, depth=0.5 * touched.radius, size=(32, 24))
    assert found.report["radius_m"] == touched.radius
    assert touched.press(0.5, 0.5)
    for depth in found.depth[found.loading]:
        assert touched._stage.press_towards(depth, False) == (depth, True)
    ours = np.array([force for _, _, force in touched.samples])
    assert ours.max() > 0.0
    assert np.allclose(ours, found.force[found.loading], rtol=0.0, atol=1e-9 * ours.max())
    assert found.report["bed"]["side"] == "-z" and found.report["bed"]["nodes"] > 2


def stop(what: str, share: float) -> None:
    raise RuntimeError("enough")


def test_refined_press_and_map_are_as_exact_as_wanted(tmp_path: Path) -> None:
    bar = palpate.Mesh.generate("bar", tets=900)
    found = palpate.press(bar, radius=0.02, size=(64, 48), within=0.3)
    rounds = found.report["rounds"]
    assert len(rounds) >= 2 and rounds[0]["order"] == 1 and rounds[-1]["order"] == 2
    assert rounds[-1]["error"] <= 0.3 * rounds[-1]["value"] and "missed" not in found.report
    assert found.report["max_force_error_n"] < 0.35 * found.report["max_force_n"]
    short = palpate.press(bar, radius=0.02, size=(64, 48), within=0.001, max_tets=1000)
    assert "more than the 1000 allowed" in short.report["missed"]
    assert any("not as exact as wanted" in note for note in short.notes)
    with pytest.raises(RuntimeError, match="enough"):
        palpate.press(bar, radius=0.02, size=(64, 48), within=0.3, progress=stop)
    settings = {"radius": 0.02, "within": 0.3, "out": tmp_path}
    whole = palpate.press_map(bar, (2, 1), **settings)
    assert (whole.error > 0).all() and (whole.error <= 0.3 * whole.stiffness).all()
    again = palpate.press_map(bar, (2, 1), **settings)
    assert np.array_equal(again.error, whole.error)
    plain = palpate.press_map(bar, (2, 1), radius=0.02)
    assert np.isnan(plain.error).all() and (plain.stiffness > whole.stiffness).all()


def test_refined_scene_is_refined(tmp_path: Path) -> None:
    entries = {
        "mesh": {"generate": "bar", "tets": 60},
        "material": {"model": "neo-hookean"},
        "solver": {"name": "implicit", "dt": 0.05, "steps": 10},
        "pin": [{"x_below": 0.001}],
        "accuracy": {"within": "60%", "max_tets": 2000},
    }
    scene = palpate.Scene(entries)
    simulator = palpate.Simulator(scene)
    assert simulator.mesh.order == 2 and not any("not refined" in note for note in simulator.notes)


def test_press_map_of_a_part(tmp_path: Path, run) -> None:
    linear = {"material": {"order": 1}}
    breast = palpate.Scene({"mesh": {"generate": "breast", "tets": 3000, "lump_mm": 0}, **linear})
    part = palpate.press_map(breast, (2, 1), radius=0.016, at=(0.01, 0.0, 0.05), side=0.08)
    assert np.allclose(part.points[:, :2], [(-0.01, 0.0), (0.03, 0.0)], atol=1e-9)
    breast.write(tmp_path / "breast.toml")
    flags = ["--map", "2x1", "--radius", "0.016", "--at", "0.01,0,0.05", "--side", "0.08"]
    run("press", tmp_path / "breast.toml", *flags, "--out", tmp_path / "theirs")
    rows = np.loadtxt(tmp_path / "theirs/map.csv", delimiter=",", skiprows=1)
    assert np.array_equal(part.points, rows[:, :3])
    assert np.allclose(part.stiffness, rows[:, 3], rtol=1e-9)
    with pytest.raises(palpate.InputError, match="--side"):
        palpate.press_map(breast, (2, 1), radius=0.016, at=(0.01, 0.0, 0.05))


def test_press_map_resumes(tmp_path: Path, run) -> None:
    linear = {"material": {"order": 1}}
    breast = palpate.Scene({"mesh": {"generate": "breast", "tets": 3000, "lump_mm": 0}, **linear})
    with pytest.raises(RuntimeError, match="enough"):
        palpate.press_map(breast, (3, 2), radius=0.016, out=tmp_path / "map", progress=stop)
    begun = (tmp_path / "map/map.json").read_text()
    assert begun.count("null") < 6, "no completed points were kept"
    whole = palpate.press_map(breast, (3, 2), radius=0.016, out=tmp_path / "map")
    assert whole.points.shape == (len(whole.stiffness), 3) and (whole.stiffness > 0).all()
    breast.write(tmp_path / "breast.toml")
    run("press", tmp_path / "breast.toml", "--map", "3x2", "--radius", "0.016", "--out", tmp_path / "theirs")
    rows = np.loadtxt(tmp_path / "theirs/map.csv", delimiter=",", skiprows=1)
    assert np.allclose(whole.stiffness, rows[:, 3], rtol=1e-9)
    with pytest.raises(palpate.InputError, match="a different body"):
        palpate.press_map(breast, (2, 2), radius=0.016, out=tmp_path / "map")


def test_demo_writes_pictures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from PIL import Image

    from palpate import demo

    assert demo.main([str(tmp_path / "demo"), "--tets", "2000", "--within", "0.3"]) == 0
    told = capsys.readouterr().out
    force, _, _, error, _, depth, _ = told.split(maxsplit=6)
    curve = np.genfromtxt(tmp_path / "demo/press.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert force == f"{curve['force_n'].max():.3g}" and depth == f"{1e3 * curve['depth_m'].max():.3g}"
    assert 0 < float(error) < 0.31 * float(force)
    for name in ("limb", "stress", "rest", "pressed"):
        drawn = np.asarray(Image.open(tmp_path / f"demo/{name}.png"))
        assert drawn.shape[:2] == (600, 800) and len(np.unique(drawn)) > 20


def test_tune_returns_scene(bar: palpate.Body) -> None:
    scene = bar.scene().updated({"solver": {"name": "implicit", "dt": 0.01}, "picture.size": [64, 48]})
    told: list[str] = []
    tuned = palpate.tune(scene, error=0.05, seconds=0.05, progress=lambda what, _: told.append(what))
    assert tuned.notes and told and tuned.picture_ms > 0
    simulator = palpate.Simulator(tuned.scene)
    simulator.advance(2)


def test_studies_are_listed_and_cancel(tmp_path: Path) -> None:
    with pytest.raises(palpate.InputError, match="stability"):
        palpate.study("everything", tmp_path)
    with pytest.raises(RuntimeError, match="enough"):
        palpate.study("pictures", tmp_path / "out", quick=True, progress=stop)
