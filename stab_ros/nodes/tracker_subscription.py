"""A subscription to what the tracker publishes below its own name, whatever that name is."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node

from stab_ros.io.topics import HOMOGRAPHY_TOPIC, TRACKER_NAME, topic_in
from stab_ros.nodes.missing_publisher import MissingPublisher
from stab_ros.nodes.qos import AdaptiveSubscription, Choice, RawCallback

_FIX = "let it offer RELIABLE or BEST_EFFORT, VOLATILE or TRANSIENT_LOCAL"


class TrackerSubscription:
    """Subscribes to `tracker_node/TOPIC`, as remapped; if nobody publishes that, to TOPIC of who sends `homography`.

    consequence: what becomes of the node's work where nobody publishes it, as said once then.
    """

    def __init__(self, node: Node, msg_class: Any, topic: str, callback: RawCallback, choose: Choice,
                 consequence: str) -> None:
        self._node, self._msg_class, self._name = node, msg_class, topic
        self._callback, self._choose, self._consequence = callback, choose, consequence
        self._relative = topic_in(TRACKER_NAME, topic)
        usual = node.resolve_topic_name(self._relative)
        self._is_remapped = usual != node.resolve_topic_name(self._relative, only_expand=True)
        self._missing = MissingPublisher(node.get_logger())
        self._subscription = self._subscribe(self._found(usual))

    @property
    def topic(self) -> str:
        """The full name of the topic that is subscribed to now."""
        return self._subscription.topic

    @property
    def publishers(self) -> int:
        """How many there are, at the last `refresh`."""
        return self._subscription.publishers

    def refresh(self, needed: bool = False) -> None:
        """Follows the publishers; to be called ten times a second. needed: whether a tracker is at work."""
        topic = self._found(self.topic)
        if topic != self.topic:
            self._subscription.close()
            self._subscription = self._subscribe(topic)
        else:
            self._subscription.refresh()
        self._missing.look(needed, self.publishers, f"nobody publishes {self.topic}: {self._consequence}; if the "
                           f"tracker publishes it under another name, remap it, as -r {self._relative}:=NAME")

    def close(self) -> None:
        """Ends the subscription."""
        self._subscription.close()

    def _subscribe(self, topic: str) -> AdaptiveSubscription:
        return AdaptiveSubscription(self._node, self._msg_class, topic, self._callback, self._choose, _FIX)

    def _found(self, now: str) -> str:
        """The topic to take: the present one, unless nobody publishes it and a tracker of another name has its own."""
        if self._is_remapped or self._node.count_publishers(now):
            return now
        homographies = self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(HOMOGRAPHY_TOPIC))
        own = [f"{one.node_namespace.rstrip('/')}/{one.node_name}/{self._name}" for one in homographies]
        return next((topic for topic in own if self._node.count_publishers(topic)), now)
