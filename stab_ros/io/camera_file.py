"""Files of cameras: camera_info YAML as `camera_calibration` writes it, with pose and reference system where known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from stab_ros.core.errors import InputError
from stab_ros.core.text import one_line
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.local_frame import LOCAL, LocalFrame
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.io.outputs import completed
from stab_ros.io.yaml_file import read_yaml

_LARGEST_PX = 2**16
_FORM = "a camera_info YAML as camera_calibration or stab-ros camera writes it"


@dataclass(frozen=True, eq=False)
class CameraFile:
    """What a file says of a camera.

    Attributes:
        camera: intrinsics and lens.
        name: of the camera.
        nominal: how much the focal length may be wrong, as a share, where it is that of a data sheet; 0: calibrated.
        pose: in the map; None: not known.
        pose_covariance: (6, 6), east, north, up and rotations about the axes of the map; None: not known.
        parameters: names of what was fitted, as `Unknowns.names`.
        covariance: (n, n) of `parameters`; None: not known.
        crs: reference system of the survey, "EPSG:nnnn" or "local".
        frame: the place of the map on the earth; None for "local".
        wse_m: water surface elevation in the map; None: not known.
        about: what else is written, for people.
    """

    camera: Camera
    name: str = "camera"
    nominal: float = 0.0
    pose: Pose | None = None
    pose_covariance: FloatArray | None = None
    parameters: tuple[str, ...] = ()
    covariance: FloatArray | None = None
    crs: str = LOCAL
    frame: LocalFrame | None = None
    wse_m: float | None = None
    about: Mapping[str, object] = field(default_factory=dict)


def write_camera_file(path: Path, file: CameraFile) -> None:
    """Writes a camera.

    Raises:
        InputError: nothing can be written there. WorkError: the disk is full.
    """
    with completed(path) as partial:
        partial.write_text(_text(file), encoding="utf-8")


def read_camera_file(path: Path) -> CameraFile:
    """Reads a camera.

    Args:
        path: of `write_camera_file`, or any camera_info YAML, which has no pose.

    Raises:
        InputError: it is missing, no such file, or contradicts itself.
    """
    tree = read_yaml(path)
    if not isinstance(tree, dict) or "camera_matrix" not in tree:
        raise InputError(f"{path}: holds no camera_matrix, it must be {_FORM}")
    try:
        return _file(tree)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def moved_to(frame: LocalFrame | None, file: CameraFile) -> CameraFile:
    """A camera in another map: its pose, the covariance of that, and the water level at the camera.

    Args:
        frame: the map; None: that of the file.
        file: with a place on the earth; without one, its coordinates are taken for those of `frame`.

    Raises:
        InputError: the maps lie too far apart.
    """
    if frame is None or file.frame is None or file.frame == frame:
        return file
    try:
        R, t = frame.from_map(file.frame)
    except InputError as error:
        raise InputError(f"origin and camera file contradict each other, {error}") from error
    pose, around = file.pose, file.pose_covariance
    below_m = np.zeros(2) if pose is None else pose.position_m[:2]
    both = np.kron(np.eye(2), R)  # of the position, and of the rotation
    return replace(
        file, frame=frame, parameters=(), covariance=None,
        pose=None if pose is None else Pose(R @ pose.position_m + t, pose.cam_R_map @ R.T),
        pose_covariance=None if around is None else both @ around @ both.T,
        wse_m=None if file.wse_m is None else float((R @ np.append(below_m, file.wse_m) + t)[2]))


def _text(file: CameraFile) -> str:
    camera, K = file.camera, file.camera.K
    projection = np.column_stack([K, np.zeros(3)])
    tree: dict[str, object] = {
        "image_width": camera.size[0], "image_height": camera.size[1], "camera_name": file.name,
        "camera_matrix": _matrix(K), "distortion_model": camera.model,
        "distortion_coefficients": _matrix(camera.D[None]), "rectification_matrix": _matrix(np.eye(3)),
        "projection_matrix": _matrix(projection)}
    if file.pose is not None:
        yaw, pitch, roll = file.pose.angles_rad
        tree["pose"] = {
            "position_m": file.pose.position_m.tolist(), "map_q_optical_xyzw": file.pose.map_q_optical.tolist(),
            "yaw_pitch_roll_rad": [yaw, pitch, roll]}
    if file.pose is not None and file.pose_covariance is not None:
        tree["pose_covariance"] = _matrix(file.pose_covariance)
    if file.covariance is not None:
        tree["fitted"] = {"parameters": list(file.parameters), "covariance": _matrix(file.covariance)}
    tree["crs"] = file.crs
    if file.frame is not None:
        tree["origin"] = {"latitude_deg": file.frame.latitude_deg, "longitude_deg": file.frame.longitude_deg,
                          "height_m": file.frame.height_m}
    if file.wse_m is not None:
        tree["wse_m"] = file.wse_m
    if file.nominal:
        tree["nominal"] = file.nominal
    return yaml.safe_dump({**tree, **file.about}, sort_keys=False, default_flow_style=None, width=100)


def _matrix(values: FloatArray) -> dict[str, object]:
    return {"rows": values.shape[0], "cols": values.shape[1], "data": [float(value) for value in values.ravel()]}


def _file(tree: dict[Any, Any]) -> CameraFile:
    camera = Camera(_numbers(tree, "camera_matrix", (3, 3)), _numbers(tree, "distortion_coefficients", None).ravel(),
                    _model(tree), (_size(tree, "image_width"), _size(tree, "image_height")))
    fitted = tree.get("fitted")
    names = tuple(str(name) for name in fitted.get("parameters", ())) if isinstance(fitted, dict) else ()
    covariance = _numbers(fitted, "covariance", (len(names),) * 2) if isinstance(fitted, dict) and names else None
    around = _numbers(tree, "pose_covariance", (6, 6)) if "pose_covariance" in tree else None
    wse_m = _number(tree, "wse_m") if tree.get("wse_m") is not None else None
    nominal = _number(tree, "nominal") if tree.get("nominal") is not None else 0.0
    return CameraFile(camera, one_line(tree.get("camera_name", "camera"))[:80], nominal, _pose(tree), around, names,
                      covariance, str(tree.get("crs", LOCAL)), _frame(tree), wse_m)


def _model(tree: dict[Any, Any]) -> str:
    """Equidistant is called fisheye by some writers."""
    model = str(tree.get("distortion_model", "plumb_bob"))
    return "equidistant" if model == "fisheye" else model


def _size(tree: dict[Any, Any], key: str) -> int:
    value = tree.get(key)
    if type(value) is not int or not 0 < value <= _LARGEST_PX:
        raise InputError(f"{key} is {one_line(value)[:40]}, it must be a number of pixels from 1 to {_LARGEST_PX}")
    return value


def _number(tree: dict[Any, Any], key: str) -> float:
    value = tree.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise InputError(f"{key} is {one_line(value)[:40]}, it must be a number")
    return float(value)


def _numbers(tree: dict[Any, Any], key: str, shape: tuple[int, ...] | None) -> FloatArray:
    """The numbers of a list, or of a matrix with rows, cols and data; `shape` None: any number of them."""
    value = tree.get(key)
    data = value.get("data") if isinstance(value, dict) else value
    flat = data if isinstance(data, list) else []
    if not all(isinstance(one, (int, float)) and not isinstance(one, bool) and math.isfinite(one) for one in flat):
        raise InputError(f"{key} must hold finite numbers")
    if (shape is None and not isinstance(data, list)) or (shape is not None and len(flat) != math.prod(shape)):
        wanted = "x".join(map(str, shape)) if shape else "a list of"
        raise InputError(f"{key} must hold {wanted} numbers, in data: [...]")
    found = np.array(flat, dtype=np.float64)
    return found if shape is None else found.reshape(shape)


def _pose(tree: dict[Any, Any]) -> Pose | None:
    pose = tree.get("pose")
    if pose is None:
        return None
    if not isinstance(pose, dict):
        raise InputError("pose must hold position_m and map_q_optical_xyzw")
    return Pose.of_quaternion(_numbers(pose, "position_m", (3,)), _numbers(pose, "map_q_optical_xyzw", (4,)))


def _frame(tree: dict[Any, Any]) -> LocalFrame | None:
    origin = tree.get("origin")
    if origin is None:
        return None
    if not isinstance(origin, dict):
        raise InputError("origin must hold latitude_deg, longitude_deg and height_m")
    return LocalFrame(*(_number(origin, key) for key in ("latitude_deg", "longitude_deg", "height_m")))
