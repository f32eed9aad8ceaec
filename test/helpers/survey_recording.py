"""A synthetic survey as a drone records it: an MCAP of images and sensors, its control points and its truth as CSV.

    write_recording(Path("survey.mcap"), flight, PPK, Origin())
    write_gcps(Path("gcps.csv"), flight, sigma_px=0.3)
    write_truth(Path("truth.csv"), flight)

Frames are rendered while they are written, so that a strip needs no more memory than a frame.
"""

from __future__ import annotations

import csv
import heapq
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from recordings import Entry, camera_info, to_cdr

from stab_ros.core.types import BoolArray
from stab_ros.io.attitude_message import Attitude, imu_cdr, quaternion_cdr
from stab_ros.io.bag import BagWriter, topic_of
from stab_ros.io.cdr import CAMERA_INFO, FLOAT64, IMAGE, IMU, NAV_SAT_FIX, QUATERNION_STAMPED, SECOND_NS, Header
from stab_ros.io.fix_message import Fix, fix_cdr
from stab_ros.io.image_message import image_cdr
from stab_ros.io.metrics_message import float64_cdr
from stab_ros.synthetic.geodetic import Origin
from stab_ros.synthetic.sensors import SensorModel, SensorSamples, measured
from stab_ros.synthetic.survey_flight import SurveyFlight

CAMERA_FRAME, ANTENNA_FRAME, BODY_FRAME = "cam_optical", "antenna", "body"
_TYPES = {"image_raw": IMAGE, "camera_info": CAMERA_INFO, "fix": NAV_SAT_FIX, "imu": IMU, "gimbal": QUATERNION_STAMPED,
          "water_level": FLOAT64}
Stamped = tuple[int, str, bytes]  # stamp, topic, message


def write_recording(path: Path, flight: SurveyFlight, model: SensorModel, origin: Origin, seed: int = 1,
                    attitude: str = "imu", namespace: str = "/cam") -> None:
    """Writes `path` with image_raw, camera_info, fix, water_level (each second) and `attitude`: imu or gimbal."""
    samples = measured(flight.map_pose_at, flight.duration_s, model, seed, flight.start_ns)
    streams = (_images(flight), _fixes(samples, origin), _attitudes(samples, attitude), _levels(flight))
    with BagWriter(path) as bag:
        for name in ("image_raw", "camera_info", "fix", attitude, "water_level"):
            bag.add_topic(topic_of(f"{namespace}/{name}", _TYPES[name]))
        for stamp_ns, name, cdr in heapq.merge(*streams, key=lambda message: message[0]):
            bag.write(f"{namespace}/{name}", stamp_ns, stamp_ns, cdr)


def write_gcps(path: Path, flight: SurveyFlight, index: int = 0, sigma_px: float = 0.0, seed: int = 1) -> None:
    """Writes name, x, y, X, Y, Z of the control points that frame `index` shows, their pixels with noise."""
    _write_points(path, flight, flight.is_control, index, sigma_px, seed)


def write_checkpoints(path: Path, flight: SurveyFlight, index: int = 0) -> None:
    """Writes the same of the checkpoints, without noise."""
    _write_points(path, flight, ~flight.is_control, index, 0.0, 0)


def write_truth(path: Path, flight: SurveyFlight) -> None:
    """Writes each frame's homography of the water plane to frame 0, as `--homographies` does, and its pose."""
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["frame", "stamp_ns", "status", *(f"h{i}{j}" for i in range(3) for j in range(3)),
                        "east_m", "north_m", "up_m", "qx", "qy", "qz", "qw", "wse_m"])
        for index in range(len(flight)):
            pose = flight.view(index).pose
            numbers = [*flight.ref_H_cur(index).ravel(), *pose.position_m, *pose.map_q_optical, flight.wse_m]
            table.writerow([index, flight.stamp_ns(index), "TRACKED", *(repr(float(number)) for number in numbers)])


def _write_points(path: Path, flight: SurveyFlight, wanted: BoolArray, index: int, sigma_px: float, seed: int) -> None:
    px = flight.board_px(index)
    noise = np.random.default_rng([seed, 90]).standard_normal(px.shape) * sigma_px
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["name", "x", "y", "X", "Y", "Z"])
        for k in np.nonzero(wanted & np.isfinite(px).all(axis=1))[0]:
            marked, place = (px[k] + noise[k]).tolist(), flight.board_m[k].tolist()
            table.writerow([flight.board_names[k], *map(repr, marked + place)])


def _images(flight: SurveyFlight) -> Iterator[Stamped]:
    camera, encoding = flight.camera, "bgr8" if flight.color else "mono8"
    for index in range(len(flight)):
        stamp_ns = flight.stamp_ns(index)
        info = camera_info(camera.K, camera.D.tolist(), camera.size, stamp_ns, camera.model)
        yield stamp_ns, "camera_info", to_cdr(Entry("", CAMERA_INFO, stamp_ns, info))
        yield stamp_ns, "image_raw", image_cdr(flight.image(index), encoding, Header(stamp_ns, CAMERA_FRAME))


def _fixes(samples: SensorSamples, origin: Origin) -> Iterator[Stamped]:
    places = samples.geodetic(origin).tolist()
    for stamp_ns, (latitude, longitude, height) in zip(samples.position_stamp_ns.tolist(), places, strict=True):
        fix = Fix(stamp_ns, latitude, longitude, height, samples.position_covariance_m2, frame_id=ANTENNA_FRAME)
        yield stamp_ns, "fix", fix_cdr(fix)


def _attitudes(samples: SensorSamples, name: str) -> Iterator[Stamped]:
    to_bytes = imu_cdr if name == "imu" else quaternion_cdr
    for stamp_ns, q in zip(samples.attitude_stamp_ns.tolist(), samples.map_q_body, strict=True):
        yield stamp_ns, name, to_bytes(Attitude(stamp_ns, q, samples.attitude_covariance_rad2, BODY_FRAME))


def _levels(flight: SurveyFlight) -> Iterator[Stamped]:
    for second in range(int(flight.duration_s) + 1):
        stamp_ns = flight.start_ns + second * SECOND_NS
        yield stamp_ns, "water_level", float64_cdr(flight.wse_m)
