"""A first look: ``python -m palpate.demo [FOLDER]`` leaves pictures."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import palpate


def main(arguments: list[str] | None = None) -> int:
    """Draws a limb, lets it sag and presses on it."""
    parser = argparse.ArgumentParser(prog="python -m palpate.demo", description=__doc__)
    folder = "folder for the pictures [default: palpate-demo]"
    parser.add_argument("out", nargs="?", default="palpate-demo", type=Path, help=folder)
    fine = "how fine the limb is [default: 8000]"
    parser.add_argument("--tets", type=int, default=8000, help=fine)
    given = parser.parse_args(arguments)
    try:
        show(given.out, given.tets)
    except palpate.Error as why:
        print(f"palpate: {why}", file=sys.stderr)
        return 1
    return 0


def show(out: Path, tets: int) -> None:
    """Leaves ``limb.png``, ``stress.png`` and what a press found in ``out``."""
    out.mkdir(parents=True, exist_ok=True)
    limb = palpate.Mesh.generate("limb", tets=tets)
    palpate.Renderer(limb, size=(800, 600), legend=True).save(out / "limb.png")

    bones = {"bone": {"regions": ["cortical bone", "marrow"], "rigid": True}}
    material = palpate.Material(young=3e4, tissues=bones)
    body = palpate.Body(limb, material=material, gravity=(0.0, 0.0, -9.81))
    simulator = palpate.Simulator(body, dt=0.02)
    simulator.advance(25)
    stress = palpate.Renderer(
        simulator,
        field="von_mises",
        clim=(0, 5e3),
        cmap="magma",
        mode="surface",
        size=(800, 600),
        legend=True,
        time=True,
    )
    stress.save(out / "stress.png")

    press = palpate.press(limb, size=(800, 600))
    press.save(out)
    deepest = 1e3 * press.depth.max()
    print(f"{press.force.max():.3g} N at {deepest:.3g} mm; pictures in {out}")


if __name__ == "__main__":
    raise SystemExit(main())
