"""Images and homographies of the same frame, paired by stamp: with message_filters where ROS has it, else by itself.

    python pair_by_stamp.py --ros-args -r __ns:=/camera -p start_s:=1.0 -p rate_hz:=30.0

The tracker answers the frames of its start together, `start_s` late. The queue must hold as many images as come in that
time, `start_s * rate_hz`; the usual 10 loses the others. A consumer that wants no late answers starts the tracker with
`answer_start:=at_once` or `drop`, and needs no more than the usual queue. The number of pairs so far is published on
`~/pairs`.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import math
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import UInt64

_SPARE = 10  # images that come while a frame is being answered


class Pairing:
    """What `message_filters.TimeSynchronizer` does for two topics."""

    def __init__(self, queue: int, take: Callable[[Image, CameraInfo], None]) -> None:
        self._queue, self._take = queue, take
        self._kept: tuple[dict[int, Any], dict[int, Any]] = ({}, {})

    def add(self, topic: int, message: Any) -> None:
        """A message of the first (0) or the second (1) topic."""
        stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        kept = self._kept[topic]
        kept[stamp_ns] = message
        if stamp_ns in self._kept[0] and stamp_ns in self._kept[1]:
            self._take(self._kept[0].pop(stamp_ns), self._kept[1].pop(stamp_ns))
        while len(kept) > self._queue:
            kept.pop(next(iter(kept)))  # the oldest


class PairNode(Node):
    """Pairs `image_raw` with `homography`."""

    def __init__(self) -> None:
        super().__init__("pair_node")
        start_s = float(self.declare_parameter("start_s", 1.0).value)
        rate_hz = float(self.declare_parameter("rate_hz", 30.0).value)
        queue = int(self.declare_parameter("queue", math.ceil(start_s * rate_hz) + _SPARE).value)
        self._count = 0
        self._pairs = self.create_publisher(UInt64, "~/pairs", 100)
        if importlib.util.find_spec("message_filters") is None:
            self._pair_alone(queue)
        else:
            self._pair_by_filters(queue)

    def _pair_by_filters(self, queue: int) -> None:
        filters = importlib.import_module("message_filters")
        inputs = [filters.Subscriber(self, Image, "image_raw", qos_profile=queue),
                  filters.Subscriber(self, CameraInfo, "homography", qos_profile=queue)]
        self._synchronizer = filters.TimeSynchronizer(inputs, queue)
        self._synchronizer.registerCallback(self._take)

    def _pair_alone(self, queue: int) -> None:
        pairing = Pairing(queue, self._take)
        self.create_subscription(Image, "image_raw", lambda message: pairing.add(0, message), queue)
        self.create_subscription(CameraInfo, "homography", lambda message: pairing.add(1, message), queue)

    def _take(self, image: Image, answer: CameraInfo) -> None:
        """Here the work would be done; K of a homography is zero while the frame is lost."""
        assert image.header.stamp == answer.header.stamp
        self._count += 1
        self._pairs.publish(UInt64(data=self._count))


def main() -> None:
    """Runs until it is interrupted."""
    rclpy.init()
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(PairNode())


if __name__ == "__main__":
    main()
