"""Records topics into an MCAP bag, whatever their type and QoS, as raw bytes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.topic_endpoint_info import TopicEndpointInfo

from stab_ros.core.errors import ConfigError, InputError, WorkError
from stab_ros.core.settings import Checked, setting
from stab_ros.io.bag import BagWriter, Topic
from stab_ros.io.diagnostics_message import ERROR, OK
from stab_ros.io.installed_types import live_topic
from stab_ros.nodes import params
from stab_ros.nodes.diagnostic_status import DiagnosticStatus
from stab_ros.nodes.gap_counter import GapCounter
from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.qos import AdaptiveSubscription, keep_all_offered, offered_yaml
from stab_ros.nodes.runtime import message_class
from stab_ros.nodes.spinner import Spinner


@dataclass(frozen=True)
class RecorderSettings(Checked):
    """Parameters of the recorder; `topics`, a list of strings, is declared beside them."""

    output: str = setting("", "Path of the .mcap file to write")
    overwrite: bool = setting(False, "Whether to replace an existing output")


class BagRecorderNode(StabNode):
    """Writes every message of `topics` (if empty: of all topics) while active; cleanup completes the file."""

    COMPOSABLE, OF_BAGS = False, True

    def __init__(self, given: Mapping[str, object]) -> None:
        super().__init__("bag_recorder_node", given)

    # lifecycle -------------------------------------------------------------------------------------------------------
    def configure(self) -> None:
        """Makes the file."""
        table = params.table_of(RecorderSettings)
        values: Any = params.declare(self, table)
        self.settings = RecorderSettings(**values)
        names = params.declare_names(self, "topics", "Topics to record; all topics if empty")
        params.warn_of_unknown(self, [*table, "topics"])
        self._wanted = self._topics_of(names)
        if not self.settings.output:
            raise ConfigError("output: no file is named, it must be one to write, as in -p output:=flight.mcap")
        self._inputs: dict[str, AdaptiveSubscription] = {}
        self._refused: set[str] = set()
        self._gaps: defaultdict[str, GapCounter] = defaultdict(GapCounter)
        self._messages = self._bytes = self._lost = 0
        self._failure: WorkError | None = None
        self._writer = BagWriter(Path(self.settings.output), self.settings.overwrite, "-p overwrite:=true")
        self.at_cleanup(self._writer.close)

    def _topics_of(self, names: Sequence[str]) -> set[str]:
        try:
            return {params.topic_of(self, name) for name in names}
        except InputError as error:
            raise ConfigError(f"topics: {error}") from error

    def activate(self) -> None:
        self.tell(f"recording to {self.settings.output}")

    def deactivate(self) -> None:
        """Pauses the recording."""
        while self._inputs:
            self._inputs.popitem()[1].close()

    def work(self, spinner: Spinner) -> None:
        super().work(spinner)
        if self.is_active:
            spinner.drain(lambda: self._messages)
        if self.is_configured and self._failure is not None:
            with self._writer:  # which stays as it is, closed and readable
                raise self._failure

    def poll(self) -> None:
        """Subscribes to wanted topics as soon as their type is known."""
        for subscription in self._inputs.values():
            subscription.refresh()
        for name, types in self.get_topic_names_and_types():
            if name not in self._inputs and name not in self._refused and (not self._wanted or name in self._wanted):
                self._add(name, types)

    def _add(self, name: str, types: list[str]) -> None:
        publishers = self.get_publishers_info_by_topic(name)
        if not publishers:
            return  # only subscribers so far, whose type may be wrong
        try:
            if len(types) > 1:
                raise InputError(f"it has several types, {', '.join(types)}")
            msg_class = message_class(types[0])
            offered = offered_yaml([info.qos_profile for info in publishers])
            topic = live_topic(name, types[0], offered, _type_hash(publishers))
            self._writer.add_topic(topic)
            self._tell_without_definition(topic)
            self._inputs[name] = AdaptiveSubscription(
                self, msg_class, name, partial(self._record, name), keep_all_offered,
                "let it offer what the other publishers of the topic offer")
        except InputError as error:
            self._refused.add(name)
            self.get_logger().warning(f"{name} is not recorded: {error}")

    def _tell_without_definition(self, topic: Topic) -> None:
        if not topic.definition:
            self.get_logger().warning(
                f"{topic.name} is recorded without the definition of {topic.msgtype}, whose .msg files are not "
                "installed: `ros2 bag` plays it where the type is installed, other tools cannot decode it")

    def _record(self, topic: str, cdr: bytes, info: Mapping[str, int]) -> None:
        """The log time is that of reception, as in rosbag2; on the simulated clock if there is one."""
        if self._failure is not None:
            return
        simulated_ns = self.get_clock().now().nanoseconds if self.get_parameter("use_sim_time").value else 0
        log_time_ns = simulated_ns or info["received_timestamp"]  # a simulated clock without publishers stands at zero
        self._try(lambda: self._writer.write(topic, log_time_ns, info["source_timestamp"], cdr))
        self._messages += 1
        self._bytes += len(cdr)
        self._lost += self._gaps[topic].missed(info["publication_sequence_number"], self._inputs[topic].publishers)

    def report(self) -> None:
        """Once a second: makes what was received survive a crash, and publishes the diagnostics."""
        if self._failure is None:
            self._try(self._writer.flush_chunk)
        level, message = (OK, "recording") if self._failure is None else (ERROR, str(self._failure))
        counts = {"topics": len(self._inputs), "messages": self._messages, "messages_lost": self._lost,
                  "bytes": self._bytes}
        self.publish_diagnostics(
            DiagnosticStatus(level, message, {name: str(count) for name, count in counts.items()}))

    def _try(self, write: Callable[[], None]) -> None:
        """A full disk ends the recording; the node goes on and reports it."""
        try:
            write()
        except WorkError as error:
            self._failure = error
            self.get_logger().error(f"nothing more is recorded: {error}")


def _type_hash(publishers: Sequence[TopicEndpointInfo]) -> str:
    """RIHS01 of the type that publishers say they have; "" if none does."""
    told = (str(publisher.topic_type_hash) for publisher in publishers)
    return next((one for one in told if one.startswith("RIHS")), "")
