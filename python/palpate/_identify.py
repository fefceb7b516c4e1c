"""Material parameters from measured presses and recordings."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import fspath
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _palpate
from ._mesh import Mesh, PathOf, Progress, _floats
from ._press import Press, _with_files
from ._scene import BodyLike, Scene


@dataclass(frozen=True)
class PressCurve:
    """A measured press: force against depth.

    Attributes:
        at: press point on the body at rest, in the mesh's unit.
        direction: direction in which the fingertip advances.
        radius: radius of the fingertip, in the mesh's unit.
        depth: depths beyond first contact, m.
        force: forces, N.
    """

    at: Sequence[float]
    direction: Sequence[float]
    radius: float
    depth: npt.ArrayLike
    force: npt.ArrayLike


@dataclass(frozen=True)
class StiffnessMap:
    """A measured map: the stiffness at points that were pressed in one direction to one depth.

    Attributes:
        points: press points, in the mesh's unit, shape (n, 3).
        stiffness: slope of force over depth in the deeper half, N/m; NaN where it is unknown.
        direction: direction in which the fingertip advances.
        radius: radius of the fingertip, in the mesh's unit.
        depth: depth, in the mesh's unit.
        unit: metres per unit of the mesh.
    """

    points: npt.ArrayLike
    stiffness: npt.ArrayLike
    direction: Sequence[float]
    radius: float
    depth: float
    unit: float = 1.0


#: What is measured: a press, the files of one, or the file of a recording of markers (``.toml``; see
#: ``palpate identify``).
Measurement = PressCurve | StiffnessMap | Press | PathOf


@dataclass(frozen=True)
class Identified:
    """Result of :func:`identify`.

    Attributes:
        values: values of the unknowns.
        intervals: for each the interval that holds it with a probability of 90 %.
        sentences: the results in words: intervals, what the data do not determine, misfits.
        report: content of ``identified.json``: ``unknowns, stiffness, misfit, noise, is_misfit,
            converged, discretisation_errors, correction, correlations, other_optima, next_press,
            seconds``.
        residuals: a row for each measured number: ``experiment, quantity, at, depth_m, measured,
            predicted, residual``; ``quantity`` is ``force`` (N), ``stiffness`` (N/m), or a number of a
            recording with its unit.
        scene: scene with the values.
    """

    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    sentences: list[str]
    report: dict[str, Any]
    residuals: list[dict[str, Any]]
    scene: Scene


def identify(
    body: BodyLike,
    data: Measurement | Sequence[Measurement],
    unknown: str | Sequence[str] = (),
    *,
    noise: float | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    first: Mapping[str, float] | None = None,
    starts: int = 1,
    first_start: int = 0,
    profile: str | Sequence[str] = (),
    advice: bool = True,
    correct: int = 0,
    adapter: str | None = None,
    progress: Progress | None = None,
) -> Identified:
    """Finds material parameters from measurements, as ``palpate identify``.

    Args:
        body: mesh, body, scene of one body, or path of a file.
        data: measurements of the body, or one.
        unknown: names of the unknowns: ``material.young``, ``material.TISSUE.young``,
            ``material.poisson``, ``material.TISSUE.poisson``, ``material.density``,
            ``material.TISSUE.density``, ``material.damping_ratio``, ``gravity.x`` (``y``, ``z``),
            ``pressure.N``, ``tool.NAME.friction``, ``finger.x`` (``y``, ``z``: how far the fingertip was
            from the stated places), ``lump``, a ball with another stiffness, or ``stiffness:cage:LENGTH`` (such as ``8mm``, with
            ``:piecewise`` behind it for sharp edges), factors on a grid. Without any, measured and
            predicted numbers are compared.
        noise: standard deviation of the measured numbers, such as 0.02: of a curve relative to its largest
            force, of a map relative to each stiffness; default: estimated from the residuals.
        bounds: lower and upper bounds of unknowns.
        first: values of unknowns at the start; default: those of the scene.
        starts: number of starts from different values.
        first_start: number of the first of them, counted from 0.
        profile: unknowns whose intervals are found by profile likelihood, which takes several
            predictions each.
        advice: whether to find the further press that would tell most.
        correct: number of times that forces of linear tets are corrected by those of quadratic ones.
        adapter: graphics adapter.
        progress: called with the current stage and its completed fraction. Ctrl-C, or an exception it
            raises, cancels the search.
    """
    scene = Scene.from_any(body)
    is_one = isinstance(data, (PressCurve, StiffnessMap, Press, str, Path))
    measured: Sequence[Any] = [data] if is_one else list(data)  # type: ignore[arg-type]
    names = [unknown] if isinstance(unknown, str) else list(unknown)
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        files = [_written(one, Path(folder) / f"data{k + 1}") for k, one in enumerate(measured)]
        report, residuals, mesh = _with_files(
            scene,
            lambda entries, place: _palpate.identify(
                entries,
                place,
                files,
                names,
                noise,
                [(name, (float(low), float(high))) for name, (low, high) in (bounds or {}).items()],
                [(name, float(value)) for name, value in (first or {}).items()],
                starts,
                first_start,
                [profile] if isinstance(profile, str) else list(profile),
                advice,
                correct,
                adapter,
                progress,
            ),
        )
    found = json.loads(report)
    sentences = found.pop("sentences")
    values = {one["name"]: one["value"] for one in found["unknowns"]}
    changes: dict[str, Any] = {name: x for name, x in values.items() if name.startswith("material.")}
    if found["correction"] is not None:
        # Linear tets with the same values have other forces.
        changes |= {"material.order": 2, "material.volume": None}
    if mesh is not None:
        own = dict(scene.entries)
        own["mesh"] = {k: v for k, v in own.get("mesh", {}).items() if k == "unit"}
        scene = Scene(own, folder=scene.folder, mesh=Mesh._of(mesh))
        lump = any(name.startswith("lump.") for name in values)
        changes["material.stiffness_field"] = "lump_stiffness" if lump else "stiffness_factor"
    for name, x in values.items():
        if name.startswith("gravity."):
            gravity = changes.setdefault("solver.gravity", list(scene.entries["solver"]["gravity"]))
            gravity["xyz".index(name[-1])] = x
        elif name.startswith("pressure."):
            pressures = changes.setdefault("pressure", [dict(one) for one in scene.entries["pressure"]])
            pressures[int(name.split(".")[1]) - 1]["pressure"] = x
    return Identified(
        values,
        {one["name"]: (one["low"], one["high"]) for one in found["unknowns"]},
        sentences,
        found,
        json.loads(residuals),
        scene.updated(changes),
    )


def _written(data: Measurement, folder: Path) -> str:
    """Returns a path with the measurement; writes it to ``folder`` if it is none."""
    if isinstance(data, PressCurve):
        rows = [np.asarray(data.depth, float), np.asarray(data.force, float)]
        about = {
            "at": [float(x) for x in data.at],
            "direction": [float(x) for x in data.direction],
            # In the mesh's unit: without a unit of its own.
            "radius_m": float(data.radius),
        }
        return _write(folder, "press", "depth_m,force_n", rows, about)
    if isinstance(data, StiffnessMap):
        points = _floats(data.points, "points")
        rows = [*points.T, np.asarray(data.stiffness, float)]
        about = {
            "radius": float(data.radius),
            "depth": float(data.depth),
            "direction": [float(x) for x in data.direction],
            "length_unit_m": float(data.unit),
        }
        return _write(folder, "map", "x,y,z,stiffness", rows, about)
    if isinstance(data, Press):
        phases = ["load" if loading else "unload" for loading in data.loading]
        lines = [f"{p},{d!r},{f!r}" for p, d, f in zip(phases, data.depth.tolist(), data.force.tolist())]
        folder.mkdir(parents=True)
        (folder / "press.csv").write_text("\n".join(["phase,depth_m,force_n", *lines, ""]))
        (folder / "press.json").write_text(json.dumps(data.report))
        return fspath(folder)
    return fspath(data)


def _write(folder: Path, name: str, header: str, columns: Sequence[Any], about: dict[str, Any]) -> str:
    folder.mkdir(parents=True)
    lines = [",".join(repr(float(x)) for x in row) for row in zip(*columns)]
    (folder / f"{name}.csv").write_text("\n".join([header, *lines, ""]))
    (folder / f"{name}.json").write_text(json.dumps(about))
    return fspath(folder)
