"""Prepares pictures of arrays for scripts/pictures, with the Python package and matplotlib.

    python scripts/array_pictures.py edges MESH OUT      adds the edge lengths of tets as a field
    python scripts/array_pictures.py warp REST BENT DISPLACEMENT OUT
"""

from __future__ import annotations

import sys
from itertools import combinations

import matplotlib
import numpy as np

import palpate

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402


def edges(source: str, out: str) -> None:
    """Writes the mesh with the mean edge length of each tet as its cell field `edge (mm)`."""
    mesh = palpate.Mesh.read(source)
    corners = mesh.nodes[mesh.tets]
    lengths = [np.linalg.norm(corners[:, a] - corners[:, b], axis=1) for a, b in combinations(range(4), 2)]
    palpate.Mesh(
        mesh.nodes, mesh.tets, cell_data={"edge (mm)": np.mean(lengths, axis=0)}, length_unit=mesh.length_unit
    ).write(out)


def warp(rest: str, bent: str, displacement: str, out: str) -> None:
    """Draws an axial slice of a scan at rest and deformed, and of the length of the displacement in it."""
    scan, moved = palpate.Volume.read(rest), palpate.Volume.read(bent)
    axes = [palpate.Volume.read(displacement, volume=axis).array for axis in range(3)]
    length = np.sqrt(sum(axis.astype(float) ** 2 for axis in axes))
    k = int(np.argmax(length.max(axis=(0, 1))))
    fig, panels = plt.subplots(1, 3, figsize=(8, 3.7), layout="constrained")
    shown = [
        ("scan at rest", scan.array[:, :, k], "gray"),
        ("scan in the pressed head", moved.array[:, :, k], "gray"),
        ("displacement (mm)", length[:, :, k], "viridis"),
    ]
    spacing = np.linalg.norm(scan.affine[:3, :3], axis=0)
    for panel, (title, values, colours) in zip(panels, shown, strict=True):
        # Anterior at the top, the patient's right at the left.
        turned = values.T[:: 1 if scan.affine[1, 1] < 0 else -1, :: 1 if scan.affine[0, 0] < 0 else -1]
        image = panel.imshow(turned, cmap=colours, aspect=spacing[1] / spacing[0])
        panel.set_title(title, fontsize=10)
        panel.axis("off")
    fig.colorbar(image, ax=panels[2], shrink=0.8)
    fig.savefig(out, dpi=100)


if __name__ == "__main__":
    {"edges": edges, "warp": warp}[sys.argv[1]](*sys.argv[2:])
