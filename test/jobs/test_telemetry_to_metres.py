"""From the subtitles of a drone to metres on the water: every convention on the way, against plain trigonometry."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from pyproj import Transformer

from stab_ros.cli import main
from stab_ros.core.geometry import apply, grid
from stab_ros.core.types import FloatArray
from stab_ros.io.homographies import read_homographies

FRAMES, FPS, SIZE, FOCAL_PX = 12, 30000 / 1001, (160, 120), 150.0
ORIGIN, WSE_M = (55.3, -2.05, 150.0), 104.0  # degrees and metres above the ellipsoid
CENTRE_PX = ((SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2)
CAMERA = f"""image_width: {SIZE[0]}
image_height: {SIZE[1]}
camera_name: drone
camera_matrix: {{rows: 3, cols: 3, data: [{FOCAL_PX}, 0, {CENTRE_PX[0]}, 0, {FOCAL_PX}, {CENTRE_PX[1]}, 0, 0, 1]}}
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}}
"""


def pose(frame: int) -> tuple[FloatArray, float, float]:
    """Place, east, north and up of the origin, m, heading and pitch, degrees: it flies on, turns and nods."""
    t = frame / FPS
    return np.array([1.5 * t, 0.7 * t, 0.4 * math.sin(9 * t)]), 40 + 30 * t, -70 + 5 * math.sin(9 * t)


def on_water(frame: int, pixels: FloatArray) -> FloatArray:
    """Where the rays of pixels (n, 2) meet the water, (n, 2), east and north."""
    place, heading, pitch = pose(frame)
    y, p = math.radians(heading), math.radians(pitch)
    ahead = np.array([math.sin(y) * math.cos(p), math.cos(y) * math.cos(p), math.sin(p)])
    right = np.array([math.cos(y), -math.sin(y), 0])
    x, v = ((pixels - CENTRE_PX) / FOCAL_PX).T
    rays = ahead + np.outer(x, right) + np.outer(v, np.cross(ahead, right))
    return np.asarray((place + rays * ((WSE_M - ORIGIN[2] - place[2]) / rays[:, 2])[:, None])[:, :2])


def geodetic(place: FloatArray) -> tuple[float, float, float]:
    """Latitude, longitude and height of a place in the map."""
    latitude, longitude, height_m = ORIGIN
    up = f"+proj=topocentric +ellps=WGS84 +lat_0={latitude} +lon_0={longitude} +h_0={height_m}"
    to_map = Transformer.from_pipeline(f"+proj=pipeline +step +proj=cart +ellps=WGS84 +step {up}")
    east, north, above = place.tolist()
    longitude, latitude, height_m = to_map.transform(east, north, above, direction="INVERSE")
    return latitude, longitude, height_m


def block(frame: int) -> str:
    """Of a drone of 2022, with more digits than it has."""
    place, heading, pitch = pose(frame)
    latitude, longitude, height_m = geodetic(place)
    ms = int(1000 * frame / FPS)
    return (f"{frame + 1}\r\n00:00:00,{ms:03d} --> 00:00:09,000\r\n<font size=\"28\">FrameCnt: {frame + 1}, DiffTime: "
            f"33ms\r\n2022-08-07 12:00:00.{ms:03d}\r\n[iso: 100] [latitude: {latitude:.10f}] [longtitude: "
            f"{longitude:.10f}] [rel_alt: 46.000 abs_alt: {height_m:.5f}] [gb_yaw: {heading:.7f} gb_pitch: {pitch:.7f} "
            "gb_roll: 0.0] </font>\r\n\r\n")


def test_subtitles_of_a_drone_place_every_pixel(tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    for frame in range(FRAMES):
        cv2.imwrite(str(tmp_path / f"frames/{frame:02d}.png"), np.full(SIZE[::-1], 100 + frame, np.uint8))
    (tmp_path / "flight.SRT").write_bytes("".join(map(block, range(FRAMES))).encode("utf-16"))
    (tmp_path / "camera.yaml").write_text(CAMERA, encoding="utf-8")
    assert main(["telemetry", str(tmp_path / "flight.SRT"), str(tmp_path / "sensors.mcap"), "--fps", str(FPS)]) == 0
    assert main(["georeference", str(tmp_path / "frames"), str(tmp_path / "o.mcap"), "--fps", str(FPS), "--no-image",
                 "--telemetry", str(tmp_path / "sensors.mcap"), "--camera", str(tmp_path / "camera.yaml"),
                 "--homographies", str(tmp_path / "H.csv"), "-p", "orientation:=dynamic_gps_imu",
                 "-p", f"wse_m:={WSE_M}"]) == 0
    rows = read_homographies(tmp_path / "H.csv")
    assert len(rows) == FRAMES
    for row in rows:
        assert row.ref_H_cur is not None
        np.testing.assert_allclose(apply(row.ref_H_cur, grid(SIZE)), on_water(row.frame, grid(SIZE)), atol=2e-4)


def test_the_truth_moves_and_begins_at_the_origin() -> None:
    assert np.linalg.norm(on_water(0, grid(SIZE)) - on_water(FRAMES - 1, grid(SIZE)), axis=1).mean() > 4
    assert geodetic(np.zeros(3)) == pytest.approx(ORIGIN, abs=1e-9)
