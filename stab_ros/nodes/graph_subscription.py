"""A subscription to a topic that may be of several types: the type is that of its publishers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rclpy.node import Node

from stab_ros.nodes.qos import AdaptiveSubscription, keep_all_offered, type_name

TypedCallback = Callable[[bytes, str, int], None]  # the message, its type, and when it was published, ns


class GraphSubscription:
    """Subscribes once somebody publishes the topic with one of the types, and anew if that changes.

    fault: what is wrong with the publishers of the topic, "" for nothing. publishers: of that type.
    """

    def __init__(self, node: Node, topic: str, classes: Sequence[Any], callback: TypedCallback) -> None:
        self._node, self._callback = node, callback
        self.topic = node.resolve_topic_name(topic)
        self._classes = {type_name(one): one for one in classes}
        self._subscription: AdaptiveSubscription | None = None
        self.msgtype = next(iter(self._classes)) if len(classes) == 1 else ""
        self.fault = ""
        if self.msgtype:
            self._subscribe()

    @property
    def publishers(self) -> int:
        """How many there are, at the last `refresh`."""
        return 0 if self._subscription is None else self._subscription.publishers

    def refresh(self) -> None:
        """Follows the publishers; to be called periodically."""
        types = [info.topic_type for info in self._node.get_publishers_info_by_topic(self.topic)]
        known = [one for one in types if one in self._classes]
        self.fault = self._fault_of(types, known)
        if known and self.msgtype not in known:
            self.msgtype = known[0]
            self._subscribe()
        elif self._subscription is not None:
            self._subscription.refresh()

    def _subscribe(self) -> None:
        if self._subscription is not None:
            self._subscription.close()
        msgtype = self.msgtype

        def on_message(cdr: bytes, info: Mapping[str, int]) -> None:
            self._callback(cdr, msgtype, info["source_timestamp"])

        self._subscription = AdaptiveSubscription(
            self._node, self._classes[msgtype], self.topic, on_message, keep_all_offered,
            "let it publish VOLATILE or TRANSIENT_LOCAL, RELIABLE or BEST_EFFORT")

    def _fault_of(self, types: Sequence[str], known: Sequence[str]) -> str:
        foreign = sorted({one for one in types if one not in self._classes})
        if foreign:
            return f"{self.topic} is published as {', '.join(foreign)}, it must be {' or '.join(self._classes)}"
        if len(set(known)) > 1:
            return f"{self.topic} is published as {' and '.join(sorted(set(known)))}, only {self.msgtype} is taken"
        return ""
