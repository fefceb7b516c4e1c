"""Clusters: four worker processes, one of which is killed during the work."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

import palpate
import palpate.dask

distributed = pytest.importorskip("distributed")


#: Workers, and how long they may take to come, s.
WORKERS, PATIENCE = 4, 600


@pytest.fixture
def client():
    # Each test has its own workers, since the one it kills may never be replaced.
    import dask

    patient = {f"distributed.comm.timeouts.{name}": f"{PATIENCE}s" for name in ("connect", "tcp")}
    with dask.config.set(patient), distributed.LocalCluster(
        n_workers=WORKERS, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster, distributed.Client(cluster, timeout=PATIENCE) as client:
        client.wait_for_workers(WORKERS, timeout=PATIENCE)
        yield client


def kill_one(client) -> None:
    """Kills a worker, preferably one that is processing a task."""
    tasks = client.processing()
    worker = max(tasks, key=lambda worker: len(tasks[worker]))
    os.kill(client.run(os.getpid, workers=[worker])[worker], signal.SIGKILL)


def test_render_frames_match_command_line(client, tmp_path: Path, run) -> None:
    run("simulate", "--frames", 12, "--no-pictures", "--out", tmp_path / "run", write_bar(tmp_path))
    pvd = next((tmp_path / "run").glob("*.pvd"))
    run("simulate", pvd, "--out", tmp_path / "theirs", "--size", "96x72", "--no-meshes", "--time")
    came: list[int] = []

    def each(frame: palpate.dask.Frame) -> None:
        came.append(frame.number)
        if len(came) == 3:
            kill_one(client)

    looks = {"size": (96, 72), "time": True}
    frames = palpate.dask.render_series(pvd, client, tmp_path / "ours", each=each, **looks)
    assert [f.number for f in frames] == list(range(len(frames))) and sorted(came) == list(range(len(frames)))
    assert len(frames) >= 12 and all(f.drawn for f in frames)
    for frame in frames:
        theirs = tmp_path / "theirs" / frame.path.name
        assert frame.path.read_bytes() == theirs.read_bytes(), frame.path.name
    # Existing pictures are reused, missing ones are rendered.
    frames[5].path.unlink()
    again = palpate.dask.render_series(pvd, client, tmp_path / "ours", **looks)
    assert [f.number for f in again if f.drawn] == [5]
    other = palpate.dask.render_series(pvd, client, tmp_path / "ours", size=(48, 36))
    assert all(f.drawn for f in other)


def write_bar(folder: Path) -> Path:
    path = folder / "bar.toml"
    path.write_text(
        '[mesh]\ngenerate = "bar"\ntets = 300\n[material]\nyoung = 3e4\n'
        '[solver]\nname = "implicit"\nengine = "cpu"\nsteps = 2\ndt = 0.02\n'
        '[[pin]]\naxis = "x"\nbelow = 0.02\n'
    )
    return path


def test_sweep_matches_single_cases(client, tmp_path: Path, bar: palpate.Body) -> None:
    scene = bar.scene().updated({"solver": {"name": "implicit", "engine": "cpu", "dt": 0.02}})
    values = {"material.young": [2e4, 4e4, 8e4], "material.poisson": [0.3, 0.45]}
    came: list[dict] = []

    def each(case: dict) -> None:
        came.append(case)
        if len(came) == 1:
            kill_one(client)

    rows = palpate.dask.sweep(scene, values, client, steps=20, out=tmp_path / "sweep", each=each)
    assert len(rows) == len(came) == 6
    assert [r["material.young"] for r in rows] == [2e4, 2e4, 4e4, 4e4, 8e4, 8e4]
    for row in rows:
        alone = palpate.Simulator(scene.updated({k: row[k] for k in values}))
        alone.advance(20)
        assert row["max_displacement"] == alone.report()["max_displacement"]
        assert row["von_mises_max_pa"] == alone.field("von_mises").max()
    assert rows[0]["max_displacement"] > rows[4]["max_displacement"]
    lines = (tmp_path / "sweep/sweep.csv").read_text().splitlines()
    assert len(lines) == 7 and lines[0].startswith("material.young,material.poisson,time_s")
    # A completed case is not run again: its result is read from its file.
    case = next((tmp_path / "sweep/cases").glob("*.json"))
    case.write_text(case.read_text().replace('"inverted": 0', '"inverted": 77'))
    again = palpate.dask.sweep(scene, values, client, steps=20, out=tmp_path / "sweep")
    assert sum(row["inverted"] == 77 for row in again) == 1
    with pytest.raises(palpate.InputError, match="list of values"):
        palpate.dask.sweep(scene, {"material.young": 3e4}, client)
    with pytest.raises(palpate.InputError, match="unknown field"):
        palpate.dask.sweep(scene, {"solver.speed": [1]}, client, steps=1)


def test_press_map_matches_single_machine(client, tmp_path: Path) -> None:
    breast = palpate.Scene({"mesh": {"generate": "breast", "tets": 3000, "lump_mm": 0}})
    here = palpate.press_map(breast, (3, 2), radius=0.016)
    came: list[int] = []

    def each(number: int, stiffness: float) -> None:
        came.append(number)
        if len(came) == 2:
            kill_one(client)

    there = palpate.dask.press_map(breast, (3, 2), client, radius=0.016, out=tmp_path / "map", each=each)
    assert sorted(came) == list(range(len(here.stiffness)))
    assert np.array_equal(there.points, here.points)
    assert np.allclose(there.stiffness, here.stiffness, rtol=1e-9)
    assert np.array_equal(there.picture, here.picture)
    came.clear()
    palpate.dask.press_map(breast, (3, 2), client, radius=0.016, out=tmp_path / "map", each=each)
    assert came == []
    part = {"radius": 0.016, "at": (0.01, 0.0, 0.05), "side": 0.08}
    here = palpate.press_map(breast, (2, 1), **part)
    there = palpate.dask.press_map(breast, (2, 1), client, **part)
    assert np.array_equal(there.points, here.points)
    assert np.allclose(there.stiffness, here.stiffness, rtol=1e-9)


def test_pieces_match_whole_body(client, tmp_path: Path) -> None:
    limb = palpate.Mesh.generate("limb", tets=8000)
    index = tmp_path / "limb.pvtu"
    assert limb.write(index, pieces=9) == []
    low, high = (np.array(corner) for corner in limb.bounds)
    middle = tuple(0.5 * (low + high))
    within = palpate.Camera(middle, tuple(np.array(middle) + (0.1, 0.3, 1.0)), up=(0, 1, 0), fov=80)
    for n, (camera, looks) in enumerate(
        [
            (None, {}),
            (within, {"field": "intensity", "clim": (-500, 1500), "cmap": "tissue"}),
            (None, {"cmap": "viridis", "light": "none", "background": "white", "samples": 4}),
        ]
    ):
        looks["size"] = (200, 150)
        came: list[palpate.dask.DrawnPiece] = []

        def each(piece: palpate.dask.DrawnPiece) -> None:
            came.append(piece)
            if n == 0 and len(came) == 3:
                kill_one(client)

        ours = palpate.dask.render_pieces(index, camera, client, each=each, **looks)
        # Pieces show regions along the faces of tets.
        whole = palpate.render(limb, camera=camera, boundaries="tets", **looks)
        assert ours.shape == whole.shape == (150, 200, 4)
        assert whole[..., :3].std() > 5.0
        apart = np.abs(ours.astype(int) - whole)
        assert apart.max() <= 1, (n, apart.max(), apart.mean())
        assert sorted(p.number for p in came) == list(range(9))
        assert sum(p.tets for p in came) == len(limb.tets)
        # A worker holds only its piece and the ghost tets around it.
        assert all(0 < p.ghosts and p.tets + p.ghosts < len(limb.tets) / 3 for p in came)
        assert all(p.memory > 10_000_000 for p in came) or sys.platform != "linux"


def test_pieces_reject_unsupported_settings(client, tmp_path: Path) -> None:
    index = tmp_path / "box.pvtu"
    box = palpate.Mesh.generate("box", tets=300)
    box.write(index, pieces=2)
    with pytest.raises(palpate.InputError, match="not support a legend"):
        palpate.dask.render_pieces(index, None, client, legend=True)
    with pytest.raises(palpate.InputError, match="not support planes"):
        palpate.dask.render_pieces(index, None, client, clip=[(0, 0, 0, 1, 0, 0)])
    with pytest.raises(palpate.InputError, match="not support smooth boundaries"):
        palpate.dask.render_pieces(index, None, client, boundaries="smooth")
    with pytest.raises(palpate.FileError):
        palpate.dask.render_pieces(tmp_path / "none.pvtu", None, client)
    with pytest.raises(palpate.InputError, match="pieces"):
        box.write(index, pieces=0)
    with pytest.raises(palpate.InputError, match="requires their number"):
        box.write(index)
    # All of it is a mesh like any other.
    assert np.array_equal(palpate.Mesh.read(index).tets, box.tets)


def test_identify_takes_sets_and_starts(client) -> None:
    def block(young: float) -> palpate.Scene:
        material = {"young": young, "poisson": 0.3, "order": 1}
        return palpate.Scene({"mesh": {"generate": "box", "tets": 300}, "material": material})

    def curve(young: float) -> palpate.PressCurve:
        press = palpate.press(block(young), radius=0.03, depth=0.008, size=(48, 32), errors=False)
        loading = press.loading & (press.depth > 0)
        return palpate.PressCurve(
            press.point, press.report["direction"], 0.03, press.depth[loading], press.force[loading]
        )

    sets = [curve(1e4), [curve(3e4)]]
    came: list[tuple[int, int]] = []
    found = palpate.dask.identify(
        block(6e3),
        sets,
        "material.young",
        client,
        starts=2,
        each=lambda n, start, _: came.append((n, start)),
        noise=0.01,
        advice=False,
    )
    assert sorted(came) == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert [one.values["material.young"] for one in found] == pytest.approx([1e4, 3e4], rel=0.01)
    assert all(one.report["other_optima"] == [] for one in found)
    alone = palpate.identify(block(6e3), sets[0], "material.young", noise=0.01, advice=False)
    assert found[0].values["material.young"] == pytest.approx(alone.values["material.young"], rel=1e-4)
