#!/usr/bin/env python3
"""Benchmarks palpate mesh against TetGen and gmsh on one closed surface, for docs/performance/meshing-presses-cuts.md.

    python3 scripts/bench_mesh.py SURFACE.stl [RUNS] [PALPATE]

TetGen and gmsh (Debian packages tetgen and gmsh) keep the triangles of the surface and mesh its
interior with default settings (tetgen -pq1.4; gmsh -3); palpate mesh gets their tet counts as its
target. Runs alternate; times are wall times of whole commands, including reading and writing.
"""
import json
import os
import statistics
import struct
import subprocess
import sys
import tempfile
import time


def vertices_and_triangles(path):
    """Returns the merged vertices and the triangles of a binary STL file."""
    data = open(path, "rb").read()
    (count,) = struct.unpack_from("<I", data, 80)
    index, triangles = {}, []
    for n in range(count):
        corners = struct.unpack_from("<9f", data, 84 + 50 * n + 12)
        points = [corners[3 * k:3 * k + 3] for k in range(3)]
        triangles.append([index.setdefault(p, len(index)) for p in points])
    return list(index), triangles


def write_smesh(path, vertices, triangles):
    with open(path, "w") as file:
        print(len(vertices), 3, 0, 0, file=file)
        for n, p in enumerate(vertices):
            print(n, *("%.9g" % x for x in p), file=file)
        print(len(triangles), 0, file=file)
        for t in triangles:
            print(3, *t, file=file)
        print("0\n0", file=file)


def run(command, folder):
    start = time.perf_counter()
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    return time.perf_counter() - start, done


def main():
    surface = os.path.abspath(sys.argv[1])
    runs = int((sys.argv[2:3] or [5])[0])
    palpate = os.path.abspath((sys.argv[3:4] or ["target/release/palpate"])[0])
    with tempfile.TemporaryDirectory() as folder:
        stl = os.path.join(folder, "s.stl")
        subprocess.run([palpate, "mesh", surface, "--out", stl], check=True, capture_output=True)
        vertices, triangles = vertices_and_triangles(stl)
        write_smesh(os.path.join(folder, "s.smesh"), vertices, triangles)
        with open(os.path.join(folder, "s.geo"), "w") as file:
            file.write('Merge "s.stl";\nSurface Loop(1) = {1};\nVolume(1) = {1};\n')
        others = {
            "tetgen": (["tetgen", "-pq1.4Q", "s.smesh"], "s.1.node"),
            "gmsh": (["gmsh", "-3", "s.geo", "-o", "s.msh", "-format", "msh22", "-v", "1"], "s.msh"),
        }

        def quality(file):
            report = subprocess.run([palpate, "info", os.path.join(folder, file), "--json"],
                                    capture_output=True, text=True)
            return json.loads(report.stdout) if report.returncode == 0 else None

        for name, (command, result) in others.items():
            seconds, done = run(command, folder)
            theirs = quality(result)
            if theirs is None:
                words = (done.stderr or done.stdout).strip().splitlines()
                print(f"{name}: no mesh ({words[-1] if words else done.returncode})")
                continue
            own = [palpate, "mesh", "s.stl", "--tets", str(theirs["tets"]), "--out", "p.vtu"]
            times = {name: [], "palpate": []}
            for _ in range(runs):
                times[name].append(run(command, folder)[0])
                times["palpate"].append(run(own, folder)[0])
            ours = quality("p.vtu")
            for who, t in ((name, theirs), ("palpate", ours)):
                q = t["quality"]
                print(f"{who}: {t['tets']} tets, {statistics.median(times[who]):.2f} s "
                      f"({min(times[who]):.2f}-{max(times[who]):.2f}), dihedral angles "
                      f"{q['min_dihedral']:.1f} to {q['max_dihedral']:.1f}, "
                      f"volume {t['volume']:.6g}")


main()
