"""MuJoCo drops a soft block on a ball, and Palpate renders its interior (docs/how-to/frames.md has the layout):

    pip install mujoco
    python3 examples/mujoco_frames.py |
        palpate render - --frames-from - --out block.png --film mujoco.gif --eye 0.7,-0.9,0.5 --look-at 0,0,0.12 --up 0,0,1
"""

import struct
import sys

import mujoco

SCENE = """
<mujoco>
  <option timestep="0.001" integrator="discrete"/>
  <worldbody>
    <geom type="plane" size="2 2 0.1"/>
    <geom type="sphere" size="0.08" pos="0 0 0.05"/>
    <flexcomp name="block" type="grid" dim="3" count="9 9 5" spacing="0.03 0.03 0.03"
              pos="0.02 0 0.25" mass="1" radius="0.002">
      <contact selfcollide="none"/>
      <elasticity young="8e3" poisson="0.3" damping="0.002"/>
    </flexcomp>
  </worldbody>
</mujoco>
"""
FRAMES, STEPS = 40, 20

model = mujoco.MjModel.from_xml_string(SCENE)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
tets = model.flex_elem.reshape(-1, 4).astype("<u4")

out = sys.stdout.buffer
out.write(b"PALPATE1" + struct.pack("<II", len(data.flexvert_xpos), len(tets)))
out.write(data.flexvert_xpos.astype("<f8").tobytes() + tets.tobytes())
for _ in range(FRAMES):
    out.write(struct.pack("<d", data.time) + data.flexvert_xpos.astype("<f8").tobytes())
    out.flush()
    mujoco.mj_step(model, data, STEPS)
