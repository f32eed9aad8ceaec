"""The topics of the sensors that the georeference node takes, decoded: position, attitude and water level."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

from geometry_msgs.msg import PointStamped, QuaternionStamped
from rclpy.node import Node
from sensor_msgs.msg import Imu, NavSatFix
from std_msgs.msg import Float64

from stab_ros.core.errors import MessageError
from stab_ros.io.attitude_message import Attitude, read_attitude
from stab_ros.io.fix_message import Fix, read_fix
from stab_ros.io.topics import FIX_TOPIC, GIMBAL_TOPIC, IMU_TOPIC, WATER_LEVEL_TOPIC
from stab_ros.io.water_level_message import NO_STAMP, WaterLevel, read_water_level
from stab_ros.nodes.graph_subscription import GraphSubscription, TypedCallback
from stab_ros.parameters.node_settings import PlacingSettings

LEVEL_CLASSES = {"auto": (PointStamped, Float64), "Float64": (Float64,), "PointStamped": (PointStamped,)}
_ATTITUDES = {GIMBAL_TOPIC: (QuaternionStamped, Imu), IMU_TOPIC: (Imu, QuaternionStamped)}


class SensorCallbacks(Protocol):
    """Who takes the decoded messages."""

    def on_fix(self, fix: Fix) -> None:
        """A position without a fault."""

    def on_attitude(self, attitude: Attitude) -> None:
        """An attitude without a fault."""

    def on_water_level(self, level: WaterLevel) -> None:
        """A water level without a fault; one without a stamp has NO_STAMP."""

    def on_unusable(self, topic: str, text: str) -> None:
        """A message that cannot be used, and why."""

    def on_doubt(self, topic: str, text: str) -> None:
        """What a message that is used does not say."""


class _Sample(Protocol):
    @property
    def fault(self) -> str: ...


_S = TypeVar("_S", bound=_Sample)


class SensorInputs:
    """Subscribes to position and water level, and to the attitude when asked to."""

    def __init__(self, node: Node, settings: PlacingSettings, callbacks: SensorCallbacks) -> None:
        self._node, self._settings, self._callbacks = node, settings, callbacks
        self._fix = GraphSubscription(node, FIX_TOPIC, [NavSatFix], self._on_fix)
        self.level = GraphSubscription(
            node, WATER_LEVEL_TOPIC, LEVEL_CLASSES[settings.water_level_type], self._on_level)
        self._attitudes: dict[str, GraphSubscription] = {}

    def open_attitude(self) -> None:
        """Subscribes to attitudes, once; of two topics, one is taken to the end."""
        wanted = self._settings.attitude
        for topic in (() if self._attitudes else _ATTITUDES if wanted == "auto" else (wanted,)):
            self._attitudes[topic] = GraphSubscription(self._node, topic, _ATTITUDES[topic], self._taking(topic))

    @property
    def faults(self) -> dict[str, str]:
        """What is wrong with the publishers, by topic."""
        return {one.topic: one.fault for one in self._all if one.fault}

    def sources(self, topic: str) -> Sequence[GraphSubscription]:
        """What positions (`fix`) come from, or attitudes."""
        return [self._fix] if topic == FIX_TOPIC else [*self._attitudes.values()]

    def refresh(self) -> None:
        """Follows the publishers."""
        for one in self._all:
            one.refresh()

    @property
    def _all(self) -> list[GraphSubscription]:
        return [self._fix, self.level, *self._attitudes.values()]

    def _on_fix(self, cdr: bytes, _msgtype: str) -> None:
        fix = self._usable(self._fix.topic, lambda: read_fix(cdr))
        if fix is not None:
            self._tell_doubt(self._fix.topic, fix.doubt)
            self._callbacks.on_fix(fix)

    def _on_level(self, cdr: bytes, msgtype: str) -> None:
        level = self._usable(self.level.topic, lambda: read_water_level(cdr, msgtype, NO_STAMP))
        if level is not None:
            self._callbacks.on_water_level(level)

    def _taking(self, topic: str) -> TypedCallback:
        def on_attitude(cdr: bytes, msgtype: str) -> None:
            name = self._attitudes[topic].topic
            attitude = self._usable(name, lambda: read_attitude(cdr, msgtype))
            if attitude is not None and self._is_chosen(topic):
                self._tell_doubt(name, attitude.doubt)
                self._callbacks.on_attitude(attitude)

        return on_attitude

    def _is_chosen(self, topic: str) -> bool:
        """Whether attitudes are taken from this topic; the first sample decides, and an imu gives way to a gimbal."""
        if topic not in self._attitudes:
            return False
        gimbal = self._attitudes.get(GIMBAL_TOPIC)
        if len(self._attitudes) > 1 and topic != GIMBAL_TOPIC and gimbal is not None and self._node.count_publishers(
                gimbal.topic):
            return False
        for other in [one for one in self._attitudes if one != topic]:
            self._attitudes.pop(other).close()
        return True

    def _usable(self, topic: str, read: Callable[[], _S]) -> _S | None:
        try:
            sample = read()
        except MessageError as error:
            self._callbacks.on_unusable(topic, str(error))
            return None
        if sample.fault:
            self._callbacks.on_unusable(topic, sample.fault)
            return None
        return sample

    def _tell_doubt(self, topic: str, doubt: str) -> None:
        if doubt:
            self._callbacks.on_doubt(topic, doubt)
