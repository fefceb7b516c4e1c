"""The sag of a clamped bar at rest: Palpate on equal and on refined tets, MuJoCo's flex, rapier's soft bodies.

The bar of `bar.py` at rest, on meshes of more and more tets. The error is that of the largest
displacement from its converged value, so it includes that of the mesh. MuJoCo and rapier take implicit
steps of a second, about one and a half periods, whose numerical damping leads to rest; times are those
until the displacement changes by less than a thousandth. The converged value is that of
`palpate render --within 0.1%`. One thread.
"""

import os
import re
import subprocess

import bar
import numpy as np

POISSON = 0.45
CELLS = [(4, 2, 2), (8, 4, 4), (16, 4, 4), (24, 6, 6), (48, 12, 12)]
QUADRATIC_CELLS = CELLS[:4]
GOALS = [20, 5, 2]
STEP, STEPS, SETTLED = 1.0, 40, 1e-3
# Rounds as printed: tets, order, number, seconds.
ROUND = re.compile(r"(\d+) tets of order (\d): largest displacement ([\d.e+-]+).*?([\d.e+-]+) s$", re.M)


def write_mesh(path, cells):
    """Writes the bar as Medit's text."""
    nodes, tets = bar.bar(cells)
    with open(path, "w") as file:
        print("MeshVersionFormatted 2\nDimension 3\nVertices", len(nodes), sep="\n", file=file)
        np.savetxt(file, np.column_stack([nodes, np.zeros(len(nodes))]), "%.17g %.17g %.17g %d")
        print("Tetrahedra", len(tets), sep="\n", file=file)
        np.savetxt(file, np.column_stack([tets + 1, np.ones(len(tets))]), "%d")
        print("End", file=file)


def rounds(palpate, folder, cells, material, goal, most):
    """Returns (tets, displacement, seconds) of the meshes of `palpate render --within`."""
    write_mesh(folder / "rest.mesh", cells)
    (folder / "rest.toml").write_text(
        f"""[mesh]
file = "rest.mesh"
unit = "m"
[material]
young = {bar.YOUNG}
poisson = {POISSON}
density = {bar.DENSITY}
{material}
[solver]
name = "implicit"
engine = "cpu"
dt = 100
steps = 2
tolerance = 1e-4
gravity = [0, 0, {-bar.GRAVITY}]
[[pin]]
axis = "x"
below = 1e-9
[picture]
size = [32, 24]
"""
    )
    asked = [palpate, "render", folder / "rest.toml", "--within", f"{goal}%", "--max-tets", str(most), "--out", folder / "rest.png"]
    environment = {**os.environ, "RAYON_NUM_THREADS": "1"}
    done = subprocess.run([str(word) for word in asked], capture_output=True, text=True, check=False, env=environment)
    found = [(int(tets), float(x), float(seconds)) for tets, _, x, seconds in ROUND.findall(done.stderr)]
    if not found:
        raise SystemExit(f"palpate render failed: {done.stderr}")
    return found


def until_rest(motion, ms):
    """Returns displacement and milliseconds at the first of all frames that changes by less than a thousandth."""
    moved = np.linalg.norm(motion, axis=-1).max(1)
    changes = np.abs(np.diff(moved)) / moved[1:]
    still = np.flatnonzero(changes < SETTLED)
    if not len(still):
        return float("nan"), float("nan")
    last = still[0] + 1
    return moved[last], ms * (last + 1) / len(motion)


def compare(root, palpate, folder):
    """Returns rows of (work, tool, setting, tets, ν, step, ms, error, state)."""
    bar.FRAME, bar.FRAMES = STEP, STEPS
    folder.mkdir(parents=True, exist_ok=True)
    commands = bar.build(root)
    truth = rounds(palpate, folder, CELLS[1], "", 0.1, 300_000)[-1]
    print(f"converged: {truth[1]:.6g} with {truth[0]} tets", flush=True)
    rows = []

    def add(tool, setting, tets, moved, ms):
        off = abs(moved / truth[1] - 1)
        rows.append(["rest", tool, setting, tets, POISSON, STEP, ms, off, "ran" if off < 2 else "diverged"])
        print(f"rest {tool} {setting} {tets} tets: {ms:.1f} ms, {off:.3g}", flush=True)

    for setting, material, meshes in [
        ("linear tets", "order = 1", CELLS),
        ("averaged volumes", 'order = 1\nvolume = "averaged"', CELLS),
        ("quadratic tets", "order = 2", QUADRATIC_CELLS),
    ]:
        for cells in meshes:
            tets, moved, seconds = rounds(palpate, folder, cells, material, 2, 1)[0]
            add("Palpate", setting, tets, moved, 1e3 * seconds)
    for goal in GOALS:
        all_rounds = rounds(palpate, folder, CELLS[0], "", goal, 300_000)
        tets, moved, _ = all_rounds[-1]
        add("Palpate", "refined (--within)", tets, moved, 1e3 * sum(seconds for _, _, seconds in all_rounds))
    for cells in CELLS:
        case = bar.Case.without_truth(cells, POISSON, folder)
        for tool, setting in [("MuJoCo", "discrete"), ("rapier", "fem"), ("rapier", "fem-solved")]:
            motion, ms, why = bar.measured(case, tool, setting, STEP, commands)
            moved, ms = until_rest(motion, ms) if motion is not None else (float("nan"), float("nan"))
            add(tool, setting, len(case.tets), moved, ms)
            if why:
                print(f"  {why}")
    return rows
