"""Draws a body in pieces by more and more workers, and charts how long it takes.

    python examples/pieces.py --tets 6000000 --workers 1 2 4 --pieces 4 16 64 --out docs/cluster

Each worker has one thread, and one of the software driver's; a real cluster has a GPU a worker. Says how
long cutting takes and what files are large, and leaves pieces.csv (a line a run), pieces.svg and pieces.png in the folder.
"""

from __future__ import annotations

import argparse
import csv
import os
import tempfile
import time
from pathlib import Path

# Before any thread is created: workers inherit the environment.
os.environ.setdefault("LP_NUM_THREADS", "1")
os.environ.setdefault("RAYON_NUM_THREADS", "1")

import numpy as np
from distributed import Client, LocalCluster

import palpate
import palpate.dask


def ready() -> None:
    """Creates the device of a worker."""
    palpate.render(palpate.Mesh.generate("box", tets=100), size=(16, 16))


def measured(index: Path, workers: int, size: tuple[int, int]) -> tuple[dict[str, float], np.ndarray]:
    """Measures a run on a separate cluster; the device of each worker exists already."""
    with LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster, Client(cluster) as client:
        client.run(ready)
        pieces: list[palpate.dask.DrawnPiece] = []
        start = time.perf_counter()
        picture = palpate.dask.render_pieces(index, None, client, size=size, each=pieces.append)
        seconds = time.perf_counter() - start
    pixels = size[0] * size[1]
    return {
        "workers": workers,
        "pieces": len(pieces),
        "tets": sum(p.tets for p in pieces),
        "seconds": seconds,
        "read_s_a_piece": float(np.mean([p.read_seconds for p in pieces])),
        "draw_s_a_piece": float(np.mean([p.draw_seconds for p in pieces])),
        # Of all workers together: tasks, and the reduction tree.
        "rest_s": workers * seconds - sum(p.read_seconds + p.draw_seconds for p in pieces),
        "ghosts_a_tet": sum(p.ghosts for p in pieces) / sum(p.tets for p in pieces),
        "bytes_a_pixel": 28 * sum(p.intervals for p in pieces) / pixels,
        "largest_bytes_a_pixel": 28 * max(p.intervals for p in pieces) / pixels,
        "worker_mb": max(p.memory for p in pieces) / 1e6,
    }, picture


def chart(rows: list[dict[str, float]], out: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")
    for workers in sorted({row["workers"] for row in rows}):
        own = sorted((r["pieces"], r["seconds"]) for r in rows if r["workers"] == workers)
        name = f"{workers:.0f} worker" + ("s" if workers > 1 else "")
        left.plot(*zip(*own), marker="o", label=name)
    left.set(xscale="log", xlabel="pieces", ylabel="seconds a picture")
    left.set_ylim(bottom=0)
    few = min(row["workers"] for row in rows)
    many = max(row["workers"] for row in rows)
    for workers, style in [(few, "-"), (many, "--")]:
        own = sorted((r["pieces"], r["worker_mb"]) for r in rows if r["workers"] == workers)
        right.plot(*zip(*own), style, marker="o", label=f"{workers:.0f}")
    right.set(xscale="log", xlabel="pieces", ylabel="most memory of a worker, MB")
    right.set_ylim(bottom=0)
    for axes in (left, right):
        pieces = sorted({row["pieces"] for row in rows})
        axes.set_xticks(pieces, [f"{n:.0f}" for n in pieces])
        axes.minorticks_off()
        axes.legend(title=None if axes is left else "workers")
        axes.grid(alpha=0.3)
    for kind in ("svg", "png"):
        figure.savefig(out / f"pieces.{kind}", dpi=120)


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--tets", type=int, default=6_000_000)
    arguments.add_argument("--body", default="cube", help="name of a generated mesh, or a mesh file")
    arguments.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4])
    arguments.add_argument("--pieces", type=int, nargs="+", default=[4, 16, 64])
    arguments.add_argument("--repeat", type=int, default=3, help="number of runs; the fastest is reported")
    arguments.add_argument("--size", type=int, nargs=2, default=(1024, 768))
    arguments.add_argument("--out", type=Path, default=Path("pieces"))
    given = arguments.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    size = (given.size[0], given.size[1])
    file = Path(given.body)
    body = palpate.Mesh.read(file) if file.suffix else palpate.Mesh.generate(given.body, tets=given.tets)
    whole = palpate.render(body, size=size).astype(int)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for pieces in given.pieces:
            index = Path(folder) / f"body{pieces}.pvtu"
            start = time.perf_counter()
            body.write(index, pieces=pieces)
            seconds = time.perf_counter() - start
            files = sum(file.stat().st_size for file in index.parent.glob(f"body{pieces}_*.vtu"))
            a_tet = files / len(body.tets)
            print(f"partitioned into {pieces} pieces in {seconds:.1f} s, {a_tet:.1f} bytes per tet", flush=True)
            for workers in given.workers:
                runs = [measured(index, workers, size) for _ in range(given.repeat)]
                # The run with the least disturbance.
                row, picture = min(runs, key=lambda run: run[0]["seconds"])
                row["most_apart"] = int(np.abs(picture - whole).max())
                print(", ".join(f"{name} {value:.4g}" for name, value in row.items()), flush=True)
                rows.append(row)
    print(f"peak memory of this process: {palpate.dask._most_memory() / len(body.tets):.0f} bytes per tet")
    with open(given.out / "pieces.csv", "w", newline="", encoding="utf-8") as text:
        writer = csv.DictWriter(text, rows[0])
        writer.writeheader()
        writer.writerows({k: f"{v:.5g}" for k, v in row.items()} for row in rows)
    chart(rows, given.out)


if __name__ == "__main__":
    main()
