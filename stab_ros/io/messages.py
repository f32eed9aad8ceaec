"""Every ROS message we read or write, as CDR bytes: live (raw topics) and offline (bags) share this one place."""

from __future__ import annotations

import functools
import math
import struct
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.text import number
from stab_ros.core.types import FloatArray, Frame, Homography, Image, Track
from stab_ros.evaluation.findings import Level
from stab_ros.evaluation.frame_metrics import POINT_METRICS, UNITS, FrameMetrics, Outcome
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.window import Window
from stab_ros.io.new_bytes import new_bytes
from stab_ros.io.pixels import decode_compressed, decode_image
from stab_ros.tracking.static_map import StaticMap

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
FLOAT64 = "std_msgs/msg/Float64"

OK, WARN, ERROR = Level
SECOND_NS = 1_000_000_000
# image_proc passes frames through untouched when D is all zero; this is zero to every computation, but not to it
_ALMOST_ZERO = 1e-300
_CDR_HEADER, _STAMP_END = 4, 12  # bytes
_Doubles: TypeAlias = NDArray[np.float64]
_WHOLE = Window()
_NO_PIXELS = np.empty(0, np.uint8)


@functools.cache
def typestore() -> Typestore:
    """The messages of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


@dataclass(frozen=True)
class Header:
    """std_msgs/Header.

    Raises:
        MessageError: the stamp does not fit a ROS time (32-bit seconds).
    """

    stamp_ns: int
    frame_id: str = ""

    def __post_init__(self) -> None:
        if not -(2**31) <= self.stamp_ns // SECOND_NS < 2**31:
            raise MessageError(f"stamp {self.stamp_ns} ns does not fit a ROS time, it must lie within 2^31 seconds")


def header_of(frame: Frame) -> Header:
    """What everything made from a frame is stamped with: the frame's own header."""
    return Header(frame.stamp_ns, frame.frame_id)


def read_image(cdr: bytes | memoryview, msgtype: str) -> Frame:
    """The frame in an Image or CompressedImage; mono8 and the like are a read-only view of `cdr`, not a copy.

    Raises:
        MessageError: the message is not what it claims to be.
    """
    message = _read(cdr, msgtype)
    if isinstance(message, ros.sensor_msgs__msg__Image):
        image, encoding = decode_image(message)
    elif isinstance(message, ros.sensor_msgs__msg__CompressedImage):
        image, encoding = decode_compressed(message.data), "bgr8"
    else:
        raise MessageError(f"{msgtype} is not an image, it must be {IMAGE} or {COMPRESSED_IMAGE}")
    return Frame(image, encoding, _stamp_ns(message.header.stamp), message.header.frame_id)


def read_stamp(cdr: bytes | memoryview) -> int:
    """The header stamp, ns, of any message that begins with a std_msgs/Header, whatever follows.

    Raises:
        MessageError: too short for a header, or not a stamp.
    """
    if len(cdr) < _STAMP_END or cdr[0] != 0 or cdr[1] > 1:
        raise MessageError(f"a message of {len(cdr)} bytes does not begin with a header in CDR")
    sec, nanosec = struct.unpack_from("<iI" if cdr[1] else ">iI", cdr, _CDR_HEADER)
    return _stamp_ns(ros.builtin_interfaces__msg__Time(sec=sec, nanosec=nanosec))


def read_camera(cdr: bytes | memoryview) -> Camera:
    """The camera in a CameraInfo.

    Raises:
        MessageError: damaged, uncalibrated, or of a picture that was binned or cut out.
    """
    message = cast(ros.sensor_msgs__msg__CameraInfo, _read(cdr, CAMERA_INFO))
    roi, size = message.roi, (message.width, message.height)
    cut = (roi.x_offset, roi.y_offset) != (0, 0) or (roi.width, roi.height) not in ((0, 0), size)
    if cut or max(message.binning_x, message.binning_y) > 1:
        raise MessageError("camera_info: binning and roi are not supported, it must describe the picture as published")
    try:
        return Camera(message.k.reshape(3, 3).copy(), message.d.copy(), message.distortion_model, size)
    except InputError as error:
        raise MessageError(str(error)) from error


def homography_cdr(track: Track, header: Header, size: tuple[int, int], camera: Camera | None = None) -> bytes:
    """CameraInfo with H = P[:, :3] R K^-1, reference of `size` (width, height); K, R, P zero while lost."""
    d, model = np.zeros(5), "plumb_bob"
    if camera is not None and len(camera.D):
        d, model = camera.D.astype(np.float64), camera.model  # astype copies
    if not d.any():
        d[0] = _ALMOST_ZERO
    k, r, p = _rectification(track.ref_H_cur, np.eye(3) if camera is None else camera.K)
    message = ros.sensor_msgs__msg__CameraInfo(
        header=_header(header), height=size[1], width=size[0], distortion_model=model, d=d, k=k.ravel(), r=r.ravel(),
        p=p.ravel(), binning_x=0, binning_y=0,
        roi=ros.sensor_msgs__msg__RegionOfInterest(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False))
    return _write(message, CAMERA_INFO)


def _rectification(ref_H_cur: Homography | None, K: FloatArray) -> tuple[_Doubles, _Doubles, _Doubles]:
    """K, R = K^-1 H K and P = [K|0] of a CameraInfo."""
    P = np.zeros((3, 4))
    if ref_H_cur is None:
        return np.zeros((3, 3)), np.zeros((3, 3)), P
    if not np.isfinite(ref_H_cur).all():
        raise ValueError("a homography with NaN or infinity must not leave the engine")
    P[:, :3] = K
    return np.asarray(K, np.float64), np.asarray(np.linalg.solve(K, ref_H_cur @ K), np.float64), P


def read_homography(cdr: bytes | memoryview) -> tuple[int, Homography | None]:
    """Stamp in ns and H, normalised to h22 = 1 (None while lost), of a `homography` message.

    Raises:
        MessageError: damaged, or K, R and P make no homography.
    """
    message = cast(ros.sensor_msgs__msg__CameraInfo, _read(cdr, CAMERA_INFO))
    K, R, P = message.k.reshape(3, 3), message.r.reshape(3, 3), message.p.reshape(3, 4)
    stamp_ns = _stamp_ns(message.header.stamp)
    if not (K.any() or R.any() or P.any()):
        return stamp_ns, None
    finite = np.isfinite([*K.flat, *R.flat, *P.flat]).all()
    with np.errstate(all="ignore"):
        inverse = _inverse(K) if finite else None
        if inverse is None:
            raise MessageError("homography: K, R and P must be finite and K invertible, or all three zero (lost)")
        H = P[:, :3] @ R @ inverse
        H /= H[2, 2]
    if not np.isfinite(H).all():
        raise MessageError("homography: P[:, :3] R K^-1 cannot be normalised to h22 = 1")
    return stamp_ns, H


def _inverse(K: FloatArray) -> FloatArray | None:
    """None where there is none; of full rank a matrix may be and yet too close to zero."""
    try:
        return np.linalg.inv(K) if np.linalg.matrix_rank(K) == 3 else None
    except np.linalg.LinAlgError:
        return None


def read_size(cdr: bytes | memoryview) -> tuple[int, int] | None:
    """Width and height of a CameraInfo; None where it does not say.

    Raises:
        MessageError: damaged.
    """
    message = cast(ros.sensor_msgs__msg__CameraInfo, _read(cdr, CAMERA_INFO))
    return (message.width, message.height) if message.width and message.height else None


def track_cdr(track: Track, header: Header, window: Window = _WHOLE) -> bytes:
    """DiagnosticArray with the one status of this frame; what is unknown while LOST is an empty string.

    window: what `image_stabilized` shows of the reference.
    """
    values = {
        "state": track.state.value,
        "reference_stamp_ns": str(track.reference_stamp_ns),
        "reset_counter": str(track.reset_counter),
        "matches": str(track.matches),
        "inliers": str(track.inliers),
        "rmse_px": number(track.rmse_px),
        "sigma_px": number(track.sigma_px),
        "covariance": "" if track.covariance is None else _upper_triangle(track.covariance),
        "offset": " ".join(f"{place_px:.12g}" for place_px in window.offset),
        "scale": f"{window.scale:.12g}",
        "provisional": str(track.provisional).lower(),
    }
    level = OK if track.tracked else WARN
    return _diagnostics(header, "track", header.frame_id, level, track.state.value, values)


def static_map_cdr(static_map: StaticMap, header: Header) -> bytes:
    """Image of the reference's size, mono8: 255 where static ground is, 0 where it is not."""
    return image_cdr(static_map.picture(), "mono8", header)


def metrics_cdr(metrics: FrameMetrics, point_names: Sequence[str], header: Header) -> bytes:
    """DiagnosticArray with the one status of this frame; what was not measured is an empty string.

    Keys are those of UNITS, and for each verification point those of POINT_METRICS, as `rmsd_reference.V1`.
    """
    values = {"outcome": metrics.outcome.value, "frame": str(metrics.frame)}
    values |= {name: number(metrics[name]) for name in UNITS}
    for name in POINT_METRICS:
        of_points = metrics.points.get(name, np.empty(0)).tolist()
        values |= {f"{name}.{point}": number(value) if np.isfinite(value) else ""
                   for point, value in zip(point_names, of_points, strict=False)}
    level = WARN if metrics.outcome is Outcome.LOST else OK
    return _diagnostics(header, "metrics", header.frame_id, level, metrics.outcome.value, values)


def read_values(cdr: bytes | memoryview) -> dict[str, str]:
    """The keys and values of the first status of a DiagnosticArray; without a status none.

    Raises:
        MessageError: damaged.
    """
    message = cast(ros.diagnostic_msgs__msg__DiagnosticArray, _read(cdr, DIAGNOSTIC_ARRAY))
    return {pair.key: pair.value for status in message.status[:1] for pair in status.values}


def float64_cdr(value: float) -> bytes:
    """std_msgs/Float64."""
    return _write(ros.std_msgs__msg__Float64(data=value), FLOAT64)


def diagnostics_cdr(
    stamp_ns: int, name: str, hardware_id: str, level: int, message: str, values: Mapping[str, str]
) -> bytes:
    """DiagnosticArray with one status."""
    return _diagnostics(Header(stamp_ns), name, hardware_id, level, message, values)


def image_cdr(image: Image, encoding: str, header: Header) -> bytes:
    """Image. The pixels are copied once, which is 20 times faster than the typestore for 4096x2160."""
    data, pixels = blank_image_cdr(image.shape, image.dtype, encoding, header)
    pixels[...] = image
    return data


def blank_image_cdr(shape: tuple[int, ...], dtype: np.dtype[Any], encoding: str, header: Header) -> tuple[bytes, Image]:
    """Image whose pixels are still to be filled, and those: (h, w) or (h, w, channels), perhaps not aligned."""
    (height, width), nbytes = shape[:2], math.prod(shape) * dtype.itemsize
    message = ros.sensor_msgs__msg__Image(
        header=_header(header), height=height, width=width, encoding=encoding,
        is_bigendian=int(sys.byteorder == "big"), step=nbytes // max(height, 1), data=_NO_PIXELS)
    head = typestore().serialize_cdr(message, IMAGE)  # ends with the length of data, 0, in native byte order
    data, octets = new_bytes(len(head) + nbytes)
    octets[: len(head)] = np.frombuffer(bytes(head[:-4]) + struct.pack("=I", nbytes), np.uint8)
    return data, np.ndarray(shape, dtype, octets.data, len(head))


def _upper_triangle(covariance: FloatArray) -> str:
    return " ".join(number(value) for value in covariance[np.triu_indices(len(covariance))])


def _diagnostics(
    header: Header, name: str, hardware_id: str, level: int, message: str, values: Mapping[str, str]
) -> bytes:
    pairs = [ros.diagnostic_msgs__msg__KeyValue(key=key, value=value) for key, value in values.items()]
    status = ros.diagnostic_msgs__msg__DiagnosticStatus(
        level=level, name=name, message=message, hardware_id=hardware_id, values=pairs)
    return _write(ros.diagnostic_msgs__msg__DiagnosticArray(header=_header(header), status=[status]), DIAGNOSTIC_ARRAY)


def _header(header: Header) -> ros.std_msgs__msg__Header:
    sec, nanosec = divmod(header.stamp_ns, SECOND_NS)
    stamp = ros.builtin_interfaces__msg__Time(sec=sec, nanosec=nanosec)
    return ros.std_msgs__msg__Header(stamp=stamp, frame_id=header.frame_id)


def _stamp_ns(stamp: ros.builtin_interfaces__msg__Time) -> int:
    if stamp.nanosec >= SECOND_NS:
        raise MessageError(f"header stamp has {stamp.nanosec} ns, it must have less than a second of them")
    return stamp.sec * SECOND_NS + stamp.nanosec


def _write(message: object, msgtype: str) -> bytes:
    return bytes(typestore().serialize_cdr(message, msgtype))


def _read(cdr: bytes | memoryview, msgtype: str) -> object:
    """The message; its arrays are views of `cdr`, which must therefore be immutable (else it is copied first)."""
    view = memoryview(cdr if isinstance(cdr, bytes) else bytes(cdr))  # a view, as rosbags slices the header off
    try:
        return typestore().deserialize_cdr(view, msgtype)
    except (SerdeError, KeyError) as error:
        raise MessageError(f"not a {msgtype}: {error}") from error
