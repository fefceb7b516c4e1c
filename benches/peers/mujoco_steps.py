"""Milliseconds per step of MuJoCo's elements, one thread, on the bar of `cargo bench --bench steps`.

    venv/bin/pip install numpy mujoco
    venv/bin/python benches/peers/mujoco_steps.py [--poisson 0.3] [--dt 0.01] [CELLS …]

CELLS is the number of cells along the bar, which has a quarter of them across: by default 12, 24
and 48, i.e. 540, 4,320 and 34,560 tets. The bar is 0.8 x 0.2 x 0.2 m of 1 MPa, fixed at x = 0,
falling under its weight. Uses the `discrete` integrator with default settings; prints the median
of the steps after the tenth.
"""

import argparse
import statistics
import time

import mujoco

from reference_dynamics import bar

parser = argparse.ArgumentParser()
parser.add_argument("cells", nargs="*", type=int, default=[12, 24, 48])
parser.add_argument("--poisson", type=float, default=0.3)
parser.add_argument("--dt", type=float, default=0.01)
parser.add_argument("--steps", type=int, default=60)
given = parser.parse_args()

for along in given.cells:
    nodes, tets = bar((along, along // 4, along // 4), 0.8 / along)
    held = (nodes[:, 0] < 1e-9).nonzero()[0]
    xml = f"""<mujoco>
      <option timestep="{given.dt}" gravity="0 0 -9.81" integrator="discrete"/>
      <size memory="2G"/>
      <worldbody><flexcomp name="bar" type="direct" dim="3" mass="32" radius="0.001"
        point="{" ".join(f"{x:.9g}" for x in nodes.ravel())}"
        element="{" ".join(str(v) for v in tets.ravel())}">
        <contact contype="0" conaffinity="0" selfcollide="none"/>
        <elasticity young="1e6" poisson="{given.poisson}" damping="0"/>
        <pin id="{" ".join(str(v) for v in held)}"/>
      </flexcomp></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    times = []
    for _ in range(given.steps):
        start = time.perf_counter()
        mujoco.mj_step(model, data)
        times.append(1e3 * (time.perf_counter() - start))
    print(
        f"MuJoCo {mujoco.__version__} discrete: {len(tets):>6} tets {len(nodes):>6} nodes "
        f"{statistics.median(times[10:]):.2f} ms per step",
        flush=True,
    )
