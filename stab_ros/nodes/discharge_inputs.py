"""The topics that the discharge node takes, decoded: velocities and water level."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from stab_ros.core.errors import MessageError
from stab_ros.io.cdr import Header
from stab_ros.io.georeference_messages import MAP_FRAME
from stab_ros.io.topics import VELOCITY_TOPIC, WATER_LEVEL_TOPIC
from stab_ros.io.velocity_message import read_surface, read_velocity
from stab_ros.io.water_level_message import NO_STAMP, WaterLevel, read_water_level
from stab_ros.nodes.graph_subscription import GraphSubscription
from stab_ros.nodes.sensor_inputs import LEVEL_CLASSES
from stab_ros.velocimetry.vectors import Vectors


class DischargeCallbacks(Protocol):
    """Who takes the decoded messages."""

    def on_velocity(self, header: Header, vectors: Vectors, surface_m: float | None) -> None:
        """The vectors of an interval; in pixels where they are not in the map. surface_m: elevation, where known."""

    def on_water_level(self, level: WaterLevel) -> None:
        """A water level without a fault; one without a stamp has NO_STAMP."""

    def on_unusable(self, topic: str, text: str) -> None:
        """A message that cannot be used, and why."""


class DischargeInputs:
    """Subscribes to both, and loses no message."""

    def __init__(self, node: Node, water_level_type: str, callbacks: DischargeCallbacks) -> None:
        self._callbacks = callbacks
        self.velocity = GraphSubscription(node, VELOCITY_TOPIC, [PointCloud2], self._on_velocity)
        self.level = GraphSubscription(node, WATER_LEVEL_TOPIC, LEVEL_CLASSES[water_level_type], self._on_level)

    @property
    def faults(self) -> dict[str, str]:
        """What is wrong with the publishers, by topic."""
        return {one.topic: one.fault for one in (self.velocity, self.level) if one.fault}

    def refresh(self) -> None:
        """Follows the publishers."""
        self.velocity.refresh()
        self.level.refresh()

    def close(self) -> None:
        """Ends the subscriptions."""
        self.velocity.close()
        self.level.close()

    def _on_velocity(self, cdr: bytes, _msgtype: str) -> None:
        try:
            (header, vectors), surface_m = read_velocity(cdr), read_surface(cdr)
        except MessageError as error:
            self._callbacks.on_unusable(self.velocity.topic, str(error))
            return
        in_map = header.frame_id == MAP_FRAME
        self._callbacks.on_velocity(header, vectors if in_map else replace(vectors, unit="px"), surface_m)

    def _on_level(self, cdr: bytes, msgtype: str) -> None:
        try:
            level = read_water_level(cdr, msgtype, NO_STAMP)
        except MessageError as error:
            self._callbacks.on_unusable(self.level.topic, str(error))
            return
        if level.fault:
            self._callbacks.on_unusable(self.level.topic, level.fault)
        else:
            self._callbacks.on_water_level(level)
