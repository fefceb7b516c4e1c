"""Volumes: numpy, nibabel, files, warps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import palpate

OBLIQUE = np.array(
    [[-0.8, 0.1, 0.0, 40.0], [0.05, 0.9, -0.2, -30.0], [0.0, 0.3, 1.5, 10.0], [0, 0, 0, 1.0]]
)


@pytest.mark.parametrize("kind", ["u1", "i2", "f4", "f8"])
def test_volume_round_trips_with_nibabel(kind: str, tmp_path: Path) -> None:
    import nibabel

    array = (np.arange(4 * 5 * 6) % 100).reshape(4, 5, 6).astype(kind)
    volume = palpate.Volume(array, OBLIQUE)
    assert np.array_equal(volume.array, array) and volume.array.dtype == array.dtype
    assert np.allclose(volume.affine, OBLIQUE)
    volume.write(tmp_path / "v.nii.gz")
    theirs = nibabel.load(tmp_path / "v.nii.gz")
    assert np.array_equal(np.asanyarray(theirs.dataobj), array)
    assert np.allclose(theirs.affine, OBLIQUE, atol=1e-5)
    back = palpate.Volume.from_nibabel(theirs)
    assert np.array_equal(back.array, array)
    again = palpate.Volume.from_nibabel(volume.to_nibabel())
    assert np.array_equal(again.array, array) and np.allclose(again.affine, OBLIQUE)
    for suffix in (".nrrd", ".mha"):
        volume.write(tmp_path / f"v{suffix}")
        read = palpate.Volume.read(tmp_path / f"v{suffix}")
        assert np.array_equal(read.array, array) and np.allclose(read.affine, OBLIQUE)


def test_volume_rejects_invalid_input() -> None:
    with pytest.raises(palpate.InputError, match="three axes"):
        palpate.Volume(np.zeros((3, 3)))
    with pytest.raises(palpate.InputError, match="inverted"):
        palpate.Volume(np.zeros((3, 3, 3)), np.zeros((4, 4)))
    with pytest.raises(palpate.InputError, match="must be integers"):
        palpate.Volume(np.zeros((2, 2, 2), complex))


def test_warp_matches_command_line(tmp_path: Path, run) -> None:
    body = palpate.Mesh.generate("bar", tets=600)
    low, high = (np.array(p) for p in body.bounds)
    mm = palpate.Mesh(body.nodes, body.tets, length_unit=1e-3)
    size = (12, 10, 40)
    step = (high - low) / (np.array(size) - 1)
    affine = np.diag([*step, 1.0])
    affine[:3, 3] = low
    rng = np.random.default_rng(1)
    scan = palpate.Volume(rng.integers(0, 200, size).astype(np.int16), affine)
    bent = mm.nodes.copy()
    along = (bent[:, 2] - low[2]) / (high - low)[2]
    bent[:, 0] += 0.2 * (high - low)[0] * along**2
    warped = palpate.warp(scan, mm, bent)
    scan.write(tmp_path / "scan.nrrd")
    mm.write(tmp_path / "rest.vtu")
    mm.with_nodes(bent).write(tmp_path / "bent.vtu")
    out = tmp_path / "out.nrrd"
    run("warp", tmp_path / "scan.nrrd", "--mesh", tmp_path / "rest.vtu", "--to", tmp_path / "bent.vtu", "--out", out)
    theirs = palpate.Volume.read(out)
    assert np.array_equal(warped.array, theirs.array)
    assert not np.array_equal(warped.array, scan.array)
