"""Round trips through meshio, VTK (pyvista) and Gmsh, and warps by ITK: python tests/interop.py PALPATE.

Each check prints a line; the exit code is 1 if one fails.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import gmsh
import meshio
import numpy as np
import pyvista

from interop_ten_node import ten_node_tets
from interop_warp import warped_by_itk

PALPATE = sys.argv[1]
DATA = Path(__file__).parent.parent / "data"
# The names of regions here are this and their number.
REGION = "tissue"
failed = 0


def check(name, difference):
    """Prints the result of a check, which passes if `difference` is empty."""
    global failed
    failed += bool(difference)
    print(f"{'FAILED' if difference else 'ok'}: {name}{': ' + difference if difference else ''}", flush=True)


def run(*arguments):
    done = subprocess.run([PALPATE, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"palpate {arguments[0]}: {done.stderr.strip()}")
    return done.stdout


def volumes(points, tets):
    a, b, c, d = (points[tets[:, i]] for i in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6


def facts(points, tets, labels=None, names=None, fields=None):
    """Returns the quantities on which two programs must agree. `labels`: one per tet; `names`: by label."""
    of_tet = volumes(np.asarray(points), np.asarray(tets))
    found = {"nodes": len(points), "tets": len(tets), "volume": of_tet.sum()}
    if labels is not None:
        labels = np.ravel(labels).astype(int)
        found["regions"] = {
            int(label): (int((labels == label).sum()), of_tet[labels == label].sum())
            for label in np.unique(labels)
        }
    if names is not None:
        found["names"] = {int(label): name for label, name in names.items()}
    # Nodes and cells may be in another order: the sorted values of a field are compared.
    found["fields"] = {name: np.sort(np.ravel(values)) for name, values in (fields or {}).items()}
    return found


def difference(a, b, tolerance=1e-9):
    """What was expected in `a` and is another way in `b`, in words; what only one tells of does not
    count, but for ranges of fields that are expected."""
    for key in (key for key in a if key in b):
        x, y = a[key], b[key]
        if isinstance(x, dict):
            if key == "ranges" and x.keys() - y.keys():
                return f"missing field {sorted(x.keys() - y.keys())}"
            if key in ("regions", "names") and x.keys() != y.keys():
                return f"{key}: {sorted(x)} and {sorted(y)}"
            for item in (item for item in x if item in y):
                told = difference({item: x[item]}, {item: y[item]}, tolerance)
                if told:
                    return f"{key} {told}"
        elif isinstance(x, str):
            if x != y:
                return f"{key}: {x} and {y}"
        elif np.shape(x) != np.shape(y):
            return f"{key}: shapes {np.shape(x)} and {np.shape(y)}"
        elif not np.allclose(x, y, rtol=tolerance, atol=1e-12):
            return f"{key}: {x} and {y}"
    return ""


def by_palpate(path):
    """Returns the description of a file by Palpate; fields are given by their range."""
    told = json.loads(run("info", path, "--json"))
    return {
        "nodes": told["nodes"],
        "tets": told["tets"],
        "volume": told["volume"],
        "regions": {r["label"]: (r["tets"], r["volume"]) for r in told["regions"]},
        "names": {r["label"]: r["name"] for r in told["regions"] if r["name"]},
        "ranges": {f["name"]: (f["min"], f["max"]) for f in told["fields"]},
    }


def ranges(fields):
    """Returns the ranges of fields as Palpate does: for tuples those of their magnitudes."""
    lengths = {name: np.linalg.norm(np.reshape(v, (len(v), -1)), axis=1) if np.ndim(v) > 1 else np.asarray(v)
               for name, v in fields.items()}
    return {name: (float(v.min()), float(v.max())) for name, v in lengths.items()}


# How each program reads a file.


def by_meshio(path):
    mesh = meshio.read(path)
    tets = np.concatenate([block.data for block in mesh.cells if block.type == "tetra"])
    cells = {name: np.concatenate(values) for name, values in mesh.cell_data.items()}
    labels = None
    for name in ("label", "gmsh:physical", "medit:ref", "tetgen:ref"):
        labels = cells.get(name, labels) if labels is None else labels
    names = {}
    for key, value in mesh.field_data.items():
        value = np.ravel(value)
        if key.startswith("region:"):
            names.update({int(label): key[len("region:"):] for label in value})
        elif len(value) == 2 and value[1] == 3:
            names[int(value[0])] = key
    if path.suffix == ".inp":
        sets = mesh.cell_sets
        labels = np.zeros(len(tets))
        for name in sets:
            number = int(name.removeprefix(REGION))
            labels[np.concatenate([np.ravel(s) for s in sets[name]])] = number
            names[number] = name
    # TetGen's attributes have no names there.
    return facts(mesh.points, tets, labels, names or None, {**mesh.point_data, **cells})


def by_vtk(path):
    mesh = pyvista.read(path)
    tets = mesh.cells_dict[pyvista.CellType.TETRA]
    names = {}
    for key in mesh.field_data.keys():
        if key.startswith("region:"):
            names.update({int(label): key[len("region:"):] for label in mesh.field_data[key]})
    fields = {**dict(mesh.point_data), **dict(mesh.cell_data)}
    return facts(mesh.points, tets, fields.get("label"), names, fields)


def by_gmsh(path):
    gmsh.clear()
    gmsh.open(str(path))
    tags, points, _ = gmsh.model.mesh.getNodes()
    index = np.zeros(int(tags.max()) + 1, int)
    index[tags.astype(int)] = np.arange(len(tags))
    tets, labels, names = [], [], {}
    for dimension, entity in gmsh.model.getEntities(3):
        _, nodes = gmsh.model.mesh.getElementsByType(4, entity)
        groups = gmsh.model.getPhysicalGroupsForEntity(3, entity)
        tets.append(index[nodes.astype(int)].reshape(-1, 4))
        labels.append(np.full(len(tets[-1]), groups[0] if len(groups) else 0))
    for dimension, group in gmsh.model.getPhysicalGroups(3):
        name = gmsh.model.getPhysicalName(3, group)
        if name:
            names[group] = name
    fields = {}
    for view in gmsh.view.getTags():
        number = gmsh.view.getIndex(view)
        name = gmsh.option.getString(f"View[{number}].Name")
        _, _, data, _, _ = gmsh.view.getModelData(view, 0)
        fields[name] = np.array(data)
    return facts(points.reshape(-1, 3), np.concatenate(tets), np.concatenate(labels), names, fields)


def written_by_palpate(folder):
    """Checks that other programs read files written by Palpate."""
    limb = pyvista.read(DATA / "limb.vtu")
    source = folder / "source.vtu"
    points, cells = limb.points, limb.cells_dict[pyvista.CellType.TETRA]
    label = np.asarray(limb.cell_data["label"])
    mesh = pyvista.UnstructuredGrid({pyvista.CellType.TETRA: cells}, points.astype(float))
    mesh.cell_data["label"] = label.astype(np.int32) + 1
    mesh.cell_data["quality"] = volumes(points, cells) ** 0.5
    mesh.point_data["warm"] = np.sin(points[:, 0] * 9.0)
    mesh.point_data["flow"] = points[:, ::-1] / 3.0
    names = {int(n): f"{REGION}{n}" for n in np.unique(mesh.cell_data["label"])}
    for number, name in names.items():
        mesh.field_data[f"region:{name}"] = np.array([number], np.int64)
    mesh.save(source)
    fields = {**dict(mesh.point_data), **dict(mesh.cell_data)}
    expected = facts(mesh.points, cells, fields["label"], names, fields)
    told = by_palpate(source)
    check("VTK writes .vtu, palpate reads it", difference({**expected, "ranges": ranges(fields)}, told))

    vtk, mio, gms = ("VTK", by_vtk), ("meshio", by_meshio), ("Gmsh", by_gmsh)
    for name, flags, readers, all_fields in [
        ("a.vtu", [], [vtk, mio], True),
        ("a.vtk", [], [vtk, mio], True),
        ("text.vtk", ["--text"], [vtk, mio], True),
        ("a41.msh", [], [gms, mio], True),
        ("text41.msh", ["--text"], [gms, mio], True),
        ("a22.msh", ["--format", "gmsh22"], [gms, mio], True),
        ("text22.msh", ["--format", "gmsh22", "--text"], [gms, mio], True),
        ("a.mesh", [], [mio], False),
        ("a.node", [], [mio], False),
        ("a.inp", [], [mio], False),
    ]:
        path = folder / name
        try:
            run("convert", source, path, *flags)
        except RuntimeError as error:
            check(f"palpate writes {name}", str(error))
            continue
        for program, read in readers:
            try:
                found = read(path)
                missing = ""
                if all_fields:
                    absent = {"warm", "flow", "quality"} - found["fields"].keys()
                    missing = f"missing {sorted(absent)}" if absent else ""
                    # meshio ignores the mesh metadata of legacy files.
                    if not found.get("names") and not (read is by_meshio and path.suffix == ".vtk"):
                        missing = "missing names"
                if "regions" not in found:
                    missing = "missing regions"
                check(f"palpate writes {name}, {program} reads it", missing or difference(expected, found))
            except Exception as error:  # a reader that stops is a check that fails
                check(f"palpate writes {name}, {program} reads it", f"{type(error).__name__}: {error}")
    gmsh.clear()
    try:
        gmsh.open(str(folder / "a.mesh"))
        _, _, nodes = gmsh.model.mesh.getElements(3)
        count = sum(len(n) for n in nodes) // 4
        check("palpate writes a.mesh, Gmsh reads it", difference({"tets": expected["tets"]}, {"tets": count}))
    except Exception as error:
        check("palpate writes a.mesh, Gmsh reads it", str(error))
    return mesh, expected, names


def written_by_gmsh(folder):
    """Checks that Palpate reads all variants of files written by Gmsh."""
    gmsh.clear()
    ball = gmsh.model.occ.addSphere(0, 0, 0, 1)
    box = gmsh.model.occ.addBox(0.3, 0.3, 0.3, 2, 1, 1)
    gmsh.model.occ.fragment([(3, ball)], [(3, box)])
    gmsh.model.occ.synchronize()
    solids = [entity for _, entity in gmsh.model.getEntities(3)]
    names = {5: "left half", 9: "bone"}
    gmsh.model.addPhysicalGroup(3, solids[:1], 5, "left half")
    gmsh.model.addPhysicalGroup(3, solids[1:], 9, "bone")
    gmsh.model.addPhysicalGroup(2, [s for _, s in gmsh.model.getEntities(2)], 3, "skin")
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.4)
    gmsh.model.mesh.generate(3)
    gmsh.option.setNumber("Mesh.SaveAll", 0)
    path = folder / "gmsh_reference.msh"
    gmsh.write(str(path))
    expected = None
    for version in (1, 2.2, 4.0, 4.1):
        for binary in (0, 1):
            if version in (1, 4.0) and binary:
                continue  # there is no such form, or Gmsh does not write it
            path = folder / f"gmsh_{version}_{binary}.msh"
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.option.setNumber("Mesh.Binary", binary)
            gmsh.write(str(path))
            if expected is None:
                tags, points, _ = gmsh.model.mesh.getNodes()
                index = {int(tag): i for i, tag in enumerate(tags)}
                tets, labels = [], []
                for group, own in ((5, solids[:1]), (9, solids[1:])):
                    for entity in own:
                        nodes = gmsh.model.mesh.getElementsByType(4, entity)[1]
                        tets.append(np.array([index[int(n)] for n in nodes]).reshape(-1, 4))
                        labels.append(np.full(len(tets[-1]), group))
                tets, labels = np.concatenate(tets), np.concatenate(labels)
                used = np.unique(tets)
                place = np.zeros(len(tags), int)
                place[used] = np.arange(len(used))
                points = points.reshape(-1, 3)[used]
                expected = facts(points, place[tets], labels, names)
            wanted = dict(expected)
            found = by_palpate(path)
            if version == 1:
                # It has no names, so groups are no regions by themselves.
                wanted["ranges"] = {"gmsh:physical": (5, 9)}
                found.pop("names"), found.pop("regions")
            form = "binary" if binary else "text"
            check(f"Gmsh writes MSH {version} as {form}, palpate reads it", difference(wanted, found))
    for extension in (".mesh", ".vtk", ".inp"):
        path = folder / f"gmsh{extension}"
        gmsh.option.setNumber("Mesh.Binary", 0)
        gmsh.write(str(path))
        found = by_palpate(path)
        wanted = {key: expected[key] for key in ("nodes", "tets", "volume")}
        if extension == ".inp":
            wanted["names"] = {1: "left half", 2: "bone"}
            first, second = (expected["regions"][label] for label in (5, 9))
            wanted["regions"] = {1: first, 2: second}
            wanted["names"] = {i: n for i, n in wanted["names"].items()}
            # Gmsh writes names without blanks there.
            found["names"] = {i: n.replace("_", " ") for i, n in found["names"].items()}
        check(f"Gmsh writes {extension}, palpate reads it", difference(wanted, found, 1e-6))


def written_by_others(folder, mesh, expected, names):
    """Checks that Palpate reads files written by meshio and VTK."""
    plain = {key: expected[key] for key in ("nodes", "tets", "volume")}
    cells = mesh.cells_dict[pyvista.CellType.TETRA]
    point_data = {name: np.asarray(values) for name, values in mesh.point_data.items()}
    cell_data = {name: [np.asarray(values)] for name, values in mesh.cell_data.items()}
    points = np.asarray(mesh.points)
    label = cell_data["label"]
    fields = ranges({**point_data, **{name: values[0] for name, values in cell_data.items()}})
    full = meshio.Mesh(points, [("tetra", cells)], point_data=point_data, cell_data=cell_data)
    bare = meshio.Mesh(points, [("tetra", cells)])
    marked = meshio.Mesh(points, [("tetra", cells)], cell_data={"medit:ref": label})
    tetgen = meshio.Mesh(points, [("tetra", cells)], cell_data={"tetgen:ref": label})
    groups = meshio.Mesh(
        points,
        [("tetra", cells)],
        point_data=point_data,
        cell_data={"gmsh:physical": label, "gmsh:geometrical": label, "quality": cell_data["quality"]},
        field_data={name: np.array([number, 3]) for number, name in names.items()},
    )
    sets = meshio.Mesh(
        points,
        [("tetra", cells)],
        cell_sets={name: [np.flatnonzero(label[0] == number)] for number, name in names.items()},
    )
    span = fields["label"]
    regions = {key: expected[key] for key in ("regions", "names")}
    without = {name: value for name, value in fields.items() if name != "label"}
    of_sets = {i: name for i, name in enumerate(names.values(), 1)}
    for name, source, options, wanted in [
        ("m.vtu", full, {}, {"ranges": fields, "regions": expected["regions"]}),
        ("m_text.vtu", full, {"binary": False}, {"ranges": fields}),
        ("m_plain.vtu", full, {"compression": None}, {"ranges": fields}),
        ("m51.vtk", full, {"file_format": "vtk51"}, {"ranges": fields}),
        ("m42.vtk", full, {"file_format": "vtk42"}, {"ranges": fields}),
        ("m_text.vtk", full, {"binary": False}, {"ranges": fields}),
        ("m.mesh", marked, {}, {"ranges": {"medit:ref": span}}),
        ("m.node", tetgen, {}, {"ranges": {"tetgen:ref": span}}),
        ("m.inp", sets, {}, {"names": of_sets, "regions": {
            i: expected["regions"][number] for i, number in enumerate(names, 1)}}),
        ("m41.msh", bare, {"file_format": "gmsh"}, {}),
        ("m40.msh", bare, {"file_format": "gmsh40"} , {}),
        ("m22.msh", groups, {"file_format": "gmsh22"}, {**regions, "ranges": without}),
        # As text, meshio writes the types of numpy 2 in front of the values of fields.
        ("m22_text.msh", bare, {"file_format": "gmsh22", "binary": False}, {}),
    ]:
        path = folder / name
        try:
            if options.get("file_format") == "gmsh40":
                meshio.gmsh.write(path, source, fmt_version="4.0")
            else:
                source.write(path, **options)
            check(f"meshio writes {name}, palpate reads it", difference({**plain, **wanted}, by_palpate(path), 1e-6))
        except Exception as error:
            check(f"meshio writes {name}, palpate reads it", f"{type(error).__name__}: {error}")
    for name, binary in (("v.vtu", True), ("v_text.vtu", False), ("v.vtk", True), ("v_text.vtk", False)):
        path = folder / name
        mesh.save(path, binary=binary)
        wanted = {**plain, **regions, "ranges": fields}
        check(f"VTK writes {name}, palpate reads it", difference(wanted, by_palpate(path), 1e-5))


def negative_control(folder, expected):
    """Checks that changes of a mesh are detected."""
    changed = meshio.read(folder / "a.vtu")
    changed.points = changed.points * [1, 1, 1.001]
    changed.write(folder / "changed.vtu")
    told = difference(expected, by_meshio(folder / "changed.vtu"))
    check("negative control: a stretched mesh is detected by its volume", "" if "volume" in told else f"not noticed: {told!r}")
    changed = meshio.read(folder / "a.vtu")
    labels = changed.cell_data["label"][0].copy()
    labels[0] += 1
    changed.cell_data["label"] = [labels]
    changed.write(folder / "changed.vtu")
    regions = {"regions": expected["regions"]}
    told = difference(regions, by_palpate(folder / "changed.vtu"))
    check("negative control: a tet in another region is detected", "" if "regions" in told else f"not noticed: {told!r}")
    changed = meshio.read(folder / "a.vtu")
    warm = changed.point_data["warm"].copy()
    warm[0] += 1
    changed.point_data["warm"] = warm
    changed.write(folder / "changed.vtu")
    told = difference(expected, by_meshio(folder / "changed.vtu"))
    check("negative control: a changed value of a field is detected", "" if "warm" in told else f"not noticed: {told!r}")


def moved_by_others(folder):
    """Checks that frames piped by a plain Python program are rendered to different pictures."""
    example = Path(__file__).parent.parent / "examples" / "frames.py"
    frames = subprocess.run([sys.executable, example], capture_output=True, check=True).stdout
    out = folder / "frame.png"
    command = [PALPATE, "render", "-", "--frames-from", "-", "--size", "64x48", "--out", out]
    done = subprocess.run(command, input=frames, capture_output=True)
    pictures = [path.read_bytes() for path in sorted(folder.glob("frame_*.png"))]
    drawn = done.returncode == 0 and len(pictures) == 20 and pictures[0] != pictures[5]
    check("frames from a pipe", "" if drawn else f"{len(pictures)} pictures, {done.stderr.decode()}")


def main():
    gmsh.initialize(["-noenv"], readConfigFiles=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.Verbosity", 0)
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        mesh, expected, names = written_by_palpate(folder)
        written_by_gmsh(folder)
        written_by_others(folder, mesh, expected, names)
        negative_control(folder, expected)
        ten_node_tets(folder, run, check)
        moved_by_others(folder)
        warped_by_itk(folder, run, check)
    gmsh.finalize()
    print(f"{failed} failed" if failed else "all ok")
    return 1 if failed else 0


sys.exit(main())
