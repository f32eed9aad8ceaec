"""The DDS transport of images between processes of one machine: shared memory that is large enough.

Fast DDS gives a process 0.5 MB of it. Beside images, a small reliable message then sometimes finds no room and is
repeated only with the next heartbeat, 3 s later; all later ones of its topic wait for it. The profile gives room for a
colour image in 4K, and a heartbeat every 0.1 s. Measured: docs/performance.md.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path

PROFILE = Path(__file__).with_name("fastdds.xml")
_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
_OF_THE_USER = (_VARIABLE, "FASTDDS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS")
_IN_THE_FOLDER = Path("DEFAULT_FASTRTPS_PROFILES.xml")  # which Fast DDS reads by itself
_SHARED_MEMORY, _ENOUGH_BYTES = Path("/dev/shm"), 512 << 20


def use_profile() -> str | None:
    """Before the first DDS participant: selects our profile, unless the user has one; returns a warning, or None.

    With little shared memory, Fast DDS's own small segments are left as they are: ours would not fit.
    """
    if not _has_room():
        return (f"{_SHARED_MEMORY} is smaller than {_ENOUGH_BYTES >> 20} MiB, large images may be lost or late; give "
                f"the container more, as with docker run --shm-size={_ENOUGH_BYTES >> 20}m")
    if not is_chosen_by_user(os.environ):
        os.environ[_VARIABLE] = str(PROFILE)
    return None


def is_chosen_by_user(environment: Mapping[str, str]) -> bool:
    """Whether the user has chosen a profile for Fast DDS."""
    return any(name in environment for name in _OF_THE_USER) or _IN_THE_FOLDER.exists()


def _has_room() -> bool:
    return not _SHARED_MEMORY.is_dir() or shutil.disk_usage(_SHARED_MEMORY).total >= _ENOUGH_BYTES
