"""Quality of service that users override by parameters, as `qos_overrides./camera/homography.publisher.depth`.

rclpy's `QoSOverridingOptions` declare the parameters; here is which of them, and what is said of others.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Literal, TypeAlias

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.qos_overriding_options import QoSOverridingOptions

from stab_ros.core.settings import Range, Value, checked, did_you_mean

Entity: TypeAlias = Literal["publisher", "subscription"]

PREFIX = "qos_overrides."
_NAME = re.compile(rf"{re.escape(PREFIX)}(?P<topic>.+)\.(?P<entity>publisher|subscription)\.(?P<policy>\w+)")
_LARGEST = 2**63 - 1
_ENUMS = {QoSPolicyKind.HISTORY: HistoryPolicy, QoSPolicyKind.RELIABILITY: ReliabilityPolicy,
          QoSPolicyKind.DURABILITY: DurabilityPolicy, QoSPolicyKind.LIVELINESS: LivelinessPolicy}
_DURATIONS = (QoSPolicyKind.DEADLINE, QoSPolicyKind.LIFESPAN, QoSPolicyKind.LIVELINESS_LEASE_DURATION)
_POLICIES = {kind.name.lower(): kind for kind in (*_ENUMS, QoSPolicyKind.DEPTH, *_DURATIONS)}
# parameters that every node shows; reliability and durability of a subscription are those of the publishers
_SHOWN: Mapping[Entity, tuple[str, ...]] = {
    "publisher": ("history", "depth", "reliability", "durability"), "subscription": ("history", "depth")}


def check_overrides(node: Node) -> Iterator[str]:
    """Refuses values that are no quality of service; before anything is published.

    Returns:
        A line for each override whose name is none of rclpy's.

    Raises:
        ConfigError: which value, and what it must be.
    """
    for name in _unused(node):
        known = _NAME.fullmatch(name)
        if known is None or known["policy"] not in _allowed(known["entity"]):
            meant = _meant(name)
            must = f"{meant} It must" if meant else "it must"
            yield (f"parameter {name} is unknown and has no effect; {must} be {PREFIX}/TOPIC.publisher.POLICY or "
                   f"{PREFIX}/TOPIC.subscription.POLICY, with one of {', '.join(_POLICIES)}")
        else:
            _judged(name, node.get_parameter(name).value, _POLICIES[known["policy"]])


def unused_overrides(node: Node) -> dict[str, str]:
    """Overrides of publishers and subscriptions that the node does not have so far: a line for each, by name."""
    names = [name for name in node.get_parameters_by_prefix("") if name.startswith(PREFIX)]
    unused = _unused(node)
    used = set(names).difference(unused)
    lines = {}
    for name in unused:
        known = _NAME.fullmatch(name)
        if known is not None and known["policy"] in _allowed(known["entity"]):
            meant = did_you_mean(name, used)
            lines[name] = (f"parameter {name} has had no effect: the node has no {known['entity']} of {known['topic']} "
                           f"so far{meant and f'; {meant}'}")
    return lines


def overridden(node: Node, entity: Entity, topic: str, qos: QoSProfile) -> tuple[QoSProfile, QoSOverridingOptions]:
    """The quality of service that parameters leave of `qos`, and what rclpy is to declare of it.

    Args:
        node: that publishes or subscribes.
        entity: which of both.
        topic: its full name, as parameters name it.
        qos: what the node would choose.
    """
    names = {policy: f"{PREFIX}{topic}.{entity}.{policy}" for policy in _allowed(entity)}
    given = {policy: name for policy, name in names.items() if node.has_parameter(name)}
    chosen = copy.copy(qos)
    for policy, name in given.items():
        _apply(chosen, _POLICIES[policy], _judged(name, node.get_parameter(name).value, _POLICIES[policy]))
        if not is_used(node, name):
            node.undeclare_parameter(name)  # for rclpy to declare it anew, with a description
    return chosen, QoSOverridingOptions([_POLICIES[policy] for policy in dict.fromkeys((*_SHOWN[entity], *given))])


def declare_overrides(node: Node, entity: Entity, topic: str, qos: QoSProfile, kinds: Iterable[QoSPolicyKind]) -> None:
    """Shows the quality of service of what another node publishes or subscribes for this one, as rclpy does."""
    for kind in kinds:
        name = f"{PREFIX}{topic}.{entity}.{kind.name.lower()}"
        if not node.has_parameter(name):
            text = f"{kind.name.lower()} for {entity} `{topic}`"
            node.declare_parameter(name, _value(qos, kind), ParameterDescriptor(description=text, read_only=True))


def _value(qos: QoSProfile, kind: QoSPolicyKind) -> Value:
    """As a parameter tells it."""
    found = getattr(qos, kind.name.lower())
    if kind in _ENUMS:
        return str(found.short_key)
    return int(found.nanoseconds) if kind in _DURATIONS else int(found)


def _meant(name: str) -> str:
    """A question about the part of a name that is none of rclpy's."""
    _, *parts = name.removeprefix(PREFIX).rsplit(".", 2)
    known: tuple[list[str], list[str]] = ([*_SHOWN], [*_POLICIES])
    return next((did_you_mean(part, right) for part, right in zip(parts, known, strict=False) if part not in right), "")


def _allowed(entity: str) -> list[str]:
    return [policy for policy in _POLICIES if policy != "lifespan" or entity == "publisher"]


def _unused(node: Node) -> list[str]:
    """Overrides as they were given at the start."""
    return [name for name in node.get_parameters_by_prefix("") if name.startswith(PREFIX) and not is_used(node, name)]


def is_used(node: Node, name: str) -> bool:
    """Whether rclpy has declared it for a publisher or subscription."""
    return bool(node.describe_parameter(name).read_only)


def _judged(name: str, value: object, kind: QoSPolicyKind) -> Value:
    if kind in _ENUMS:
        choices = tuple(one for one in _ENUMS[kind].short_keys() if one != "unknown")
        return checked(name, value, "", Range("", choices=choices))
    return checked(name, value, 0, Range("", 0, _LARGEST))


def _apply(qos: QoSProfile, kind: QoSPolicyKind, value: Value) -> None:
    if kind in _ENUMS:
        setattr(qos, kind.name.lower(), _ENUMS[kind][str(value).upper()])
    else:
        setattr(qos, kind.name.lower(), Duration(nanoseconds=int(value)) if kind in _DURATIONS else int(value))
