"""Quality of service: adapted to the offers of the publishers, as rosbag2 does, also of those that join later."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import yaml
from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
    qos_policy_name_from_kind,
)
from rclpy.subscription import Subscription

from stab_ros.nodes.qos_overrides import overridden

RawCallback: TypeAlias = Callable[[bytes, Mapping[str, int]], None]
Choice: TypeAlias = Callable[[Sequence[QoSProfile]], QoSProfile]

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
KEEP_ALL = QoSProfile(history=HistoryPolicy.KEEP_ALL)
_REPLAY_DEPTH = 10  # of a replayed topic, as rosbag2
_COMPATIBLE = {"RELIABILITY": "reliability BEST_EFFORT", "DURABILITY": "durability VOLATILE"}
_INFINITE_NS = 2**63 - 1

# as rosbag2 writes them: names since Iron, numbers before
_RELIABILITY = {"best_effort": ReliabilityPolicy.BEST_EFFORT, "2": ReliabilityPolicy.BEST_EFFORT}
_DURABILITY = {"transient_local": DurabilityPolicy.TRANSIENT_LOCAL, "1": DurabilityPolicy.TRANSIENT_LOCAL}


def reliability_for(offers: Sequence[QoSProfile]) -> ReliabilityPolicy:
    """RELIABLE if every publisher offers it, else BEST_EFFORT, which connects to all of them."""
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    return ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT


def durability_for(offers: Sequence[QoSProfile]) -> DurabilityPolicy:
    """TRANSIENT_LOCAL, to get latched messages, if every publisher offers it."""
    latched = bool(offers) and all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    return DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE


def newest_only(offers: Sequence[QoSProfile]) -> QoSProfile:
    """Keeps the newest message only."""
    return QoSProfile(depth=1, reliability=reliability_for(offers))


def keep_all_reliable(_offers: Sequence[QoSProfile]) -> QoSProfile:
    """Keeps all messages; publishers that do not offer RELIABLE are not connected."""
    return KEEP_ALL


def keep_all_offered(offers: Sequence[QoSProfile]) -> QoSProfile:
    """Keeps all messages, as reliable and durable as all publishers offer."""
    return QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=reliability_for(offers),
                      durability=durability_for(offers))


def latest_latched(offers: Sequence[QoSProfile]) -> QoSProfile:
    """Keeps the newest message; a latched one too, unless a publisher does not offer TRANSIENT_LOCAL."""
    latched = all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    return QoSProfile(depth=1, reliability=reliability_for(offers),
                      durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE)


class AdaptiveSubscription:
    """A raw subscription that is created anew when `choose` gives another QoS for the current publishers.

    fix: advice for the user about a publisher that stays incompatible. group: of its callbacks; None: the node's.
    """

    def __init__(self, node: Node, msg_class: Any, topic: str, callback: RawCallback, choose: Choice, fix: str,
                 group: CallbackGroup | None = None) -> None:
        self._node, self._group = node, group
        self._msg_class = msg_class
        self.topic = node.resolve_topic_name(topic)
        self._callback = callback
        self._choose = choose
        self._fix = fix
        self._incompatible = ""
        self._foreign = ""  # what publishers of another type send
        offers = self._offers()
        self.publishers = len(offers)
        self.qos = self._wanted(offers)
        self._subscription = self._subscribe()

    def refresh(self) -> None:
        """Adapts to the current publishers; to be called periodically."""
        offers = self._offers()
        self.publishers = len(offers)
        wanted = self._wanted(offers)
        if offers and (wanted.reliability, wanted.durability) != (self.qos.reliability, self.qos.durability):
            self.qos = wanted
            self._node.destroy_subscription(self._subscription)
            self._subscription = self._subscribe()
        elif self._incompatible:
            self._node.get_logger().error(f"{self.topic}: a publisher offers an incompatible {self._incompatible}, "
                                          f"nothing is received from it; {self._fix}")
        self._incompatible = ""

    def close(self) -> None:
        """Ends the subscription."""
        self._node.destroy_subscription(self._subscription)

    def _offers(self) -> list[QoSProfile]:
        """The offers of the publishers; those of another type are logged, once, as nothing is received from them."""
        known = type_name(self._msg_class)
        infos = self._node.get_publishers_info_by_topic(self.topic)
        foreign = next((info.topic_type for info in infos if info.topic_type != known), "")
        if foreign and foreign != self._foreign:
            self._node.get_logger().error(f"{self.topic}: a publisher sends {foreign}, nothing is received from it; it "
                                          f"must be {known}")
        self._foreign = foreign
        return [info.qos_profile for info in infos if info.topic_type == known]

    def _wanted(self, offers: Sequence[QoSProfile]) -> QoSProfile:
        """What suits the offers, unless the user overrides it."""
        chosen, self._overriding = overridden(self._node, "subscription", self.topic, self._choose(offers))
        return chosen

    def _subscribe(self) -> Subscription:
        callback: Any = self._callback  # rclpy's type lacks callbacks that take the message info
        events = SubscriptionEventCallbacks(incompatible_qos=self._on_incompatible)
        return self._node.create_subscription(self._msg_class, self.topic, callback, self.qos, raw=True,
                                              callback_group=self._group, event_callbacks=events,
                                              qos_overriding_options=self._overriding)

    def _on_incompatible(self, event: Any) -> None:
        self._incompatible = policy_name(event.last_policy_kind)  # logged by `refresh`, unless it can adapt


def type_name(msg_class: Any) -> str:
    """The name of a message class, as sensor_msgs/msg/Image."""
    package, kind = msg_class.__module__.split(".")[:2]
    return f"{package}/{kind}/{msg_class.__name__}"


def publisher_events(node: Node, topic: str) -> PublisherEventCallbacks:
    """Logs subscribers that request a QoS that is not offered."""

    def on_incompatible(event: Any) -> None:
        policy = policy_name(event.last_policy_kind)
        node.get_logger().error(f"{topic}: a subscriber asks for a {policy} that is not offered and gets nothing; "
                                f"let it subscribe with {_COMPATIBLE.get(policy, 'the default ' + policy)}")

    return PublisherEventCallbacks(incompatible_qos=on_incompatible)


def policy_name(kind: QoSPolicyKind) -> str:
    """RELIABILITY, DURABILITY, ..."""
    return str(qos_policy_name_from_kind(kind)).removesuffix("_QOS_POLICY").removesuffix("_POLICY")


def replay_qos(offered_qos_profiles: str) -> QoSProfile:
    """The QoS that a player offers for a recorded topic, given rosbag2's YAML of the recorded offers.

    RELIABLE and VOLATILE if the recording holds no offers, or different ones.
    """
    kinds = {(str(offer.get("reliability")), str(offer.get("durability")))
             for offer in _recorded_offers(offered_qos_profiles)}
    reliability, durability = kinds.pop() if len(kinds) == 1 else ("", "")
    return QoSProfile(depth=_REPLAY_DEPTH, reliability=_RELIABILITY.get(reliability, ReliabilityPolicy.RELIABLE),
                      durability=_DURABILITY.get(durability, DurabilityPolicy.VOLATILE))


def _recorded_offers(offered_qos_profiles: str) -> list[dict[str, Any]]:
    try:
        offers = yaml.safe_load(offered_qos_profiles)
    except (yaml.YAMLError, ValueError, RecursionError):  # from a file that anybody may have written
        return []
    if not isinstance(offers, list):
        return []
    return [offer for offer in offers if isinstance(offer, dict)]


def offered_yaml(offers: Sequence[QoSProfile]) -> str:
    """The `offered_qos_profiles` that rosbag2 writes for a topic with these publishers."""
    profiles = [
        {
            "history": "keep_last",  # discovery does not transmit the history
            "depth": _REPLAY_DEPTH,
            "reliability": offer.reliability.name.lower(),
            "durability": offer.durability.name.lower(),
            "deadline": _infinite(),
            "lifespan": _infinite(),
            "liveliness": "automatic",
            "liveliness_lease_duration": _infinite(),
            "avoid_ros_namespace_conventions": False,
        }
        for offer in offers
    ]
    return yaml.safe_dump(profiles, sort_keys=False) if profiles else ""


def _infinite() -> dict[str, int]:  # a new one each time: yaml would write a shared one as an alias
    return {"sec": _INFINITE_NS // 1_000_000_000, "nsec": _INFINITE_NS % 1_000_000_000}
