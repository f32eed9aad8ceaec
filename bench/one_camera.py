"""A process that plays the pictures of a bag over and over at a steady rate, each stamped when it is published.

python bench/one_camera.py BAG RATE_HZ COUNT [LISTENERS]    Once so many listen (1); prints the stamps of what was sent,
ns, as JSON.
"""

from __future__ import annotations

import json
import struct
import sys
import time
from itertools import cycle, islice
from pathlib import Path

import rclpy
from rclpy.duration import Duration
from rclpy.qos import QoSProfile

from stab_ros.core.memory import keep_freed_memory
from stab_ros.io.bag import open_bag
from stab_ros.nodes.runtime import message_class
from stab_ros.nodes.transport import use_profile

_BEFORE, _STAMP_END = 4, 12  # bytes of a serialised message: what comes before its stamp, and with it
_SETTLED_S = 1.0  # after the others have found each other


def main(path: str, rate_hz: float, count: int, listeners: int) -> None:
    """All pictures are read beforehand: a camera does not wait for a disk."""
    use_profile()
    keep_freed_memory()
    with open_bag(Path(path)) as bag:
        (topic,) = bag.topics.values()
        bodies = [(message.data[:_BEFORE], memoryview(message.data)[_STAMP_END:]) for message in bag.messages()]
    rclpy.init()
    node = rclpy.create_node("camera")
    images = node.create_publisher(message_class(topic.msgtype), topic.name, QoSProfile(depth=1))
    while images.get_subscription_count() < listeners:
        time.sleep(0.01)
    time.sleep(_SETTLED_S)
    stamps_ns, start_s = list[int](), time.monotonic()
    for number, (before, rest) in enumerate(islice(cycle(bodies), count)):
        time.sleep(max(0.0, start_s + number / rate_hz - time.monotonic()))
        stamps_ns.append(time.time_ns())
        images.publish(b"".join((before, struct.pack("<iI", *divmod(stamps_ns[-1], 10**9)), rest)))
    images.wait_for_all_acked(Duration(seconds=10))
    print(json.dumps(stamps_ns))
    rclpy.shutdown()


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]) if len(sys.argv) > 4 else 1)
