"""A process that subscribes to what the tracker makes, as a velocimetry node does.

python bench/one_follower.py IMAGES    IMAGES: 1, also image_stabilized. Until SIGINT; prints as JSON, of homographies
and of images, [stamp, how late] in ns and ms.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image

from stab_ros.core.memory import keep_freed_memory
from stab_ros.io.cdr import read_stamp
from stab_ros.nodes.transport import use_profile


def main(with_images: bool) -> None:
    """Whatever comes, in the order in which it comes."""
    use_profile()
    keep_freed_memory()
    rclpy.init()
    node = rclpy.create_node("follower")
    homographies, images = list[tuple[int, float]](), list[tuple[int, float]]()
    node.create_subscription(CameraInfo, "homography", noting(homographies), QoSProfile(depth=100), raw=True)
    if with_images:
        node.create_subscription(Image, "image_stabilized", noting(images), QoSProfile(depth=1), raw=True)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)
    print(json.dumps({"homographies": homographies, "images": images}))
    rclpy.try_shutdown()


def noting(into: list[tuple[int, float]]) -> Callable[[bytes], None]:
    """A callback that notes the stamp of a message, ns, and how late it is, ms."""

    def note(cdr: bytes) -> None:
        now_ns, stamp_ns = time.time_ns(), read_stamp(cdr)
        into.append((stamp_ns, (now_ns - stamp_ns) / 1e6))

    return note


if __name__ == "__main__":
    main(sys.argv[1] == "1")
