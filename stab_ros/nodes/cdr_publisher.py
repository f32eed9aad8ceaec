"""A publisher of CDR bytes that can wait for slow subscribers instead of losing messages."""

from __future__ import annotations

from functools import partial
from typing import Any

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile

from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.own_participant import OwnParticipant
from stab_ros.nodes.qos import publisher_events
from stab_ros.nodes.qos_overrides import declare_overrides, overridden
from stab_ros.nodes.unlocked_calls import acknowledged_unlocked, publish_unlocked

_STEP = Duration(nanoseconds=100_000_000)
_PATIENCE = 300  # steps without an acknowledgement: DDS itself drops a process that was killed or stopped after 20 s


class CdrPublisher:
    """One topic that a node publishes.

    lossless: before the history of a KEEP_LAST publisher would overwrite a message that a RELIABLE subscriber has not
    acknowledged yet, `send` waits for it.
    participant: to publish in, so that a slow link holds up nothing else; `send` is for a thread of its own then.
    """

    def __init__(self, node: StabNode, msg_class: Any, topic: str, qos: QoSProfile, lossless: bool = False,
                 participant: OwnParticipant | None = None) -> None:
        self._node = node
        full_name = node.resolve_topic_name(topic)
        self._qos, overriding = overridden(node, "publisher", full_name, qos)
        events = publisher_events(node, full_name)
        if participant is None:
            self._publisher = node.create_publisher(msg_class, topic, self._qos, event_callbacks=events,
                                                    qos_overriding_options=overriding)
        else:
            declare_overrides(node, "publisher", full_name, self._qos, overriding.policy_kinds)
            self._publisher = participant.node.create_publisher(msg_class, full_name, self._qos, event_callbacks=events)
        self._publish = self._publisher.publish if participant is None else partial(publish_unlocked, self._publisher)
        self._lossless = lossless
        self._pending = 0  # upper bound of the messages that are not acknowledged
        self._hung_subscribers = 0  # number of subscribers when `flush` gave up on them

    @property
    def topic(self) -> str:
        """The full name."""
        return str(self._publisher.topic_name)

    @property
    def is_latched(self) -> bool:
        """Whether later subscribers get the last messages, too."""
        return bool(self._qos.durability == DurabilityPolicy.TRANSIENT_LOCAL)

    @property
    def depth(self) -> int:
        """How many messages are kept for them."""
        return int(self._qos.depth)

    @property
    def subscribers(self) -> int:
        return int(self._publisher.get_subscription_count())

    def send(self, data: bytes) -> None:
        if self._lossless and self._pending >= self._qos.depth:
            self.flush()
        self._publish(data)
        self._pending += 1

    def wait_until_taken(self, timeout_s: float) -> None:
        """Waits until every RELIABLE subscriber has acknowledged every message, no longer than that.

        For a thread of its own: other threads go on.
        """
        for _ in range(round(timeout_s * 1e9 / _STEP.nanoseconds)):
            if acknowledged_unlocked(self._publisher, _STEP.nanoseconds) or self._node.stop.requested:
                return

    def flush(self) -> None:
        """Waits until every RELIABLE subscriber has acknowledged every message, or hangs."""
        self._pending = 0
        if self.subscribers == self._hung_subscribers != 0:
            return
        self._hung_subscribers = 0
        for _ in range(_PATIENCE):  # counted in waits: if this process is stopped, it is not the subscriber that hangs
            if self._publisher.wait_for_all_acked(_STEP) or self._node.stop.requested:
                return
        self._hung_subscribers = self.subscribers
        self._node.get_logger().warning(f"{self.topic}: a subscriber acknowledges nothing, it will lose messages")
