"""Scans that follow a body, settings that are accurate enough, and studies."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path

import numpy.typing as npt

from . import _palpate
from ._mesh import Mesh, PathOf, Progress, _floats
from ._scene import BodyLike, Scene
from ._volume import Volume


def warp(
    scan: Volume | PathOf,
    rest: Mesh | PathOf,
    bent: Mesh | npt.ArrayLike,
    *,
    labels: bool = False,
    background: float | None = None,
    like: Volume | None = None,
) -> Volume:
    """The scan in the bent body: each voxel takes the value at its place at rest.

    Args:
        scan: of the body at rest.
        rest: the mesh at rest in the scan's world (RAS; in mm, or the unit that it tells).
        bent: the same mesh with its nodes moved, or their positions, shape (n, 3).
        labels: the voxels are labels, none of which are mixed.
        background: the value where no tet is; default: the scan's smallest, 0 of labels.
        like: a volume whose grid the result has; default: the scan.
    """
    volume = scan if isinstance(scan, Volume) else Volume.read(scan)
    mesh = rest if isinstance(rest, Mesh) else Mesh.read(rest)
    nodes = bent.nodes if isinstance(bent, Mesh) else _floats(bent, "bent")
    warped, _, _ = _palpate.warp(
        volume._native, mesh._native, nodes, labels, background, None if like is None else like._native
    )
    return Volume._of(warped)


@dataclass(frozen=True)
class Tuned:
    """The cheapest settings that are accurate enough.

    Attributes:
        scene: the scene with them.
        met: whether they meet what was wanted; else they are those that come nearest.
        notes: what was chosen, a sentence each.
        motion_ms: for a second of motion, on this machine.
        picture_ms: for a picture.
    """

    scene: Scene
    met: bool
    notes: list[str]
    motion_ms: float
    picture_ms: float


def tune(
    body: BodyLike,
    *,
    error: float = 0.01,
    fps: float | None = None,
    seconds: float = 0.5,
    adapter: str | None = None,
    progress: Progress | None = None,
) -> Tuned:
    """Finds the cheapest settings of a scene that are accurate enough, by measuring them here.

    Args:
        body: a scene of one body of tets.
        error: the largest error, of motion and of pictures, as a share.
        fps: pictures a second wanted of a body that moves as fast as in life.
        seconds: of motion that are held against truth.
        adapter: which graphics adapter.
        progress: told what is being done, and the fraction of it that is done.
    """
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        given, found = Path(folder) / "scene.toml", Path(folder) / "tuned.toml"
        own = Scene.of(body)
        own.write(given)
        met, notes, (motion, picture) = _palpate.tune(
            fspath(given), fspath(found), error, fps, seconds, adapter, progress
        )
        tuned = Scene.read(found)
    if own.mesh is not None:
        # The file it was written to is gone.
        tuned.entries.get("mesh", {}).pop("file", None)
    return Tuned(
        Scene(tuned.entries, folder=own.folder, mesh=own.mesh), met, notes, motion, picture
    )


def study(
    what: str,
    out: PathOf,
    *,
    scene: BodyLike | None = None,
    quick: bool = False,
    adapter: str | None = None,
    progress: Progress | None = None,
) -> list[str]:
    """Measures, draws charts and writes findings into a folder; what is measured there already is
    not measured again.

    Args:
        what: one of ``palpate study --help``.
        out: the folder.
        scene: a body of your own to study, where the study takes one.
        quick: few and small points.
        adapter: which graphics adapter.
        progress: told what is being done. Ctrl-C, or what it raises, ends the study after the
            point under way.

    Returns:
        What was noted, a sentence each.
    """
    if scene is None or isinstance(scene, (str, PathLike)):
        path = None if scene is None else fspath(scene)
        return _palpate.study(what, path, fspath(out), quick, adapter, progress)
    file = Path(out) / "scene.toml"
    file.parent.mkdir(parents=True, exist_ok=True)
    Scene.of(scene).write(file)
    return _palpate.study(what, fspath(file), fspath(out), quick, adapter, progress)
