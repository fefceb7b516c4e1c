"""Warping of scans, tuning of settings, and studies."""

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
    """Warps a scan by the deformation of a body: each voxel takes the value at its rest position.

    Args:
        scan: scan of the body at rest.
        rest: mesh at rest in the scan's world coordinates (RAS; in mm, or in its own length unit).
        bent: the same mesh with displaced nodes, or the positions, shape (n, 3).
        labels: whether the voxels are labels, which are sampled by nearest neighbour.
        background: value outside the mesh; default: the scan's smallest, 0 for labels.
        like: volume whose grid the result uses; default: the scan.
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
    """Result of :func:`tune`: the cheapest settings that meet the target.

    Attributes:
        scene: scene with the chosen settings.
        met: whether the settings meet the target; otherwise they are the closest ones.
        notes: the choices, one sentence each.
        motion_ms: computing time per simulated second on this machine, ms.
        picture_ms: computing time per picture, ms.
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
    """Finds the cheapest settings of a scene that meet a target accuracy, by measuring on this machine.

    Args:
        body: scene of one tetrahedral body. With ``accuracy.within`` its mesh is refined first, until a
            number at rest is as exact, and the returned scene has that mesh.
        error: largest relative error of motion and of pictures.
        fps: frame rate at which the simulation has to run in real time, 1/s.
        seconds: simulated duration compared with the reference solution, s.
        adapter: graphics adapter.
        progress: called with the current stage and its completed fraction.
    """
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        given, found = Path(folder) / "scene.toml", Path(folder) / "tuned.toml"
        own = Scene.from_any(body)
        own.write(given)
        met, notes, (motion, picture) = _palpate.tune(
            fspath(given), fspath(found), error, fps, seconds, adapter, progress
        )
        tuned = Scene.read(found)
        refined = found.with_suffix(".vtu")
        mesh = Mesh.read(refined) if refined.exists() else own.mesh
    if mesh is not None:
        # The temporary file no longer exists.
        tuned.entries.get("mesh", {}).pop("file", None)
    return Tuned(Scene(tuned.entries, folder=own.folder, mesh=mesh), met, notes, motion, picture)


def study(
    what: str,
    out: PathOf,
    *,
    scene: BodyLike | None = None,
    quick: bool = False,
    adapter: str | None = None,
    progress: Progress | None = None,
) -> list[str]:
    """Runs a study and writes measurements, charts and findings to a folder; existing measurements
    are kept.

    Args:
        what: name of the study, as listed by ``palpate study --help``.
        out: folder of the results.
        scene: body to study, if the study accepts one.
        quick: whether to measure few and small points only.
        adapter: graphics adapter.
        progress: called with the current stage. Ctrl-C, or an exception it raises, cancels the
            study after the current point.

    Returns:
        Notes, one sentence each.
    """
    if scene is None or isinstance(scene, (str, PathLike)):
        path = None if scene is None else fspath(scene)
        return _palpate.study(what, path, fspath(out), quick, adapter, progress)
    file = Path(out) / "scene.toml"
    file.parent.mkdir(parents=True, exist_ok=True)
    Scene.from_any(scene).write(file)
    return _palpate.study(what, fspath(file), fspath(out), quick, adapter, progress)
