"""A process that subscribes to what velocimetry and discharge make, and tells the calibration of the camera.

python bench/one_velocity_follower.py    Until SIGINT; prints as JSON, of each topic, [stamp, how late] in ns and ms.
"""

from __future__ import annotations

import json
from contextlib import suppress

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from one_follower import noting
from one_ortho_follower import camera_without_lens
from rclpy.executors import ExternalShutdownException
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, PointCloud2

from stab_ros.core.memory import keep_freed_memory
from stab_ros.nodes.transport import use_profile

TOPICS = {"homography": CameraInfo, "velocity": PointCloud2, "velocity_grid": PointCloud2, "discharge": DiagnosticArray}


def main() -> None:
    """Whatever comes, in the order in which it comes."""
    use_profile()
    keep_freed_memory()
    rclpy.init()
    node = rclpy.create_node("follower")
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_publisher(CameraInfo, "camera_info", latched).publish(camera_without_lens())
    late: dict[str, list[tuple[int, float]]] = {topic: [] for topic in TOPICS}
    for topic, kind in TOPICS.items():
        node.create_subscription(kind, topic, noting(late[topic]), QoSProfile(depth=100), raw=True)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)
    print(json.dumps(late))
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
