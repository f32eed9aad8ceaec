"""Publishes the messages of a bag, byte for byte and at the recorded pace; RELIABLE subscribers lose none."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from tqdm import tqdm

from stab_ros.core.errors import InputError
from stab_ros.core.settings import Checked, setting
from stab_ros.core.text import counted
from stab_ros.io.bag import BagReader, Message, Topic, open_bag
from stab_ros.io.cdr import SECOND_NS
from stab_ros.io.diagnostics_message import OK
from stab_ros.io.image_message import IMAGE_TYPES
from stab_ros.io.image_topic import holds_images
from stab_ros.io.topics import CLOCK_TOPIC
from stab_ros.nodes import params
from stab_ros.nodes.cdr_publisher import CdrPublisher
from stab_ros.nodes.diagnostic_status import DiagnosticStatus
from stab_ros.nodes.latched_messages import LatchedMessages
from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.qos import replay_qos
from stab_ros.nodes.runtime import message_class
from stab_ros.nodes.schedule import Schedule
from stab_ros.nodes.shared_publisher import SharedImagePublisher
from stab_ros.nodes.spinner import Spinner

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from stab_ros.nodes.node_options import NodeOptions

_TICK_NS = 20_000_000  # period of /clock
_STALL_NS = 200_000_000  # delay that counts as a stall: by a slow subscriber, or as the process was stopped


@dataclass(frozen=True)
class PlayerSettings(Checked):
    """Parameters of the player."""

    bag: str = setting("", "Path of the recording: an .mcap, a rosbag2 folder or a ROS 1 .bag")
    rate: float = setting(1.0, "Playback speed relative to real time", 0.001, 1e6)
    loop: bool = setting(False, "Whether to start again at the end")
    start_offset: float = setting(0.0, "Time in seconds to skip at the beginning of the recording", 0.0, 1e9)
    clock: bool = setting(False, "Whether to publish /clock, from the log times; one in the recording is left out then")
    wait_for_subscribers: int = setting(
        0, "Number of subscribers, over all image topics (all topics if none has images), to wait for before playing",
        0, 1000)


@dataclass(frozen=True)
class _Place:
    """Where the replay goes on after a pause: before the message of number `passed`, whose log time is `next_ns`.

    Log times do not tell the place: messages of several topics may share one.
    """

    passed: int
    next_ns: int


class BagPlayerNode(StabNode):
    """Plays once, or again and again with `loop`; a pause of the replay is the state inactive.

    At the end it ends, or is inactive where it was activated from outside, and begins anew with the next activation.
    """

    COMPOSABLE, OF_BAGS = False, True

    def __init__(self, given: Mapping[str, object] | None = None, **options: Unpack[NodeOptions]) -> None:
        super().__init__("bag_player_node", given, **options)

    # lifecycle -------------------------------------------------------------------------------------------------------
    def configure(self) -> None:
        """Opens the recording, and advertises its topics."""
        table = params.table_of(PlayerSettings)
        values: Any = params.declare(self, table)
        params.warn_of_unknown(self, table)
        self.settings = PlayerSettings(**values)
        if not self.settings.bag:
            raise InputError("bag: no recording is named, it must be the path of one, as in -p bag:=flight.mcap")
        opened = ExitStack()
        self.at_cleanup(opened.close)
        self._bag = opened.enter_context(open_bag(Path(self.settings.bag)))
        self._outputs: dict[str, CdrPublisher] = {}
        clock = self.settings.clock
        self._clock_publisher = CdrPublisher(self, Clock, CLOCK_TOPIC, QoSProfile(depth=1)) if clock else None
        self._schedule = Schedule(0, 0, self.settings.rate)
        self._clock_ns = 0
        self._messages = self._rounds = 0
        self._activity = "opening the recording"
        self._paused: _Place | None = None
        self._advertise(self._bag)

    def work(self, spinner: Spinner) -> None:
        while not spinner.stopping:
            if not self.is_active:
                spinner.once()
            elif self._played(spinner):
                if self.autostart:
                    break
                self.flush()
                self.trigger_deactivate()

    def _played(self, spinner: Spinner) -> bool:
        """Whether it has come to the end, and not to a pause."""
        self._wait_for_subscribers(self._bag, spinner)
        while self._plays_on(spinner):
            self._play(self._bag, spinner)
            if self._plays_on(spinner) and not self.settings.loop:
                return True
        return False

    def _plays_on(self, spinner: Spinner) -> bool:
        return self.is_active and not spinner.stopping

    def flush(self) -> None:
        """Waits for the subscribers, unless the process is to end at once, and reports what was played."""
        for publisher in () if self.stop.requested else self._outputs.values():
            publisher.flush()
        self.report()
        self.flush_diagnostics()

    def report(self) -> None:
        """Publishes the diagnostics, once a second and at the end."""
        if self._clock_publisher is not None and self.count_publishers(CLOCK_TOPIC) > 1:
            self.get_logger().warning(f"others publish {CLOCK_TOPIC} too, nodes with use_sim_time jump between the "
                                      "times; end them, or play without clock", once=True)
        counts = {"messages": str(self._messages), "rounds": str(self._rounds)}
        self.publish_diagnostics(DiagnosticStatus(OK, self._activity, counts))

    def _advertise(self, bag: BagReader) -> None:
        """A publisher for every topic whose type is installed."""
        for topic in bag.topics.values():
            if topic.name == CLOCK_TOPIC and self.settings.clock:
                self.get_logger().info(f"{CLOCK_TOPIC} of the recording is left out, as clock is set: there is one "
                                       "clock, the log times at the rate of the replay")
                continue
            try:
                params.topic_of(self, topic.name)  # ROS 1 and other writers of MCAP have further names
                msg_class = message_class(topic.msgtype)
            except InputError as error:
                self.get_logger().warning(f"{topic.name} is left out: {error}")
                continue
            self._outputs[topic.name] = self._output(topic, msg_class)
        if not self._outputs:
            raise InputError(f"{self.settings.bag}: no topic can be played, it must hold messages of installed types")

    def _output(self, topic: Topic, msg_class: Any) -> CdrPublisher:
        if self.images is not None and topic.msgtype in IMAGE_TYPES:
            return SharedImagePublisher(self, msg_class, topic.name, replay_qos(topic.qos), self.images)
        return CdrPublisher(self, msg_class, topic.name, replay_qos(topic.qos), lossless=True)

    def _wait_for_subscribers(self, bag: BagReader, spinner: Spinner) -> None:
        images = [name for name in self._outputs if holds_images(bag.topics[name])]
        while self._plays_on(spinner):
            missing = self._missing(images)
            if not missing:
                return
            self._activity = f"waiting for {missing}"
            spinner.once()

    def _missing(self, images: Sequence[str]) -> str:
        """What playing waits for, "" for nothing. images: topics of them."""
        if images and self.images is not None and self.images.obstacle:
            return self.images.obstacle
        wanted = self.settings.wait_for_subscribers
        there = sum(self._outputs[name].subscribers for name in images or self._outputs)
        return counted(wanted, "subscriber") if there < wanted else ""

    def _play(self, bag: BagReader, spinner: Spinner) -> None:
        self._activity = "playing"
        self._rounds += self._paused is None
        place = self._paused or _Place(0, bag.start_ns + round(self.settings.start_offset * SECOND_NS))
        self._schedule = Schedule(place.next_ns, time.monotonic_ns(), self.settings.rate)
        total = sum(bag.topics[name].count for name in self._outputs)
        with tqdm(total=total, unit=" messages", disable=None) as progress:
            progress.update(place.passed)
            self._paused = self._played_from(place, bag, spinner, progress)
        if self._paused is None:
            for warning in bag.warnings:
                self.get_logger().warning(warning)

    def _played_from(self, place: _Place, bag: BagReader, spinner: Spinner, progress: tqdm[Any]) -> _Place | None:
        """Plays from there on; returns where it was paused, or None at the end."""
        latched = LatchedMessages(self._outputs)
        for number, message in enumerate(islice(bag.messages(self._outputs), place.passed, None), place.passed):
            if message.log_time_ns < place.next_ns:
                latched.take(message)
            else:
                self._send(latched.release())
                self._wait_until_due(message, spinner)
                if not self._plays_on(spinner):
                    return _Place(number, message.log_time_ns)
                self._send([message])
            progress.update()
        return None

    def _send(self, messages: Iterable[Message]) -> None:
        for message in messages:
            self._outputs[message.topic].send(message.data)
            self._messages += 1

    def _wait_until_due(self, message: Message, spinner: Spinner) -> None:
        schedule, wait_ns, now_ns = self._schedule, 0, 0
        due_ns = schedule.due_ns(message.log_time_ns)
        while self._plays_on(spinner):  # if not, all that is needed to play may be gone
            now_ns = time.monotonic_ns()
            self._publish_clock(min(schedule.bag_time_ns(now_ns), message.log_time_ns), at_once=now_ns >= due_ns)
            if now_ns >= due_ns:
                break
            wait_ns = min(due_ns - now_ns, _TICK_NS)
            spinner.once(wait_ns / SECOND_NS)
        if wait_ns == 0:
            spinner.once(0.0)  # late already, but parameters and signals must not starve
        if now_ns - due_ns > _STALL_NS:
            self._schedule = schedule.resumed(now_ns - due_ns)

    def _publish_clock(self, bag_ns: int, at_once: bool) -> None:
        """Publishes /clock, every tick or with the message that is due."""
        if self._clock_publisher is None or not (at_once or abs(bag_ns - self._clock_ns) >= _TICK_NS):
            return
        self._clock_ns = bag_ns
        clock = Clock(clock=Time(nanoseconds=bag_ns).to_msg())
        self._clock_publisher.send(serialize_message(clock))
