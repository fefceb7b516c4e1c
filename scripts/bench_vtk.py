#!/usr/bin/env python3
"""Times VTK's unstructured volume mappers on the benchmark cube, for docs/performance.md.

    python3 -m venv v && v/bin/pip install vtk numpy pillow
    v/bin/python scripts/bench_vtk.py CUBE.vtu projected|raycast [FRAMES] [OUT.png]

512 x 512 pixels; before each frame the camera turns 7 degrees about the cube, so that VTK sorts
anew. Prints the median wall time of a frame. With OUT.png, also saves the last frame.
    v/bin/python scripts/bench_vtk.py --truth FRAMES PICTURE.png [PICTURE.png ...]
prints each picture's RMSE to the picture of the analytic field that the cube samples.
"""
import statistics
import sys
import time

import numpy as np

# The scalar's colours, and its extinction per unit of length.
COLOUR = [(0.0, 0.1, 0.1, 0.8), (0.5, 0.1, 0.9, 0.3), (1.0, 0.9, 0.2, 0.1)]
EXTINCTION = [(0.0, 0.0), (0.45, 0.0), (0.55, 3.5), (0.65, 0.5), (1.0, 8.0)]
EYE, MIDDLE, UP, FOV, SIZE, TURN = (1.8, 1.3, 2.5), (0.5, 0.5, 0.5), (0, 1, 0), 30, 512, 7


def bench(mesh, mapper, frames, out):
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401 (registers the renderer)
    from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
    from vtkmodules.vtkIOImage import vtkPNGWriter
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader
    from vtkmodules.vtkRenderingCore import (
        vtkColorTransferFunction, vtkRenderer, vtkRenderWindow, vtkVolume, vtkVolumeProperty,
        vtkWindowToImageFilter)
    from vtkmodules.vtkRenderingVolume import vtkUnstructuredGridVolumeRayCastMapper
    from vtkmodules.vtkRenderingVolumeOpenGL2 import vtkOpenGLProjectedTetrahedraMapper

    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(mesh)
    reader.Update()
    grid = reader.GetOutput()
    grid.GetPointData().SetActiveScalars("scalar")
    if mapper == "projected":
        m = vtkOpenGLProjectedTetrahedraMapper()
    else:
        m = vtkUnstructuredGridVolumeRayCastMapper()
        m.SetAutoAdjustSampleDistances(0)
        m.SetImageSampleDistance(1.0)
    m.SetInputData(grid)
    # Both functions at the union of their nodes: the ray caster ignores those of the opacity.
    nodes = sorted({c[0] for c in COLOUR} | {e[0] for e in EXTINCTION})
    colour, opacity = vtkColorTransferFunction(), vtkPiecewiseFunction()
    for s in nodes:
        rgb = [np.interp(s, [c[0] for c in COLOUR], [c[k] for c in COLOUR]) for k in (1, 2, 3)]
        colour.AddRGBPoint(s, *rgb)
        unit = 0.1
        opacity.AddPoint(s, unit * np.interp(s, *zip(*EXTINCTION)))
    property_ = vtkVolumeProperty()
    property_.SetColor(colour)
    property_.SetScalarOpacity(opacity)
    property_.SetScalarOpacityUnitDistance(unit)
    property_.SetInterpolationTypeToLinear()
    volume = vtkVolume()
    volume.SetMapper(m)
    volume.SetProperty(property_)
    renderer, window = vtkRenderer(), vtkRenderWindow()
    renderer.AddVolume(volume)
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(0)
    window.SetSize(SIZE, SIZE)
    window.AddRenderer(renderer)
    camera = renderer.GetActiveCamera()
    camera.SetFocalPoint(*MIDDLE)
    camera.SetPosition(*EYE)
    camera.SetViewUp(*UP)
    camera.SetViewAngle(FOV)

    def frame():
        renderer.ResetCameraClippingRange()
        start = time.perf_counter()
        window.Render()
        window.WaitForCompletion()
        return time.perf_counter() - start

    frame()
    times = []
    for _ in range(frames):
        camera.Azimuth(TURN)
        times.append(frame())
    print(f"{mapper}: {1e3 * statistics.median(times):.0f} ms a frame, {grid.GetNumberOfCells()} tets")
    if out:
        picture, writer = vtkWindowToImageFilter(), vtkPNGWriter()
        picture.SetInput(window)
        picture.ReadFrontBufferOff()
        picture.Update()
        writer.SetFileName(out)
        writer.SetInputData(picture.GetOutput())
        writer.Write()


def truth(frames, pictures):
    """The ray integral through the analytic field itself, by 600 samples a ray."""
    from PIL import Image
    turn = np.radians(TURN * frames)
    c, s = np.cos(turn), np.sin(turn)
    middle = np.array(MIDDLE)
    eye = middle + np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ (np.array(EYE) - middle)
    forward = (middle - eye) / np.linalg.norm(middle - eye)
    right = np.cross(forward, UP)
    right /= np.linalg.norm(right)
    x = ((np.arange(SIZE) + 0.5) / SIZE * 2 - 1) * np.tan(np.radians(FOV / 2))
    ray = forward + x[None, :, None] * right + -x[:, None, None] * np.cross(right, forward)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    a, b = (0 - eye) / ray, (1 - eye) / ray
    enter, leave = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
    step = np.maximum(leave - enter, 0) / 600
    sum_, clear = np.zeros(ray.shape), np.ones(enter.shape)
    for k in range(600):
        u, v, w = np.moveaxis(eye + (enter + (k + 0.5) * step)[..., None] * ray - 0.5, -1, 0)
        scalar = 0.5 + 0.25 * (np.sin(9 * u) * np.cos(7 * v) + np.sin(8 * w + 2 * u))
        alpha = 1 - np.exp(-step * np.interp(scalar, *zip(*EXTINCTION)))
        rgb = [np.interp(scalar, [c[0] for c in COLOUR], [c[k] for c in COLOUR]) for k in (1, 2, 3)]
        sum_ += (clear * alpha)[..., None] * np.stack(rgb, -1)
        clear *= 1 - alpha
    for name in pictures:
        picture = np.asarray(Image.open(name).convert("RGB")) / 255
        print(f"{name}: RMSE {np.sqrt(((picture - sum_) ** 2).mean()):.4f}")


if sys.argv[1:2] == ["--truth"]:
    truth(int(sys.argv[2]), sys.argv[3:])
elif len(sys.argv) >= 3:
    bench(sys.argv[1], sys.argv[2], int((sys.argv[3:4] or [5])[0]), (sys.argv[4:5] or [None])[0])
else:
    sys.exit(__doc__)
