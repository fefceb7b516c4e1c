"""Pressing on a body with a fingertip: indentation tests and stiffness maps."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from os import fspath
from pathlib import Path
from typing import Any, Union

import numpy as np
import numpy.typing as npt

from . import _palpate
from ._errors import Error, InputError
from ._mesh import Mesh, PathOf, Points, Progress
from ._scene import BodyLike, Scene
from ._stage import Picture

Numbers = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Press:
    """Result of a press; arrays have one value per step.

    Attributes:
        time: time of the quasi-static steps, s, without physical meaning.
        loading: whether the fingertip was advancing.
        depth: indentation relative to first contact with the body at rest, m.
        force: contact force on the fingertip, directed out of the body, N.
        force_error: error of the force, N; None without an estimate.
        report: ``stiffness_n_per_m, hertz_young_pa, max_force_n``, their errors
            ``stiffness_error_n_per_m, hertz_young_error_pa, max_force_error_n`` with ``error_parts``,
            ``max_depth_m, radius_m, poisson, engine, seconds, warnings``. Stiffness and modulus are None
            if there are warnings: the press did not measure the elastic response of the body. After a
            press ``within`` an error also ``rounds``, the meshes on the way, and ``missed`` if the force
            is not as exact as wanted.
        point: press point, in the mesh's unit.
        rest: picture of the body at rest, shape (height, width, 4).
        pressed: picture at maximum depth: what gives, cut through the fingertip towards the eye.
        deformed: mesh at maximum depth, with its displacement.
        notes: notes of automatic choices, one sentence each.
        failure: error of the failed step, or None.
    """

    time: Numbers
    loading: npt.NDArray[np.bool_]
    depth: Numbers
    force: Numbers
    force_error: Numbers | None
    report: dict[str, Any]
    point: tuple[float, float, float]
    rest: Picture
    pressed: Picture
    deformed: Mesh
    notes: list[str]
    failure: str | None

    def save(self, out: PathOf) -> None:
        """Writes ``rest.png``, ``pressed.png``, ``press.csv``, ``press.json`` and ``pressed.vtu`` to
        a folder."""
        folder = Path(out)
        folder.mkdir(parents=True, exist_ok=True)
        for name, picture in [("rest", self.rest), ("pressed", self.pressed)]:
            _palpate.write_png(fspath(folder / f"{name}.png"), picture)
        phases = ["load" if loading else "unload" for loading in self.loading]
        errors = [""] * len(phases) if self.force_error is None else self.force_error.tolist()
        rows = zip(self.time.tolist(), phases, self.depth.tolist(), self.force.tolist(), errors)
        lines = [",".join(str(value) for value in row) for row in rows]
        header = "time_s,phase,depth_m,force_n,force_error_n"
        _replace(folder / "press.csv", "\n".join([header, *lines, ""]))
        _replace(folder / "press.json", json.dumps(self.report, indent=2) + "\n")
        self.deformed.write(folder / "pressed.vtu")


def press(
    body: BodyLike,
    *,
    at: Sequence[float] | None = None,
    pick: Sequence[float] | None = None,
    radius: float | None = None,
    depth: float | None = None,
    force: float | None = None,
    size: Sequence[int] | None = None,
    engine: str | None = None,
    errors: bool = True,
    show: str | None = None,
    scene_view: bool = False,
    within: float | None = None,
    max_tets: int | None = None,
    adapter: str | None = None,
    progress: Progress | None = None,
) -> Press:
    """Presses on a body with a fingertip and releases it, as ``palpate press``.

    Args:
        body: mesh, body, scene of one body, or path of a file.
        at: press on the boundary point nearest to this point; default: the point at the centre of the
            picture.
        pick: press on the boundary point visible at this point of the picture, in pixels.
        radius: radius of the fingertip, in the mesh's unit; default: chosen from the local thickness.
        depth: indentation depth, in the mesh's unit; default: a tenth of the local thickness.
        force: press until this contact force is reached instead, N.
        size: width and height of the pictures, in pixels.
        engine: engine of the time steps: ``gpu``, ``cpu`` or ``auto``.
        errors: whether to estimate the errors of the numbers, which takes two to four times as long as its steps.
        show: isolines on the cut of the picture ``pressed``: ``"displacement"`` or ``"stress"``.
        scene_view: draw ``pressed`` with the camera and mode of the scene, clipped through the press.
        within: refine the mesh, and raise the order of its elements, until the error of the largest force
            is at most this share of it, such as 0.05.
        max_tets: largest number of elements for ``within``; default: 300,000.
        adapter: graphics adapter.
        progress: called with the completed fraction of steps. Ctrl-C, or an exception it raises,
            cancels the press.
    """
    changes = [
        ("picture.size", size),
        ("solver.engine", engine),
        ("accuracy.within", _percent(within)),
        ("accuracy.max_tets", max_tets),
    ]
    scene = Scene.from_any(body).updated({k: v for k, v in changes if v is not None})
    native = _with_files(
        scene,
        lambda entries, folder: _palpate.Press(
            entries,
            folder,
            _triple(at),
            None if pick is None else (float(pick[0]), float(pick[1])),
            radius,
            depth,
            force,
            adapter,
            progress,
        ),
    )
    rest = _picture(native.rgba())
    if show is not None and scene_view:
        raise InputError("show and scene_view are both given; remove one of them")
    if scene_view:
        native.cut_through()
    pressed, deformed = rest, native.mesh()
    samples: list[tuple[float, str, float, float]] = []
    steps = max(native.steps(), 1)
    failure = None
    seconds = 0.0
    while True:
        start = time.perf_counter()
        try:
            sample = native.advance()
        except Error as why:
            # The earlier measurements are kept.
            failure = str(why)
            break
        seconds += time.perf_counter() - start
        if sample is None:
            break
        samples.append(sample)
        if not scene_view:
            native.keep_picture(show)
        if native.is_deepest():
            pressed = _picture(native.rgba() if scene_view else native.deepest_picture())
            deformed = native.mesh()
        if progress is not None:
            progress("pressing", min(len(samples) / steps, 1.0))
    notes = native.notes()
    if native.falls_short():
        notes.append("the force was not reached within half of the thickness")
    if errors and failure is None:
        native.estimate_error(progress)
    if native.has_error() and not scene_view:
        # Again, with the error of the force.
        pressed = _picture(native.deepest_picture())
    force_error = native.force_errors()
    report = json.loads(native.report(seconds))
    notes += report["warnings"]
    if "missed" in report:
        notes.append(f"the largest force is not as exact as wanted (within): {report['missed']}")
    return Press(
        time=np.array([s[0] for s in samples]),
        loading=np.array([s[1] == "load" for s in samples], dtype=np.bool_),
        depth=np.array([s[2] for s in samples]),
        force=np.array([s[3] for s in samples]),
        force_error=None if force_error is None else np.array(force_error),
        report=report,
        point=native.spot()[0],
        rest=rest,
        pressed=pressed,
        deformed=Mesh._of(deformed),
        notes=notes,
        failure=failure,
    )


#: Centre and length of the sides of a map.
_Area = tuple[Union[tuple[float, float, float], None], Union[float, None]]


@dataclass(frozen=True)
class PressMap:
    """Stiffness of a body at the points of a grid, pressed from above.

    Attributes:
        points: press points, in the mesh's unit, shape (n, 3).
        stiffness: N/m, shape (n,); NaN if a step failed or the press was not valid.
        error: error of the stiffness, N/m, shape (n,); NaN unless its mesh was refined (``within``).
        picture: picture of the stiffness on the body, shape (height, width, 4).
        notes: notes of automatic choices, one sentence each.
    """

    points: Points
    stiffness: Numbers
    error: Numbers
    picture: Picture
    notes: list[str]


def press_map(
    body: BodyLike,
    points: Sequence[int],
    *,
    at: Sequence[float] | None = None,
    side: float | None = None,
    radius: float | None = None,
    depth: float | None = None,
    out: PathOf | None = None,
    within: float | None = None,
    max_tets: int | None = None,
    adapter: str | None = None,
    progress: Progress | None = None,
) -> PressMap:
    """Presses on a body at the points of a grid, on all cores.

    Args:
        body: mesh, body, scene of one body, or path of a file.
        points: numbers of points along the two sides, such as ``(10, 10)``.
        at: centre of the map, in the mesh's unit, only with ``side``; default: the centre of the body.
        side: length of the sides of the map, a square, in the mesh's unit; default: it covers the body.
        radius: radius of the fingertip, in the mesh's unit.
        depth: indentation depth, in the mesh's unit.
        out: folder in which completed points are kept, so that an interrupted map can be resumed.
        within: refine the mesh at each point until the error of the force is at most this share of it,
            such as 0.05; a point then takes as long as a press.
        max_tets: largest number of elements for ``within``; default: 300,000.
        adapter: graphics adapter.
        progress: called with the completed fraction of points. Ctrl-C, or an exception it raises,
            cancels the map after the current points.
    """
    along, across = (int(n) for n in points)
    changes = [("accuracy.within", _percent(within)), ("accuracy.max_tets", max_tets)]
    native = _with_files(
        Scene.from_any(body).updated({k: v for k, v in changes if v is not None}),
        lambda entries, folder: _palpate.PressMap(
            entries, folder, (along, across), _area(at, side), (radius, depth), adapter
        ),
    )
    mark = native.mark()
    kept = None if out is None else Path(out) / "map.json"
    if kept is not None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        if kept.exists():
            native.take_over(_found_before(kept, mark))

    def done(what: str, share: float) -> None:
        if kept is not None:
            _keep(native.found(), mark, kept)
        if progress is not None:
            progress(what, share)

    try:
        native.measure(done)
    finally:
        if kept is not None:
            _keep(native.found(), mark, kept)
    return _measured(native)


def _area(at: Sequence[float] | None, side: float | None) -> _Area:
    if at is None:
        return None, side
    x, y, z = (float(k) for k in at)
    return (x, y, z), side


def _measured(native: _palpate.PressMap) -> PressMap:
    unknown = (math.nan, math.nan)
    found = np.array([unknown if k is None else k for k in native.found()]).reshape(-1, 2)
    picture = _picture(native.rgba())
    return PressMap(native.places(), found[:, 0], found[:, 1], picture, native.notes())


def _percent(share: float | None) -> str | None:
    return None if share is None else f"{100.0 * share}%"


def _keep(results: list[tuple[float, float] | None], mark: str, file: Path) -> None:
    stiffness = [k if k is None else "failed" if math.isnan(k[0]) else k[0] for k in results]
    content: dict[str, Any] = {"mark": mark, "stiffness": stiffness}
    errors = [None if k is None or math.isnan(k[1]) else k[1] for k in results]
    if any(error is not None for error in errors):
        content["error"] = errors
    _replace(file, json.dumps(content))


def _replace(file: Path, text: str) -> None:
    part = file.with_name(f".{file.name}.part")
    part.write_text(text, encoding="utf-8")
    os.replace(part, file)


def _found_before(file: Path, mark: str) -> list[tuple[float, float] | None]:
    def result(stiffness: Any, error: Any) -> tuple[float, float] | None:
        if stiffness is None:
            return None
        of = math.nan if error is None else float(error)
        return (math.nan, of) if stiffness == "failed" else (float(stiffness), of)

    try:
        before = json.loads(file.read_text(encoding="utf-8"))
        same = before["mark"] == mark
        stiffness = before["stiffness"]
        errors = before.get("error", [None] * len(stiffness))
        found = [result(*pair) for pair in zip(stiffness, errors)]
    except (ValueError, KeyError, TypeError) as why:
        raise InputError(f"{file} is damaged ({why}); remove it to start again") from None
    if not same:
        raise InputError(
            f"{file} is a map of a different body or of different settings; choose another folder, "
            "or remove it"
        )
    return found


def _with_files(scene: Scene, make: Any) -> Any:
    """Calls ``make`` with the scene, whose mesh in memory is written to a file first."""
    if scene.mesh is None:
        return make(scene.json(), fspath(scene.folder))
    import tempfile

    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        return make(scene.in_files(folder).json(), folder)


def _picture(native: tuple[npt.NDArray[np.uint8], tuple[int, int]]) -> Picture:
    pixels, (width, height) = native
    return pixels.reshape(height, width, 4)


def _triple(values: Sequence[float] | None) -> tuple[float, float, float] | None:
    if values is None:
        return None
    x, y, z = (float(v) for v in values)
    return (x, y, z)
