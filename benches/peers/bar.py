"""A bar let go under gravity: Palpate's solvers and MuJoCo's flex against linear finite elements.

Everything is linear here: gravity is weak, so that the bar bends by a hundredth of its length.
"""

import subprocess
import time
from pathlib import Path

import numpy as np
from scipy.linalg import eigh

YOUNG, POISSON, DENSITY, GRAVITY = 1e5, 0.25, 1000.0, 1.0
TETS, SPAN, SPANS = 640, 0.032, 8

SCENE = """
[mesh]
generate = "bar"
tets = {tets}
[material]
model = "springs"
young = {young}
density = {density}
damping = 0.0
[solver]
name = "{solver}"
dt = {dt}
steps = {steps}
gravity = [0.0, 0.0, {gravity}]
[[pin]]
axis = "x"
below = 0.0
"""


def read(path):
    """Nodes and tets of a .vtu file."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    grid = reader.GetOutput()
    tets = vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(-1, 4)
    return vtk_to_numpy(grid.GetPoints().GetData()).astype(float), tets


def simulate(palpate, folder, solver, steps, frames):
    """Runs Palpate; returns the seconds it took."""
    folder.mkdir(parents=True, exist_ok=True)
    scene = folder / "bar.toml"
    scene.write_text(
        SCENE.format(
            tets=TETS,
            young=YOUNG,
            density=DENSITY,
            solver=solver,
            dt=SPAN / steps,
            steps=steps,
            gravity=-GRAVITY,
        )
    )
    command = [palpate, "simulate", scene, "--frames", str(frames), "--no-pictures", "--out", folder]
    start = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        return None
    return time.perf_counter() - start


def shape_gradients(nodes, tets):
    """Gradients of the four shape functions of every tet, and the tets' volumes."""
    corners = nodes[tets]
    edges = corners[:, 1:] - corners[:, :1]
    inverse = np.linalg.inv(edges)
    others = np.transpose(inverse, (0, 2, 1))
    gradients = np.concatenate([-others.sum(1, keepdims=True), others], 1)
    return gradients, np.abs(np.linalg.det(edges)) / 6


def lumped_mass(nodes, tets, volumes):
    mass = np.zeros(len(nodes))
    np.add.at(mass, tets, (DENSITY * volumes / 4)[:, None])
    return mass


def exact_motion(nodes, tets, times):
    """Displacements of linear elements released at rest, at `times`, by their modes."""
    gradients, volumes = shape_gradients(nodes, tets)
    lam = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
    mu = YOUNG / (2 * (1 + POISSON))
    g = gradients
    blocks = lam * np.einsum("tai,tbj->taibj", g, g) + mu * np.einsum("taj,tbi->taibj", g, g)
    blocks += mu * np.einsum("tak,tbk,ij->taibj", g, g, np.eye(3))
    blocks *= volumes[:, None, None, None, None]
    size = 3 * len(nodes)
    stiffness = np.zeros((size, size))
    places = (3 * tets[:, :, None] + np.arange(3)).reshape(len(tets), 12)
    for place, block in zip(places, blocks.reshape(len(tets), 12, 12)):
        stiffness[np.ix_(place, place)] += block
    mass = np.repeat(lumped_mass(nodes, tets, volumes), 3)
    free = np.repeat(nodes[:, 0] > 1e-9, 3)
    squares, modes = eigh(stiffness[np.ix_(free, free)], np.diag(mass[free]))
    weight = (mass.reshape(-1, 3) * [0, 0, -GRAVITY]).ravel()[free]
    pushed = modes.T @ weight / squares
    motion = np.zeros((len(times), size))
    motion[:, free] = (1 - np.cos(np.outer(times, np.sqrt(squares)))) * pushed @ modes.T
    return motion.reshape(len(times), -1, 3)


def error(found, truth):
    return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))


def mujoco_motion(nodes, tets, integrator, dt):
    """Displacements at the ends of the spans by MuJoCo's flex, and the seconds its steps took."""
    import mujoco

    held = np.flatnonzero(nodes[:, 0] < 1e-9)
    xml = f"""<mujoco>
      <option timestep="{dt}" gravity="0 0 {-GRAVITY}" integrator="{integrator}"/>
      <size memory="1G"/>
      <worldbody><flexcomp name="bar" type="direct" dim="3" mass="1" radius="0.0005"
        point="{" ".join(f"{x:.9g}" for x in nodes.ravel())}"
        element="{" ".join(str(v) for v in tets.ravel())}">
        <contact contype="0" conaffinity="0" selfcollide="none"/>
        <elasticity young="{YOUNG}" poisson="{POISSON}" damping="0"/>
        <pin id="{" ".join(str(v) for v in held)}"/>
      </flexcomp></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    # Each node weighs a quarter of its tets, as in the elements and in Palpate.
    _, volumes = shape_gradients(nodes, tets)
    mass = lumped_mass(nodes, tets, volumes)
    for node, body in enumerate(model.flex_vertbodyid):
        if nodes[node, 0] > 1e-9:
            model.body_mass[body] = mass[node]
    mujoco.mj_setConst(model, data)
    mujoco.mj_forward(model, data)
    start = data.flexvert_xpos.copy()
    steps = round(SPAN / dt)
    motion, seconds = [], 0.0
    for _ in range(SPANS):
        begin = time.perf_counter()
        for _ in range(steps):
            mujoco.mj_step(model, data)
        seconds += time.perf_counter() - begin
        motion.append(data.flexvert_xpos - start)
    motion = np.array(motion)
    return (motion if np.isfinite(motion).all() and np.abs(motion).max() < 1 else None), seconds


def compare(palpate, folder):
    """Rows of (tool, setting, step, ms a simulated second, error)."""
    simulate(palpate, folder / "rest", "implicit", 4, 0)
    nodes, tets = read(next((folder / "rest").glob("*.vtu")))
    times = SPAN * np.arange(1, SPANS + 1)
    truth = exact_motion(nodes, tets, times)
    rows = []
    duration = SPAN * SPANS
    for solver, ladder in [
        ("symplectic", [64, 128, 256]),
        ("velocity-verlet", [64, 128, 256]),
        ("implicit", [4, 16, 64, 256]),
    ]:
        for steps in ladder:
            run = folder / f"{solver}_{steps}"
            start = simulate(palpate, run, solver, steps, 0)
            took = simulate(palpate, run, solver, steps, SPANS)
            row = ["Palpate", solver, SPAN / steps]
            if start is None or took is None:
                rows.append(row + [float("nan"), float("nan"), "diverged"])
                continue
            frames = sorted(run.glob("*.vtu"))
            found = np.array([read(f)[0] for f in frames[1:]]) - nodes
            ms = 1e3 * max(took - start, 1e-4) / duration
            rows.append(row + [ms, error(found, truth), "ran"])
    # Its other integrators refuse elastic flexes.
    for integrator, ladder in [("Euler", [32, 64, 128, 256]), ("discrete", [8, 32, 128])]:
        for steps in ladder:
            found, seconds = mujoco_motion(nodes, tets, integrator, SPAN / steps)
            row = ["MuJoCo", integrator, SPAN / steps]
            off = float("inf") if found is None else error(found, truth)
            # Farther off than the body moves: it starts anew in between, or flies apart.
            if off > 1:
                rows.append(row + [float("nan"), float("nan"), "diverged"])
            else:
                rows.append(row + [1e3 * seconds / duration, off, "ran"])
    return rows
