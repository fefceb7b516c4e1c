#!/usr/bin/env python3
"""Compares light paths with the volumetric path tracer of Mitsuba 3, for docs/validation/mitsuba.md.

    python3 -m venv mi && mi/bin/pip install mitsuba pillow matplotlib
    mi/bin/python scripts/compare_mitsuba.py FOLDER [SAMPLES] [PALPATE]          means and noise
    mi/bin/python scripts/compare_mitsuba.py FOLDER noise [PALPATE]              time to equal noise
    mi/bin/python scripts/compare_mitsuba.py FOLDER bent [PALPATE]               pictures side by side

Both draw the head of data/head_ct.mha at rest, without surfaces and under white light from all sides:
Palpate in a box of tetrahedra around the scan, Mitsuba's volpath in a grid of extinctions and albedos,
three times as fine as the scan, since transfer functions are applied after interpolation. Writes
mitsuba.png, with Palpate at the left, and prints the means of the body's pixels, their standard errors, and
the noise of the pixels' differences in units of their standard errors.

`noise` measures seconds and noise at several numbers of samples and writes mitsuba-noise.csv and .svg.
`bent` draws the head of data/scenes/head_ct.toml with its cheek pressed by the head light and by light paths,
and the scan at rest by Mitsuba, and writes light-paths.png.
"""
import csv
import json
import re
import subprocess
import sys
import time
import tomllib
import zlib
from pathlib import Path

import mitsuba as mi
import numpy as np
from PIL import Image

REPOSITORY = Path(__file__).resolve().parent.parent
SCAN = REPOSITORY / "data/head_ct.mha"
SIZE = (64, 80)
EYE, LOOK_AT, UP, FOV = [150.0, 500.0, 40.0], [0.0, 0.0, -8.0], [0.0, 0.0, 1.0], 28.0
EXTINCTION = 8.0
# Without peaks, which the grid would miss.
TRANSFER = {
    "colour": [[0, 0.8, 0.45, 0.35], [2100, 0.97, 0.93, 0.85]],
    "extinction": [[0, 0.0], [300, 0.0], [1300, 0.012], [2100, 0.05]],
}
# Seeds per program: their spread is the noise.
SEEDS = 4
# Points of the grid per voxel of the scan, along each axis.
FINER = 3
BENT_SIZE = (264, 360)
# Samples per pixel at which time and noise are measured, and the size of those pictures.
STEPS = [1, 4, 16]
NOISE_SIZE = (192, 240)


def read_scan():
    """Returns values indexed z, y, x, and the lower and upper corners in LPS mm."""
    data = SCAN.read_bytes()
    end = data.index(b"LOCAL") + 6
    field = lambda name: re.search(rf"^{name} = (.*)$", data[:end].decode(), re.M)[1].split()
    counts = [int(n) for n in field("DimSize")]
    spacing = np.array(field("ElementSpacing"), float)
    low = np.array(field("Offset"), float) - 0.5 * spacing
    values = np.frombuffer(zlib.decompress(data[end:]), "<i2").reshape(counts[::-1])
    return values.astype(float), low, low + spacing * counts


def finer(values):
    """Interpolates linearly, clamped to the outermost centres."""
    for axis in range(3):
        n = values.shape[axis]
        at = np.clip((np.arange(FINER * n) + 0.5) / FINER - 0.5, 0, n - 1)
        below = np.minimum(at.astype(int), n - 2)
        share = (at - below).reshape([-1 if k == axis else 1 for k in range(3)])
        values = (1 - share) * np.take(values, below, axis) + share * np.take(values, below + 1, axis)
    return values


def write_box(path, low, high, cells=12):
    """Writes a box of cells³ cubes of six tetrahedra."""
    n = cells + 1
    grid = np.stack(np.meshgrid(*[np.linspace(low[k], high[k], n) for k in range(3)], indexing="ij"), -1)
    nodes = grid.reshape(-1, 3)
    step = np.array([n * n, n, 1])
    tets = []
    for cell in np.ndindex(cells, cells, cells):
        for order in [(0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2)]:
            tet = [int(np.dot(cell, step))]
            for axis in order:
                tet.append(tet[-1] + int(step[axis]))
            # Odd orders turn the other way.
            tets.append(tet if order in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] else [tet[0], tet[2], tet[1], tet[3]])
    with open(path, "w") as out:
        out.write(f"MeshVersionFormatted 2\nDimension 3\nVertices\n{len(nodes)}\n")
        out.writelines("%.9g %.9g %.9g 0\n" % tuple(p) for p in nodes)
        out.write(f"Tetrahedra\n{len(tets)}\n")
        out.writelines("%d %d %d %d 0\n" % tuple(v + 1 for v in tet) for tet in tets)
        out.write("End\n")


def draw_palpate(folder, program, samples, seed, size=SIZE):
    numbers = lambda v: ", ".join(str(x) for x in v)
    (folder / "transfer.json").write_text(json.dumps(TRANSFER))
    (folder / "mitsuba.toml").write_text(
        f'mesh = {{ file = "box.mesh", frame = "ras", unit = "mm" }}\n'
        f'scan = {{ file = "{SCAN}", transfer = "transfer.json", labels = false }}\n'
        f'light = {{ model = "path", from = "none", environment = "white", samples = {samples}, '
        f"seed = {seed}, extinction = {EXTINCTION} }}\n"
        f"camera = {{ eye = [{numbers(EYE)}], look_at = [{numbers(LOOK_AT)}], up = [{numbers(UP)}], fov = {FOV} }}\n"
        f"picture = {{ size = [{numbers(size)}] }}\n"
    )
    out = folder / "palpate.exr"
    subprocess.run([program, "render", folder / "mitsuba.toml", "-q", "-o", out], check=True)
    return np.array(mi.Bitmap(str(out)).convert(mi.Bitmap.PixelFormat.RGBA, mi.Struct.Type.Float32, False))


def mitsuba_scene(values, low, high, size=SIZE, transfer=TRANSFER, camera=(EYE, LOOK_AT, UP, FOV)):
    s = finer(values)
    eye, look_at, up, fov = camera
    table = lambda points, k: np.interp(s, [p[0] for p in points], [p[k] for p in points])
    sigma = EXTINCTION * table(transfer["extinction"], 1)
    colour = np.stack([table(transfer["colour"], k) for k in (1, 2, 3)], -1)
    albedo = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    # From the unit cube, whose axes are those of the scan, to RAS.
    place = mi.ScalarTransform4f().scale([-1, -1, 1]).translate(list(low)).scale(list(high - low))
    cube = place.translate([0.5, 0.5, 0.5]).scale([0.5, 0.5, 0.5])
    grid = lambda v: {"type": "gridvolume", "grid": mi.VolumeGrid(v.astype(np.float32)), "to_world": place, "raw": True}
    return mi.load_dict({
        "type": "scene",
        "integrator": {"type": "volpath", "max_depth": -1, "rr_depth": 8, "hide_emitters": True},
        "sensor": {
            "type": "perspective", "fov": fov, "fov_axis": "y",
            "to_world": mi.ScalarTransform4f().look_at(origin=eye, target=look_at, up=up),
            "film": {"type": "hdrfilm", "width": size[0], "height": size[1], "pixel_format": "rgba",
                     "rfilter": {"type": "box"}},
            "sampler": {"type": "independent"},
        },
        "light": {"type": "constant", "radiance": {"type": "rgb", "value": 1.0}},
        "body": {
            "type": "cube", "to_world": cube, "bsdf": {"type": "null"},
            "interior": {"type": "heterogeneous", "sigma_t": grid(sigma[..., None]), "albedo": grid(albedo),
                         "phase": {"type": "isotropic"}},
        },
    })


def noise_of(pictures, body):
    """Returns the root mean square of the pixels' standard errors, relative to the mean, of one picture."""
    return np.sqrt(pictures[:, body, :3].var(0, ddof=1).mean()) / pictures[:, body, :3].mean()


def measure_noise(folder, program):
    """Measures the seconds and the noise of pictures; of Palpate's whole run, of Mitsuba's rendering alone."""
    rows = []

    def measure(name, draw):
        for samples in STEPS:
            seconds, pictures = [], []
            for seed in range(2):
                began = time.perf_counter()
                pictures.append(draw(samples, seed))
                seconds.append(time.perf_counter() - began)
            pictures = np.stack(pictures)
            body = pictures[..., 3].mean(0) > 0.9
            rows.append([name, samples, min(seconds), 100 * noise_of(pictures, body)])
            print("%s: %d samples, %.2f s, noise %.2f %%" % tuple(rows[-1]))

    measure("Palpate", lambda samples, seed: draw_palpate(folder, program, samples, seed, NOISE_SIZE))
    scene = mitsuba_scene(*read_scan(), NOISE_SIZE)
    measure("Mitsuba, scalar_rgb", lambda samples, seed: np.array(mi.render(scene, spp=samples, seed=seed)))
    with open(folder / "mitsuba-noise.csv", "w", newline="") as out:
        table = csv.writer(out)
        table.writerow(["program", "samples", "seconds", "noise_percent"])
        table.writerows([name, n, f"{seconds:.3g}", f"{noise:.3g}"] for name, n, seconds, noise in rows)
    draw_noise(folder)


def draw_noise(folder):
    """Draws mitsuba-noise.svg from mitsuba-noise.csv."""
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    with open(folder / "mitsuba-noise.csv", newline="") as table:
        rows = list(csv.DictReader(table))
    figure, axes = plt.subplots(figsize=(6.4, 4))
    for name in dict.fromkeys(row["program"] for row in rows):
        own = [row for row in rows if row["program"] == name]
        axes.loglog(*[[float(row[key]) for row in own] for key in ("seconds", "noise_percent")], "o-", label=name)
    for axis, ticks in [(axes.xaxis, [0.5, 1, 2, 5, 10, 20]), (axes.yaxis, [20, 30, 50, 70, 100])]:
        axis.set_ticks(ticks, [str(tick) for tick in ticks])
        axis.set_ticks([], minor=True)
    axes.set_xlabel("seconds per picture")
    axes.set_ylabel("noise, % of the mean")
    axes.grid(True, alpha=0.3)
    axes.legend()
    figure.tight_layout()
    figure.savefig(folder / "mitsuba-noise.svg", metadata={"Date": None})


def draw_bent(folder, program):
    """Draws the bent head by both lights of Palpate, and the scan at rest by Mitsuba."""
    scene, size = REPOSITORY / "data/scenes/head_ct.toml", BENT_SIZE
    panels = []
    for name, flags in [("head", ["--light", "head"]), ("path", ["--light", "path", "--extinction", str(EXTINCTION)])]:
        out = folder / f"{name}.png"
        more = ["--spp", "64", "--denoise"] if name == "path" else []
        given = ["--size", "%dx%d" % size, "--background", "white", "-q", "-o", out]
        subprocess.run([program, "render", scene, *flags, *more, *given], check=True)
        panels.append(Image.open(out).convert("RGB"))
    transfer = json.loads((REPOSITORY / "data/head_ct.json").read_text())
    # Outside the head the scan is air, which the mesh leaves out.
    transfer["extinction"] = [[0, 0.0], [500, 0.0]] + [[s, e] for s, e in transfer["extinction"] if s > 500]
    view = tomllib.loads(scene.read_text())["camera"]
    camera = tuple(view[key] for key in ("eye", "look_at", "up", "fov"))
    rest = np.array(mi.render(mitsuba_scene(*read_scan(), size, transfer, camera), spp=16))
    shown = np.clip(rest[..., :3] + 1 - rest[..., 3:], 0, 1) ** (1 / 2.2)
    panels.append(Image.fromarray((255 * shown).astype(np.uint8)))
    both = Image.new("RGB", (3 * size[0], size[1]))
    for k, panel in enumerate(panels):
        both.paste(panel, (k * size[0], 0))
    both.save(folder / "light-paths.png")


def main():
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    what = sys.argv[2] if len(sys.argv) > 2 else "64"
    program = sys.argv[3] if len(sys.argv) > 3 else REPOSITORY / "target/release/palpate"
    mi.set_variant("scalar_rgb")
    values, low, high = read_scan()
    ends = np.array([[-high[0], -high[1], low[2]], [-low[0], -low[1], high[2]]])
    write_box(folder / "box.mesh", *ends)
    if what == "noise":
        return measure_noise(folder, program)
    if what == "bent":
        return draw_bent(folder, program)
    compare(folder, program, int(what), (values, low, high))


def compare(folder, program, samples, scan):
    """Compares means and noise, and writes both pictures."""
    ours = np.stack([draw_palpate(folder, program, samples, seed) for seed in range(SEEDS)])
    scene = mitsuba_scene(*scan)
    theirs = np.stack([np.array(mi.render(scene, spp=samples, seed=seed)) for seed in range(SEEDS)])
    body = (ours[..., 3].mean(0) > 0.5) & (theirs[..., 3].mean(0) > 0.5)
    print(f"{body.sum()} pixels of the body, {SEEDS} × {samples} samples each")
    for k, name in enumerate(["red", "green", "blue", "opacity"]):
        means = [v[:, body, k].mean(1) for v in (ours, theirs)]
        errors = [m.std(ddof=1) / SEEDS**0.5 for m in means]
        print(f"{name}: {means[0].mean():.4f} ± {errors[0]:.4f}, Mitsuba {means[1].mean():.4f} ± {errors[1]:.4f}")
    # Of differences by noise alone, the root mean square is 1.
    spread = [v[:, body, :3].var(0, ddof=1) / SEEDS for v in (ours, theirs)]
    difference = (ours.mean(0) - theirs.mean(0))[body][:, :3]
    ratio = np.sqrt((difference**2).mean() / (spread[0] + spread[1]).mean())
    print(f"differences of pixels: {ratio:.2f} of their noise")
    shown = [np.clip(v.mean(0)[..., :3] + 1 - v.mean(0)[..., 3:], 0, 1) ** (1 / 2.2) for v in (ours, theirs)]
    image = Image.fromarray((255 * np.concatenate(shown, 1)).astype(np.uint8))
    image.resize((4 * SIZE[0], 2 * SIZE[1]), Image.Resampling.NEAREST).save(folder / "mitsuba.png")


if __name__ == "__main__":
    main()
