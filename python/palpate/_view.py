"""Interactive view of a body in a notebook: rendered by the kernel, controlled in the browser."""

from __future__ import annotations

import base64
import gzip
import json
import os
import tempfile
import threading
import time
from collections.abc import Sequence
from os import fspath
from pathlib import Path
from typing import Any

import anywidget
import numpy as np
import traitlets

from . import _palpate
from ._deprecated import warn_renamed
from ._errors import Error, InputError
from ._mesh import PathOf
from ._scene import BodyLike, Scene, _absolute, picture_entries
from ._stage import Picture
from ._touch import Touched

_HERE = Path(__file__).parent
#: Idle time after which the picture is rendered at full resolution, s.
_STILL = 0.25
#: Fraction of the picture size while something moves, and JPEG quality in motion and at rest.
_COARSE, _QUICK, _FINE = 0.5, 75, 92
#: Most samples per pixel of light paths between two pictures.
_MORE_SAMPLES = 8
#: Number of forces kept for the curve.
_KEPT = 400


class View(anywidget.AnyWidget):  # type: ignore[misc]
    """Interactive view of a body in a notebook.

    Drag to orbit the body, turn the wheel to zoom. With **Press** place a fingertip on the body and
    drag away from that point to press deeper; with **Cut** draw a stroke that begins on the body. The
    kernel renders the pictures and sends them as JPEG, the latest only, one at a time.

    Args:
        body: as in :func:`palpate.render`.
        size: width and height of the picture, in pixels.
        adapter: graphics adapter.
        picture: as in :func:`palpate.render`.
    """

    _esm = _HERE / "view.js"
    _css = _HERE / "view.css"

    size = traitlets.List(traitlets.Int(), default_value=[640, 480]).tag(sync=True)
    fields = traitlets.List(traitlets.Unicode()).tag(sync=True)
    field = traitlets.Unicode("").tag(sync=True)
    colours = traitlets.List(traitlets.Unicode()).tag(sync=True)
    colour = traitlets.Unicode("").tag(sync=True)
    opacity_scale = traitlets.Float(1.0).tag(sync=True)
    whole = traitlets.List(traitlets.Float(), default_value=[0.0, 1.0]).tag(sync=True)
    range = traitlets.List(traitlets.Float(), default_value=[0.0, 1.0]).tag(sync=True)
    plane = traitlets.Unicode("").tag(sync=True)
    plane_position = traitlets.Float(0.5).tag(sync=True)
    said = traitlets.Unicode("").tag(sync=True)
    curve = traitlets.List().tag(sync=True)

    def __init__(
        self,
        body: BodyLike,
        *,
        size: Sequence[int] = (640, 480),
        adapter: str | None = None,
        **picture: Any,
    ) -> None:
        width, height = (int(n) for n in size)
        self._scene = Scene.from_any(body).updated(picture_entries(size=(width, height), **picture))
        self._draws_paths = self._scene.entries.get("light", {}).get("model") == "path"
        self._adapter = adapter
        self._touched = Touched(self._scene, adapter)
        own = self._scene.entries.get("picture", {})
        _, whole = self._touched._stage.shown()
        super().__init__(
            size=[width, height],
            fields=_fields(self._touched),
            field=own.get("field", ""),
            colours=_palpate.presets(),
            colour=own.get("transfer", "") if own.get("transfer") in _palpate.presets() else "",
            whole=list(whole),
            range=list(whole),
        )
        #: Guards the received messages (held briefly), and rendering and stepping.
        self._news = threading.Condition()
        self._at_work = threading.Lock()
        self._changed = time.monotonic()
        self._dirty = True
        self._looks = False
        self._waits: list[tuple[str, Any]] = []
        self._sent = self._got = self._heard = 0
        self._shown_at = 0.0
        #: Samples per pixel of the light paths that set in at rest, and whether more are to come.
        self._samples, self._refines = 0, False
        self._ended = False
        self._working = False
        self._problem: str | None = None
        self.on_msg(self._hear)
        self.observe(self._relook, ["field", "colour", "opacity_scale", "range", "plane", "plane_position"])
        self._painter = threading.Thread(target=self._paint, name="palpate-view", daemon=True)
        self._painter.start()

    def picture(self, size: Sequence[int] | None = None) -> Picture:
        """Returns the current picture, shape (height, width, 4)."""
        with self._at_work:
            width, height = self.size if size is None else (int(n) for n in size)
            stage = self._touched._stage
            stage.set_size((width, height))
            return stage.rgba().reshape(height, width, 4)

    @property
    def density(self) -> float:
        """Old name of :attr:`opacity_scale`."""
        warn_renamed("View.density", "View.opacity_scale")
        return float(self.opacity_scale)

    @density.setter
    def density(self, scale: float) -> None:
        warn_renamed("View.density", "View.opacity_scale")
        self.opacity_scale = scale

    @property
    def plane_at(self) -> float:
        """Old name of :attr:`plane_position`."""
        warn_renamed("View.plane_at", "View.plane_position")
        return float(self.plane_position)

    @plane_at.setter
    def plane_at(self, position: float) -> None:
        warn_renamed("View.plane_at", "View.plane_position")
        self.plane_position = position

    @property
    def forces(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Simulated time (s), depth (m) and force (N) of each step of the last press, shape (n, 3)."""
        return np.array(self._touched.samples).reshape(-1, 3)

    def close(self) -> None:
        """Stops rendering and closes the view."""
        with self._news:
            self._ended = True
            self._news.notify_all()
        super().close()

    def export_html(self, path: PathOf, page: PathOf | None = None) -> None:
        """Writes a single HTML file with the body and the browser build, for any browser with WebGPU.

        Args:
            path: the HTML file.
            page: folder built by ``scripts/web``; default: the value of PALPATE_WEB.
        """
        folder = page or os.environ.get("PALPATE_WEB")
        if folder is None or not (Path(folder) / "palpate_view_bg.wasm").is_file():
            raise InputError(
                f"no browser build in {folder or 'PALPATE_WEB, which is not set'}; build it in "
                "target/web with scripts/web and pass that folder as page="
            )
        with self._at_work:
            camera = self._touched.camera.entries()
        scene = self._scene.updated({"camera": camera})
        export(scene, Path(folder), Path(path))

    def _hear(self, _: Any, said: Any, __: Any) -> None:
        """Queues a message of the browser, which the rendering thread handles in order."""
        with self._news:
            kind = said.get("kind")
            if kind == "got":
                self._got = int(said["number"])
            elif kind == "shown":
                # A new or additional display of the same body.
                self._got, self._dirty = self._sent, True
            else:
                self._waits.append((kind, said))
            self._news.notify_all()

    def _relook(self, _: Any) -> None:
        with self._news:
            self._looks = True
            self._news.notify_all()

    def _paint(self) -> None:
        while True:
            with self._news:
                self._working = False
                while not (self._ended or self._due()):
                    sharp = self._changed + _STILL - time.monotonic()
                    waits = self._shown_at < self._changed + _STILL
                    self._news.wait(max(sharp, 0.01) if waits else None)
                if self._ended:
                    return
                heard, self._waits = self._waits, []
                self._heard += len(heard)
                looks, self._looks = self._looks, False
                self._working = True
                free = self._sent == self._got
            try:
                with self._at_work:
                    picture = self._work(heard, looks, free)
            except Error as why:
                self._touched.let_go()
                self.said = str(why)
                continue
            if picture is not None:
                quality = _QUICK if picture.shape[1] != self.size[0] else _FINE
                with self._news:
                    self._sent += 1
                frame = {"kind": "frame", "number": self._sent, "heard": self._heard}
                self.send(frame, [_palpate.jpeg(picture, quality)])
                samples = [s for s in self._touched.samples if s[1] >= 0.0][-_KEPT:]
                problem = self._touched.problem
                if problem != self._problem:
                    self.said = problem or ""
                    self._problem = problem
                if len(samples) != len(self.curve):
                    self.curve = [[1e3 * depth, force] for _, depth, force in samples]

    @property
    def idle(self) -> bool:
        """Whether nothing is pending and the browser has the sharp picture of the current state."""
        with self._news:
            pending = bool(self._waits) or self._looks or self._dirty or self._working
            sharp = self._shown_at >= self._changed + _STILL
            pending = pending or self._refines
            return sharp and not pending and not self._touched.moves and self._sent == self._got

    def _due(self) -> bool:
        busy = bool(self._waits) or self._looks or self._touched.moves
        free = self._sent == self._got
        still = self._changed + _STILL
        sharpens = time.monotonic() >= still and self._shown_at < still
        return busy or (free and (self._dirty or sharpens or self._refines))

    def _work(self, heard: list[tuple[str, Any]], looks: bool, free: bool) -> Picture | None:
        """Handles the messages, performs a press step, and renders a picture if one can be shown."""
        for kind, said in heard:
            self._do(kind, said)
        if looks:
            self._touched._stage.set_looks(self._looked().json(), fspath(self._scene.folder))
            self._dirty = True
        if self._touched.moves:
            self._touched.step()
            self._dirty = True
        now = time.monotonic()
        if self._dirty:
            self._changed = now
        if not free:
            return None
        moves = now < self._changed + _STILL
        share = _COARSE if moves and self._sent > 0 else 1.0
        if not (moves or self._dirty) and self._draws_paths:
            return self._refined(now)
        picture = self._draw([max(int(share * n), 1) for n in self.size])
        self._dirty, self._samples = False, 0
        self._refines = not moves and self._draws_paths
        # A full-resolution picture is the last until something changes.
        self._shown_at = now if moves else self._changed + _STILL
        return picture

    def _refined(self, now: float) -> Picture | None:
        """Adds samples to the light paths of a view at rest, as many as it has, and returns it."""
        stage = self._touched._stage
        width, height = self.size
        fresh = self._samples == 0
        if fresh:
            stage.set_size((width, height))
        more = min(max(self._samples, 1), _MORE_SAMPLES)
        pixels = stage.refine_paths(more, fresh)
        self._samples += more
        self._refines = pixels is not None
        self._shown_at = max(now, self._changed + _STILL)
        return None if pixels is None else pixels.reshape(height, width, 4)

    def _do(self, kind: str, said: Any) -> None:
        touched = self._touched
        if kind == "turn":
            touched.turn(float(said["x"]), float(said["y"]))
        elif kind == "pan":
            touched.pan(float(said["x"]), float(said["y"]))
        elif kind == "zoom":
            touched.zoom(float(np.exp(np.clip(float(said["by"]), -2.0, 2.0))))
        elif kind == "press":
            if not touched.press(float(said["x"]), float(said["y"])):
                self.said = "place the fingertip on the body"
        elif kind == "deeper":
            touched.press_to(float(said["depth"]))
        elif kind == "release":
            touched.let_go()
        elif kind == "cut":
            done = touched.cut([[float(x), float(y)] for x, y in said["way"]])
            self.said = "cut" if done else "the stroke cut nothing; start it on the body"
            if done:
                touched.step()
        elif kind == "reset":
            camera = touched.camera
            self._touched = Touched(self._scene, self._adapter)
            self._touched.camera = camera
            self._looks = True
            self.said, self.curve = "", []
        self._dirty = True

    def _draw(self, size: Sequence[int]) -> Picture:
        stage = self._touched._stage
        stage.set_size((size[0], size[1]))
        # Light paths would take seconds; they set in at rest.
        return stage.rgba(local_light=True).reshape(size[1], size[0], 4)

    def _looked(self) -> Scene:
        """Returns the scene with the settings of the controls."""
        scene = self._touched.scene
        chosen: dict[str, Any] = {"picture.field": self.field or None}
        if self.colour:
            chosen["picture.transfer"] = self.colour
        if self.range != self.whole:
            chosen["picture.range"] = list(self.range)
        if self.plane:
            low, high = self._touched.bounds
            axis = "xyz".index(self.plane)
            point, normal = 0.5 * (low + high), np.zeros(3)
            point[axis] = low[axis] + self.plane_position * (high - low)[axis]
            normal[axis] = 1.0
            planes = list(scene.entries.get("plane", []))
            chosen["plane"] = [*planes, {"clip": [*point.tolist(), *normal.tolist()]}]
        looked = scene.updated(chosen)
        if self.opacity_scale != 1.0:
            stage = self._touched._stage
            stage.set_looks(looked.json(), fspath(scene.folder))
            looked = looked.updated({"picture.transfer": stage.transfer(float(self.opacity_scale))})
        return looked


def _fields(touched: Touched) -> list[str]:
    """Returns the fields that can be displayed."""
    own = [f.name for f in touched.rest.fields() if f.values.ndim == 1]
    computed = ["displacement", "von_mises", "stress_1", "strain", "J"]
    return own + ([] if touched.obstacle is not None else computed)


def export(scene: Scene, page: Path, path: Path) -> None:
    """Writes the page of a folder, a scene and its files as one HTML file."""
    files: dict[str, bytes] = {}

    def taken(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: taken(inner) for name, inner in value.items()}
        if isinstance(value, (list, tuple)):
            return [taken(inner) for inner in value]
        if isinstance(value, str) and "{" not in value and Path(value).is_absolute():
            file = Path(value)
            if file.is_file():
                files[file.name] = file.read_bytes()
                return file.name
        return value

    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        whole = scene.in_files(folder)
        entries = taken(_absolute(whole.entries, Path(folder)))
    files["scene.toml"] = _palpate.to_toml(json.dumps(entries)).encode()
    text = (_HERE / "export.html").read_text(encoding="utf-8")
    parts = {
        "BINDINGS": json.dumps((page / "palpate_view.js").read_text(encoding="utf-8")),
        "ELEMENT": json.dumps((page / "palpate-view.js").read_text(encoding="utf-8")),
        "MODULE": json.dumps(
            _encoded(gzip.compress((page / "palpate_view_bg.wasm").read_bytes(), mtime=0))
        ),
        "FILES": json.dumps({name: _encoded(content) for name, content in files.items()}),
    }
    for name, value in parts.items():
        # "</" could close the script element.
        text = text.replace(f'"@{name}@"', value.replace("</", "<\\/"))
    part = path.with_name(f".{path.name}.part")
    part.write_text(text, encoding="utf-8")
    os.replace(part, path)


def _encoded(content: bytes) -> str:
    return base64.b64encode(content).decode()


