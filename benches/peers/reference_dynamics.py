"""The motion of a small bar of stable Neo-Hookean tets, computed with numpy and scipy only.

    venv/bin/pip install numpy scipy
    venv/bin/python benches/peers/reference_dynamics.py

Prints the deflection of the end of the bar, for implicit Euler at 10 ms and for the trapezoidal rule
(Newmark with β = ¼, γ = ½) at 1 ms, each solved by Newton's method to the last digits with a sparse
factorisation. `tests/suite/physics/element_motion.rs` compares the CPU engine with these numbers.
It has no code in common with Palpate. The bar: 8 x 2 x 2 cells of five tets, 0.8 x 0.2 x 0.2 m, fixed at
x = 0, falling under its weight.
"""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

CELLS, EDGE = (8, 2, 2), 0.1
YOUNG, POISSON, DENSITY = 1e6, 0.3, 1000.0
GRAVITY = np.array([0.0, 0.0, -9.81])
MU = YOUNG / (2 * (1 + POISSON))
# The second parameter of the stable Neo-Hookean energy is λ + μ.
LAMBDA = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)) + MU
EPSILON = np.zeros((3, 3, 3))
for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    EPSILON[i, j, k], EPSILON[i, k, j] = 1.0, -1.0


def bar(cells=CELLS, edge=EDGE):
    """Returns the nodes and tets of a bar of cubes; alternate cubes are mirrored."""
    nx, ny, nz = cells
    number = lambda i, j, k: (k * (ny + 1) + j) * (nx + 1) + i
    nodes = [(i, j, k) for k in range(nz + 1) for j in range(ny + 1) for i in range(nx + 1)]
    even = [(0, 3, 5, 6), (1, 0, 3, 5), (2, 0, 6, 3), (4, 0, 5, 6), (7, 3, 6, 5)]
    tets = []
    for k in range(nz):
        for j in range(ny):
            for i in range(nx):
                for tet in even:
                    if (i + j + k) % 2:
                        tet = [c ^ 1 for c in tet]
                    tets.append([number(i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)) for c in tet])
    return edge * np.array(nodes, float), np.array(tets)


class Body:
    def __init__(self):
        self.rest, self.tets = bar()
        edges = np.stack([self.rest[self.tets[:, k]] - self.rest[self.tets[:, 0]] for k in (1, 2, 3)], 2)
        self.volume = np.abs(np.linalg.det(edges)) / 6
        inverse = np.linalg.inv(edges)
        self.gradients = np.concatenate([-inverse.sum(1)[:, None], inverse], 1)
        self.mass = np.zeros(len(self.rest))
        np.add.at(self.mass, self.tets, (DENSITY * self.volume / 4)[:, None])
        self.free = np.flatnonzero(np.repeat(self.rest[:, 0] > 1e-9, 3))
        self.end = self.rest[:, 0] > CELLS[0] * EDGE - 1e-9
        dofs = 3 * self.tets[:, :, None] + np.arange(3)
        dofs = dofs.reshape(len(self.tets), 12)
        self.rows, self.columns = np.repeat(dofs, 12, 1).ravel(), np.tile(dofs, (1, 12)).ravel()

    def elastic(self, x):
        """Returns the gradient and the Hessian of the energy."""
        g, m = self.gradients, len(self.tets)
        f = np.einsum("mai,maj->mij", x[self.tets], g)
        a, b, c = f[:, :, 0], f[:, :, 1], f[:, :, 2]
        cofactor = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], 2)
        pressure = LAMBDA * (np.linalg.det(f) - 1) - MU
        stress = MU * f + pressure[:, None, None] * cofactor
        slope = np.zeros_like(x)
        np.add.at(slope, self.tets, np.einsum("m,mij,maj->mai", self.volume, stress, g))
        turning = np.einsum("ikp,jlq,mpq->mijkl", EPSILON, EPSILON, f)
        second = LAMBDA * np.einsum("mij,mkl->mijkl", cofactor, cofactor)
        second += MU * np.einsum("ik,jl->ijkl", np.eye(3), np.eye(3))
        second += pressure[:, None, None, None, None] * turning
        blocks = np.einsum("m,maj,mijkl,mbl->maibk", self.volume, g, second, g).reshape(m, -1)
        size = 3 * len(x)
        return slope, sp.csr_matrix((blocks.ravel(), (self.rows, self.columns)), (size, size))

    def least(self, x, target, weight):
        """Returns the minimiser of weight/2 |x − target|² (in the mass norm) plus the energy."""
        mass = np.repeat(self.mass, 3)
        for _ in range(30):
            slope, stiffness = self.elastic(x)
            r = (weight * mass * (x - target).ravel() + slope.ravel())[self.free]
            system = (stiffness + sp.diags(weight * mass))[self.free][:, self.free].tocsc()
            step = spsolve(system, -r)
            x = x.copy()
            x.ravel()[self.free] += step
            if np.abs(step).max() < 1e-13:
                return x
        raise RuntimeError("Newton's method did not converge")

    def sunk(self, x):
        return float((self.rest - x)[self.end, 2].mean())


def euler(body, h, steps):
    x, v, sunk = body.rest.copy(), np.zeros_like(body.rest), []
    for _ in range(steps):
        after = body.least(x, x + h * v + h * h * GRAVITY, 1 / h**2)
        x, v = after, (after - x) / h
        sunk.append(body.sunk(x))
    return sunk


def trapezoid(body, h, steps):
    held = (body.rest[:, 0] < 1e-9)[:, None]
    x, v, sunk = body.rest.copy(), np.zeros_like(body.rest), []
    a = np.where(held, 0.0, GRAVITY)
    for _ in range(steps):
        target = np.where(held, body.rest, x + h * v + h * h / 4 * (a + GRAVITY))
        after = body.least(x, target, 4 / h**2)
        later = np.where(held, 0.0, 4 / h**2 * (after - x - h * v) - a)
        x, v, a = after, v + h / 2 * (a + later), later
        sunk.append(body.sunk(x))
    return sunk


if __name__ == "__main__":
    body = Body()
    print(f"{len(body.rest)} nodes, {len(body.tets)} tets")
    for name, method, h, steps in (("euler", euler, 0.01, 100), ("trapezoid", trapezoid, 0.001, 500)):
        sunk = method(body, h, steps)
        k = int(np.argmax(sunk))
        tenth = ", ".join(f"{sunk[n - 1]:.8f}" for n in (steps // 10, steps // 4, steps // 2, steps))
        print(f"{name} at {h} s: after {steps // 10}, {steps // 4}, {steps // 2}, {steps} steps {tenth};")
        print(f"  deepest {sunk[k]:.8f} m at {h * (k + 1):.3f} s")
