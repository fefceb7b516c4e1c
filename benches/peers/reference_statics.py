"""Static solutions by quadratic tets of scikit-fem, refined to three digits.

    venv/bin/pip install numpy scipy scikit-fem
    venv/bin/python benches/peers/reference_statics.py [cook|twist]

- cook: Cook's membrane in plane strain, a slab one cell thick with faces constrained to their planes,
  linear elasticity: the mean rise of the right face times E t / F, F the shear force on it and
  t the thickness. The upper clamped corner is singular, and the mesh is refined towards it.
- twist: a beam of 0.2 x 0.2 x 0.6 between two clamped ends, one rotated by 90 degrees about its
  axis, of stable Neo-Hookean material: its energy over E V.

tests/suite/physics/statics compares Palpate with the limits of the printed values.
"""

import sys

import numpy as np
import scipy.sparse.linalg as linalg
from skfem import (Basis, BilinearForm, ElementTetP2, ElementVector, FacetBasis, LinearForm,
                   Functional, MeshTet, condense)
from skfem.helpers import ddot, det, dot, grad, inv, sym_grad, trace, transpose


def lame(poisson):
    """Returns mu and lambda relative to Young's modulus."""
    return (1 / (2 * (1 + poisson)),
            poisson / ((1 + poisson) * (1 - 2 * poisson)))


def box(cells):
    """Returns the unit cube, subdivided into cells of six tets."""
    return MeshTet.init_tensor(*(np.linspace(0, 1, n + 1) for n in cells))


def solve(matrix, load, fixed, given=None):
    given = np.zeros(matrix.shape[0]) if given is None else given
    system = condense(matrix, load, x=given, D=fixed)
    a, b, x, free = system
    x = x.copy()
    factor = linalg.splu(a.tocsc(), permc_spec='MMD_AT_PLUS_A', diag_pivot_thresh=0.0,
                         options={'SymmetricMode': True})
    x[free] = factor.solve(b)
    return x


def cook(poisson, n):
    mesh = box([n, n, 1])
    x, y, z = mesh.p
    # Refined towards the singular corner.
    x, y = x ** 2, 1 - (1 - y) ** 2
    thick = 48 / n
    mesh = MeshTet(np.array([48 * x, 44 * x + y * (44 - 28 * x), thick * z]), mesh.t)
    basis = Basis(mesh, ElementVector(ElementTetP2()))
    mu, lam = lame(poisson)

    @BilinearForm
    def stiffness(u, v, _):
        e, d = sym_grad(u), sym_grad(v)
        return 2 * mu * ddot(e, d) + lam * trace(e) * trace(d)

    right = mesh.facets_satisfying(lambda p: np.isclose(p[0], 48))
    loaded = FacetBasis(mesh, basis.elem, facets=right)

    @LinearForm
    def shear(v, _):
        return v[1] / (16 * thick)

    left = basis.get_dofs(lambda p: np.isclose(p[0], 0)).all()
    faces = basis.get_dofs(lambda p: np.isclose(p[2], 0) | np.isclose(p[2], thick))
    fixed = np.union1d(left, faces.all(['u^3']))
    load = shear.assemble(loaded)
    return float(load @ solve(stiffness.assemble(basis), load, fixed)) * thick


def twist(poisson, n):
    size = np.array([0.2, 0.2, 0.6])
    mesh = box([n, n, 3 * n])
    mesh = MeshTet(mesh.p * size[:, None], mesh.t)
    basis = Basis(mesh, ElementVector(ElementTetP2()), intorder=4)
    mu, lam = lame(poisson)
    second = lam + mu
    unit = np.eye(3)[:, :, None, None]

    def state(w):
        f = grad(w['u']) + unit
        j = det(f)
        return f, j, j * transpose(inv(f))

    def cofactor_change(f, d):
        """Returns the derivative of the cofactors of f in the direction d."""
        out = np.zeros_like(f + d)
        for k in range(3):
            a, b = (k + 1) % 3, (k + 2) % 3
            out[:, k] = (np.cross(d[:, a], f[:, b], axis=0) + np.cross(f[:, a], d[:, b], axis=0))
        return out

    @Functional
    def energy(w):
        f, j, _ = state(w)
        return 0.5 * mu * (ddot(f, f) - 3) - mu * (j - 1) + 0.5 * second * (j - 1) ** 2

    @LinearForm
    def force(v, w):
        f, j, c = state(w)
        return ddot(mu * f + (second * (j - 1) - mu) * c, grad(v))

    known = [None, None, None]

    @BilinearForm
    def slope(u, v, w):
        # The same u is paired with every v in turn.
        if known[0] is not u or known[1] is not w:
            f, j, c = state(w)
            d = grad(u)
            known[:] = [u, w, mu * d + second * ddot(c, d) * c
                        + (second * (j - 1) - mu) * cofactor_change(f, d)]
        return ddot(known[2], grad(v))

    ends = basis.get_dofs(lambda p: np.isclose(p[2], 0) | np.isclose(p[2], size[2])).all()
    at = basis.doflocs
    x, y, z = at[0] - 0.1, at[1] - 0.1, at[2]
    u = np.zeros(basis.N)
    # Dofs are x, y and z of each vertex, then of each edge.
    axis = np.arange(basis.N) % 3
    steps = 3
    previous = np.zeros(basis.N)
    for step in range(1, steps + 1):
        angle = 0.5 * np.pi * step / steps
        # The initial guess rotates the whole beam uniformly.
        turn = angle * z / size[2]
        cos, sin = np.cos(turn), np.sin(turn)
        wanted = np.choose(axis, [cos * x - sin * y - x, sin * x + cos * y - y, 0 * x])
        u = u + wanted - previous
        previous = wanted
        for _ in range(20):
            w = basis.interpolate(u)
            r = force.assemble(basis, u=w)
            known[:] = [None, None, None]
            k = slope.assemble(basis, u=w)
            change = solve(k, -r, ends)
            u = u + change
            if np.abs(change).max() < 1e-10:
                break
        else:
            raise SystemExit('no convergence')
    return float(energy.assemble(basis, u=basis.interpolate(u))) / size.prod()


def main():
    wanted = sys.argv[1:] or ['cook', 'twist']
    studies = [('cook', cook, (0.3, 0.45, 0.49), (8, 16, 24, 32)),
               ('twist', twist, (0.3, 0.49), (2, 3, 4, 6))]
    for name, study, ratios, cells in studies:
        if name not in wanted:
            continue
        for poisson in ratios:
            for n in cells:
                print(f'{name} nu = {poisson}, {n} cells: {study(poisson, n):.6g}', flush=True)


if __name__ == '__main__':
    main()
