"""Where rcl writes its log files to: without a folder that can be made, it would not even start."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

WITHOUT = ("--ros-args", "--disable-external-lib-logs")  # what is logged goes to the console and to /rosout then


def trouble(environment: Mapping[str, str]) -> str:
    """Why there will be no log file; "" if there will be."""
    folder = _folder(environment)
    if folder is not None and _can_be_made(folder):
        return ""
    where = "there is no HOME" if folder is None else f"{folder} cannot be made"
    return f"no log file: {where}; name a folder in ROS_LOG_DIR"


def _folder(environment: Mapping[str, str]) -> Path | None:
    """As rcl looks for it; empty values count for nothing."""
    if environment.get("ROS_LOG_DIR"):
        return Path(environment["ROS_LOG_DIR"])
    if environment.get("ROS_HOME"):
        return Path(environment["ROS_HOME"], "log")
    return Path(environment["HOME"], ".ros", "log") if environment.get("HOME") else None


def _can_be_made(folder: Path) -> bool:
    try:
        folder.expanduser().mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # which `expanduser` raises where there is no home
        return False
    return os.access(folder.expanduser(), os.W_OK)
