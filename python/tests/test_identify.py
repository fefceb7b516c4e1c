"""Material parameters from measured presses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import palpate


def block(young: float) -> palpate.Scene:
    material = {"young": young, "poisson": 0.3, "order": 1}
    return palpate.Scene({"mesh": {"generate": "box", "tets": 600}, "material": material})


def test_identify_finds_modulus_of_press_and_arrays() -> None:
    press = palpate.press(block(2e4), radius=0.03, depth=0.008, size=(48, 32), errors=False)
    told: list[str] = []
    found = palpate.identify(
        block(6e3), press, "material.young", noise=0.01, progress=lambda what, _: told.append(what)
    )
    assert found.values["material.young"] == pytest.approx(2e4, rel=0.01)
    low, high = found.intervals["material.young"]
    assert low < 2e4 < high
    assert told and any("material.young" in sentence for sentence in found.sentences)
    assert len(found.residuals) == 8 and not found.report["is_misfit"]
    assert found.scene.entries["material"]["young"] == found.values["material.young"]

    loading = press.loading & (press.depth > 0)
    depth, force = press.depth[loading], press.force[loading]
    direction = press.report["direction"]
    curve = palpate.PressCurve(press.point, direction, 0.03, depth, force)
    again = palpate.identify(block(6e3), [curve], "material.young", noise=0.01, advice=False)
    assert again.values["material.young"] == pytest.approx(found.values["material.young"], rel=1e-6)
    assert again.report["next_press"] is None and again.report["correction"] is None

    # Quadratic tets, which are softer, need a larger modulus for the forces of linear ones.
    corrected = palpate.identify(block(6e3), curve, "material.young", noise=0.01, advice=False, correct=1)
    assert corrected.report["correction"]["times"] == 1
    assert corrected.values["material.young"] > 1.05 * again.values["material.young"]
    assert corrected.scene.entries["material"]["order"] == 2


def test_identify_rejects_unsuited_data() -> None:
    point, down = (0.05, 0.05, 0.1), (0, 0, -1)
    stiffness = palpate.StiffnessMap([point], [np.nan], down, 0.03, 0.008)
    with pytest.raises(palpate.Error, match="no stiffness"):
        palpate.identify(block(6e3), stiffness, "material.young")
    curve = palpate.PressCurve(point, down, 0.03, [0.001, 0.002], [0.1, 0.3])
    with pytest.raises(palpate.InputError, match="expected material.young"):
        palpate.identify(block(6e3), curve, "young")
    with pytest.raises(palpate.InputError, match="is no unknown"):
        palpate.identify(block(6e3), curve, "material.young", bounds={"lump.x": (0, 1)})


def test_recording_of_markers_is_read_and_compared(tmp_path: Path) -> None:
    # A marker on top of a block that stands on the ground and is compressed by its weight.
    rows = [f"{0.1 * k},50,50,{100 if k < 5 else 97}" for k in range(20)]
    (tmp_path / "take.csv").write_text("\n".join(["time_s,top_x_mm,top_y_mm,top_z_mm", *rows, ""]))
    recording = tmp_path / "recording.toml"
    recording.write_text(
        'takes = ["take.csv"]\nstraight = [0, 0.45]\nat_rest = [1, 2]\naxes = ["x", "y", "z"]\n'
        '[[marker]]\nname = "top"\nat = [0.05, 0.05, 0.1]\n'
    )
    material = {"young": 1e4, "poisson": 0.3, "order": 1, "density": 1000}
    solver = {"name": "implicit", "engine": "cpu", "gravity": [0, 0, -9.81]}
    mesh = {"generate": "box", "tets": 600}
    pin = [{"axis": "z", "below": 0.01}]
    scene = palpate.Scene({"mesh": mesh, "material": material, "solver": solver, "pin": pin})
    compared = palpate.identify(scene, recording)
    assert [row["quantity"] for row in compared.residuals] == ["top x (m)", "top y (m)", "top z (m)"]
    assert compared.residuals[2]["measured"] == pytest.approx(-0.003)
    assert compared.values == {}
    found = palpate.identify(scene, recording, "material.young", noise=0.02)
    # Nearly ρ g L² / 2 E, with the sides free and the bottom fixed.
    assert found.values["material.young"] == pytest.approx(1e3 * 9.81 * 0.01 / 2 / 0.003, rel=0.15)
