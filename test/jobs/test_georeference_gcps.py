"""`stab-ros georeference` with control points whose coordinates are swapped."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from control_scene import SIZE, Scene

from stab_ros.cli import main
from stab_ros.core.types import FloatArray
from stab_ros.io.camera_file import CameraFile, write_camera_file

SCENE = Scene(relief_m=6)
POINTS = SCENE.points(9, 0.2, np.random.default_rng(1))
EAST, NORTH, UP = POINTS.map_m.T
LON, LAT = 7.3 + EAST / 77_170, 46.2 + NORTH / 111_160


@pytest.mark.parametrize("calibrated", [True, False])
@pytest.mark.parametrize(("head", "first", "second", "lift_m"), [
    ("X,Y,Z", NORTH, EAST, 0), ("X,Y,Z", NORTH, EAST, 100), ("lat,lon,height", LON, LAT, 200)])
def test_swapped_coordinates_are_said_whatever_is_known(
        calibrated: bool, head: str, first: FloatArray, second: FloatArray, lift_m: float, tmp_path: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    frames, known = tmp_path / "frames", tmp_path / "camera.yaml"
    frames.mkdir()
    cv2.imwrite(str(frames / "0.png"), np.zeros((SIZE[1], SIZE[0]), np.uint8))
    write_camera_file(known, CameraFile(SCENE.view.camera))
    rows = (",".join(map(repr, row)) for row in np.column_stack([POINTS.image_px, first, second, UP + lift_m]).tolist())
    gcps = tmp_path / "g.csv"
    gcps.write_text("\n".join([f"x,y,{head}", *rows]) + "\n", encoding="utf-8")
    words = ["--gcps", str(gcps), "-p", "orientation:=stationary_gcps", "-p", f"wse_m:={lift_m}"]
    camera = ["--camera", str(known)] if calibrated else []
    assert main(["georeference", str(frames), str(tmp_path / "o.mcap"), *words, *camera]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "east and north (or latitude and longitude) seem to be swapped: read so, the points fit within 0." in line
    assert not (tmp_path / "o.mcap").exists()
