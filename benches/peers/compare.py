"""Palpate and its peers in one sitting: peers.csv, peers_bar.svg, peers_cube.svg."""

import argparse
import csv
import datetime
import platform
import tempfile
from pathlib import Path

import bar
import cube
import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot, ticker  # noqa: E402

# Okabe and Ito's colours, which the colour-blind tell apart, and marks besides.
COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"]
MARKS = "o^sDvPX"


def rounded(entry):
    return f"{entry:.4g}" if isinstance(entry, float) else entry


def chart(rows, title, x, y, path):
    figure, axes = pyplot.subplots(figsize=(10, 6), layout="constrained")
    tools = list(dict.fromkeys((r[1], r[2]) for r in rows))
    for k, tool in enumerate(tools):
        points = [(r[4], r[5]) for r in rows if (r[1], r[2]) == tool and r[6] == "ran"]
        if points:
            look = {"color": COLOURS[k % 7], "marker": MARKS[k % 7]}
            axes.plot(*zip(*points), label=f"{tool[0]}, {tool[1]}", **look)
    axes.set(xscale="log", yscale="log", xlabel=x, ylabel=y, title=title)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(ticker.NullFormatter())
    axes.grid(color="#dddddd")
    axes.legend(loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    for kind in ("svg", "png"):
        figure.savefig(path.with_suffix(f".{kind}"), dpi=100)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--palpate", default="target/release/palpate", help="the program to compare")
    parser.add_argument("--out", type=Path, required=True, help="folder for the CSV and charts")
    parser.add_argument("--sides", default="10,20,40", help="cells along the cube's side")
    parser.add_argument("--frames", type=int, default=5, help="frames whose median counts")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    sides = [int(n) for n in asked.sides.split(",")]
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        bars = [["bar", *row] for row in bar.compare(asked.palpate, folder / "bar")]
        cubes = [["cube", *row] for row in cube.compare(asked.palpate, folder / "cube", sides, asked.frames)]
    stamp = [platform.processor() or platform.machine(), datetime.date.today().isoformat()]
    with open(asked.out / "peers.csv", "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["work", "tool", "setting", "step_s_or_tets", "ms", "error", "state", "machine", "date"])
        writer.writerows([*map(rounded, row), *stamp] for row in bars + cubes)
    chart(
        bars,
        f"A bar of {bar.TETS} tets released under gravity",
        "ms per simulated second",
        "relative L2 error against linear elements",
        asked.out / "peers_bar",
    )
    chart(
        cubes,
        f"A cube of {', '.join(f'{6 * n**3:,}' for n in sides)} tets, {cube.SIZE}²",
        "ms a frame",
        "RMSE of the range 0 to 1",
        asked.out / "peers_cube",
    )


if __name__ == "__main__":
    main()
