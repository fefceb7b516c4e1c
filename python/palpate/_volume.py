"""Scans: scalar images on regular grids."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike, fspath
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _palpate
from ._errors import InputError

PathOf = str | PathLike[str]


class Volume:
    """Scalar image on a regular grid in world coordinates (RAS, mm).

    Args:
        array: voxel values, shape (ni, nj, nk).
        affine: transform from voxel indices to world coordinates, shape (4, 4), as in nibabel.
        names: names of labels.
    """

    def __init__(
        self,
        array: npt.ArrayLike,
        affine: npt.ArrayLike | None = None,
        names: Mapping[int, str] | None = None,
    ) -> None:
        voxels = np.asarray(array)
        world = np.eye(4) if affine is None else np.asarray(affine, dtype=np.float64)
        if voxels.ndim != 3 or world.shape != (4, 4):
            raise InputError(
                "a volume requires an array of three axes and an affine of shape (4, 4), got "
                f"{voxels.shape} and {world.shape}"
            )
        if voxels.dtype == np.bool_:
            voxels = voxels.astype(np.uint8)
        self._native = _palpate.Volume(
            voxels.astype(voxels.dtype.newbyteorder("=")).ravel(order="F"),
            voxels.shape,
            np.ascontiguousarray(world[:3].T),
            {int(k): str(v) for k, v in (names or {}).items()},
        )

    @classmethod
    def _of(cls, native: _palpate.Volume) -> Volume:
        volume = cls.__new__(cls)
        volume._native = native
        return volume

    @classmethod
    def read(cls, path: PathOf, *, volume: int | None = None) -> Volume:
        """Reads NIfTI, Analyze, NRRD, MetaImage, MGH, or DICOM: a file or a folder of slices.

        Args:
            path: file or folder.
            volume: which of several volumes (times, echoes, components), counted from 0.
        """
        return cls._of(_palpate.Volume.read(fspath(path), volume))

    @classmethod
    def from_nibabel(cls, image: Any) -> Volume:
        """Converts a nibabel image of three axes, in millimetres."""
        array = np.asanyarray(image.dataobj)
        return cls(array, image.affine)

    def to_nibabel(self) -> Any:
        """Converts the volume to a ``nibabel.Nifti1Image``."""
        import nibabel

        array = self.array
        if array.dtype in (np.int64, np.uint64):
            return nibabel.Nifti1Image(array, self.affine, dtype=array.dtype)
        return nibabel.Nifti1Image(array, self.affine)

    def write(self, path: PathOf) -> None:
        """Writes a .nrrd, .nii.gz or .mha file."""
        self._native.write(fspath(path))

    @property
    def array(self) -> npt.NDArray[Any]:
        """Voxel values in physical units, shape (ni, nj, nk); without scaling in the stored type."""
        raw = self._native.raw().reshape(self._native.size(), order="F")
        slope, intercept = self._native.slope_and_intercept()
        if (slope, intercept) == (1.0, 0.0):
            return np.asarray(raw)
        return np.asarray(slope * raw.astype(np.float64) + intercept)

    @property
    def affine(self) -> npt.NDArray[np.float64]:
        """Transform from voxel indices to world coordinates (RAS, mm), shape (4, 4)."""
        return np.array(self._native.affine())

    @property
    def names(self) -> dict[int, str]:
        """Names of labels."""
        return self._native.names()

    @property
    def colours(self) -> dict[int, tuple[float, float, float]]:
        """Colours of labels, RGB from 0 to 1, if the file has them."""
        return {k: (r, g, b) for k, (r, g, b) in self._native.colours().items()}

    @property
    def notes(self) -> list[str]:
        """What was repaired or assumed in reading, one sentence each."""
        return self._native.notes()

    def __repr__(self) -> str:
        return f"<palpate.Volume of {' × '.join(str(n) for n in self._native.size())} voxels>"
