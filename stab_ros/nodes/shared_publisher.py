"""A topic of images that a node publishes for nodes of its own process, in memory, and for others over DDS."""

from __future__ import annotations

import time
from typing import Any

from rclpy.qos import QoSProfile

from stab_ros.nodes.cdr_publisher import CdrPublisher
from stab_ros.nodes.image_source import ImageSource
from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.qos import type_name

_AHEAD = 10  # images that wait for a node of the process, as in the history of a publisher
_STEP_S = 0.005


class SharedImagePublisher(CdrPublisher):
    """Loses none: it waits for the nodes of the process as for RELIABLE subscribers. subscribers: both kinds."""

    def __init__(self, node: StabNode, msg_class: Any, topic: str, qos: QoSProfile, images: ImageSource) -> None:
        super().__init__(node, msg_class, topic, qos, lossless=True)
        self._supply = images.supply(self.topic, type_name(msg_class))
        node.at_cleanup(self._supply.close)

    @property
    def subscribers(self) -> int:
        return super().subscribers + self._supply.takers

    def send(self, data: bytes) -> None:
        """Over DDS only where somebody else subscribes, now or to what is latched."""
        while self._supply.backlog >= _AHEAD and not self._node.stop.requested:
            time.sleep(_STEP_S)
        self._supply.hand_over(data)
        if super().subscribers or self.is_latched:
            super().send(data)
