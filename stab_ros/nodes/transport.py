"""The DDS transport of images between processes of one machine: shared memory that is large enough.

Fast DDS gives a process 0.5 MB of it. Beside images, a small reliable message then sometimes finds no room and is
repeated only with the next heartbeat, 3 s later; all later ones of its topic wait for it. The profile gives room for a
colour image in 4K, and a heartbeat every 0.1 s. Measured: docs/performance.md.

Fast DDS 2 (up to Jazzy) and 3 (since Kilted) each refuse the other's profile as a whole, as the heartbeat has another
name, and read it from another variable. Which of them is there is told by the library that this process has loaded:
that holds for apt, wheels and builds from source alike, and with another middleware nothing is chosen.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rclpy.utilities import get_rmw_implementation_identifier


@dataclass(frozen=True)
class FastDds:
    """What one generation of Fast DDS reads. variable: names a profile. in_folder: read there without being named."""

    library: str
    variable: str
    in_folder: Path
    profile: Path


FAST_DDS = (
    FastDds("libfastrtps", "FASTRTPS_DEFAULT_PROFILES_FILE", Path("DEFAULT_FASTRTPS_PROFILES.xml"),
            Path(__file__).with_name("fastdds_2.xml")),
    FastDds("libfastdds", "FASTDDS_DEFAULT_PROFILES_FILE", Path("DEFAULT_FASTDDS_PROFILES.xml"),
            Path(__file__).with_name("fastdds_3.xml")),
)
# rmw_fastrtps of Kilted reads the variable of Fast DDS 2, too
_OF_THE_USER = (*(one.variable for one in FAST_DDS), "FASTDDS_BUILTIN_TRANSPORTS")
_LOADED = Path("/proc/self/maps")
_SHARED_MEMORY, _ENOUGH_BYTES = Path("/dev/shm"), 512 << 20


def use_profile() -> str | None:
    """Before the first DDS participant: selects our profile, unless the user has one; returns a warning, or None.

    With little shared memory, Fast DDS's own small segments are left as they are: ours would not fit.
    """
    if not _has_room():
        return (f"{_SHARED_MEMORY} is smaller than {_ENOUGH_BYTES >> 20} MiB, large images may be lost or late; give "
                f"the container more, as with docker run --shm-size={_ENOUGH_BYTES >> 20}m")
    fast_dds = loaded_fast_dds()
    if fast_dds is not None and not is_chosen_by_user(fast_dds, os.environ):
        os.environ[fast_dds.variable] = str(fast_dds.profile)
    return None


def loaded_fast_dds() -> FastDds | None:
    """The Fast DDS of this process; None with another middleware, and where the system does not tell."""
    get_rmw_implementation_identifier()  # loads the middleware, which apt's rclpy does only when it is needed
    text = _LOADED.read_text(errors="replace") if _LOADED.exists() else ""
    return next((one for one in FAST_DDS if re.search(rf"/{one.library}[-.][^/\n]*$", text, re.MULTILINE)), None)


def is_chosen_by_user(fast_dds: FastDds, environment: Mapping[str, str]) -> bool:
    """Whether the user has chosen a profile for Fast DDS."""
    return any(name in environment for name in _OF_THE_USER) or fast_dds.in_folder.exists()


def _has_room() -> bool:
    return not _SHARED_MEMORY.is_dir() or shutil.disk_usage(_SHARED_MEMORY).total >= _ENOUGH_BYTES
