"""Pictures per second of a notebook's view, for a browser that accepts each immediately.

    python examples/view_rate.py [TETS...]

Rotates a limb for some seconds, then presses on it, and counts the JPEGs sent, at half the width and height
of the view (640 by 480), as always during motion.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import palpate


class Counted(palpate.View):  # type: ignore[misc]
    """A view that counts its pictures instead of sending them."""

    frames = 0

    def send(self, content: Any, buffers: Any = None) -> None:
        if content.get("kind") == "frame":
            self.frames += 1
            self._hear(self, {"kind": "got", "number": content["number"]}, None)


def rate(view: Counted, seconds: float, said: Any) -> float:
    """Returns pictures per second while it receives `said` 60 times per second, like pointer events."""
    start, before = time.monotonic(), view.frames
    while time.monotonic() < start + seconds:
        view._hear(view, said(time.monotonic() - start), None)
        time.sleep(1 / 60)
    return (view.frames - before) / (time.monotonic() - start)


def main() -> None:
    for tets in [int(n) for n in sys.argv[1:]] or [10_000, 50_000]:
        view = Counted(palpate.Mesh.generate("limb", tets=tets), field="intensity")
        rate(view, 2.0, lambda _: {"kind": "turn", "x": 0.01, "y": 0.0})
        turned = rate(view, 5.0, lambda _: {"kind": "turn", "x": 0.01, "y": 0.0})
        view._hear(view, {"kind": "press", "x": 0.45, "y": 0.5}, None)
        rate(view, 1.0, lambda _: {"kind": "deeper", "depth": 0.0})
        pressed = rate(view, 5.0, lambda t: {"kind": "deeper", "depth": 0.001 * t})
        view.close()
        print(f"{tets} tets: {turned:.1f} images per second while rotating, {pressed:.1f} while pressing {view.said}")


if __name__ == "__main__":
    main()
