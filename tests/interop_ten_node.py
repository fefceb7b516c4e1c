"""Ten-node tets: the order of their nodes and curved edges, to and from meshio, VTK and Gmsh."""

import json

import gmsh
import meshio
import numpy as np
import pyvista

QUADRATIC_TETRA = pyvista.CellType.QUADRATIC_TETRA
# Gmsh's number of the type, and its order of the nodes in the order of VTK.
GMSH_TYPE, OF_GMSH = 11, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]


def shapes(points, cells):
    """Returns the positions of the nodes of each cell, sorted by cell: equal for equal meshes."""
    nodes = np.asarray(points, float)[np.asarray(cells)]
    centres = nodes[:, :4].mean(axis=1).round(7)
    return nodes[np.lexsort(centres.T)]


def by_meshio(path):
    mesh = meshio.read(path)
    blocks = [block.data for block in mesh.cells if block.type == "tetra10"]
    return shapes(mesh.points, np.concatenate(blocks))


def by_vtk(path):
    grid = pyvista.read(path)
    return shapes(grid.points, grid.cells_dict[QUADRATIC_TETRA])


def by_gmsh(path=None):
    """Reads a file, or takes the present model."""
    if path is not None:
        gmsh.clear()
        gmsh.open(str(path))
    tags, points, _ = gmsh.model.mesh.getNodes()
    index = np.zeros(int(tags.max()) + 1, int)
    index[tags.astype(int)] = np.arange(len(tags))
    _, nodes = gmsh.model.mesh.getElementsByType(GMSH_TYPE)
    return shapes(points.reshape(-1, 3), index[nodes.astype(int)].reshape(-1, 10)[:, OF_GMSH])


def unlike(expected, found):
    """Says how two meshes differ; empty if they do not."""
    if expected.shape != found.shape:
        return f"{expected.shape} and {found.shape}"
    apart = np.abs(expected - found).max()
    return "" if apart < 1e-6 else f"nodes are {apart:.3g} apart"


def curved_ball():
    """Makes a ball of ten-node tets in Gmsh; their edges follow its surface."""
    gmsh.clear()
    gmsh.model.occ.addSphere(0, 0, 0, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(3, [1], 4, "ball")
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.6)
    gmsh.option.setNumber("Mesh.SaveAll", 0)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)
    return by_gmsh()


def ten_node_tets(folder, run, check):
    def test(name, read, wanted):
        try:
            check(name, unlike(wanted, read()))
        except Exception as error:  # a reader that stops is a check that fails
            check(name, f"{type(error).__name__}: {error}")

    def through_palpate(path):
        out = folder / "through.vtu"
        run("convert", path, out)
        return by_vtk(out)

    expected = curved_ball()
    bulge = np.abs(expected[:, 4] - (expected[:, 0] + expected[:, 1]) / 2).max()
    check("the ball of ten-node tets is curved", "" if bulge > 0.01 else f"by {bulge}")
    forms = [("b22.msh", 2.2, 0), ("b22b.msh", 2.2, 1), ("b41.msh", 4.1, 0), ("b41b.msh", 4.1, 1)]
    forms += [(f"b{extension}", 4.1, 0) for extension in (".mesh", ".vtk", ".inp")]
    for name, version, binary in forms:
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.write(str(folder / name))
    gmsh.option.setNumber("Mesh.Binary", 0)
    for name, _, _ in forms:
        test(f"Gmsh writes ten-node tets to {name}, palpate reads them", lambda: through_palpate(folder / name), expected)

    source = folder / "through.vtu"
    run("convert", folder / "b41b.msh", source)
    vtk, mio, gms = ("VTK", by_vtk), ("meshio", by_meshio), ("Gmsh", by_gmsh)
    for name, flags, readers in [
        ("q.vtu", [], [vtk, mio]),
        ("q.vtk", [], [vtk, mio]),
        ("qt.vtk", ["--text"], [vtk, mio]),
        ("q41.msh", [], [gms, mio]),
        ("q41t.msh", ["--text"], [gms, mio]),
        ("q22.msh", ["--format", "gmsh22"], [gms, mio]),
        ("q22t.msh", ["--format", "gmsh22", "--text"], [gms, mio]),
        ("q.mesh", [], [gms]),
        ("q.inp", [], [mio]),
    ]:
        run("convert", source, folder / name, *flags)
        for program, read in readers:
            test(f"palpate writes ten-node tets to {name}, {program} reads them", lambda: read(folder / name), expected)

    volume = json.loads(run("info", source, "--json"))["volume"]
    wrong = abs(volume / (4 / 3 * np.pi) - 1)
    check("palpate measures the volume inside curved faces", "" if wrong < 0.01 else f"{volume}")

    grid = pyvista.read(source)
    points, cells = np.asarray(grid.points), grid.cells_dict[QUADRATIC_TETRA]
    mesh = meshio.Mesh(points, [("tetra10", cells)])
    for name, options in [
        ("m10.vtu", {}),
        ("m10.vtk", {"file_format": "vtk42"}),
        ("m10_51.vtk", {"file_format": "vtk51"}),
        ("m10.inp", {}),
        ("m10_22.msh", {"file_format": "gmsh22"}),
        ("m10_41.msh", {"file_format": "gmsh"}),
    ]:
        mesh.write(folder / name, **options)
        test(f"meshio writes ten-node tets to {name}, palpate reads them", lambda: through_palpate(folder / name), expected)
    for name, binary in [("v10.vtu", True), ("v10t.vtu", False), ("v10.vtk", True), ("v10t.vtk", False)]:
        grid.save(folder / name, binary=binary)
        test(f"VTK writes ten-node tets to {name}, palpate reads them", lambda: through_palpate(folder / name), expected)

    meshio.Mesh(points, [("tetra10", cells[:, OF_GMSH])]).write(folder / "swapped.vtu")
    told = unlike(expected, through_palpate(folder / "swapped.vtu"))
    check("negative control: ten-node tets in Gmsh's order are detected", "" if "apart" in told else f"not noticed: {told!r}")
