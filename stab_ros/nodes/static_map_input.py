"""The static map that the tracker publishes, once it tells ground from water."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image

from stab_ros.core.errors import MessageError
from stab_ros.io.static_maps import map_of_message
from stab_ros.io.topics import STATIC_MAP_TOPIC
from stab_ros.nodes.qos import latest_latched
from stab_ros.nodes.tracker_subscription import TrackerSubscription
from stab_ros.tracking.static_map import StaticMap

_DEPTH = 10  # of maps that come one after the other: the first that tells ground from water counts


def _several_latched(offers: Sequence[QoSProfile]) -> QoSProfile:
    one = latest_latched(offers)
    return QoSProfile(depth=_DEPTH, reliability=one.reliability, durability=one.durability)


class StaticMapInput:
    """Passes on the first map that tells ground from water; later ones are of no use to what has begun."""

    def __init__(self, node: Node, take: Callable[[StaticMap], None], refused: Callable[[str], None]) -> None:
        self._take, self._refused, self._is_known = take, refused, False
        self._maps = TrackerSubscription(node, Image, STATIC_MAP_TOPIC, self._on_map, _several_latched,
                                         "nobody tells ground from water")

    @property
    def topic(self) -> str:
        """The full name."""
        return self._maps.topic

    @property
    def lack(self) -> str:
        """Why no map that tells ground from water has come, for people."""
        return f"{self.topic} tells no ground from water" if self._maps.publishers else f"nobody publishes {self.topic}"

    def refresh(self) -> None:
        """Follows the publishers; the node itself tells that no map comes."""
        self._maps.refresh()

    def _on_map(self, cdr: bytes, _info: Mapping[str, int]) -> None:
        if self._is_known:
            return
        try:
            found = map_of_message(cdr)
        except MessageError as error:
            self._refused(f"{self.topic}: {error}")
            return
        if found is not None:
            self._is_known = True
            self._take(found)
