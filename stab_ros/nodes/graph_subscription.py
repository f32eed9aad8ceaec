"""A subscription to a topic that may be of several types: the type is that of its publishers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

from rclpy.node import Node

from stab_ros.nodes.qos import AdaptiveSubscription, keep_all_offered, type_name

TypedCallback: TypeAlias = Callable[[bytes, str], None]  # the message and its type


class GraphSubscription:
    """Subscribes to the first of the types at once, and anew where the publishers have another one of them.

    fault: what is wrong with the types of the publishers, "" for nothing.
    """

    def __init__(self, node: Node, topic: str, classes: Sequence[Any], callback: TypedCallback) -> None:
        self._node, self._callback = node, callback
        self.topic = node.resolve_topic_name(topic)
        self._classes = {type_name(one): one for one in classes}
        self.fault = ""
        self._msgtype = self._wanted(self._published(), next(iter(self._classes)))
        self._subscription = self._subscribe()

    @property
    def publishers(self) -> int:
        """How many there are of the type that is taken, at the last `refresh`."""
        return self._subscription.publishers

    def refresh(self) -> None:
        """Follows the publishers; to be called periodically."""
        published = self._published()
        wanted = self._wanted(published, self._msgtype)
        self.fault = self._fault_of(published, wanted)
        if wanted != self._msgtype:
            self._subscription.close()
            self._msgtype = wanted
            self._subscription = self._subscribe()
        elif not self.fault:
            self._subscription.refresh()

    def close(self) -> None:
        """Ends the subscription."""
        self._subscription.close()

    def _published(self) -> list[str]:
        return sorted({info.topic_type for info in self._node.get_publishers_info_by_topic(self.topic)})

    def _wanted(self, published: Sequence[str], now: str) -> str:
        """The type to take: the present one, unless only another one is published."""
        known = [one for one in published if one in self._classes]
        return now if now in known or not known else known[0]

    def _subscribe(self) -> AdaptiveSubscription:
        msgtype = self._msgtype

        def on_message(cdr: bytes, _info: Mapping[str, int]) -> None:
            self._callback(cdr, msgtype)

        return AdaptiveSubscription(self._node, self._classes[msgtype], self.topic, on_message, keep_all_offered,
                                    "let it publish VOLATILE or TRANSIENT_LOCAL, RELIABLE or BEST_EFFORT")

    def _fault_of(self, published: Sequence[str], taken: str) -> str:
        others = [one for one in published if one != taken]
        if not others:
            return ""
        return f"{self.topic} is published as {' and '.join(others)}, nothing is received of it; it must be " + (
            taken if taken in published else " or ".join(self._classes))
