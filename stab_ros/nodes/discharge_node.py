"""Discharge live: the ROS side of `RunningDischarge`."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile

from stab_ros.core.settings import Value, settings_of
from stab_ros.core.text import counted
from stab_ros.discharge.doubts import surface_doubts
from stab_ros.discharge.running import Reading, RunningDischarge
from stab_ros.discharge.settings import DischargeConfig, RunningConfig
from stab_ros.georeferencing.level_doubts import silent_level
from stab_ros.io.cdr import SECOND_NS, Header
from stab_ros.io.discharge_message import discharge_cdr
from stab_ros.io.topics import DISCHARGE_TOPIC
from stab_ros.io.water_level_message import WaterLevel
from stab_ros.jobs.placed_section import placed_section
from stab_ros.nodes import params
from stab_ros.nodes.cdr_publisher import CdrPublisher
from stab_ros.nodes.discharge_inputs import DischargeInputs
from stab_ros.nodes.discharge_status import DischargeStatus
from stab_ros.nodes.failures import Failures
from stab_ros.nodes.level_stamps import LevelStamps
from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.throttled_warnings import ThrottledWarnings
from stab_ros.parameters.discharge import DISCHARGE_PARAMETERS, discharge_config, running_config
from stab_ros.parameters.node_settings import DischargeSettings
from stab_ros.velocimetry.vectors import Vectors

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from stab_ros.nodes.node_options import NodeOptions

SETTINGS = params.table_of(DischargeSettings)
CHANGEABLE = frozenset(name for name, _, _ in settings_of(DischargeConfig))  # section and window stay as they are


class DischargeNode(StabNode):
    """Publishes a discharge, or why there is none, every `every_s` by the stamps of the velocities."""

    def __init__(self, **options: Unpack[NodeOptions]) -> None:
        super().__init__("discharge_node", **options)

    # lifecycle -------------------------------------------------------------------------------------------------------
    def configure(self) -> None:
        given = [name for name in DISCHARGE_PARAMETERS if params.given(self, name) is not None]
        declared = params.declare(self, {**DISCHARGE_PARAMETERS, **SETTINGS}, CHANGEABLE)
        params.warn_of_unknown(self, declared)
        chosen: Any = {item.name: declared[item.name] for item in fields(DischargeSettings)}
        self.settings = DischargeSettings(**chosen)
        self._values = {name: declared[name] for name in given}
        section, doubts = placed_section(self._values)
        wse_m = float(self._values["wse_m"]) if "wse_m" in self._values else None
        self._config = discharge_config(self._values)
        self._running = RunningDischarge(section, self._config, running_config(self._values), wse_m)
        self._given_m = wse_m
        self._newest_ns = 0  # stamp of the last velocities; 0: none have come
        self._levels = LevelStamps()
        self._inputs: DischargeInputs | None = None
        self._warnings, self._failures = ThrottledWarnings(self.get_logger()), Failures(self.get_logger())
        self.status = DischargeStatus(round(self.settings.stale_s * SECOND_NS), doubts)
        self._output = CdrPublisher(self, DiagnosticArray, DISCHARGE_TOPIC, QoSProfile(depth=100), lossless=True)
        self.at_cleanup(params.ParameterUpdates(self, DISCHARGE_PARAMETERS, self._change).close)

    def deactivate(self) -> None:
        if self._inputs is not None:
            self._inputs.close()
            self._inputs = None
        self.status.suspend()

    def flush(self) -> None:
        self._output.flush()

    def on_failure(self, error: BaseException) -> None:
        if not isinstance(error, Exception):
            raise error
        self._failures.note(error)

    def poll(self) -> None:
        """Follows the publishers, once subscribers are there."""
        if self._inputs is None and self._output.subscribers >= self.settings.wait_for_subscribers:
            self._inputs = DischargeInputs(self, self.settings.water_level_type, self)
            self.tell(f"ready, taking velocities from {self._inputs.velocity.topic}")
        if self._inputs is not None:
            self._inputs.refresh()
            self.status.faults = self._inputs.faults
        self.status.waiting_for = self._awaited()

    def _awaited(self) -> str:
        if self._inputs is None:
            return f"{counted(self.settings.wait_for_subscribers, 'subscriber')} of {self._output.topic}"
        velocity = self._inputs.velocity
        return f"velocities on {velocity.topic}" + ("" if velocity.publishers else ", nobody publishes it")

    # input -----------------------------------------------------------------------------------------------------------
    def on_velocity(self, header: Header, vectors: Vectors, surface_m: float | None) -> None:
        """See `DischargeCallbacks`."""
        self._tell_of_step(header.stamp_ns - self._newest_ns)
        self._newest_ns = header.stamp_ns
        self.status.on_velocity(header.stamp_ns, len(vectors), self.free.ns)
        with self._failures:
            reading = self._running.add(header.stamp_ns, vectors)
            self._set_level(self._levels.advance(header.stamp_ns))
            if reading is not None:
                self._tell(self._with_surface(reading, surface_m), header)

    def _tell_of_step(self, step_ns: int) -> None:
        """Stamps that go back are said: a recording in a loop that is shorter than every_s makes no discharge."""
        if step_ns < 0:
            self._warn("back", f"stamps of velocities went back by {-step_ns / SECOND_NS:.1f} s; a discharge needs "
                       f"{float(self._values.get('every_s', RunningConfig.every_s)):g} s of them (every_s)")

    def _warn(self, kind: str, text: str) -> None:
        """In the next report, and throttled in the log."""
        self.status.warn(kind, text)
        self._warnings.log(kind, text)

    def _with_surface(self, reading: Reading, surface_m: float | None) -> Reading:
        """With a warning where the last velocities lie on another water surface."""
        if reading.discharge is None:
            return reading
        doubts = surface_doubts(surface_m, reading.discharge.wse_m, self._config.wse_sigma_m)
        return replace(reading, warnings=(*doubts, *reading.warnings))

    def _tell(self, reading: Reading, header: Header) -> None:
        self.status.on_reading(reading)
        self._output.send(discharge_cdr(reading, header))

    def on_water_level(self, level: WaterLevel) -> None:
        """See `DischargeCallbacks`. A level without a stamp holds from the last velocities on, or from the first."""
        self.status.count("water_levels")
        self._set_level(self._levels.stamped(level))

    def _set_level(self, level: WaterLevel | None) -> None:
        if level is not None:
            self._running.set_level(level.stamp_ns, level.wse_m)
            self.status.on_level(level.stamp_ns)

    def on_unusable(self, topic: str, text: str) -> None:
        """See `DischargeCallbacks`."""
        self.status.count("messages_refused")
        self._warn(f"unusable {topic}", f"refused a message: {topic}: {text}")

    # diagnostics and parameters --------------------------------------------------------------------------------------
    def report(self) -> None:
        self.status.level_doubts = self._running.level_doubts(self._newest_ns)
        self.status.level_missing, self.status.level_from = self._level_missing(), self._level_from()
        if self.status.level_missing:
            self._warnings.log("water level", self.status.level_missing)
        if self._failures.count > self.status.errors:
            self.status.errors = self._failures.count
            self.status.warn("internal", self._failures.last)
        self.publish_diagnostics(self.status.report(self.free.ns))

    def _level_missing(self) -> str:
        """Why no water level has come; "": one has, or none is asked for, as wse_m tells it."""
        if self._running.has_level or self._inputs is None:
            return ""
        level = self._inputs.level
        if self._given_m is not None:
            return silent_level(level.topic, self._given_m) if level.publishers else ""
        return f"{level.topic} has told no level yet" if level.publishers else f"nobody publishes {level.topic}"

    def _level_from(self) -> str:
        """Where the water level is from, for people."""
        if self._running.has_level:
            return "water_level"
        return "" if self._given_m is None else "wse_m"

    def _change(self, changed: dict[str, Value]) -> None:
        """Other settings hold from the next discharge on."""
        values = {**self._values, **changed}
        self._config = discharge_config(values)
        self._running.reconfigure(self._config)
        self._values = values
