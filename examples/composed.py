"""A node of one's own and the tracker in one process.

    python composed.py --ros-args -r __ns:=/camera -p image_transport:=compressed

The options after `--ros-args` hold for both nodes. The other node says how far the drone has moved away from the
reference, on `drift_node/drift_px`.
"""

from __future__ import annotations

import contextlib

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Float64

from stab_ros.nodes.tracker_node import TrackerNode
from stab_ros.nodes.transport import use_profile


class DriftNode(Node):
    """Publishes by how many pixels of the reference the centre of each frame is displaced."""

    def __init__(self) -> None:
        super().__init__("drift_node")
        self._drift_px = self.create_publisher(Float64, "~/drift_px", 100)
        self.create_subscription(CameraInfo, "homography", self._on_homography, 100)

    def _on_homography(self, message: CameraInfo) -> None:
        K, R, P = np.reshape(message.k, (3, 3)), np.reshape(message.r, (3, 3)), np.reshape(message.p, (3, 4))
        if not K.any():  # the frame is lost
            return
        centre = np.array([(message.width - 1) / 2, (message.height - 1) / 2, 1.0])
        x, y, w = P[:, :3] @ R @ np.linalg.inv(K) @ centre
        self._drift_px.publish(Float64(data=float(np.hypot(x / w - centre[0], y / w - centre[1]))))


def main() -> None:
    """Runs both nodes until they are interrupted."""
    use_profile()  # room for images in shared memory, as the executables have it
    rclpy.init()
    executor = SingleThreadedExecutor()  # or a MultiThreadedExecutor
    for node in (TrackerNode(), DriftNode()):
        executor.add_node(node)
    # the tracker begins once the executor spins; if kernels must be compiled first, the other node need not wait
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


if __name__ == "__main__":
    main()
