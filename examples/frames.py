"""Frames of a body moved by this program, rendered by Palpate (docs/how-to/frames.md has the layout):

    python3 examples/frames.py | palpate render - --frames-from - --out frame.png --film frames.gif
"""

import math
import struct
import sys

N = 6  # cubes of a bar, of five tets each
nodes = [(x, y, z) for x in range(N + 1) for y in (0, 1) for z in (0, 1)]
tets = []
for i in range(N):
    corner = [4 * (i + a) + 2 * b + c for a in (0, 1) for b in (0, 1) for c in (0, 1)]
    # Alternate cubes are subdivided in mirrored form, so their faces match.
    if i % 2:
        corner = [corner[k] for k in (4, 5, 6, 7, 0, 1, 2, 3)]
    for a, b, c, d in ((0, 3, 5, 6), (0, 3, 1, 5), (0, 3, 6, 2), (0, 5, 4, 6), (3, 5, 6, 7)):
        a, b = (b, a) if i % 2 else (a, b)
        tets.append([corner[k] for k in (a, b, c, d)])

out = sys.stdout.buffer
out.write(b"PALPATE1" + struct.pack("<II", len(nodes), len(tets)))
out.write(b"".join(struct.pack("<3d", *p) for p in nodes))
out.write(b"".join(struct.pack("<4I", *t) for t in tets))
for k in range(20):
    time = 0.05 * k
    out.write(struct.pack("<d", time))
    for x, y, z in nodes:
        out.write(struct.pack("<3d", x, y, z + 0.04 * x * x * math.sin(2 * math.pi * time)))
    out.flush()
