"""The folder of rcl's log files: rcl does not start if it cannot create it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

NO_LOG_FILE = ("--ros-args", "--disable-external-lib-logs")  # log to the console and to /rosout only


def problem(environment: Mapping[str, str]) -> str:
    """Why there will be no log file; "" if there will be."""
    folder = _folder(environment)
    if folder is not None and _can_be_created(folder):
        return ""
    where = "there is no HOME" if folder is None else f"{folder} cannot be created"
    return f"no log file: {where}; name a folder in ROS_LOG_DIR"


def _folder(environment: Mapping[str, str]) -> Path | None:
    """As rcl determines it; empty values count as unset."""
    if environment.get("ROS_LOG_DIR"):
        return Path(environment["ROS_LOG_DIR"])
    if environment.get("ROS_HOME"):
        return Path(environment["ROS_HOME"], "log")
    return Path(environment["HOME"], ".ros", "log") if environment.get("HOME") else None


def _can_be_created(folder: Path) -> bool:
    try:
        folder.expanduser().mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # which `expanduser` raises where there is no home
        return False
    return os.access(folder.expanduser(), os.W_OK)
