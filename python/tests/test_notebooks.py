"""The notebooks run from top to bottom, and one is displayed by a real server in a real browser."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "python/notebooks").glob("*.ipynb"))
#: Where screenshots go.
OUT = Path(os.environ.get("PALPATE_SHOTS", ROOT / "target/notebooks"))
SOURCE = (
    "import palpate\n"
    'view = palpate.View(palpate.Mesh.generate("limb", tets=3000), size=(480, 360), field="intensity", cmap="bone")\n'
    "view"
)


def test_six_notebooks_exist() -> None:
    assert len(NOTEBOOKS) == 6


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_notebook_runs(path: Path, tmp_path: Path) -> None:
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "kept without outputs"
    NotebookClient(notebook, timeout=600, kernel_name="python3").execute(cwd=str(tmp_path))
    shown = [out for cell in notebook.cells for out in cell.get("outputs", [])]
    assert any("image/png" in out.get("data", {}) for out in shown)


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api")
    chromium = os.environ.get("PALPATE_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    assert chromium, "Chromium not found; on Debian install it with apt install chromium"
    gpu = ["--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader", "--enable-features=Vulkan",
           "--use-vulkan=swiftshader", "--use-angle=swiftshader", "--ignore-gpu-blocklist"]
    with playwright.sync_playwright() as driver:
        launched = driver.chromium.launch(
            executable_path=chromium, args=["--no-sandbox", "--disable-background-networking", *gpu]
        )
        yield launched
        launched.close()


@pytest.fixture
def server(tmp_path: Path):
    """Starts a Jupyter server in a folder with a notebook."""
    cell = {"cell_type": "code", "id": "one", "metadata": {}, "outputs": [], "execution_count": None, "source": SOURCE}
    kernel = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    (tmp_path / "view.ipynb").write_text(
        json.dumps({"cells": [cell], "metadata": kernel, "nbformat": 4, "nbformat_minor": 5})
    )
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    command = [
        sys.executable, "-m", "jupyterlab", "--no-browser", "--allow-root", f"--port={port}",
        "--IdentityProvider.token=", "--ServerApp.password=", "--LabApp.expose_app_in_browser=True",
        "--LabApp.news_url=", f"--ServerApp.root_dir={tmp_path}",
    ]
    with open(tmp_path / "server.log", "w") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, env={**os.environ, "JUPYTER_CONFIG_DIR": str(tmp_path / "config")})
    address = f"http://localhost:{port}"
    try:
        for _ in range(3000):
            try:
                urllib.request.urlopen(f"{address}/api", timeout=60)
                break
            except OSError:
                assert process.poll() is None, (tmp_path / "server.log").read_text()[-2000:]
                time.sleep(0.2)
        else:
            raise AssertionError((tmp_path / "server.log").read_text()[-2000:])
        yield address
    finally:
        process.terminate()
        try:
            process.wait(60)
        except subprocess.TimeoutExpired:
            process.kill()


def test_view_orbits_and_presses_in_jupyterlab(browser, server: str) -> None:
    OUT.mkdir(parents=True, exist_ok=True)
    page = browser.new_page(viewport={"width": 1100, "height": 900})
    page.goto(f"{server}/lab/tree/view.ipynb?reset")
    page.wait_for_function("window.jupyterapp?.commands.hasCommand('notebook:run-all-cells')", timeout=600_000)
    page.wait_for_selector(".jp-Notebook .jp-CodeCell", timeout=600_000)
    page.wait_for_function(
        "document.querySelector('.jp-Notebook-ExecutionIndicator')?.dataset.status === 'idle'", timeout=600_000
    )
    # A kernel that has only just come may miss the command: again until a cell runs or has run.
    for last in (False, False, False, False, True):
        page.evaluate("void window.jupyterapp.commands.execute('notebook:run-all-cells')")
        try:
            page.wait_for_selector(".jp-InputPrompt:has-text('[*]'), .palpate-view", timeout=30_000)
            break
        except Exception:
            if last:
                raise
    page.wait_for_selector(".palpate-view[data-frame]", timeout=600_000)
    view = page.locator(".palpate-view")

    def dismiss() -> None:
        """Closes the dialogs that JupyterLab opens on a slow machine, which receive the pointer events."""
        for dialog in page.locator(".jp-Dialog").all():
            print(dialog.inner_text())
            page.keyboard.press("Escape")

    def rest(unlike: str = "") -> bytes:
        """Returns the full-resolution picture after all messages, which differs from `unlike`."""
        page.wait_for_function(
            """before => {
                const { frame, width, heard, sent } = document.querySelector(".palpate-view").dataset;
                return frame && frame !== before && width === "480" && heard === sent;
            }""",
            arg=unlike,
            timeout=600_000,
        )
        return page.locator(".palpate-view canvas").screenshot()

    def drag(start: tuple[float, float], end: tuple[float, float]) -> None:
        dismiss()
        box = page.locator(".palpate-view canvas").bounding_box()
        assert box is not None
        (x, y), (to_x, to_y) = ((box["x"] + p[0] * box["width"], box["y"] + p[1] * box["height"]) for p in (start, end))
        page.mouse.move(x, y)
        page.mouse.down()
        for n in range(1, 13):
            page.mouse.move(x + (to_x - x) * n / 12, y + (to_y - y) * n / 12)

    def frame() -> str:
        return view.get_attribute("data-frame") or ""

    first, shown = rest(), frame()
    drag((0.5, 0.5), (0.6, 0.55))
    page.mouse.up()
    turned = rest(unlike=shown)
    assert turned != first
    dismiss()
    page.get_by_role("button", name="Press", exact=True).click()
    drag((0.5, 0.5), (0.6, 0.65))
    page.wait_for_function("/ N at /.test(document.querySelector('.palpate-view').textContent)", timeout=600_000)
    pressed = rest()
    page.screenshot(path=OUT / "pressed.png")
    page.mouse.up()
    assert pressed != turned
    rest()
    shown = frame()
    page.get_by_label("Clip along").select_option("z")
    clipped = rest(unlike=shown)
    assert clipped != pressed
    page.screenshot(path=OUT / "clipped.png")
    page.close()


def test_exported_page_contains_body(browser, tmp_path: Path) -> None:
    import palpate

    web = Path(os.environ.get("PALPATE_WEB", ROOT / "target/web"))
    if not (web / "palpate_view_bg.wasm").is_file():
        pytest.skip("left out: no browser build here (scripts/web)")
    OUT.mkdir(parents=True, exist_ok=True)
    view = palpate.View(palpate.Mesh.generate("limb", tets=3000), field="intensity", cmap="bone")
    view.export_html(tmp_path / "limb.html", page=web)
    view.close()
    page = browser.new_page(viewport={"width": 800, "height": 600})
    said: list[str] = []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda why: said.append(str(why)))
    page.goto((tmp_path / "limb.html").as_uri())
    opened = "document.querySelector('palpate-view')?.state?.().opened > 0"
    try:
        page.wait_for_function(opened, timeout=600_000)
    except Exception:
        raise AssertionError("\n".join(said)) from None
    tets = page.evaluate("document.querySelector('palpate-view').state().tets")
    assert tets == len(palpate.Mesh.generate("limb", tets=3000).tets)
    drawn = "(({ pictures, busy }) => pictures > 0 && !busy)(document.querySelector('palpate-view').state())"
    page.wait_for_function(drawn, timeout=600_000)
    page.screenshot(path=OUT / "exported.png")
    page.close()
