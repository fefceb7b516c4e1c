"""Distributed rendering and simulation: frames, sweeps, stiffness maps, identifications and pieces of large
bodies as tasks of dask.distributed.

Each function takes a ``distributed.Client`` of this machine (``LocalCluster``) or of a cluster
(dask-jobqueue, clouds), whose workers have this package and access the same files. Each task is one
frame, case, point or piece; tasks of a lost worker run again on another one; with ``out`` completed
results are kept in a folder and reused. Use one thread and one device per worker.
"""

from __future__ import annotations

import csv
import hashlib
import itertools
import json
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import fspath
from pathlib import Path
from typing import Any, Union

import numpy as np

from . import _palpate
from ._camera import CameraLike
from ._errors import Error, InputError
from ._identify import Identified, Measurement
from ._identify import identify as _identified
from ._mesh import Mesh, PathOf
from ._press import PressMap, _Area, _area, _found_before, _keep, _measured, _percent, _with_files
from ._scene import BodyLike, Scene, picture_entries
from ._stage import Picture, Simulator, stage_of

#: Measurements of a case, as JSON values.
Measured = dict[str, Any]
#: Number of retries of a task whose worker was lost.
RETRIES = 3
#: Number of points, area, radius and depth, and adapter of a map.
_MapSettings = tuple[
    tuple[int, int], _Area, tuple[Union[float, None], Union[float, None]], Union[str, None]
]


@dataclass(frozen=True)
class Frame:
    """Rendered frame of a series.

    Attributes:
        number: index, counted from 0.
        time: simulated time, s.
        path: file of the picture.
        drawn: whether it was rendered now, not reused from an earlier call.
    """

    number: int
    time: float
    path: Path
    drawn: bool


def render_series(
    pvd: PathOf,
    client: Any,
    out: PathOf,
    *,
    each: Callable[[Frame], None] | None = None,
    adapter: str | None = None,
    **picture: Any,
) -> list[Frame]:
    """Renders every frame of a recorded series, identical to ``palpate simulate SERIES.pvd``: the
    nodes, fields and tets of each frame, with one camera and one range of the displayed field.

    Args:
        pvd: series, accessible to the workers under the same path.
        client: ``distributed.Client``.
        out: folder of ``NAME_0000.png`` and so on, writable by the workers. Existing pictures of the
            same series and settings are reused.
        each: called with each completed frame.
        adapter: graphics adapter of the workers.
        picture: as in :func:`palpate.render`.
    """
    series = Path(pvd).resolve()
    listed = _palpate.read_series(fspath(series))
    frames = [(time, [Path(file).resolve() for file in files]) for time, files in listed]
    if not frames:
        raise InputError(f"{series}: the series has no frames")
    folder = Path(out).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    first = frames[0][1]
    body = first[0] if len(first) == 1 else Mesh._of(_palpate.Mesh.read_parts(_paths(first)))
    scene = Scene.from_any(body).updated(picture_entries(**picture))
    stamps = [
        [fspath(f), f.stat().st_size, f.stat().st_mtime_ns] for _, files in frames for f in files
    ]
    mark = _mark(scene.json(), stamps, adapter)
    kept = folder / f"{series.stem}.json"
    same = _content(kept).get("mark") == mark
    paths = [folder / f"{series.stem}_{n:04}.png" for n in range(len(frames))]
    left = [n for n, path in enumerate(paths) if not (same and path.is_file())]
    if not same:
        for path in paths:
            path.unlink(missing_ok=True)
        _write(kept, {"mark": mark, "frames": len(frames)})
    done: dict[int, Frame] = {}

    def tell(frame: Frame) -> None:
        done[frame.number] = frame
        if each is not None:
            each(frame)

    for n in sorted(set(range(len(frames))) - set(left)):
        tell(Frame(n, frames[n][0], paths[n], drawn=False))
    if left:
        files = [_paths(files) for _, files in frames]
        extents = client.gather(client.map(_extent, files, pure=False, retries=RETRIES))
        reach = [
            list(corner) for low, high, _ in extents for corner in itertools.product(*zip(low, high))
        ]
        ranges: _Ranges = {}
        for *_, own in extents:
            for name, (low, high) in own.items():
                known = ranges.get(name, (low, high))
                ranges[name] = (min(known[0], low), max(known[1], high))
        times = [time for time, _ in frames]
        resolution = min((b - a for a, b in zip(times, times[1:])), default=math.inf)
        futures = {
            client.submit(
                _draw,
                scene,
                reach,
                ranges,
                (frames[n][0], resolution, files[n]),
                fspath(paths[n]),
                adapter,
                pure=False,
                retries=RETRIES,
            ): n
            for n in left
        }
        for future in _as_completed(futures):
            future.result()
            n = futures[future]
            tell(Frame(n, frames[n][0], paths[n], drawn=True))
    return [done[n] for n in range(len(frames))]


def sweep(
    scene: BodyLike,
    values: Mapping[str, Sequence[Any]],
    client: Any,
    *,
    steps: int | None = None,
    measure: Callable[[Simulator], Measured] | None = None,
    out: PathOf | None = None,
    each: Callable[[Measured], None] | None = None,
    adapter: str | None = None,
) -> list[Measured]:
    """Simulates a scene for every combination of values.

    Args:
        scene: body to simulate.
        values: lists of values by dotted names of entries, such as ``{"material.muscle.young": [1e4, 3e4]}``.
        client: ``distributed.Client``.
        steps: number of steps per case; default: the scene's, or 50.
        measure: function that returns the measurements of a completed case as a table of JSON values;
            default: the report (energies, volume, largest displacement) and the largest von Mises
            stress. It must be in a module that the workers can import.
        out: folder of ``sweep.csv`` and of the measurements of each case, which are reused.
        each: called with each completed case.
        adapter: graphics adapter of the workers.

    Returns:
        One table per case, its values first, in the order of the combinations. For a failed
        simulation ``failure`` holds the error.
    """
    for name, choices in values.items():
        if isinstance(choices, (str, bytes)) or not isinstance(choices, Iterable):
            raise InputError(f"values: {name} must be a list of values, got {choices!r}")
    own = Scene.from_any(scene)
    given = [dict(zip(values, combination)) for combination in itertools.product(*values.values())]
    folder = None if out is None else Path(out)
    if folder is not None:
        (folder / "cases").mkdir(parents=True, exist_ok=True)
    look = measure or report_of
    content = "" if own.mesh is None else _mesh_hash(own.mesh)
    results: list[Measured | None] = [None] * len(given)
    futures = {}

    def tell(n: int, found: Measured) -> None:
        results[n] = {**given[n], **found}
        if each is not None:
            each({**given[n], **found})

    for n, case in enumerate(given):
        changed = own.updated(case)
        mark = _mark(changed.json(), content, steps, adapter, f"{look.__module__}.{look.__qualname__}")
        file = None if folder is None else folder / "cases" / f"{mark[:16]}.json"
        kept = {} if file is None else _content(file)
        if kept.get("mark") == mark:
            tell(n, kept["measured"])
        else:
            future = client.submit(
                _run, changed, steps, look, adapter, pure=False, retries=RETRIES
            )
            futures[future] = (n, file, mark)
    for future in _as_completed(futures):
        n, file, mark = futures[future]
        found = future.result()
        if file is not None:
            _write(file, {"mark": mark, "case": given[n], "measured": found})
        tell(n, found)
    rows = [row for row in results if row is not None]
    if folder is not None:
        _table(folder / "sweep.csv", rows)
    return rows


def press_map(
    body: BodyLike,
    points: Sequence[int],
    client: Any,
    *,
    at: Sequence[float] | None = None,
    side: float | None = None,
    radius: float | None = None,
    depth: float | None = None,
    out: PathOf | None = None,
    within: float | None = None,
    max_tets: int | None = None,
    each: Callable[[int, float], None] | None = None,
    adapter: str | None = None,
) -> PressMap:
    """Measures the map of :func:`palpate.press_map`, one task per point.

    Args:
        body: mesh, body, scene of one body, or path of a file.
        points: numbers of points along the two sides.
        client: ``distributed.Client``.
        at: centre of the map, as in :func:`palpate.press_map`.
        side: length of its sides.
        radius: radius of the fingertip, in the mesh's unit.
        depth: indentation depth, in the mesh's unit.
        out: folder in which completed points are kept, as in :func:`palpate.press_map`.
        within: refine the mesh at each point, as in :func:`palpate.press_map`.
        max_tets: largest number of elements for ``within``.
        each: called with the index and the stiffness (N/m) of each completed point.
        adapter: graphics adapter of the workers.
    """
    changes = [("accuracy.within", _percent(within)), ("accuracy.max_tets", max_tets)]
    scene = Scene.from_any(body).updated({k: v for k, v in changes if v is not None})
    count = (int(points[0]), int(points[1]))
    wanted: _MapSettings = (count, _area(at, side), (radius, depth), adapter)
    native = _map(scene, *wanted)
    mark = native.mark()
    kept = None if out is None else Path(out) / "map.json"
    if kept is not None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        if kept.exists():
            native.take_over(_found_before(kept, mark))
    found = native.found()
    left = [n for n, result in enumerate(found) if result is None]
    futures = {
        client.submit(_press, scene, wanted, n, len(found), pure=False, retries=RETRIES): n
        for n in left
    }
    for future in _as_completed(futures):
        n = futures[future]
        result = future.result()
        found[n] = result
        if kept is not None:
            _keep(found, mark, kept)
        if each is not None:
            each(n, result[0])
    native.take_over(found)
    return _measured(native)


def identify(
    body: BodyLike,
    data: Sequence[Measurement | Sequence[Measurement]],
    unknown: str | Sequence[str],
    client: Any,
    *,
    starts: int = 1,
    each: Callable[[int, int, Identified], None] | None = None,
    adapter: str | None = None,
    **options: Any,
) -> list[Identified]:
    """Finds material parameters as :func:`palpate.identify`, one task per set of measurements and start.

    Args:
        body: mesh, body, scene of one body, or path of a file.
        data: sets of measurements; each is explained by itself.
        unknown: names of the unknowns.
        client: ``distributed.Client``.
        starts: number of starts from different values for each set.
        each: called with the index of the set, the number of the start and the result of each completed
            task.
        adapter: graphics adapter of the workers.
        options: ``noise``, ``bounds``, ``first``, ``profile``, ``advice`` and ``correct`` as in :func:`palpate.identify`.

    Returns:
        For each set the result with the smallest misfit. Its ``other_optima`` are values of other starts
        outside of its intervals with a misfit of at most twice its own.
    """
    scene = Scene.from_any(body)
    futures = {
        client.submit(
            _identify,
            scene,
            one,
            unknown,
            {**options, "adapter": adapter, "first_start": start},
            pure=False,
            retries=RETRIES,
        ): (n, start)
        for n, one in enumerate(data)
        for start in range(starts)
    }
    found: list[list[Identified]] = [[] for _ in data]
    for future in _as_completed(futures):
        n, start = futures[future]
        try:
            result = future.result()
        except Error:
            # Values far from the first ones may have no equilibrium.
            if start == 0:
                raise
            continue
        found[n].append(result)
        if each is not None:
            each(n, start, result)
    return [_best(results) for results in found]


@dataclass(frozen=True)
class DrawnPiece:
    """Rendered piece of a body.

    Attributes:
        number: index, counted from 0.
        tets: number of owned tets.
        ghosts: number of ghost tets, which belong to its neighbours.
        intervals: number of ray segments, 28 bytes each.
        read_seconds: time for reading it.
        draw_seconds: time for rendering it, on the device and on the CPU.
        memory: peak memory of its worker, bytes; 0 if unknown.
    """

    number: int
    tets: int
    ghosts: int
    intervals: int
    read_seconds: float
    draw_seconds: float
    memory: int


def render_pieces(
    pvtu: PathOf,
    camera: CameraLike | None,
    client: Any,
    *,
    size: Sequence[int] | None = None,
    each: Callable[[DrawnPiece], None] | None = None,
    adapter: str | None = None,
    **picture: Any,
) -> Picture:
    """Renders a body in pieces, each on a worker that reads that piece only; the picture matches
    :func:`palpate.render` of the whole body within 1/255, its regions along the faces of tets
    (``boundaries="tets"``).

    Each piece yields its ray segments with depth, colour and opacity. Pairs of pieces are merged in
    depth order and touching segments composited, in a tree of tasks whose root yields the picture. A
    worker holds its piece and the segments of the pieces that it merges.

    Args:
        pvtu: index, accessible to the workers under the same path: written by
            :meth:`palpate.Mesh.write` with ``pieces``, or ``palpate mesh`` and ``palpate convert`` with ``--pieces``.
        camera: as in :func:`palpate.render`; None frames the whole body.
        client: ``distributed.Client``.
        size: width and height in pixels; default 1024 by 768.
        each: called with each rendered piece.
        adapter: graphics adapter of the workers.
        picture: as in :func:`palpate.render`, for the volume of a static body: planes, isosurfaces,
            scans, skins, shadows, legends and the like are rejected.

    Returns:
        Shape (height, width, 4), uint8: red, green, blue, opacity.

    Raises:
        InputError: for settings that pieces do not support, and for pieces of other programs.
    """
    index = Path(pvtu).resolve()
    scene = Scene({}).updated(picture_entries(camera=camera, size=size, **picture))
    entries, folder = scene.json(), fspath(scene.folder)
    count = _palpate.count_pieces(fspath(index))
    drawn = [
        client.submit(
            _draw_piece, fspath(index), n, entries, folder, adapter, pure=False, retries=RETRIES
        )
        for n in range(count)
    ]
    # The statistics of a piece are small; its ray segments stay on the worker until they are merged.
    said = [client.submit(_said_of, future, pure=False, retries=RETRIES) for future in drawn]
    level = [client.submit(_told_by, future, pure=False, retries=RETRIES) for future in drawn]
    drawn.clear()
    while len(level) > 1:
        pairs = [level[n : n + 2] for n in range(0, len(level), 2)]
        level = [
            client.submit(_joined, *pair, pure=False, retries=RETRIES) if len(pair) == 2 else pair[0]
            for pair in pairs
        ]
    for future in _as_completed(said):
        piece = future.result()
        if each is not None:
            each(piece)
    told = _palpate.Intervals.from_bytes(level[0].result())
    pixels, (width, height) = told.rgba(entries, folder)
    return pixels.reshape(height, width, 4)


def _draw_piece(
    index: str, number: int, entries: str, folder: str, adapter: str | None
) -> tuple[DrawnPiece, bytes]:
    told, (own, held), (read, draw) = _palpate.Intervals.of_piece(
        index, number, entries, folder, adapter
    )
    piece = DrawnPiece(number, own, held - own, told.count(), read, draw, _most_memory())
    return piece, told.to_bytes()


def _said_of(drawn: tuple[DrawnPiece, bytes]) -> DrawnPiece:
    return drawn[0]


def _told_by(drawn: tuple[DrawnPiece, bytes]) -> bytes:
    return drawn[1]


def _joined(front: bytes, back: bytes) -> bytes:
    one, other = map(_palpate.Intervals.from_bytes, (front, back))
    return one.joined(other).to_bytes()


def _most_memory() -> int:
    """Returns the peak memory of this process, bytes; 0 if unknown."""
    try:
        # The value of the resource module includes the memory of the parent at the fork.
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return 1024 * int(line.split()[1])
    except OSError:
        pass
    return 0


def report_of(simulator: Simulator) -> Measured:
    """Returns the default measurements of :func:`sweep`."""
    report = simulator.report()
    measured = {
        "time_s": simulator.time,
        "max_displacement": report["max_displacement"],
        "volume_ratio": report["volume_ratio"],
        "inverted": report["inverted"],
        **{f"{name}_j": value for name, value in report["energy"].items()},
    }
    try:
        measured["von_mises_max_pa"] = float(simulator.field("von_mises").max())
    except InputError:
        # Springs, grids and cages have no stress.
        pass
    return measured


def _run(
    scene: Scene,
    steps: int | None,
    measure: Callable[[Simulator], Measured],
    adapter: str | None,
) -> Measured:
    from ._errors import SolverError

    simulator = Simulator(scene, adapter=adapter)
    try:
        simulator.advance(simulator._stage.steps() if steps is None else steps)
    except SolverError as why:
        return {"failure": str(why)}
    return measure(simulator)


#: Range of each field over a series, by name.
_Ranges = dict[str, tuple[float, float]]


def _paths(files: Sequence[Path]) -> list[str]:
    return [fspath(file) for file in files]


def _extent(files: list[str]) -> tuple[list[float], list[float], _Ranges]:
    native = _palpate.Mesh.read_parts(files)
    low, high = Mesh._of(native).bounds
    return low, high, native.field_ranges()


#: The stage of the series that this worker renders, shared by its frames.
_drawn: dict[str, _palpate.Stage] = {}


def _draw(
    scene: Scene,
    reach: list[list[float]],
    ranges: _Ranges,
    frame: tuple[float, float, list[str]],
    path: str,
    adapter: str | None,
) -> None:
    key = _mark(scene.json(), [reach, ranges], adapter)
    stage = _drawn.get(key)
    if stage is None:
        stage = stage_of(scene, adapter)
        stage.use_ranges(ranges)
        stage.frame(np.array(reach))
        _drawn.clear()
        _drawn[key] = stage
    time, resolution, files = frame
    mesh = _palpate.Mesh.read_parts(files)
    try:
        stage.show(mesh)
    except InputError as why:
        raise InputError(f"{files[0]}: {why}") from None
    stage.set_displayed_time(time, resolution)
    stage.save(path)


def _map(
    scene: Scene,
    points: tuple[int, int],
    area: _Area,
    radius_and_depth: tuple[float | None, float | None],
    adapter: str | None,
) -> _palpate.PressMap:
    native: _palpate.PressMap = _with_files(
        scene,
        lambda entries, folder: _palpate.PressMap(
            entries, folder, points, area, radius_and_depth, adapter
        ),
    )
    return native


def _press(
    scene: Scene,
    wanted: _MapSettings,
    number: int,
    count: int,
) -> tuple[float, float]:
    native = _map(scene, *wanted)
    # All others count as done.
    failed = (math.nan, math.nan)
    native.take_over([None if n == number else failed for n in range(count)])
    native.measure(None)
    return native.found()[number] or failed


def _identify(
    scene: Scene, data: Any, unknown: str | Sequence[str], options: dict[str, Any]
) -> Identified:
    return _identified(scene, data, unknown, **options)


def _best(results: Sequence[Identified]) -> Identified:
    """Returns the result with the smallest misfit; other optima are in its report."""
    best, *others = sorted(results, key=lambda one: float(one.report["misfit"]))
    misfit = 2 * float(best.report["misfit"])

    def differs(one: Identified) -> bool:
        inside = (low <= one.values[name] <= high for name, (low, high) in best.intervals.items())
        return not all(inside)

    optima = [list(one.values.values()) for one in others if one.report["misfit"] <= misfit and differs(one)]
    return replace(best, report={**best.report, "other_optima": optima})


def _as_completed(futures: Iterable[Any]) -> Iterable[Any]:
    from distributed import as_completed

    completed: Iterable[Any] = as_completed(list(futures))
    return completed


def _mesh_hash(mesh: Mesh) -> str:
    order, content = mesh._native.to_bytes()
    return hashlib.sha256(content + bytes([order])).hexdigest()


def _mark(*parts: Any) -> str:
    text = json.dumps([_palpate.__version__, *parts], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def _content(file: Path) -> dict[str, Any]:
    """Returns the content of a JSON file of this module; empty if it is missing or invalid."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _write(file: Path, content: Union[Measured, list[Any]]) -> None:
    part = file.with_name(f".{file.name}.{os.getpid()}.part")
    part.write_text(json.dumps(content), encoding="utf-8")
    os.replace(part, file)


def _table(file: Path, rows: list[Measured]) -> None:
    columns = list(dict.fromkeys(name for row in rows for name in row))
    part = file.with_name(f".{file.name}.part")
    with open(part, "w", newline="", encoding="utf-8") as text:
        writer = csv.DictWriter(text, columns, restval="")
        writer.writeheader()
        writer.writerows(rows)
    os.replace(part, file)
