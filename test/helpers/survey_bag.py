"""A rendered flight of a drone in gusts as a recording: pictures, calibration, fixes, attitudes; and control points."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
from ground_pictures import GroundPictures

from stab_ros.core.types import FloatArray, State, Track
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import BODY_R_OPTICAL, Pose, quaternion_of
from stab_ros.imaging.view import View
from stab_ros.io.attitude_message import Attitude, imu_cdr
from stab_ros.io.bag import BagWriter, topic_of
from stab_ros.io.cdr import CAMERA_INFO, IMAGE, IMU, NAV_SAT_FIX, Header
from stab_ros.io.fix_message import Fix, fix_cdr
from stab_ros.io.homography_message import homography_cdr
from stab_ros.io.image_message import image_cdr

SIZE = (960, 540)
CAMERA = Camera(np.array([[750.0, 0, 481.3], [0, 750, 268.2], [0, 0, 1]]), np.array([-0.05, 0.01, 0.0005, 0, 0]),
                "plumb_bob", SIZE)
ORIGIN = LocalFrame(55.2, -1.9, 0.0)
FRAMES, STEP_NS, FIRST_NS = 6, 100_000_000, 5 * 10**9
HEIGHT_M, LEVER_M = 46.0, np.array([-0.1, 0.02, 0.3])
GCPS_M = np.array([[-17.0, -8, 0], [16, -10, 0], [17, 9, 0], [-18, 8, 0], [0, -10, 0], [-8, 5, 0], [9, 2, 0],
                   [2, 10, 0]])


def pose(at_s: float, pitch_deg: float) -> Pose:
    """Of the camera, seconds after the first frame; it looks at the origin of the map."""
    turn, pitch = 2 * math.pi * at_s / 3, math.radians(pitch_deg)
    place = np.array([0.4 * math.sin(turn), -HEIGHT_M / math.tan(pitch) + 0.3 * math.sin(1.3 * turn),
                      HEIGHT_M + 0.2 * math.sin(0.7 * turn)])
    return Pose.of_angles(place, math.pi / 2 + 0.02 * math.sin(turn), pitch + 0.01 * math.sin(1.1 * turn),
                          0.01 * math.sin(0.9 * turn))


def view(frame: int, pitch_deg: float) -> View:
    """Of a frame."""
    return View(CAMERA, pose(frame * STEP_NS / 1e9, pitch_deg))


def write_survey(path: Path, pitch_deg: float, sensor_delay_ns: int = 0, fixes: bool = True) -> None:
    """The recording; sensors at 200 Hz, stamped late by `sensor_delay_ns`."""
    ground, stream = GroundPictures(), []
    for number in range(FRAMES):
        stamp_ns = FIRST_NS + number * STEP_NS
        stream.append((stamp_ns, "/cam/image_raw", image_cdr(ground.seen_by(view(number, pitch_deg)), "mono8",
                                                             Header(stamp_ns, "cam"))))
    stream.append((FIRST_NS, "/cam/camera_info", _camera_info()))
    for at_ns in range(-STEP_NS, (FRAMES + 1) * STEP_NS, 5_000_000) if fixes else ():
        stamp_ns = FIRST_NS + at_ns + sensor_delay_ns
        for topic, cdr in zip(("/cam/fix", "/cam/imu"), _measured(pose(at_ns / 1e9, pitch_deg), stamp_ns), strict=True):
            stream.append((stamp_ns, topic, cdr))
    types = {"/cam/image_raw": IMAGE, "/cam/camera_info": CAMERA_INFO, "/cam/fix": NAV_SAT_FIX, "/cam/imu": IMU}
    with BagWriter(path) as writer:
        for name, msgtype in types.items():
            writer.add_topic(topic_of(name, msgtype))
        for stamp_ns, name, data in sorted(stream, key=lambda one: one[0]):
            writer.write(name, stamp_ns, stamp_ns, data)


def _camera_info() -> bytes:
    """A camera's own, as a driver sends it: R the identity."""
    still = Track(State.TRACKED, 0, FIRST_NS, FIRST_NS, 0, ref_H_cur=np.eye(3))
    return homography_cdr(still, Header(FIRST_NS, "cam"), SIZE, CAMERA)


def _measured(camera: Pose, stamp_ns: int) -> tuple[bytes, bytes]:
    map_R_body = camera.cam_R_map.T @ BODY_R_OPTICAL.T
    latitude, longitude, height = ORIGIN.to_geodetic((camera.position_m + map_R_body @ LEVER_M)[None])[0]
    fix = Fix(stamp_ns, float(latitude), float(longitude), float(height), 4e-4 * np.eye(3))
    return fix_cdr(fix), imu_cdr(Attitude(stamp_ns, quaternion_of(map_R_body), 1e-6 * np.eye(3)))


def write_gcps(path: Path, pitch_deg: float, places: FloatArray = GCPS_M) -> None:
    """The control points as marked in the first frame, in UTM zone 30 north."""
    pixels, there = view(0, pitch_deg).project(GCPS_M), ORIGIN.to_crs("EPSG:32630", places)
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["name", "x", "y", "X", "Y", "Z"])
        for number, (pixel, place) in enumerate(zip(pixels.tolist(), there.tolist(), strict=True)):
            rows.writerow([f"G{number}", *map(repr, pixel), *map(repr, place)])

