"""Palpate and its peers in one sitting: peers.csv and the charts of bars, the bar at rest and cubes."""

import argparse
import csv
import datetime
import platform
import tempfile
from pathlib import Path

import bar
import cube
import matplotlib
import rest

matplotlib.use("Agg")
from matplotlib import pyplot, ticker  # noqa: E402

COLUMNS = ["work", "tool", "setting", "tets", "poisson", "step_s", "ms", "error", "state", "machine", "date"]
# Okabe and Ito's colours, which are safe for colour blindness, and markers: blues and greens for
# Palpate, reds for MuJoCo, greys and yellow for rapier.
LOOKS = {
    ("Palpate", "implicit"): ("#0072B2", "o", "-"),
    ("Palpate", "bdf2"): ("#56B4E9", "s", "-"),
    ("Palpate", "bdf2-tight"): ("#56B4E9", "s", ":"),
    ("Palpate", "midpoint"): ("#009E73", "^", "-"),
    ("Palpate", "velocity-verlet"): ("#0B3C5D", "D", "-"),
    ("Palpate", "implicit, rigid"): ("#0072B2", "o", ":"),
    ("Palpate", "bdf2, rigid"): ("#56B4E9", "s", ":"),
    ("MuJoCo", "discrete"): ("#D55E00", "v", "--"),
    ("MuJoCo", "Euler"): ("#CC79A7", "P", "--"),
    ("MuJoCo", "discrete, rigid"): ("#D55E00", "v", ":"),
    ("MuJoCo", "Euler, rigid"): ("#CC79A7", "P", ":"),
    ("rapier", "fem"): ("#999999", "X", "-."),
    ("rapier", "fem-solved"): ("#000000", "X", "-."),
    ("rapier", "constraints"): ("#E69F00", "*", "-."),
    ("VTK", "projected tetrahedra"): ("#D55E00", "^", "-"),
    ("VTK", "ray cast"): ("#009E73", "s", "-"),
    ("VTK", "ZSweep"): ("#CC79A7", "D", "-"),
    ("Palpate", "raycast"): ("#0072B2", "o", "-"),
    ("Palpate", "linear tets"): ("#56B4E9", "s", "-"),
    ("Palpate", "averaged volumes"): ("#009E73", "^", "-"),
    ("Palpate", "quadratic tets"): ("#0B3C5D", "D", "-"),
    ("Palpate", "refined (--within)"): ("#0072B2", "o", "-"),
}


def rounded(entry):
    return f"{entry:.4g}" if isinstance(entry, float) else entry


def curves(axes, rows):
    """Draws time against error, one line per tool; returns them by name."""
    lines = {}
    for name in LOOKS:
        points = [(float(r[6]), float(r[7])) for r in rows if (r[1], r[2]) == name and r[8] == "ran"]
        if points:
            colour, mark, dash = LOOKS[name]
            look = {"color": colour, "marker": mark, "linestyle": dash, "markersize": 5}
            # Hollow markers denote rigid rods.
            if name[1].endswith("rigid"):
                look["markerfacecolor"] = "white"
            (lines[", ".join(name)],) = axes.plot(*zip(*points), **look)
    axes.set(xscale="log", yscale="log")
    axes.grid(color="#dddddd")
    axes.set_axisbelow(True)
    return lines


def save(figure, path):
    for kind in ("svg", "png"):
        figure.savefig(path.with_suffix(f".{kind}"), dpi=100)
    # Strips trailing whitespace from the lines of the SVG.
    svg = path.with_suffix(".svg")
    svg.write_text("\n".join(line.rstrip() for line in svg.read_text().splitlines()) + "\n")


def chart_of_bars(rows, path):
    """Draws a panel for each size and Poisson's ratio."""
    sizes = list(dict.fromkeys(int(r[3]) for r in rows))
    ratios = list(dict.fromkeys(float(r[4]) for r in rows))
    shape = (len(sizes), len(ratios))
    figure, grid = pyplot.subplots(
        *shape, figsize=(11, 1 + 3.6 * len(sizes)), sharex="row", sharey=True, squeeze=False, layout="constrained"
    )
    lines = {}
    for i, tets in enumerate(sizes):
        for j, ratio in enumerate(ratios):
            here = [r for r in rows if int(r[3]) == tets and float(r[4]) == ratio]
            lines |= curves(grid[i, j], here)
            grid[i, j].set_title(f"{tets:,} tets, ν = {ratio:g}", fontsize=10)
            grid[i, j].yaxis.set_major_formatter(ticker.FuncFormatter(lambda y, _: f"{100 * y:g} %"))
            grid[i, j].xaxis.set_major_formatter("{x:,.0f}")
            grid[i, j].xaxis.set_minor_formatter(ticker.NullFormatter())
    figure.supxlabel("milliseconds of processor time a simulated second, one thread", fontsize=10)
    figure.supylabel("largest distance of a node to the exact motion, of the longest way", fontsize=10)
    named = {", ".join(name): None for name in LOOKS}
    names = [name for name in named if name in lines]
    figure.legend([lines[n] for n in names], names, loc="outside upper center", ncols=5 if len(ratios) > 1 else 3, frameon=False)
    save(figure, path)


def chart_of_bar_with_rod(rows, path):
    figure, axes = pyplot.subplots(figsize=(10, 6), layout="constrained")
    lines = curves(axes, rows)
    axes.yaxis.set_major_formatter(ticker.FuncFormatter(lambda y, _: f"{100 * y:g} %"))
    axes.xaxis.set_major_formatter("{x:,.0f}")
    axes.set(
        title=f"{bar.ROD_TETS:,} tets with a rod {bar.ROD:,.0f} times as stiff, ν = {bar.ROD_POISSON:g}",
        xlabel="milliseconds of processor time a simulated second, one thread",
        ylabel="largest distance of a node to the exact motion, of the longest way",
    )
    axes.legend(lines.values(), lines, loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    save(figure, path)


def chart_of_cubes(rows, path):
    figure, axes = pyplot.subplots(figsize=(10, 6), layout="constrained")
    lines = curves(axes, rows)
    sizes = list(dict.fromkeys(int(r[3]) for r in rows))
    axes.set(
        title=f"A cube of {', '.join(f'{n:,}' for n in sizes)} tets, {cube.SIZE}²",
        xlabel="ms a frame",
        ylabel="RMSE of the range 0 to 1",
    )
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(ticker.NullFormatter())
    axes.legend(lines.values(), lines, loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    save(figure, path)


def chart_of_bar_at_rest(rows, path):
    figure, axes = pyplot.subplots(figsize=(10, 6), layout="constrained")
    lines = curves(axes, rows)
    axes.yaxis.set_major_formatter(ticker.FuncFormatter(lambda y, _: f"{100 * y:g} %"))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set(
        title=f"A clamped bar at rest, ν = {rest.POISSON:g}, on more and more tets",
        xlabel="milliseconds until rest, one thread",
        ylabel="error of the largest displacement",
    )
    axes.legend(lines.values(), lines, loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    save(figure, path)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--palpate", default="target/release/palpate", help="Palpate executable that renders the cube")
    parser.add_argument("--out", type=Path, required=True, help="folder for the CSV and charts")
    parser.add_argument("--only", choices=["bar", "rest", "cube", "charts"], help="measure only this benchmark and keep the other rows")
    parser.add_argument("--tets", default=",".join(map(str, bar.CELLS)), help="tet counts of the bar, comma-separated")
    parser.add_argument("--sides", default="10,20,40", help="cells per side of the cube, comma-separated")
    parser.add_argument("--frames", type=int, default=5, help="number of frames; the median is reported")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    sheet = asked.out / "peers.csv"
    stamp = [platform.processor() or platform.machine(), datetime.date.today().isoformat()]
    rows = []
    if asked.only:
        with open(sheet, newline="") as file:
            head, *rows = csv.reader(file)
        if head != COLUMNS:
            raise SystemExit(f"{sheet} has other columns; move it away, or omit --only")
    # The folder of this file contains the sources of the programs that simulate bars.
    root = Path(__file__).resolve().parents[2]
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        if asked.only in (None, "bar"):
            sizes = [int(n) for n in asked.tets.split(",")]
            found = bar.compare(root, folder / "bar", sizes)
            rows = [[*map(rounded, row), *stamp] for row in found] + [r for r in rows if r[0] in ("rest", "cube")]
        if asked.only in (None, "rest"):
            found = rest.compare(root, asked.palpate, folder / "rest")
            rows = [r for r in rows if r[0] != "rest"] + [[*map(rounded, row), *stamp] for row in found]
        if asked.only in (None, "cube"):
            sides = [int(n) for n in asked.sides.split(",")]
            found = cube.compare(asked.palpate, folder / "cube", sides, asked.frames)
            # Tool, setting and tets, then milliseconds, error and state.
            found = [["cube", *row[:3], "", "", *row[3:]] for row in found]
            rows = [r for r in rows if r[0] != "cube"] + [[*map(rounded, row), *stamp] for row in found]
    with open(sheet, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(rows)
    of = lambda work: [r for r in rows if r[0] == work]
    if of("bar"):
        chart_of_bars(of("bar"), asked.out / "peers_bar")
    if of("rod"):
        chart_of_bar_with_rod(of("rod"), asked.out / "peers_rod")
    if of("rest") and asked.only in (None, "rest", "charts"):
        chart_of_bar_at_rest(of("rest"), asked.out / "peers_rest")
    if of("cube") and asked.only in (None, "cube"):
        chart_of_cubes(of("cube"), asked.out / "peers_cube")


if __name__ == "__main__":
    main()
