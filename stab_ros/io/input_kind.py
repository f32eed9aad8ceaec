"""What kind of input a path is: a bag, a video or a folder of images."""

from __future__ import annotations

from enum import Enum
from pathlib import Path

from stab_ros.core.errors import InputError
from stab_ros.io.image_folder import IMAGE_SUFFIXES, image_files
from stab_ros.io.rosbag2_folder import PART_SUFFIXES
from stab_ros.io.video import VIDEO_SUFFIXES

_BAG_SUFFIXES = (*PART_SUFFIXES, ".mcap.partial", ".bag")
_KINDS = "an .mcap, a rosbag2 folder, a ROS 1 .bag, a video file or a folder of images"


class Kind(Enum):
    """What an input is."""

    BAG = "bag"
    VIDEO = "video"
    FOLDER = "folder of images"


def kind_of(path: Path) -> Kind:
    """Decided by the name, for a folder by what it holds.

    Raises:
        InputError: no such file, or none of the kinds we read.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file or folder; the input must be {_KINDS}")
    if path.is_dir():
        return _kind_of_folder(path)
    name = path.name.lower()
    if name.endswith(_BAG_SUFFIXES):
        return Kind.BAG
    if name.endswith(VIDEO_SUFFIXES):
        return Kind.VIDEO
    hint = "; for images give their folder" if name.endswith(IMAGE_SUFFIXES) else ""
    raise InputError(f"{path}: cannot be read, the input must be {_KINDS}{hint}")


def _kind_of_folder(path: Path) -> Kind:
    try:
        if (path / "metadata.yaml").exists():
            return Kind.BAG
        if image_files(path):
            return Kind.FOLDER
        if any(found.name.lower().endswith(PART_SUFFIXES) for found in path.iterdir()):  # its recorder was killed
            return Kind.BAG
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; the input must be {_KINDS}") from error
    raise InputError(f"{path}: holds neither a bag (.mcap, .db3) nor images ({', '.join(IMAGE_SUFFIXES)})")
