"""Pictures, compared bytewise with those of the command line."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import palpate
from palpate import _palpate

ROOT = Path(__file__).resolve().parents[2]
SIZE = ("--size", "160x120")


def png(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path).convert("RGBA"))


@pytest.mark.parametrize(
    ("flags", "arguments"),
    [
        ([], {}),
        (["--field", "intensity", "--transfer", "magma"], {"field": "intensity", "cmap": "magma"}),
        (
            ["--field", "intensity", "--range", "100,900", "--background", "white"],
            {"field": "intensity", "clim": (100, 900), "background": "white"},
        ),
        (["--background", "transparent", "--light", "none"], {"background": "transparent", "light": "none"}),
        (["--mode", "surface", "--legend", "--title", "A limb"], {"mode": "surface", "legend": True, "title": "A limb"}),
        (["--clip", "0,0,0,0,0,1", "--hide", "skin"], {"clip": [(0, 0, 0, 0, 0, 1)], "hide": ["skin"]}),
        (["--field", "intensity", "--iso", "500", "--shadows=0.5"], {"field": "intensity", "iso": [500], "shadows": 0.5}),
        (
            ["--eye", "0.5,0.4,0.3", "--look-at", "0,0,0.1", "--orthographic", "0.4"],
            {"camera": palpate.Camera((0.5, 0.4, 0.3), (0, 0, 0.1), orthographic=0.4)},
        ),
    ],
)
def test_pictures_match_command_line(
    flags: list[str], arguments: dict, limb: palpate.Mesh, limb_file: Path, tmp_path: Path, run
) -> None:
    run("render", limb_file, "--out", tmp_path / "theirs.png", *SIZE, *flags)
    ours = palpate.render(limb, size=(160, 120), **arguments)
    assert ours.shape == (120, 160, 4) and ours.dtype == np.uint8
    theirs = png(tmp_path / "theirs.png")
    assert np.array_equal(ours, theirs)
    assert theirs[..., :3].std() > 1, "the picture is empty"
    assert np.array_equal(palpate.render(limb_file, size=(160, 120), **arguments), theirs)


def test_render_simulates_scene_first(tmp_path: Path, run) -> None:
    scene = tmp_path / "bar.toml"
    scene.write_text(
        '[mesh]\ngenerate = "bar"\ntets = 500\n[material]\nyoung = 3e4\n'
        '[solver]\nname = "implicit"\nengine = "cpu"\nsteps = 20\ndt = 0.01\n'
        '[[pin]]\naxis = "x"\nbelow = 0.02\n[picture]\nfield = "von_mises"\nsize = [160, 120]\n'
    )
    run("render", scene, "--out", tmp_path / "theirs.png")
    shares: list[float] = []
    ours = palpate.render(scene, progress=lambda _, share: shares.append(share))
    assert np.array_equal(ours, png(tmp_path / "theirs.png"))
    assert shares[-1] == 1.0


def test_pyvista_cameras_are_converted(limb: palpate.Mesh) -> None:
    import pyvista

    camera = pyvista.Camera()
    camera.position = (0.6, 0.3, 0.4)
    camera.focal_point = (0.0, 0.0, 0.1)
    camera.up = (0.0, 0.0, 1.0)
    camera.view_angle = 25.0
    own = palpate.Camera((0.6, 0.3, 0.4), (0.0, 0.0, 0.1), (0.0, 0.0, 1.0), fov=25.0)
    small = {"size": (80, 60)}
    assert np.array_equal(
        palpate.render(limb, camera=camera, **small), palpate.render(limb, camera=own, **small)
    )
    camera.parallel_projection = True
    camera.parallel_scale = 0.2
    assert palpate.Camera.from_any(camera).orthographic == 0.4
    position = [(0.6, 0.3, 0.4), (0.0, 0.0, 0.1), (0.0, 0.0, 1.0)]
    assert palpate.Camera.from_any(position) == palpate.Camera((0.6, 0.3, 0.4), (0.0, 0.0, 0.1), (0.0, 0.0, 1.0))
    with pytest.raises(palpate.InputError, match="camera"):
        palpate.render(limb, camera="iso")


def test_matplotlib_colormaps_are_accepted(limb: palpate.Mesh) -> None:
    shown = {"field": "intensity", "size": (80, 60), "light": "none", "background": "black"}
    jet, gray = (palpate.render(limb, cmap=name, **shown) for name in ("jet", "gist_gray"))
    assert not np.array_equal(jet, gray)
    spread = gray[..., :3].max(axis=2).astype(int) - gray[..., :3].min(axis=2)
    assert spread.max() <= 2, "a grey map gives grey pictures"
    with pytest.raises(palpate.InputError, match="or a colour map of matplotlib"):
        palpate.render(limb, cmap="no such map")


def test_renderer_draws_external_positions(limb: palpate.Mesh) -> None:
    renderer = palpate.Renderer(limb, size=(80, 60))
    rest = renderer.render()
    nodes = limb.nodes
    nodes[:, 0] *= 1.3
    renderer.set_positions(nodes)
    assert not np.array_equal(renderer.render(), rest)
    renderer.set_positions(limb.nodes)
    assert np.array_equal(renderer.render(), rest)
    assert renderer.render_float().shape == (60, 80, 4) and renderer.render_float().dtype == np.float32
    seen = renderer.pick(40, 30)
    assert seen is not None and 0 <= seen.tet < len(limb.tets)
    assert renderer.pick(0, 0) is None
    view = renderer.camera
    renderer.camera = palpate.Camera(view.eye, view.look_at, fov=view.fov)
    assert renderer.camera == view
    renderer.size = (40, 30)
    assert renderer.render().shape == (30, 40, 4)


def test_render_rejects_invalid_input(limb: palpate.Mesh) -> None:
    with pytest.raises(palpate.InputError, match="unknown field `feild`"):
        palpate.render(limb, feild="intensity")
    with pytest.raises(palpate.InputError, match="Temp"):
        palpate.render(limb, field="Temp")
    with pytest.raises(palpate.InputError, match="per side"):
        palpate.render(limb, size=(0, 10))
    with pytest.raises(palpate.DeviceError, match="no such card"):
        palpate.render(limb, adapter="no such card")
    with pytest.raises(palpate.InputError, match="ndarray"):
        palpate.render(np.zeros(3))


def test_concurrent_renders_are_identical(limb: palpate.Mesh) -> None:
    wanted = palpate.render(limb, size=(80, 60))
    drawn: list[np.ndarray] = []

    def draw() -> None:
        for _ in range(3):
            drawn.append(palpate.render(limb, size=(80, 60)))

    threads = [threading.Thread(target=draw) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(drawn) == 12 and all(np.array_equal(picture, wanted) for picture in drawn)


def test_render_frees_device_memory() -> None:
    mesh = palpate.Mesh.generate("bar", tets=200)

    def resident() -> float:
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmRSS"):
                return int(line.split()[1]) / 1024
        return 0.0

    def draw(times: int) -> tuple[int, int | None, int | None]:
        for _ in range(times):
            palpate.render(mesh, size=(32, 24))
        return _palpate.device_memory()

    first, before = draw(10), resident()
    one = draw(1)
    last = draw(100)
    print(f"device {first}, {one}, {last}; {before:.0f} MB, then {resident():.0f} MB")
    assert last[0] - one[0] == 100 * (one[0] - first[0]), "each render allocates the same"
    assert last[1:] == first[1:], "live allocations and their bytes"
    # Ten times the observed variation.
    assert resident() - before < 300, f"{before:.0f} MB became {resident():.0f} MB"


def test_pyvista_opacities_are_accepted(limb: palpate.Mesh) -> None:
    from palpate._transfer import with_opacity

    pyvista = pytest.importorskip("pyvista")
    for name in ["linear", "linear_r", "geom", "geom_r", "sigmoid", "sigmoid_5", "foreground"]:
        theirs = np.asarray(pyvista.opacity_transfer_function(name, 64), dtype=float) / 255.0
        extinction = np.array(with_opacity("magma", name).extinction)[:, 1]
        ours = 1.0 - np.exp(-0.1 * extinction)
        # Theirs are whole numbers of 255.
        assert np.abs(ours - theirs).max() < 1.01 / 255.0, name
    looks = {"field": "intensity", "cmap": "magma", "size": (120, 90), "background": "black"}
    faint = palpate.render(limb, opacity=0.05, **looks).astype(int)
    dense = palpate.render(limb, opacity=[0.0, 0.3, 0.95], **looks).astype(int)
    assert faint[..., :3].max() > 10 and dense[..., :3].mean() > 2.0 * faint[..., :3].mean()
    assert np.array_equal(
        palpate.render(limb, opacity=np.array([0, 255], dtype=np.uint8), **looks),
        palpate.render(limb, opacity="linear", **looks),
    )
    for wrong in ["steep", 1.5, [], [[0.1]]]:
        with pytest.raises(palpate.InputError, match="opacity"):
            palpate.render(limb, opacity=wrong, **looks)
    absolute = palpate.TransferFunction([[0, 1, 1, 1]], [[0, 1]])
    with pytest.raises(palpate.InputError, match="range"):
        palpate.render(limb, transfer=absolute, opacity=0.5)
