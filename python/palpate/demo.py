"""Demo: ``python -m palpate.demo [FOLDER]`` writes pictures of a simulated limb and a pressed breast."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import palpate


def main(arguments: list[str] | None = None) -> int:
    """Renders a limb, simulates it under gravity, and presses on a breast."""
    parser = argparse.ArgumentParser(prog="python -m palpate.demo", description=__doc__)
    folder = "write the pictures to this folder [default: palpate-demo]"
    parser.add_argument("out", nargs="?", default="palpate-demo", type=Path, help=folder)
    fine = "set the approximate number of tets of the limb [default: 8000]"
    parser.add_argument("--tets", type=int, default=8000, help=fine)
    exact = "press until the force is within this part of the true one [default: 0.05]"
    parser.add_argument("--within", type=float, default=0.05, help=exact)
    given = parser.parse_args(arguments)
    try:
        show(given.out, given.tets, given.within)
    except palpate.Error as why:
        print(f"palpate: {why}", file=sys.stderr)
        return 1
    return 0


def show(out: Path, tets: int, within: float) -> None:
    """Writes ``limb.png``, ``stress.png`` and the results of a press to ``out``."""
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

    breast = palpate.Scene({"mesh": {"generate": "breast", "tets": max(tets, 8000)}})
    press = palpate.press(breast, size=(800, 600), within=within)
    press.save(out)
    force, deepest = press.force.max(), 1e3 * press.depth.max()
    error = press.report["max_force_error_n"]
    print(f"{force:.3g} N ± {error:.1g} at {deepest:.3g} mm; pictures in {out}")


if __name__ == "__main__":
    raise SystemExit(main())
