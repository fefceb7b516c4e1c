"""Simulated bodies."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import palpate


def test_steps_match_command_line(bar: palpate.Body, tmp_path: Path, run) -> None:
    scene = bar.scene().updated({"solver": {"name": "implicit", "engine": "cpu", "dt": 0.01, "steps": 15}})
    scene.write(tmp_path / "bar.toml")
    run("render", tmp_path / "bar.toml", "--out", tmp_path / "p.png", "--size", "64x48", "--mesh-out", tmp_path / "bent.vtu")
    theirs = palpate.Mesh.read(tmp_path / "bent.vtu")
    simulator = palpate.Simulator(scene)
    simulator.advance(15)
    assert simulator.engine == "cpu" and np.isclose(simulator.time, 0.15)
    assert np.array_equal(simulator.positions, theirs.nodes)
    assert np.array_equal(simulator.velocities, theirs.point_data["velocity"])
    assert np.array_equal(simulator.deformed.nodes, theirs.nodes)


def test_wall_reaction_equals_weight_at_rest(bar: palpate.Body) -> None:
    simulator = palpate.Simulator(bar, engine="cpu", dt=0.05)
    simulator.advance(120)
    weight = simulator.masses.sum() * 9.81
    wall = simulator.reactions()["wall"]
    assert np.allclose(wall.force, [0, 0, -weight], atol=0.01 * weight)
    report = simulator.report()
    assert report["inverted"] == 0 and report["energy"]["kinetic"] < 1e-3 * report["energy"]["elastic"]
    stress = simulator.field("von_mises")
    assert stress.shape == (len(simulator.mesh.tets),) and stress.max() > 3 * np.median(stress) > 0
    assert simulator.field("J", at_nodes=True).shape == (len(simulator.mesh.nodes),)
    held = np.abs(simulator.mesh.nodes[:, 0] - simulator.mesh.nodes[:, 0].min()) < 1e-9
    pulled = simulator.forces()[held].sum(axis=0)
    assert np.allclose(pulled, [0, 0, -weight], atol=0.05 * weight)


def test_state_loads_grabs_and_cuts(bar: palpate.Body) -> None:
    simulator = palpate.Simulator(bar, engine="cpu", dt=0.01, gravity=(0, 0, 0))
    rest = simulator.positions
    simulator.advance(3)
    assert np.abs(simulator.positions - rest).max() < 1e-6
    low, high = (np.array(p) for p in simulator.mesh.bounds)
    size = high - low
    end = [high[0], *(0.5 * (low + high))[1:]]
    grab = simulator.grab(end, 0.3 * size[1:].max())
    grab.move_to(np.array(end) + [0, 0, 0.1 * size[0]])
    simulator.advance(10)
    held = np.linalg.norm(rest - end, axis=1) <= 0.3 * size[1:].max()
    moved = simulator.positions[held] - rest[held]
    assert np.allclose(moved, [0, 0, 0.1 * size[0]], atol=1e-6 * size[0])
    assert grab.release() == held.sum()
    # What is let go of moves freely from the next step on.
    simulator.advance(1)
    simulator.restart()
    assert np.allclose(simulator.positions, rest)
    velocities = np.zeros_like(rest)
    velocities[rest[:, 0] > low[0] + 0.1 * size[0], 2] = 0.5
    simulator.velocities = velocities
    assert np.allclose(simulator.velocities, velocities, atol=1e-6)
    raised = rest + 0.02 * velocities
    simulator.positions = raised
    assert np.allclose(simulator.positions, raised, atol=1e-6)
    simulator.restart()
    middle = 0.5 * (low[0] + high[0])
    edges = [[[middle, low[1] - 1, low[2] - 1], [middle, high[1] + 1, low[2] - 1]],
             [[middle, low[1] - 1, high[2] + 1], [middle, high[1] + 1, high[2] + 1]]]
    assert simulator.cut(edges) and len(simulator.mesh.nodes) > len(rest)
    assert not simulator.cut([[[9, 9, 9], [9, 9, 10]], [[10, 9, 9], [10, 9, 10]]])
    with pytest.raises(palpate.InputError, match="positions"):
        simulator.positions = rest[:3]


def test_rendered_positions_follow_the_body(bar: palpate.Body) -> None:
    simulator = palpate.Simulator(bar, dt=0.02)
    renderer = palpate.Renderer(simulator, size=(80, 60), field="displacement")
    before = renderer.render()
    simulator.advance(10)
    after = renderer.render()
    assert before.shape == after.shape == (60, 80, 4) and not np.array_equal(before, after)
    assert renderer.field_info[0] == "displacement"


def test_quadratic_tets_bend_more_and_keep_the_nodes_of_the_mesh() -> None:
    mesh = palpate.Mesh.generate("bar", tets=600)
    drops = []
    for order in (1, 2):
        body = palpate.Body(
            mesh,
            material=palpate.Material(young=3e4, poisson=0.49, density=1000.0, order=order),
            pin=[{"axis": "x", "below": 0.02}],
            gravity=(0.0, 0.0, -9.81),
        )
        simulator = palpate.Simulator(body, engine="cpu", dt=10.0)
        simulator.advance(10)
        count = len(mesh.nodes)
        drops.append((mesh.nodes[:, 2] - simulator.positions[:count, 2]).max())
        assert (len(simulator.positions) > count) == (order == 2)
    # Linear tets lock at this ratio.
    assert abs(drops[1] / drops[0] - 1.36) < 0.03
    with pytest.raises(palpate.InputError, match="order 3"):
        palpate.Simulator(palpate.Body(mesh, material=palpate.Material(order=3)), dt=0.01)


def test_failed_step_keeps_last_valid_state() -> None:
    body = palpate.Body(
        palpate.Mesh.generate("bar", tets=300),
        material=palpate.Material(stiffness=500.0, model="springs"),
        pin=[{"axis": "x", "below": 0.02}],
    )
    simulator = palpate.Simulator(body, solver="explicit", engine="cpu", dt=0.5, gravity=(0, 0, -9.81))
    with pytest.raises(palpate.SolverError) as failed:
        simulator.advance(2000)
    assert failed.value.step >= 1 and "explicit" in failed.value.solver
    assert np.isfinite(simulator.positions).all()


def test_steps_release_the_gil_and_ctrl_c_cancels(bar: palpate.Body) -> None:
    simulator = palpate.Simulator(bar.scene().updated({"solver.sleep": False}), engine="cpu", dt=0.01)
    begun, ended = threading.Event(), threading.Event()

    def interrupt() -> None:
        # It gets there only if it runs while the steps do.
        begun.wait()
        for _ in range(50):
            time.sleep(0.001)
        if not ended.is_set():
            os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    # Background processes of a shell ignore Ctrl-C.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        thread.start()
        # Minutes of work, were it not interrupted.
        with pytest.raises(KeyboardInterrupt):
            simulator.advance(100_000, progress=lambda *_: begun.set())
    finally:
        ended.set()
        begun.set()
        thread.join()
        signal.signal(signal.SIGINT, before)
    # Completed steps are kept, and the simulation can continue.
    steps = simulator.time / simulator.dt
    assert 0 < steps < 100_000 and np.isclose(steps, round(steps), rtol=0, atol=1e-6)
    simulator.advance(1)
    assert np.isclose(simulator.time / simulator.dt, steps + 1, rtol=0, atol=1e-6)


def test_progress_callback_reads_body_and_cancels(bar: palpate.Body) -> None:
    simulator = palpate.Simulator(bar.scene().updated({"solver.sleep": False}), engine="cpu", dt=0.01)

    def look(what: str, share: float) -> None:
        assert what == "steps" and 0 < share <= 1
        if simulator.time > 0.05:
            raise StopIteration("far enough")

    with pytest.raises(StopIteration):
        simulator.advance(1_000_000, progress=look)


def test_simulator_rejects_invalid_input(bar: palpate.Body) -> None:
    with pytest.raises(palpate.InputError, match="implicit"):
        palpate.Simulator(bar, solver="wishful")
    simulator = palpate.Simulator(bar, engine="cpu")
    with pytest.raises(palpate.InputError, match="steps"):
        simulator.advance(-1)
    with pytest.raises(palpate.InputError, match="von_mises"):
        simulator.field("stress")
    with pytest.raises(palpate.InputError, match="shape"):
        simulator.cut([[0, 0, 0]])
    with pytest.raises(palpate.InputError):
        simulator.pin([10**6])
