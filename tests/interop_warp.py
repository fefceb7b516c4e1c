"""Scans warped by Palpate and, with the fields that it writes, by ITK; a part of interop.py."""

import meshio
import numpy as np
import SimpleITK as sitk


def bent(points):
    """Where a body that is waved and turned a little has its points, in mm."""
    x, y, z = points.T
    turned = np.stack([0.98 * x - 0.2 * y, 0.2 * x + 0.98 * y, z], axis=1)
    return turned + 3.0 * np.stack([np.sin(0.1 * z), np.cos(0.08 * x), np.sin(0.07 * (x + y))], axis=1)


def warped_by_itk(folder, run, check):
    """What `palpate warp` makes of a scan is what ITK resamples by the field that it writes; `run`
    calls Palpate, `check` tells of a difference, in words or none."""
    rng = np.random.default_rng(5)
    size = np.array([40, 44, 36])
    # Smooth blobs in whole numbers, on a tilted and stretched grid about the origin.
    noise = sitk.GetImageFromArray(rng.standard_normal(size[::-1]))
    scan = sitk.Cast(4e4 * sitk.SmoothingRecursiveGaussian(noise, 2.0), sitk.sitkInt16)
    turn = sitk.Euler3DTransform((0, 0, 0), 0.3, -0.2, 0.5).GetMatrix()
    spacing = np.array([1.25, 0.9, 1.6])
    scan.SetDirection(turn)
    scan.SetSpacing(spacing.tolist())
    axes = np.reshape(turn, (3, 3)) * spacing
    scan.SetOrigin((-axes @ ((size - 1) / 2)).tolist())
    values = sitk.GetArrayViewFromImage(scan)
    labels = sitk.Cast(sitk.GetImageFromArray(np.digitize(values, np.quantile(values, [0.25, 0.5, 0.75])) + 1), sitk.sitkUInt8)
    ones = sitk.GetImageFromArray(np.ones(size[::-1], np.uint8))
    for image in (labels, ones):
        image.CopyInformation(scan)
    sitk.WriteImage(scan, folder / "scan.nrrd")
    sitk.WriteImage(labels, folder / "labels.nii.gz")
    sitk.WriteImage(ones, folder / "ones.mha")
    # All of the grid but its rim is body, which leaves some of it in no tet.
    rest, moved = folder / "rest.vtu", folder / "moved.vtu"
    run("mesh", folder / "ones.mha", "--labels", "1", "--tets", "20000", "--out", rest)
    mesh = meshio.read(rest)
    mesh.points = bent(mesh.points)
    mesh.write(moved)

    def warp(image, out, *flags):
        run("warp", folder / image, "--mesh", rest, "--to", moved, "--out", folder / out, *flags)
        return sitk.ReadImage(folder / out)

    covered = sitk.GetArrayFromImage(warp("ones.mha", "covered.nrrd", "--labels")) == 1
    share = covered.mean()
    check("some of the warped grid is body, some is not", "" if 0.5 < share < 0.99 else f"{share}")
    span = float(values.max()) - float(values.min())
    real = sitk.Cast(scan, sitk.sitkFloat64)

    def by_itk(image, field, interpolator, mirror=1.0):
        field = sitk.Cast(sitk.ReadImage(field), sitk.sitkVectorFloat64)
        if mirror != 1.0:
            x, y, z = (sitk.VectorIndexSelectionCast(field, n) for n in range(3))
            field = sitk.Compose(mirror * x, mirror * y, z)
        grid = sitk.Image(field.GetSize(), sitk.sitkUInt8)
        grid.CopyInformation(field)
        transform = sitk.DisplacementFieldTransform(field)
        return sitk.GetArrayFromImage(sitk.Resample(image, grid, transform, interpolator, 0.0))

    def rmse(ours, theirs, where):
        return np.sqrt(np.mean((ours[where].astype(float) - theirs[where]) ** 2)) / span

    for extension in ("nii.gz", "nrrd", "mha"):
        inverse = folder / f"inverse.{extension}"
        there = folder / f"there.{extension}"
        image = warp("scan.nrrd", f"warped.{extension}", "--inverse", inverse, "--displacement", there)
        ours = sitk.GetArrayFromImage(image)
        off = rmse(ours, by_itk(real, inverse, sitk.sitkLinear), covered)
        check(f"ITK resamples to the same picture by our field in .{extension}", "" if off <= 0.01 else f"RMSE {off}")
        off = rmse(ours, by_itk(real, inverse, sitk.sitkLinear, -1.0), covered)
        check(f"negative control: a field in RAS, .{extension}, is told", "" if off > 0.05 else f"RMSE {off}")
        still = rmse(ours, sitk.GetArrayFromImage(scan), covered)
        check("negative control: the scan that nobody moved is told", "" if still > 0.05 else f"RMSE {still}")
        # The other way round, by a field on the scan's own grid: what was bent comes back, but for
        # what two samplings take from it.
        back = by_itk(sitk.Cast(image, sitk.sitkFloat64), there, sitk.sitkLinear)
        middle = (slice(9, -9),) * 3
        off = rmse(sitk.GetArrayFromImage(scan)[middle], back[middle], slice(None))
        check(f"and back by the displacement in .{extension}", "" if off <= 0.05 else f"RMSE {off}")

    ours = sitk.GetArrayFromImage(warp("labels.nii.gz", "warped_labels.nii.gz", "--labels", "--inverse", folder / "of_labels.nii.gz"))
    theirs = by_itk(labels, folder / "of_labels.nii.gz", sitk.sitkNearestNeighbor)
    # Away from the rim of the body and of the scan.
    away = np.zeros_like(covered)
    away[1:-1, 1:-1, 1:-1] = True
    for axis in range(3):
        for step in (-1, 1):
            away &= np.roll(covered, step, axis)
    same = (ours == theirs)[away].mean()
    check("ITK resamples to the same labels", "" if same >= 0.995 else f"{same:.4f} of them are the same")
