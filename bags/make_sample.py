"""Makes the sample flight beside it, bit for bit: sample.mcap and its truth, sample_truth.csv and sample_water.csv.

    .venv/bin/python bags/make_sample.py [FOLDER]

A drone hovers in the wind over a river with an island: 72 frames of 960x540 at 24 fps, as JPEG the way cameras on small
drones record, with the camera's calibration and the drone's GPS. The truth is the renderer's own homography, and the
velocity with which it moves the ripples of the water.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.core.geometry import apply
from stab_ros.io.bag import BagWriter, Message, topic_of
from stab_ros.io.cdr import CAMERA_INFO, COMPRESSED_IMAGE, typestore
from stab_ros.io.homographies import COLUMNS
from stab_ros.synthetic.camera_path import Motion, Pose, inverse
from stab_ros.synthetic.flight import Flight, Shot
from stab_ros.synthetic.river import ControlPoint, Island, SceneSettings, Stream
from stab_ros.synthetic.terrain import COARSE

if TYPE_CHECKING:
    from stab_ros.core.types import FloatArray, Image

FRAMES = 72
SEED = 7
START_NS = 1_750_000_000_000_000_000  # 15 June 2025, 15:06:40 UTC
JPEG_QUALITY = 80
IMAGE_TOPIC, CAMERA_TOPIC, GPS_TOPIC = "/camera/image_raw/compressed", "/camera/camera_info", "/gps/fix"
NAV_SAT_FIX, NAV_SAT_STATUS = "sensor_msgs/msg/NavSatFix", "sensor_msgs/msg/NavSatStatus"
GPS_EVERY = 5  # frames
HOME_DEG, HOME_ALTITUDE_M = (46.2270, 7.6080), 540.0
WATER_STEP_PX = 12  # between the places of sample_water.csv
METRES_PER_DEGREE = 111_320.0  # of latitude

RIVER = SceneSettings(
    name="sample", size=(960, 540), gsd_m=0.06, fps=24.0, duration_s=3.0,
    stream=Stream(centre=0.50, width=0.60, bend=0.10, speed_m_s=1.5),
    motion=Motion(
        sway=Pose(x_m=0.45, y_m=0.45, height_m=0.35, yaw_deg=0.6, pitch_deg=0.45, roll_deg=0.45), sway_hz=0.55
    ),
    islands=(Island((0.58, 0.50), (0.12, 0.10)),),
    control_points=tuple(ControlPoint(place, 0.8) for place in ((0.10, 0.10), (0.88, 0.09), (0.12, 0.92), (0.9, 0.90))),
    noise_levels=1.5,
)


def main() -> None:
    """Makes the files in the folder that the command line names."""
    parser = argparse.ArgumentParser(description="Makes sample.mcap, sample_truth.csv and sample_water.csv.")
    parser.add_argument("folder", nargs="?", type=Path, default=Path(__file__).parent)
    folder = parser.parse_args().folder
    flight = Flight(RIVER, frames=FRAMES, seed=SEED, color=True, start_ns=START_NS)
    write_bag(folder / "sample.mcap", flight)
    write_truth(folder / "sample_truth.csv", flight)
    write_water(folder / "sample_water.csv", flight)


def write_bag(path: Path, flight: Flight) -> None:
    """Closes a chunk after every message: left to itself the writer would do so by the clock."""
    with BagWriter(path, overwrite=True) as bag:
        for name, msgtype in ((IMAGE_TOPIC, COMPRESSED_IMAGE), (CAMERA_TOPIC, CAMERA_INFO), (GPS_TOPIC, NAV_SAT_FIX)):
            bag.add_topic(topic_of(name, msgtype))
        for shot in flight:
            for message in messages_of(flight, shot):
                bag.write(*message)
                bag.flush_chunk()


def messages_of(flight: Flight, shot: Shot) -> Iterator[Message]:
    """Everything the drone records with one frame."""
    stamp_ns = shot.stamp_ns
    yield Message(CAMERA_TOPIC, stamp_ns, stamp_ns, camera_info(flight, stamp_ns))
    yield Message(IMAGE_TOPIC, stamp_ns, stamp_ns, compressed(shot.image, stamp_ns))
    if shot.index % GPS_EVERY == 0:
        yield Message(GPS_TOPIC, stamp_ns, stamp_ns, fix(shot.pose, stamp_ns))


def write_truth(path: Path, flight: Flight) -> None:
    """The columns of H.csv that truth has."""
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(COLUMNS) + "\n")
        for index in range(len(flight)):
            elements = (repr(float(h)) for h in flight.ref_H_cur(index).ravel())
            file.write(",".join((str(index), str(flight.stamp_ns(index)), "TRACKED", *elements)) + "\n")


def write_water(path: Path, flight: Flight) -> None:
    """Velocities of the water, m/s, along x (right) and y (down) of the first frame; row by row, 0 on land."""
    columns, rows = (np.arange(0, side + 1, WATER_STEP_PX) for side in flight.size)
    places_px = np.array([(x, y) for y in rows for x in columns], np.float64)
    places_m = apply(inverse(flight.image_H_plane(0)), places_px)
    flow = flow_at(flight, places_m)
    ahead_px = apply(flight.image_H_plane(0), places_m + 1e-3 * flow) - places_px
    towards = ahead_px / np.maximum(np.linalg.norm(ahead_px, axis=1, keepdims=True), 1e-12)
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write("x_px,y_px,vx_m_s,vy_m_s\n")
        velocities = np.round(np.linalg.norm(flow, axis=1, keepdims=True) * towards, 3) + 0.0
        for (x, y), (vx, vy) in zip(places_px, velocities, strict=True):
            file.write(f"{x:.0f},{y:.0f},{vx:.3f},{vy:.3f}\n")


def flow_at(flight: Flight, places_m: FloatArray) -> FloatArray:
    """Velocity (n, 2) of the ripples at places (n, 2) on the ground, as the renderer has it; 0 outside."""
    flow, extent = flight.ground.flow, flight.ground.extent
    at = (places_m - (extent.x_m, extent.y_m)) / (COARSE * extent.texel_m)
    column, row = np.clip(np.floor(at).astype(int), 0, np.array(flow.shape[1::-1]) - 2).T
    right, down = np.clip(at - np.stack([column, row], axis=1), 0, 1).T[..., None]
    upper = (1 - right) * flow[row, column] + right * flow[row, column + 1]
    lower = (1 - right) * flow[row + 1, column] + right * flow[row + 1, column + 1]
    return np.asarray((1 - down) * upper + down * lower)


def header(stamp_ns: int, frame_id: str) -> ros.std_msgs__msg__Header:
    """std_msgs/Header."""
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    return ros.std_msgs__msg__Header(ros.builtin_interfaces__msg__Time(sec, nanosec), frame_id)


def compressed(image: Image, stamp_ns: int) -> bytes:
    """The image as JPEG."""
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    message = ros.sensor_msgs__msg__CompressedImage(header(stamp_ns, "camera"), "jpeg", data.ravel())
    return bytes(typestore().serialize_cdr(message, COMPRESSED_IMAGE))


def camera_info(flight: Flight, stamp_ns: int) -> bytes:
    """A pinhole camera without distortion."""
    K, (width, height) = np.asarray(flight.camera.K, np.float64), flight.size
    message = ros.sensor_msgs__msg__CameraInfo(
        header=header(stamp_ns, "camera"), height=height, width=width, distortion_model="plumb_bob", d=np.zeros(5),
        k=K.ravel(), r=np.eye(3).ravel(), p=np.column_stack([K, np.zeros(3)]).ravel(), binning_x=0, binning_y=0,
        roi=ros.sensor_msgs__msg__RegionOfInterest(0, 0, 0, 0, do_rectify=False))
    return bytes(typestore().serialize_cdr(message, CAMERA_INFO))


def fix(pose: Pose, stamp_ns: int) -> bytes:
    """The drone's position; the lower edge of the nominal image faces south."""
    latitude, longitude = HOME_DEG
    types = typestore().types
    message = types[NAV_SAT_FIX](
        header=header(stamp_ns, "gps"), status=types[NAV_SAT_STATUS](status=0, service=1),
        latitude=latitude - pose.y_m / METRES_PER_DEGREE,
        longitude=longitude + pose.x_m / (METRES_PER_DEGREE * math.cos(math.radians(latitude))),
        altitude=HOME_ALTITUDE_M + pose.height_m, position_covariance=np.diag([0.04, 0.04, 0.09]).ravel(),
        position_covariance_type=2)
    return bytes(typestore().serialize_cdr(message, NAV_SAT_FIX))


if __name__ == "__main__":
    main()
