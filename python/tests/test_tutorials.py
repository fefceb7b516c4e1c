"""The Python of the tutorials runs as it stands."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(page: str, language: str) -> list[str]:
    text = (DOCS / page).read_text(encoding="utf-8")
    return [found[2] for found in BLOCK.finditer(text) if found[1] == language]


def run_blocks(page: str) -> dict[str, Any]:
    names: dict[str, Any] = {}
    for block in blocks(page, "python"):
        exec(compile(block, page, "exec"), names)
    return names


def test_notebook_tutorial_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names = run_blocks("tutorials/notebook.md")
    assert names["picture"].shape == (240, 320, 4)
    assert names["stress"].max() > 0.0
    assert names["press"].force.max() > 0.0


def test_force_in_pandas_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Any) -> None:
    monkeypatch.chdir(tmp_path)
    Path("press.toml").write_text(blocks("how-to/force-in-pandas.md", "toml")[0], encoding="utf-8")
    run("simulate", "press.toml", "--frames", 10, "--no-pictures", "--reactions", "forces.csv", "--out", "run")
    Path("pressed").mkdir()
    header = "time_s,phase,depth_m,force_n,force_error_n\n"
    Path("pressed/press.csv").write_text(header + "1,load,0.001,0.5,\n2,load,0.002,1.0,\n", encoding="utf-8")
    names = run_blocks("how-to/force-in-pandas.md")
    # The body pushes the finger upwards, and more the deeper it is.
    force = names["finger"].fz
    assert force.iloc[-1] > force.iloc[2] >= 0.0
    assert set(names["table"].columns) == {"table", "finger"}
    assert len(names["loading"]) == 2
