"""A bar released under low gravity: Palpate, MuJoCo's flex and rapier's soft bodies.

    venv/bin/python benches/peers/bar.py        # deviation from the limit of small loads

The bar is 0.8 x 0.2 x 0.2 m of 1 MPa and 1000 kg/m³, clamped at x = 0, of cubes of five tets. The
reference is the modal solution of linear finite elements on the same mesh, in float64: gravity is
so low that the motion of any constitutive model is within 0.1 % of it. Every tool uses the same
mesh, node masses and one thread. The rod, if there is one, is the core of the bar from a quarter
of its length to the free end.
"""

import json
import os
import subprocess
import time
from pathlib import Path
from statistics import median

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigsh, splu

YOUNG, DENSITY, GRAVITY, LENGTH = 1e6, 1000.0, 0.05, 0.8
# Interval of the compared frames in seconds, and their number: about one oscillation.
FRAME, FRAMES = 0.02, 32
CELLS = {640: (8, 4, 4), 4320: (24, 6, 6), 34560: (48, 12, 12)}
POISSONS = (0.3, 0.45)
ROD_TETS, ROD_POISSON, ROD = 4320, 0.3, 1000.0
MODES = 80
# Maximum time of a run in seconds for half its step to be tried, too.
PATIENCE = 8.0
TURNS = {640: 3, 4320: 2, 34560: 1}

# Maximum number of halvings of the step of a frame.
HALVES = {
    ("Palpate", "implicit"): range(0, 7),
    ("Palpate", "bdf2"): range(0, 6),
    ("Palpate", "bdf2-tight"): range(0, 6),
    ("Palpate", "midpoint"): range(0, 6),
    ("Palpate", "velocity-verlet"): range(5, 8),
    ("MuJoCo", "discrete"): range(0, 6),
    ("MuJoCo", "Euler"): range(5, 9),
    ("rapier", "fem"): range(0, 7),
    ("rapier", "fem-solved"): range(0, 7),
    ("rapier", "constraints"): range(1, 8),
}


def bar(cells):
    """Returns the nodes and tets of the bar; alternate cells are mirrored."""
    from reference_dynamics import bar as cubes

    nodes, tets = cubes(cells, 1.0)
    nodes = nodes * (np.array([LENGTH, 0.2, 0.2]) / cells)
    edges = nodes[tets[:, 1:]] - nodes[tets[:, :1]]
    turned = np.linalg.det(edges) < 0
    tets[turned] = tets[turned][:, [0, 2, 1, 3]]
    return nodes, tets


def in_rod(nodes, tets):
    """Returns the mask of the rod's tets: the central third of the section, without the first quarter."""
    middle = nodes[tets].mean(1)
    across = np.abs(middle[:, 1:] - 0.1).max(1)
    return (across < 0.1 / 3) & (middle[:, 0] > LENGTH / 4)


def shape_gradients(nodes, tets):
    """Returns the gradients of the four shape functions of every tet, and the tets' volumes."""
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


def exact_motion(nodes, tets, young, poisson):
    """Returns the displacements by frame of linear elements released at rest, from their slowest modes.

    The contribution of the other modes is the static one under gravity; its size relative to the
    maximum displacement is also returned.
    """
    g, volumes = shape_gradients(nodes, tets)
    lam = young * poisson / ((1 + poisson) * (1 - 2 * poisson)) * volumes
    mu = young / (2 * (1 + poisson)) * volumes
    blocks = np.einsum("t,tai,tbj->taibj", lam, g, g) + np.einsum("t,taj,tbi->taibj", mu, g, g)
    blocks += np.einsum("t,tak,tbk,ij->taibj", mu, g, g, np.eye(3))
    places = (3 * tets[:, :, None] + np.arange(3)).reshape(len(tets), 12)
    rows, columns = np.repeat(places, 12, 1).ravel(), np.tile(places, (1, 12)).ravel()
    size = 3 * len(nodes)
    free = np.flatnonzero(np.repeat(nodes[:, 0] > 1e-9, 3))
    stiffness = sp.csc_matrix((blocks.ravel(), (rows, columns)), (size, size))[free][:, free]
    mass = np.repeat(lumped_mass(nodes, tets, volumes), 3)[free]
    weight = mass * np.tile([0, 0, -GRAVITY], len(nodes))[free]
    factor = splu(stiffness, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0, options={"SymmetricMode": True})
    still = factor.solve(weight)
    inverse = LinearOperator(stiffness.shape, factor.solve, dtype=float)
    squares, modes = eigsh(stiffness, MODES, sp.diags(mass), sigma=0, OPinv=inverse, v0=still)
    shares = modes.T @ (mass * still)
    times = FRAME * np.arange(1, FRAMES + 1)
    motion = np.zeros((FRAMES, size))
    motion[:, free] = still - (np.cos(np.outer(times, np.sqrt(squares))) * shares) @ modes.T
    motion = motion.reshape(FRAMES, -1, 3)
    rest = np.abs(still - modes @ shares).max() / way(motion)
    return motion, rest


def way(motion):
    return float(np.linalg.norm(motion, axis=-1).max())


def error(found, truth):
    """Returns the maximum position error over nodes and frames, relative to the maximum displacement."""
    return way(found - truth) / way(truth)


class Case:
    """A mesh with its reference solution, and the input of the tools."""

    def __init__(self, tets, poisson, rod, folder):
        self.poisson, self.rod, self.folder = poisson, rod, folder
        self.nodes, self.tets = bar(CELLS[tets])
        self.stiff = in_rod(self.nodes, self.tets)
        young = np.where(self.stiff, ROD * YOUNG, YOUNG) if rod else np.full(len(self.tets), YOUNG)
        self.truth, self.rest = exact_motion(self.nodes, self.tets, young, poisson)
        self.write()

    @classmethod
    def without_truth(cls, cells, poisson, folder):
        """A bar of these cells, whose motion is not compared."""
        case = cls.__new__(cls)
        case.poisson, case.rod, case.folder = poisson, False, folder
        case.nodes, case.tets = bar(cells)
        case.stiff = in_rod(case.nodes, case.tets)
        case.write()
        return case

    def write(self):
        folder = self.folder
        self.mesh = folder / "bar.txt"
        folder.mkdir(parents=True, exist_ok=True)
        with open(self.mesh, "w") as file:
            print(len(self.nodes), len(self.tets), file=file)
            np.savetxt(file, self.nodes, "%.17g")
            np.savetxt(file, np.column_stack([self.tets, self.stiff]), "%d")
        self.models = {}


def program(command, case, setting, step):
    """Runs a program of this folder: returns motion and milliseconds of processor time, or the failure."""
    scheme, _, rod = setting.partition(", ")
    out = case.folder / "motion.bin"
    out.unlink(missing_ok=True)
    numbers = [case.poisson, GRAVITY, repr(step), FRAME, FRAMES]
    rod = [] if not case.rod else ["rigid"] if rod else [ROD]
    asked = [command, case.mesh, out, scheme, *numbers, *rod]
    asked = [str(word) for word in asked]
    environment = {**os.environ, "RAYON_NUM_THREADS": "1"}
    done = subprocess.run(asked, capture_output=True, text=True, check=False, env=environment)
    if done.returncode != 0:
        return None, float("nan"), done.stderr.strip()
    motion = np.fromfile(out).reshape(FRAMES, -1, 3)
    return motion, float(done.stdout.split()[0]), ""


def words(numbers):
    return " ".join(f"{x:.9g}" for x in np.ravel(numbers))


def mujoco_rod(case, mass):
    """Returns the bar as a flex with a body per node, and a single body for the nodes of the rod."""
    held, of_rod = case.nodes[:, 0] < 1e-9, np.zeros(len(case.nodes), bool)
    of_rod[case.tets[case.stiff].ravel()] = True
    weights = mass[of_rod]
    middle = weights @ case.nodes[of_rod] / weights.sum()
    arms = case.nodes[of_rod] - middle
    inertia = (weights @ (arms**2).sum(1)) * np.eye(3) - np.einsum("n,ni,nj->ij", weights, arms, arms)
    inertia = [*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    slides = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
    bodies = [
        f"""<body name="rod" pos="{words(middle)}"><freejoint/>
          <inertial pos="0 0 0" mass="{weights.sum():.9g}" fullinertia="{words(inertia)}"/></body>"""
    ]
    names, places = [], np.zeros_like(case.nodes)
    for node, place in enumerate(case.nodes):
        names.append("world" if held[node] else "rod" if of_rod[node] else f"node{node}")
        if held[node]:
            places[node] = place
        elif of_rod[node]:
            places[node] = place - middle
        else:
            # A node does not rotate; the magnitude of its inertia is irrelevant.
            bodies.append(
                f"""<body name="node{node}" pos="{words(place)}">{slides}
                  <inertial pos="0 0 0" mass="{mass[node]:.9g}" diaginertia="{words([1e-4 * mass[node]] * 3)}"/></body>"""
            )
    return f"""<worldbody>{"".join(bodies)}</worldbody>
      <deformable><flex name="bar" dim="3" radius="0.0005" body="{" ".join(names)}"
        vertex="{words(places)}" element="{words(case.tets)}">
        <contact contype="0" conaffinity="0" selfcollide="none"/>
        <elasticity young="{YOUNG}" poisson="{case.poisson}" damping="0"/>
      </flex></deformable>"""


def mujoco_model(case, integrator):
    import mujoco

    # Its warnings are counted, so no log file is needed.
    mujoco.set_mju_user_warning(lambda text: None)
    # Each node has a quarter of the mass of its tets, as in the elements and in Palpate.
    _, volumes = shape_gradients(case.nodes, case.tets)
    mass = lumped_mass(case.nodes, case.tets, volumes)
    held = np.flatnonzero(case.nodes[:, 0] < 1e-9)
    plain = f"""<worldbody><flexcomp name="bar" type="direct" dim="3" mass="32" radius="0.0005"
        point="{words(case.nodes)}" element="{words(case.tets)}">
        <contact contype="0" conaffinity="0" selfcollide="none"/>
        <elasticity young="{YOUNG}" poisson="{case.poisson}" damping="0"/>
        <pin id="{words(held)}"/>
      </flexcomp></worldbody>"""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 {-GRAVITY}" integrator="{integrator}"/><size memory="2G"/>
        {mujoco_rod(case, mass) if case.rod else plain}</mujoco>"""
    )
    data = mujoco.MjData(model)
    if not case.rod:
        for node, body in enumerate(model.flex_vertbodyid):
            if case.nodes[node, 0] > 1e-9:
                model.body_mass[body] = mass[node]
        mujoco.mj_setConst(model, data)
    return model, data


def mujoco_motion(case, integrator, step):
    import mujoco

    if integrator not in case.models:
        case.models[integrator] = mujoco_model(case, integrator)
    model, data = case.models[integrator]
    mujoco.mj_resetData(model, data)
    model.opt.timestep = step
    mujoco.mj_forward(model, data)
    start = data.flexvert_xpos.copy()
    kinds = mujoco.mjtWarning
    lost = [kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC]
    motion, seconds = [], 0.0
    for _ in range(FRAMES):
        begin = time.thread_time()
        for _ in range(round(FRAME / step)):
            mujoco.mj_step(model, data)
        seconds += time.thread_time() - begin
        motion.append(data.flexvert_xpos - start)
        # MuJoCo restarts when the simulation diverges, with a warning.
        if any(data.warning[kind].number for kind in lost) or not way(motion[-1]) < 1:
            return None, float("nan"), "diverged"
    unsolved = data.warning[kinds.mjWARN_INERTIA].number
    return np.array(motion), 1e3 * seconds, "warning: a solve did not converge" if unsolved else ""


def build(root):
    """Builds the programs that run Palpate and rapier from source; returns their commands."""
    def made(name, *cargo):
        command = ["cargo", *cargo, "--message-format=json"]
        done = subprocess.run(command, cwd=root, stdout=subprocess.PIPE, text=True, check=True)
        parts = [json.loads(line) for line in done.stdout.splitlines()]
        return next(p["executable"] for p in parts if p.get("executable") and p["target"]["name"] == name)

    rapier = str(Path("benches/peers/rapier/Cargo.toml"))
    return {
        "Palpate": made("peer_bar", "bench", "--bench", "peer_bar", "--no-run"),
        "rapier": made("rapier-bar", "build", "--release", "--locked", "--manifest-path", rapier),
    }


def measured(case, tool, setting, step, commands):
    if tool == "MuJoCo":
        return mujoco_motion(case, setting.partition(",")[0], step)
    return program(commands[tool], case, setting, step)


def ladder(case, tets, poisson, work, halves, commands):
    """Returns the rows of a panel of a chart; the tools alternate."""
    rows = {}
    for turn in range(TURNS[tets]):
        slow = set()
        for k in range(max(of_it.stop for of_it in halves.values())):
            for (tool, setting), of_it in halves.items():
                if k not in of_it or (tool, setting) in slow:
                    continue
                step = FRAME / 2**k
                row = rows.get((tool, setting, step))
                if turn and (row is None or row["state"] != "ran"):
                    continue
                motion, ms, why = measured(case, tool, setting, step, commands)
                if row is None:
                    off = error(motion, case.truth) if motion is not None else float("nan")
                    # An error as large as the motion of the bar: no useful result.
                    state = "ran" if off < 2 else "diverged"
                    row = {"state": state, "error": off if state == "ran" else float("nan"), "ms": []}
                    rows[tool, setting, step] = row
                    print(f"{work} {tets} {poisson} {tool} {setting} {step:.3g} s: {ms:.1f} ms, {row['error']:.3g} {why}", flush=True)
                row["ms"].append(ms)
                if ms > 1e3 * PATIENCE:
                    slow.add((tool, setting))
    length = FRAME * FRAMES
    return [
        [work, tool, setting, tets, poisson, step, median(row["ms"]) / length if row["state"] == "ran" else float("nan"), row["error"], row["state"]]
        for (tool, setting, step), row in rows.items()
    ]


def compare(root, folder, sizes):
    """Returns rows of (work, tool, setting, tets, ν, step, ms per simulated second, error, state)."""
    commands = build(root)
    rows = []
    for tets in sizes:
        for poisson in POISSONS:
            case = Case(tets, poisson, False, folder)
            print(f"bar {tets} {poisson}: omitted modes are {case.rest:.1e} of the displacement", flush=True)
            rows += ladder(case, tets, poisson, "bar", HALVES, commands)
    # MuJoCo has one modulus per flex, whose nodes may be those of a rigid body; rapier's soft
    # bodies have no such nodes; Palpate has both.
    halves = {name: k for name, k in HALVES.items() if name[0] != "MuJoCo"}
    rigid = [("Palpate", "implicit"), ("Palpate", "bdf2"), ("MuJoCo", "discrete"), ("MuJoCo", "Euler")]
    halves |= {(tool, f"{scheme}, rigid"): HALVES[tool, scheme] for tool, scheme in rigid}
    case = Case(ROD_TETS, ROD_POISSON, True, folder)
    print(f"rod: omitted modes are {case.rest:.1e} of the displacement", flush=True)
    return rows + ladder(case, ROD_TETS, ROD_POISSON, "rod", halves, commands)


def load_is_small(poisson):
    """Returns the relative difference of the motion of neo-Hookean tets from that under 1 % of the load."""
    import reference_dynamics as reference

    reference.MU = YOUNG / (2 * (1 + poisson))
    reference.LAMBDA = YOUNG * poisson / ((1 + poisson) * (1 - 2 * poisson)) + reference.MU
    motions = []
    for gravity in (GRAVITY, GRAVITY / 100):
        reference.GRAVITY = np.array([0.0, 0.0, -gravity])
        body, states = reference.Body(), []
        sunk = body.sunk

        def noted(x):
            states.append((x - body.rest) / gravity)
            return sunk(x)

        body.sunk = noted
        reference.trapezoid(body, FRAME / 4, 4 * FRAMES)
        motions.append(np.array(states))
    return error(*motions)


if __name__ == "__main__":
    for ratio in POISSONS:
        print(f"at ν = {ratio}, nonlinearity at gravity {GRAVITY} m/s² is {load_is_small(ratio):.1e} of the displacement")
