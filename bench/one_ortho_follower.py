"""A process that subscribes to what tracker and georeferencing make, and tells the calibration of the camera.

python bench/one_ortho_follower.py IMAGES LENS    IMAGES: 1, also image_ortho. LENS: the first coefficient of its
distortion. Until SIGINT; prints as JSON, of each topic, [stamp, how late] in ns and ms.
"""

from __future__ import annotations

import json
import sys
from contextlib import suppress

import rclpy
from one_follower import noting
from rclpy.executors import ExternalShutdownException
from rclpy.qos import DurabilityPolicy, QoSProfile
from scenes import HD
from sensor_msgs.msg import CameraInfo, Image

from stab_ros.core.memory import keep_freed_memory
from stab_ros.nodes.transport import use_profile

FOCAL_PX = 1500.0


def main(with_images: bool, k1: float) -> None:
    """Whatever comes, in the order in which it comes."""
    use_profile()
    keep_freed_memory()
    rclpy.init()
    node = rclpy.create_node("follower")
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_publisher(CameraInfo, "camera_info", latched).publish(_camera(k1))
    late: dict[str, list[tuple[int, float]]] = {"homography": [], "ortho_info": [], "image_ortho": []}
    for topic in ("homography", "ortho_info"):
        node.create_subscription(CameraInfo, topic, noting(late[topic]), QoSProfile(depth=100), raw=True)
    if with_images:
        node.create_subscription(Image, "image_ortho", noting(late["image_ortho"]), QoSProfile(depth=1), raw=True)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)
    print(json.dumps(late))
    rclpy.try_shutdown()


def camera_without_lens() -> CameraInfo:
    """As the camera of the bench is calibrated, but for its lens."""
    return _camera(0.0)


def _camera(k1: float) -> CameraInfo:
    width, height = HD
    return CameraInfo(width=width, height=height, distortion_model="plumb_bob", d=[k1, 0.0, 0.0, 0.0, 0.0],
                      k=[FOCAL_PX, 0.0, (width - 1) / 2, 0.0, FOCAL_PX, (height - 1) / 2, 0.0, 0.0, 1.0])


if __name__ == "__main__":
    main(sys.argv[1] == "1", float(sys.argv[2]))
