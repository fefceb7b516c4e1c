"""Gradients against central differences."""

from __future__ import annotations

import numpy as np
import pytest

import palpate
from palpate import gradients

# Long steps, which end at rest.
STEP = 1e3


def block(young: float = 1e4, gravity: float = -9.81, stiffer: float = 3e4) -> palpate.Simulator:
    """Returns a block of two regions on its pinned end, which hangs under its weight."""
    mesh = palpate.Mesh.generate("bar", tets=200)
    middle = mesh.nodes[mesh.tets].mean(axis=1)[:, 0]
    far = middle > np.median(middle)
    mesh = palpate.Mesh(mesh.nodes, mesh.tets, cell_data={"region": far.astype(float)})
    body = palpate.Body(
        mesh,
        material=palpate.Material(
            young=young,
            poisson=0.3,
            density=1000.0,
            model="neo-hookean",
            volume="per-tet",
            tissues={"stiff": {"regions": [1], "young": stiffer}},
        ),
        pin=[{"axis": "x", "below": 0.02, "name": "wall"}],
        gravity=(0.0, 0.0, gravity),
    )
    return palpate.Simulator(body, solver="implicit", engine="cpu", dt=STEP, precision="double")


def tip(simulator: palpate.Simulator) -> gradients.Displacement:
    node = int(np.argmax(simulator.mesh.nodes.sum(axis=1)))
    return gradients.Displacement([node], (0.0, 0.0, 1.0))


def settled(**changes: float) -> palpate.Simulator:
    simulator = block(**changes)
    simulator.advance(30)
    return simulator


def sag(simulator: palpate.Simulator) -> float:
    node = tip(simulator).nodes[0]
    return float((simulator.positions - simulator.mesh.nodes)[node, 2])


def test_gradient_matches_differences() -> None:
    simulator = settled()
    parameters = [
        gradients.Young(region=0),
        gradients.Young(region=1),
        gradients.Gravity((0.0, 0.0, 1.0)),
    ]
    found = simulator.gradient(tip(simulator), parameters)
    assert found.value == pytest.approx(sag(simulator), rel=1e-9)
    assert found.derivatives.shape == (3,) and found.iterations > 0 and found.imbalance < 1e-5
    expected = [
        (sag(settled(young=1e4 + 20)) - sag(settled(young=1e4 - 20))) / 40,
        (sag(settled(stiffer=3e4 + 60)) - sag(settled(stiffer=3e4 - 60))) / 120,
        (sag(settled(gravity=-9.80)) - sag(settled(gravity=-9.82))) / 0.02,
    ]
    assert np.allclose(found.derivatives, expected, rtol=1e-4, atol=0)
    assert not np.allclose(1.001 * found.derivatives, expected, rtol=1e-4, atol=0)
    whole = simulator.gradient(tip(simulator), [gradients.Young()])
    tets = np.arange(len(simulator.mesh.tets))
    same = simulator.gradient(tip(simulator), [gradients.Young(tets=tets)])
    assert whole.derivatives == same.derivatives
    assert whole.derivatives[0] == pytest.approx(found.derivatives[:2].sum(), rel=1e-9)


def test_gradient_of_motion_matches_differences() -> None:
    def moved(gravity: float) -> palpate.Simulator:
        return palpate.Simulator(block(gravity=gravity).scene.updated({"solver.dt": 0.01}), precision="double")

    simulator = moved(-9.81)
    seen: list[float] = []
    found = simulator.gradient_of_motion(
        5, tip(simulator), [gradients.Gravity((0, 0, 1))], progress=lambda what, done: seen.append(done)
    )
    assert simulator.time == pytest.approx(0.05)
    assert found.value == pytest.approx(sag(simulator), rel=1e-9)
    none: list[gradients.Parameter] = []
    ends = [moved(gravity) for gravity in (-9.80, -9.82)]
    values = [end.gradient_of_motion(5, tip(end), none).value for end in ends]
    assert found.derivatives[0] == pytest.approx((values[0] - values[1]) / 0.02, rel=1e-4)
    assert seen and 0 <= seen[0] <= 1
    total = moved(-9.81).gradient_of_motion(5, tip(simulator), none, integral=True)
    assert 0 < total.value / found.value < 0.05


def test_gradient_of_motion_by_damping_matches_differences() -> None:
    def damped(ratio: float) -> palpate.Simulator:
        changes = {"solver.dt": 0.01, "material.damping_ratio": ratio, "material.damping_hz": 4.0}
        return palpate.Simulator(block(gravity=-9.81).scene.updated(changes), precision="double")

    def end(ratio: float, *by: gradients.Parameter) -> gradients.Gradient:
        simulator = damped(ratio)
        return simulator.gradient_of_motion(5, tip(simulator), by)

    found = end(0.1, gradients.DampingTime(), gradients.MassDamping()).derivatives
    omega = 2 * np.pi * 4.0
    difference = (end(0.101).value - end(0.099).value) / 0.002
    assert found[0] / omega + found[1] * omega == pytest.approx(difference, rel=1e-4)


def test_gradient_of_motion_along_paths_matches_differences() -> None:
    low, high = (np.array(corner) for corner in block().mesh.bounds)
    thick = high[2] - low[2]
    x, y = 0.5 * (low + high)[:2]

    def pressed(young: float = 1e4, shift: float = 0.0) -> palpate.Simulator:
        tool = {
            "sphere": {"radius": 0.4 * thick},
            "at": [x + shift, y, high[2] + 0.42 * thick],
            "path": [[0.0, 0.0, 0.0, 0.0], [0.05, 0.1 * thick, 0.0, -0.06 * thick]],
            "friction": 0.3,
        }
        # It rises against the tool.
        rising = block(young=young, gravity=9.81)
        scene = rising.scene.updated({"solver.dt": 0.01, "tool": [tool]})
        return palpate.Simulator(scene, precision="double")

    simulator = pressed()
    force = gradients.ToolForce(0, (1, 0, 1))
    by = [gradients.Young(region=0), gradients.ToolPosition(0, (1, 0, 0))]
    found = simulator.gradient_of_motion(5, force, by)
    assert simulator.time == pytest.approx(0.05)
    assert abs(found.value) > 1e-3
    none: list[gradients.Parameter] = []
    values = [pressed(1e4 + by).gradient_of_motion(5, force, none).value for by in (10, -10)]
    assert found.derivatives[0] == pytest.approx((values[0] - values[1]) / 20, rel=1e-3)
    h = 1e-5 * thick
    values = [pressed(shift=by).gradient_of_motion(5, force, none).value for by in (h, -h)]
    assert found.derivatives[1] == pytest.approx((values[0] - values[1]) / (2 * h), rel=1e-3)


def test_refusals_say_what_to_do() -> None:
    simulator = block()
    simulator.advance(1)
    with pytest.raises(palpate.InputError, match="at rest"):
        simulator.gradient(tip(simulator), [])
    with pytest.raises(palpate.InputError, match="region 7 does not exist"):
        simulator.gradient(tip(simulator), [gradients.Young(region=7)])
    with pytest.raises(palpate.InputError, match="not both"):
        simulator.gradient(tip(simulator), [gradients.Young(tets=[0], region=1)])
    with pytest.raises(palpate.InputError, match="not a quantity"):
        simulator.gradient("sag", [])  # type: ignore[arg-type]
    single = palpate.Simulator(simulator.scene)
    with pytest.raises(palpate.InputError, match="double precision"):
        single.gradient(tip(single), [])
