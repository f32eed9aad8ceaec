"""Cameras by name: nominal profiles of common drones, and any camera file; scaled to the picture."""

from __future__ import annotations

import dataclasses
import difflib
import os
import sys
from pathlib import Path

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.imaging.camera import Camera
from stab_ros.io.camera_file import CameraFile, read_camera_file

_FOLDER = Path("config") / "cameras"
_SAME_SHAPE = 0.005  # relative difference of the ratios of width to height


def profiles() -> dict[str, Path]:
    """The profiles that are installed, by name."""
    shares = [Path(prefix) / "share" / "stab_ros" for prefix in
              (*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix) if prefix]
    folders = [Path(__file__).parents[2] / _FOLDER, *(share / _FOLDER for share in shares)]
    found: dict[str, Path] = {}
    for folder in folders:
        for path in sorted(folder.glob("*.yaml")):
            found.setdefault(path.stem, path)
    return found


def camera_for(name: str, size: tuple[int, int]) -> tuple[CameraFile, list[str]]:
    """A camera and what is doubtful of it.

    Args:
        name: path of a camera file, or the name of a profile.
        size: width and height of the picture.

    Raises:
        InputError: there is no such camera, or its pictures have another shape.
    """
    known, path = profiles(), Path(name)
    if name in known and not path.exists():
        path = known[name]
    elif not path.exists() and not path.suffix:
        near = difflib.get_close_matches(name, known, n=1)
        raise InputError(f"{name}: is no camera file and no profile{f', did you mean {near[0]}?' if near else ''}; "
                         f"profiles are {', '.join(known)}")
    file = read_camera_file(path)
    doubts = [f"{file.name}: its focal length is that of a data sheet and may be wrong by {100 * file.nominal:.0f} %, in "
              "cropped video modes by more; fit or calibrate it"] if file.nominal else []
    if file.camera.size == size:
        return file, doubts
    camera, how = _of_size(file, size)
    return dataclasses.replace(file, camera=camera), [*doubts, f"{file.name} is for {_text(file.camera.size)}, {how}"]


def _of_size(file: CameraFile, size: tuple[int, int]) -> tuple[Camera, str]:
    """The camera for pictures of this size, and how it was made."""
    (width, height), (from_width, from_height) = size, file.camera.size
    scale = width / from_width
    if abs(width / height * from_height / from_width - 1) < _SAME_SHAPE:
        return _scaled(file.camera, scale, 0.0, size), f"and is scaled to the picture of {_text(size)}"
    if not file.nominal:
        raise InputError(f"{file.name} is calibrated for {_text(file.camera.size)}, the picture has another shape, "
                         f"{_text(size)}: calibrate the camera in this mode")
    cut = (scale * from_height - height) / 2
    return _scaled(file.camera, scale, cut, size), (
        f"and is taken to show its full width in {_text(size)}, cut at top and bottom")


def _scaled(camera: Camera, scale: float, cut_px: float, size: tuple[int, int]) -> Camera:
    """Scaled about the corner of the image, then cut at the top; pixels count from the centre of the first."""
    shift = np.array([[scale, 0, (scale - 1) / 2], [0, scale, (scale - 1) / 2 - cut_px], [0, 0, 1]])
    return Camera(shift @ camera.K, camera.D, camera.model, size)


def _text(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"
