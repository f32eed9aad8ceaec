"""A process that subscribes to `image_stabilized/compressed`, as a viewer at the far end of a link does.

python bench/one_viewer.py RELIABILITY    reliable or best_effort. Until SIGINT; prints as JSON, of every picture that
came, [stamp, how late, bytes], in ns and ms.
"""

from __future__ import annotations

import json
import sys
import time
from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CompressedImage

from stab_ros.io.cdr import read_stamp


def main(reliability: str) -> None:
    """With the settings of Fast DDS, as a viewer that knows nothing of ours."""
    rclpy.init()
    node = rclpy.create_node("viewer")
    pictures = list[tuple[int, float, int]]()

    def note(cdr: bytes) -> None:
        now_ns, stamp_ns = time.time_ns(), read_stamp(cdr)
        pictures.append((stamp_ns, (now_ns - stamp_ns) / 1e6, len(cdr)))

    qos = QoSProfile(depth=1, reliability=ReliabilityPolicy[reliability.upper()])
    node.create_subscription(CompressedImage, "image_stabilized/compressed", note, qos, raw=True)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)
    print(json.dumps(pictures))
    rclpy.try_shutdown()


if __name__ == "__main__":
    main(sys.argv[1])
