"""One small flight, recorded in every format by libraries other than our own writer."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from stab_ros.core.types import FloatArray
from stab_ros.synthetic.flight import Shot

IMAGE_TOPIC = "/cam/image_raw"
OTHER_TOPIC = "/cam/height"
FRAME_ID = "cam_optical"
LOG_DELAY_NS = 3_000_000  # a message is logged a little after its stamp
MCAP_PROFILE = "ros2"
_ENCODINGS = {(1,): "mono8", (2,): "mono16", (3, 1): "bgr8", (4, 1): "bgra8"}  # by channels and bytes of a value

_JAZZY = get_typestore(Stores.ROS2_JAZZY)
_NOETIC = get_typestore(Stores.ROS1_NOETIC)


@dataclass(frozen=True)
class Entry:
    """A message to record; `message` of the typestore's classes, or bytes that are recorded as they are."""

    topic: str
    msgtype: str
    log_time_ns: int
    message: Any


def image(shot: Shot, store: Typestore = _JAZZY) -> Any:
    """sensor_msgs/Image, mono8, mono16, bgr8 or bgra8."""
    height, width, *channels = shot.image.shape
    encoding = _ENCODINGS[(*channels, shot.image.itemsize)]
    data = np.ascontiguousarray(shot.image).reshape(-1).view(np.uint8)
    return store.types["sensor_msgs/msg/Image"](
        header=header(shot.stamp_ns, store), height=height, width=width, encoding=encoding, is_bigendian=0,
        step=len(data) // height, data=data)


def compressed(shot: Shot, suffix: str) -> Any:
    """sensor_msgs/CompressedImage."""
    data = cv2.imencode(f".{suffix}", shot.image)[1].reshape(-1)
    return _JAZZY.types["sensor_msgs/msg/CompressedImage"](header=header(shot.stamp_ns), format=suffix, data=data)


def camera_info(K: FloatArray, D: Sequence[float], size: tuple[int, int], stamp_ns: int,
                model: str = "plumb_bob") -> Any:
    """sensor_msgs/CameraInfo."""
    types = _JAZZY.types
    roi = types["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return types["sensor_msgs/msg/CameraInfo"](
        header=header(stamp_ns), height=size[1], width=size[0], distortion_model=model,
        d=np.array(D, np.float64), k=K.ravel(), r=np.eye(3).ravel(), p=np.hstack([K, np.zeros((3, 1))]).ravel(),
        binning_x=0, binning_y=0, roi=roi)


def header(stamp_ns: int, store: Typestore = _JAZZY) -> Any:
    """std_msgs/Header of either ROS."""
    stamp = store.types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    seq = {"seq": 0} if store is _NOETIC else {}
    return store.types["std_msgs/msg/Header"](**seq, stamp=stamp, frame_id=FRAME_ID)


def entries(shots: Sequence[Shot], store: Typestore = _JAZZY) -> Iterator[Entry]:
    """Every frame, and a message of another topic after it."""
    for number, shot in enumerate(shots):
        log_time_ns = shot.stamp_ns + LOG_DELAY_NS
        yield Entry(IMAGE_TOPIC, "sensor_msgs/msg/Image", log_time_ns, image(shot, store))
        height = store.types["std_msgs/msg/Float64"](data=30.0 + number)
        yield Entry(OTHER_TOPIC, "std_msgs/msg/Float64", log_time_ns + 1, height)


def to_cdr(entry: Entry) -> bytes:
    """The message's bytes in ROS 2."""
    message = entry.message
    return message if isinstance(message, bytes) else bytes(_JAZZY.serialize_cdr(message, entry.msgtype))


def write_mcap(path: Path, messages: Sequence[Entry]) -> Path:
    """With mcap's own writer, as ros2 bag would."""
    with path.open("wb") as file:
        writer = McapWriter(file, compression=CompressionType.ZSTD)
        writer.start(profile=MCAP_PROFILE, library="test")
        channels: dict[str, int] = {}
        for entry in messages:
            if entry.topic not in channels:
                definition = _JAZZY.generate_msgdef(entry.msgtype, ros_version=2)[0].encode()
                schema = writer.register_schema(entry.msgtype, "ros2msg", definition)
                channels[entry.topic] = writer.register_channel(entry.topic, "cdr", schema)
            writer.add_message(channels[entry.topic], entry.log_time_ns, to_cdr(entry), entry.log_time_ns)
        writer.finish()
    return path


def write_rosbag2(path: Path, messages: Sequence[Entry], storage: StoragePlugin) -> Path:
    """A folder with metadata.yaml."""
    with Rosbag2Writer(path, version=9, storage_plugin=storage) as writer:
        connections: dict[str, Any] = {}
        for entry in messages:
            if entry.topic not in connections:
                connections[entry.topic] = writer.add_connection(entry.topic, entry.msgtype, typestore=_JAZZY)
            writer.write(connections[entry.topic], entry.log_time_ns, to_cdr(entry))
    return path


def write_rosbag1(path: Path, shots: Sequence[Shot]) -> Path:
    """A ROS 1 bag of the same flight."""
    with Rosbag1Writer(path) as writer:
        connections: dict[str, Any] = {}
        for entry in entries(shots, _NOETIC):
            if entry.topic not in connections:
                connections[entry.topic] = writer.add_connection(entry.topic, entry.msgtype, typestore=_NOETIC)
            data = bytes(_NOETIC.serialize_ros1(entry.message, entry.msgtype))
            writer.write(connections[entry.topic], entry.log_time_ns, data)
    return path


def write_folder(path: Path, shots: Sequence[Shot]) -> Path:
    """PNG files."""
    path.mkdir()
    for number, shot in enumerate(shots):
        (path / f"frame_{number:04}.png").write_bytes(cv2.imencode(".png", shot.image)[1].tobytes())
    return path


def write_video(path: Path, shots: Sequence[Shot], fps: float = 25.0) -> Path:
    """Lossless."""
    height, width = shots[0].image.shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), fps, (width, height))
    assert writer.isOpened()
    for shot in shots:
        writer.write(shot.image if shot.image.ndim == 3 else cv2.cvtColor(shot.image, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


RECORDERS: dict[str, Callable[[Path, Sequence[Shot]], Path]] = {
    "mcap": lambda folder, shots: write_mcap(folder / "flight.mcap", list(entries(shots))),
    "rosbag2_mcap": lambda folder, shots: write_rosbag2(folder / "bag_m", list(entries(shots)), StoragePlugin.MCAP),
    "rosbag2_sqlite3": lambda folder, shots: write_rosbag2(
        folder / "bag_s", list(entries(shots)), StoragePlugin.SQLITE3),
    "rosbag1": lambda folder, shots: write_rosbag1(folder / "flight.bag", shots),
    "folder": lambda folder, shots: write_folder(folder / "frames", shots),
    "video": lambda folder, shots: write_video(folder / "flight.avi", shots),
}
