"""What kind of input a path is: a bag, a video or a folder of images."""

from __future__ import annotations

from enum import Enum
from pathlib import Path

from stab_ros.core.errors import InputError
from stab_ros.io.bag_metadata import is_rosbag2
from stab_ros.io.image_names import IMAGE_SUFFIXES, image_files, unread_kinds
from stab_ros.io.other_storage import ROS1_SUFFIXES
from stab_ros.io.rosbag2_folder import PART_SUFFIXES
from stab_ros.io.telemetry import KINDS
from stab_ros.io.video import VIDEO_SUFFIXES

_BAG_SUFFIXES = (*PART_SUFFIXES, ".mcap.partial", *ROS1_SUFFIXES)
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
    check_input(path)
    if path.is_dir():
        return _kind_of_folder(path)
    name = path.name.lower()
    if name.endswith(_BAG_SUFFIXES):
        return Kind.BAG
    if name.endswith(VIDEO_SUFFIXES):
        return Kind.VIDEO
    raise InputError(f"{path}: cannot be read, the input must be {_KINDS}{_hint(name)}")


def _hint(name: str) -> str:
    if name.endswith(tuple(KINDS)):
        return "; `stab-ros telemetry` makes a bag of it, should it hold positions"
    return "; for images give their folder" if name.endswith(IMAGE_SUFFIXES) else ""


def check_input(path: Path) -> None:
    """Raises InputError where there is no such file or folder."""
    if not path.exists():
        raise InputError(f"{path}: no such file or folder; the input must be {_KINDS}")


def _kind_of_folder(path: Path) -> Kind:
    """rosbag2's metadata.yaml makes it a bag, whatever else lies there; one of others does not."""
    try:
        if is_rosbag2(path):
            return Kind.BAG
        if image_files(path):
            return Kind.FOLDER
        if any(found.name.lower().endswith(PART_SUFFIXES) for found in path.iterdir()):  # its recorder was killed
            return Kind.BAG
        beside = _beside(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; the input must be {_KINDS}") from error
    raise InputError(f"{path}: holds neither a bag (.mcap, .db3) nor images ({', '.join(IMAGE_SUFFIXES)}){beside}")


def _beside(path: Path) -> str:
    """What in the folder the user may have meant."""
    unread = unread_kinds(path)
    if unread:
        return f", but *{', *'.join(unread)}, to be converted first"
    full = next((one for one in sorted(path.iterdir()) if one.is_dir() and image_files(one)), None)
    return f"; its folder {full.name} holds images" if full else ""
