"""The view of notebooks without a browser: its pictures and its reactions to messages."""

from __future__ import annotations

import io
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import palpate

pytest.importorskip("anywidget")


class Shown:
    """A simulated browser: receives the pictures of a view and acknowledges them."""

    def __init__(self, view: palpate.View, answers: bool = True) -> None:
        self.view, self.answers = view, answers
        self.pictures: list[np.ndarray] = []
        self.numbers: list[int] = []
        view.send = self.take
        self.say(kind="shown")

    def take(self, content: dict, buffers: list[bytes]) -> None:
        self.pictures.append(np.asarray(Image.open(io.BytesIO(buffers[0]))))
        self.numbers.append(content["number"])
        if self.answers:
            self.view._hear(None, {"kind": "got", "number": content["number"]}, [])

    def say(self, **said: object) -> None:
        self.view._hear(None, said, [])

    def wait(self, what: str, is_so, seconds: float = 600) -> None:
        end = time.monotonic() + seconds
        while not is_so():
            assert time.monotonic() < end, f"timeout waiting for {what}; {self.view.said}"
            time.sleep(0.02)

    def rest(self) -> np.ndarray:
        """Returns the full-resolution picture once nothing is pending."""
        self.wait("rest", lambda: self.view.idle)
        return self.pictures[-1].astype(int)


    def settle(self) -> None:
        """Waits until all messages are handled, with one picture unacknowledged."""

        def settled() -> bool:
            view = self.view
            with view._news:
                return not (view._waits or view._working) and view._sent != view._got

        self.wait("the messages handled", settled)


@pytest.fixture
def ball():
    ball = palpate.Mesh.generate("ball", tets=1500)
    view = palpate.View(ball, size=(160, 120), background="black")
    yield view
    view.close()


def test_view_renders_camera_changes(ball: palpate.View) -> None:
    shown = Shown(ball)
    first = shown.rest()
    assert first.shape == (120, 160, 3) and first.max() > 50
    # JPEGs are not the picture to the bit, but nearly.
    assert np.abs(first - ball.picture()[..., :3].astype(int)).mean() < 3
    shown.say(kind="turn", x=0.2, y=0.1)
    shown.wait("a reduced picture", lambda: any(p.shape == (60, 80, 3) for p in shown.pictures))
    turned = shown.rest()
    assert turned.shape == (120, 160, 3), "full resolution at rest"
    shown.say(kind="zoom", by=0.5)
    nearer = shown.rest()
    assert (nearer.max(axis=2) > 10).sum() > 1.3 * (turned.max(axis=2) > 10).sum()
    count = len(shown.pictures)
    # News that changes nothing.
    shown.say(kind="got", number=shown.numbers[-1])
    shown.rest()
    assert len(shown.pictures) == count, "an unchanged view must not be rendered again"


def test_light_paths_set_in_at_rest() -> None:
    scene = palpate.Scene(
        {"mesh": {"generate": "ball", "tets": 400}, "light": {"model": "path", "samples": 12}}
    )
    view = palpate.View(scene, size=(96, 72), background="black")
    shown = Shown(view)
    last = shown.rest()
    drawn = [p for p in shown.pictures if p.shape == (72, 96, 3)]
    # 1, 2, 4, 8 and 12 samples.
    assert len(drawn) >= 5, len(drawn)
    whole = view.picture()[..., :3].astype(int)
    apart = [np.abs(picture.astype(int) - whole).mean() for picture in (drawn[-5], last)]
    assert apart[1] < 3 and apart[0] > 2 * apart[1], apart
    shown.say(kind="turn", x=0.3, y=0.0)
    shown.wait("a picture in local light", lambda: any(p.shape == (36, 48, 3) for p in shown.pictures))
    assert np.abs(shown.rest().astype(int) - last.astype(int)).mean() > 1
    view.close()


def test_latest_camera_is_rendered(ball: palpate.View) -> None:
    shown = Shown(ball, answers=False)
    shown.wait("a picture", lambda: shown.numbers)
    shown.settle()
    sent = len(shown.numbers)
    for _ in range(30):
        shown.say(kind="turn", x=0.02, y=0.0)
    shown.settle()
    assert len(shown.numbers) == sent, "no picture may be sent before the last one is acknowledged"
    shown.answers = True
    shown.say(kind="got", number=shown.numbers[-1])
    last = shown.rest()
    assert len(shown.numbers) <= sent + 2
    assert np.abs(last - ball.picture()[..., :3].astype(int)).mean() < 3


def test_view_presses_cuts_and_resets(ball: palpate.View) -> None:
    shown = Shown(ball)
    rest = shown.rest()
    shown.say(kind="press", x=0.01, y=0.01)
    shown.wait("a message", lambda: "place the fingertip on the body" in ball.said)
    shown.say(kind="press", x=0.5, y=0.5)
    for depth in np.linspace(0, 0.12, 10):
        shown.say(kind="deeper", depth=float(depth))
    shown.wait("a force", lambda: len(ball.forces) > 5 and ball.forces[-1, 2] > 0)
    shown.rest()
    forces = ball.forces
    assert (np.diff(forces[:, 1]) >= 0).all() and forces[-1, 2] > forces[2, 2]
    assert ball.curve[-1] == [1e3 * forces[-1, 1], forces[-1, 2]]
    assert np.abs(shown.rest() - rest).mean() > 0.5
    shown.say(kind="release")
    shown.wait("the fingertip withdrawn", lambda: not ball._touched.pressed)
    tets = len(ball._touched._stage.mesh().nodes())
    shown.say(kind="cut", way=[[0.5, 0.3], [0.5, 0.45], [0.5, 0.6], [0.5, 0.7]])
    shown.wait("a cut", lambda: ball.said == "cut")
    assert len(ball._touched._stage.mesh().nodes()) > tets
    shown.say(kind="reset")
    again = shown.rest()
    assert np.abs(again - rest).mean() < 2 and len(ball.curve) == 0


def test_view_changes_appearance(ball: palpate.View) -> None:
    shown = Shown(ball)
    rest = shown.rest()
    seen = [rest]
    for trait, value in [("colour", "magma"), ("opacity_scale", 4.0), ("plane", "x"), ("range", [0.2, 0.5])]:
        if trait == "range":
            low, high = ball.whole
            value = [low + share * (high - low) for share in (0.2, 0.5)]
        setattr(ball, trait, value)
        seen.append(shown.rest())
        assert np.abs(seen[-1] - seen[-2]).mean() > 0.3, trait
    assert {"displacement", "von_mises"} <= set(ball.fields)
    ball.field = "no such field"
    shown.wait("a message", lambda: "no such field" in ball.said)


def test_picked_points_lie_on_rays(ball: palpate.View) -> None:
    touched = ball._touched
    for x, y in [(0.5, 0.5), (0.4, 0.6)]:
        seen = touched.pick(x, y)
        assert seen is not None
        origin, direction = touched.ray(x, y)
        assert np.allclose(origin + seen.distance * direction, seen.point, atol=1e-4 * touched.diagonal)


def test_old_traits_warn_and_work(ball: palpate.View) -> None:
    for old, current in [("density", "opacity_scale"), ("plane_at", "plane_position")]:
        with pytest.warns(DeprecationWarning, match=f"View.{old} is now View.{current}"):
            setattr(ball, old, 0.25)
        assert getattr(ball, current) == 0.25
        with pytest.warns(DeprecationWarning, match=f"View.{old} is now View.{current}"):
            assert getattr(ball, old) == 0.25


@pytest.mark.parametrize("name", ["three_bodies", "foot_bones"])
def test_view_renders_bodies_that_cannot_be_pressed(name: str) -> None:
    scene = Path(__file__).resolve().parents[2] / f"data/scenes/{name}.toml"
    view = palpate.View(scene, size=(80, 60))
    shown = Shown(view)
    assert shown.rest().max() > 20
    shown.say(kind="press", x=0.5, y=0.5)
    shown.wait("a message", lambda: bool(view.said))
    view.close()


def test_export_reports_missing_files(ball: palpate.View, tmp_path, monkeypatch) -> None:
    monkeypatch.delenv("PALPATE_WEB", raising=False)
    with pytest.raises(palpate.InputError, match="scripts/web"):
        ball.export_html(tmp_path / "ball.html")
