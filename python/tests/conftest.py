"""Shared fixtures: the command line built beside the package, and real data if available."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

import palpate

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def command() -> Path:
    """Returns the command-line program built from the same sources (set PALPATE to override)."""
    path = Path(os.environ.get("PALPATE", ROOT / "target/debug/palpate"))
    assert path.is_file(), f"{path} is not there: cargo build --bin palpate, or name it by PALPATE"
    return path


@pytest.fixture(scope="session")
def run(command: Path):
    """Returns a function that runs the command line and requires success."""

    def call(*arguments: object) -> str:
        done = subprocess.run(
            [command, *map(str, arguments)], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    return call


@pytest.fixture(scope="session")
def data() -> Path:
    """Returns the folder of real meshes and volumes; required if PALPATE_DATA_REQUIRED is set."""
    path = Path(os.environ.get("PALPATE_DATA", ROOT.parent / "shared/data"))
    if not path.is_dir():
        assert "PALPATE_DATA_REQUIRED" not in os.environ, "PALPATE_DATA names no folder"
        pytest.skip("left out: no real data here (PALPATE_DATA)")
    return path


@pytest.fixture(scope="session")
def limb() -> palpate.Mesh:
    return palpate.Mesh.generate("limb", tets=3000)


@pytest.fixture(scope="session")
def limb_file(limb: palpate.Mesh, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("meshes") / "limb.vtu"
    limb.write(path)
    return path


@pytest.fixture
def bar() -> palpate.Body:
    """Returns a soft bar, pinned at its lower end along x."""
    return palpate.Body(
        palpate.Mesh.generate("bar", tets=600),
        material=palpate.Material(young=3e4, density=1000.0),
        pin=[{"axis": "x", "below": 0.02, "name": "wall"}],
        gravity=(0.0, 0.0, -9.81),
    )
