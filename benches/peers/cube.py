"""The benchmark's cube rendered by Palpate and by VTK's volume mappers, against a float64 integral."""

import json
import subprocess
import time
from statistics import median

import numpy as np

SIZE = 512
EYE, LOOK_AT, UP, FOV = (2.71205037, 1.3, 1.39265496), (0.5, 0.5, 0.5), (0.0, 1.0, 0.0), 30.0
COLOUR = [(0.0, 0.1, 0.1, 0.8), (0.5, 0.1, 0.9, 0.3), (1.0, 0.9, 0.2, 0.1)]
EXTINCTION = [(0.0, 0.0), (0.45, 0.0), (0.55, 3.5), (0.65, 0.5), (1.0, 8.0)]
# Stride of the reference pixels along x and y, and samples along a ray.
SPARSE, SAMPLES = 16, 2000

SCENE = """
[mesh]
generate = "cube"
tets = {tets}
[camera]
eye = {eye}
look_at = {look_at}
up = {up}
fov = {fov}
[light]
from = "none"
[picture]
size = [{size}, {size}]
bits = 16
transfer = '''{transfer}'''
"""


def field(p):
    """Returns the field of the cube at points (…, 3)."""
    x, y, z = np.moveaxis(p - 0.5, -1, 0)
    return 0.5 + 0.25 * (np.sin(9 * x) * np.cos(7 * y) + np.sin(8 * z + 2 * x))


def mesh_field(p, n):
    """Returns the field interpolated linearly on n³ cells of six tets around the diagonal."""
    cell = np.clip(np.floor(p * n), 0, n - 1)
    inside = p * n - cell
    order = np.argsort(-inside, axis=-1)
    sorted_ = np.take_along_axis(inside, order, -1)
    corner, value = cell.copy(), field(cell / n) * (1 - sorted_[..., 0])
    for k in range(3):
        np.put_along_axis(corner, order[..., k : k + 1], np.take_along_axis(cell, order[..., k : k + 1], -1) + 1, -1)
        after = sorted_[..., k + 1] if k < 2 else 0.0
        value += field(corner / n) * (sorted_[..., k] - after)
    return value


def truth(n):
    """Returns the colour of every SPARSEth pixel over black, (rows, columns, 3)."""
    eye, look_at, up = (np.array(v) for v in (EYE, LOOK_AT, UP))
    forward = (look_at - eye) / np.linalg.norm(look_at - eye)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    above = np.cross(right, forward)
    pixels = (np.arange(SPARSE // 2, SIZE, SPARSE) + 0.5) / SIZE * 2 - 1
    half = np.tan(np.radians(FOV) / 2)
    picture = np.zeros((len(pixels), len(pixels), 3))
    colour, extinction = np.array(COLOUR), np.array(EXTINCTION)
    for row, v in enumerate(-pixels):
        rays = forward + half * (pixels[:, None] * right + v * above)
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        with np.errstate(divide="ignore"):
            ends = np.sort(np.stack([(0 - eye) / rays, (1 - eye) / rays]), axis=0)
        enter, leave = ends[0].max(1), ends[1].min(1)
        hit = leave > enter
        if not hit.any():
            continue
        step = (leave - enter)[hit] / SAMPLES
        t = enter[hit][:, None] + step[:, None] * (np.arange(SAMPLES) + 0.5)
        s = mesh_field(np.clip(eye + t[..., None] * rays[hit][:, None], 0, 1), n)
        tau = np.interp(s, extinction[:, 0], extinction[:, 1])
        depth = np.cumsum(tau * step[:, None], axis=1)
        before = np.concatenate([np.zeros((len(depth), 1)), depth[:, :-1]], 1)
        share = np.exp(-before) - np.exp(-depth)
        for c in range(3):
            picture[row, hit, c] = (share * np.interp(s, colour[:, 0], colour[:, c + 1])).sum(1)
    return picture


def error(picture, exact):
    """Returns the root mean square error over the sparse pixels, for values in 0..1."""
    return float(np.sqrt(np.mean((picture[SPARSE // 2 :: SPARSE, SPARSE // 2 :: SPARSE] - exact) ** 2)))


def png(path):
    """Reads red, green and blue of a PNG with 8 or 16 bits per channel, as 0..1."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOImage import vtkPNGReader

    reader = vtkPNGReader()
    reader.SetFileName(str(path))
    reader.Update()
    values = vtk_to_numpy(reader.GetOutput().GetPointData().GetScalars())
    values = values / float(np.iinfo(values.dtype).max)
    return values.reshape(SIZE, SIZE, -1)[::-1, :, :3]


def palpate_picture(palpate, folder, n, frames):
    folder.mkdir(parents=True, exist_ok=True)
    scene = folder / "cube.toml"
    transfer = json.dumps({"colour": COLOUR, "extinction": EXTINCTION})
    scene.write_text(
        SCENE.format(
            tets=6 * n**3,
            eye=list(EYE),
            look_at=list(LOOK_AT),
            up=list(UP),
            fov=FOV,
            size=SIZE,
            transfer=transfer,
        )
    )
    out, report = folder / f"palpate_{n}.png", folder / f"palpate_{n}.json"
    command = [palpate, "render", scene, "--out", out, "--repeat", str(frames), "--report", report]
    subprocess.run(command, check=True, capture_output=True)
    return png(out), json.loads(report.read_text())["frame_ms"]


def vtk_picture(mapper, n, frames):
    """Returns a picture by one of VTK's mappers, and the median milliseconds of a redrawn frame."""
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import VTK_TETRA, vtkCellArray, vtkPiecewiseFunction, vtkUnstructuredGrid
    from vtkmodules.vtkRenderingCore import (
        vtkColorTransferFunction,
        vtkRenderer,
        vtkRenderWindow,
        vtkVolume,
        vtkVolumeProperty,
        vtkWindowToImageFilter,
    )
    from vtkmodules.vtkRenderingVolume import vtkUnstructuredGridVolumeRayCastMapper, vtkUnstructuredGridVolumeZSweepMapper
    from vtkmodules.vtkRenderingVolumeOpenGL2 import vtkOpenGLProjectedTetrahedraMapper

    line = np.arange(n + 1) / n
    nodes = np.stack(np.meshgrid(line, line, line, indexing="ij"), -1).reshape(-1, 3)
    index = np.arange((n + 1) ** 3).reshape((n + 1,) * 3)
    paths = [(a, b) for a in range(3) for b in range(3) if a != b]
    corners = []
    for a, b in paths:
        at = np.zeros((4, 3), int)
        at[1:, a] = 1
        at[2:, b] = 1
        at[3] = 1
        corners.append(np.stack([index[i : n + i, j : n + j, k : n + k].ravel() for i, j, k in at], 1))
    tets = np.concatenate(corners)
    grid = vtkUnstructuredGrid()
    points = vtkPoints()
    points.SetData(numpy_to_vtk(nodes, deep=1))
    grid.SetPoints(points)
    cells = vtkCellArray()
    packed = np.concatenate([np.full((len(tets), 1), 4), tets], 1).astype(np.int64).ravel()
    cells.SetCells(len(tets), numpy_to_vtkIdTypeArray(packed, deep=1))
    grid.SetCells(VTK_TETRA, cells)
    grid.GetPointData().SetScalars(numpy_to_vtk(field(nodes), deep=1))

    volume = vtkVolume()
    made = {
        "projected tetrahedra": vtkOpenGLProjectedTetrahedraMapper,
        "ray cast": vtkUnstructuredGridVolumeRayCastMapper,
        "ZSweep": vtkUnstructuredGridVolumeZSweepMapper,
    }[mapper]()
    made.SetInputData(grid)
    if mapper != "projected tetrahedra":
        made.SetAutoAdjustSampleDistances(0)
        made.SetImageSampleDistance(1.0)
    volume.SetMapper(made)
    # Colour and opacity at the same values: otherwise two of the mappers render a different
    # picture.
    values = sorted({s for s, *_ in COLOUR} | {s for s, _ in EXTINCTION})
    most = max(t for _, t in EXTINCTION)
    colour, opacity = vtkColorTransferFunction(), vtkPiecewiseFunction()
    for s in values:
        rgb = [np.interp(s, [c[0] for c in COLOUR], [c[k] for c in COLOUR]) for k in (1, 2, 3)]
        colour.AddRGBPoint(s, *rgb)
        opacity.AddPoint(s, np.interp(s, *zip(*EXTINCTION)) / most)
    look = vtkVolumeProperty()
    look.SetColor(colour)
    look.SetScalarOpacity(opacity)
    look.SetScalarOpacityUnitDistance(1 / most)
    look.SetInterpolationTypeToLinear()
    volume.SetProperty(look)

    renderer = vtkRenderer()
    renderer.AddVolume(volume)
    renderer.SetBackground(0, 0, 0)
    window = vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(SIZE, SIZE)
    window.AddRenderer(renderer)
    camera = renderer.GetActiveCamera()
    camera.SetPosition(EYE)
    camera.SetFocalPoint(LOOK_AT)
    camera.SetViewUp(UP)
    camera.SetViewAngle(FOV)
    renderer.ResetCameraClippingRange()
    taken = []
    for _ in range(frames + 1):
        # The nodes are marked as moved, so everything is sorted and rendered again.
        points.Modified()
        grid.Modified()
        start = time.perf_counter()
        window.Render()
        window.WaitForCompletion()
        taken.append(1e3 * (time.perf_counter() - start))
    grab = vtkWindowToImageFilter()
    grab.SetInput(window)
    grab.ReadFrontBufferOff()
    grab.Update()
    bytes_ = vtk_to_numpy(grab.GetOutput().GetPointData().GetScalars())
    return bytes_.reshape(SIZE, SIZE, 3)[::-1] / 255, median(taken[1:])


def compare(palpate, folder, sides, frames):
    """Returns rows of (tool, setting, tets, ms per frame, error)."""
    rows = []
    for n in sides:
        exact = truth(n)
        picture, ms = palpate_picture(palpate, folder, n, frames)
        rows.append(["Palpate", "raycast", 6 * n**3, ms, error(picture, exact), "ran"])
        for mapper in ["projected tetrahedra", "ray cast", "ZSweep"]:
            picture, ms = vtk_picture(mapper, n, frames if mapper == "projected tetrahedra" else 1)
            rows.append(["VTK", mapper, 6 * n**3, ms, error(picture, exact), "ran"])
    return rows
