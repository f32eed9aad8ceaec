"""A process that subscribes to pictures and to small messages, and prints how late the small ones came, ms, as JSON."""

from __future__ import annotations

import json
import sys
import time

import rclpy
from rclpy.qos import HistoryPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, Image

KEEP_ALL = QoSProfile(history=HistoryPolicy.KEEP_ALL)
PATIENCE_S = 10.0  # without news


def main(count: int) -> None:
    """Until `count` small messages have come, or none for long."""
    rclpy.init()
    node, late_ms = rclpy.create_node("listener"), list[float]()

    def on_small(message: CameraInfo) -> None:
        stamp = message.header.stamp
        late_ms.append(1e3 * (time.time() - stamp.sec) - 1e-6 * stamp.nanosec)

    node.create_subscription(Image, "pictures", lambda _cdr: None, KEEP_ALL, raw=True)
    node.create_subscription(CameraInfo, "small", on_small, KEEP_ALL)
    news_s = time.monotonic()
    while len(late_ms) < count and time.monotonic() - news_s < PATIENCE_S:
        before = len(late_ms)
        rclpy.spin_once(node, timeout_sec=0.1)
        news_s = time.monotonic() if len(late_ms) > before or not late_ms else news_s
    print(json.dumps(late_ms))
    rclpy.shutdown()


if __name__ == "__main__":
    main(int(sys.argv[1]))
