"""Commands that need ROS 2."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from stab_ros.core.errors import InputError


@contextmanager
def needs_ros(command: str) -> Iterator[None]:
    """Raises InputError where a module of ROS 2 is missing."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise InputError(f"{command} needs ROS 2, but there is no module {error.name}; install ROS 2 Jazzy or "
                         "`pip install ros-jazzy-rclpy[fastrtps] ros-jazzy-common-interfaces`") from error
