"""Images for several nodes of one process: one subscription or player, and each image handed over in memory.

rclpy has no transport within a process: each subscription is sent a copy of its own, and decodes it.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Collection, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from threading import RLock
from typing import TYPE_CHECKING, Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import CompressedImage, Image

from stab_ros.core.text import counted
from stab_ros.io.cdr import COMPRESSED_IMAGE, IMAGE
from stab_ros.nodes import params
from stab_ros.nodes.image_source import ImageSubscription, ImageSupply
from stab_ros.nodes.namesakes import Namesakes
from stab_ros.nodes.qos import AdaptiveSubscription, keep_all_reliable, newest_only
from stab_ros.nodes.qos_overrides import check_overrides, is_used
from stab_ros.nodes.received_image import ReceivedImage

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from stab_ros.nodes.node_options import RosOptions

RELIABLE_FIX = "let it offer RELIABLE, or set queue_depth:=1"
_LOOK_S, _NAMES_S = 0.1, 1.0
_MOST_WAITING = 8  # images for a node that wants all of them
_LOOKS = 50  # of a node, until it is said that no images can come, if it is so: 5 s


@dataclass(frozen=True)
class _Wish:
    """What nodes share a subscription for: a topic by its full name, of one type, with one depth of the queue."""

    topic: str
    compressed: bool
    keep_all: bool


class ImageHub(params.DeclaringNode):
    """Subscribes to images once for all nodes that were given it as `images`; it must be spun, as they are.

    Nodes share a subscription if they take the same topic with the same `image_transport` and `queue_depth`. Each works
    through its images in callbacks of its own, on whatever thread these run. If one that wants all of them falls
    behind, no more are taken until it has room, so that DDS holds back a reliable source.

    Attributes:
        awaited: number of nodes that must have asked for images before any is taken.
    """

    def __init__(self, name: str = "image_hub", **options: Unpack[RosOptions]) -> None:
        """Prepares; nothing is subscribed to before a node asks.

        Args:
            name: of the hub, unless it is remapped.
            options: as of rclpy's node; the services of logger levels are there unless they are declined.

        Raises:
            InputError: a quality of service is none, or a parameter is given an empty value.
        """
        options.setdefault("enable_logger_service", True)
        super().__init__(name, **options)
        self.awaited = 0
        self._expected: set[str] = set()  # full names of nodes that are to ask for images
        self._joined: set[str] = set()  # full names of nodes that have asked so far, or never will
        self._is_spun = self._idleness_is_told = self._obstacle_is_told = False
        self._lock = RLock()  # of the channels and their members
        self._channels: dict[_Wish, _Channel] = {}
        self._supplied: set[str] = set()  # topics that come from a node of the process
        for line in check_overrides(self):
            self.get_logger().warning(line)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_LOOK_S, self._refresh, clock=steady)
        self.create_timer(_NAMES_S, Namesakes(self, options.get("node_name", name)).look, clock=steady)

    @property
    def parameters(self) -> Collection[str]:
        """See `ImageSource`."""
        return ()

    def is_used(self, override: str) -> bool:
        """See `ImageSource`."""
        return self.has_parameter(override) and is_used(self, override)

    @property
    def obstacle(self) -> str:
        """See `ImageSource`."""
        if not self._is_spun and self._idleness_is_told:
            return f"an executor that spins {self.get_fully_qualified_name()}"
        with self._lock:
            there, missing = len(self._joined), sorted(self._expected - self._joined)
        names = f", not yet {', '.join(missing)}" if missing else ""
        return "" if there >= self.awaited else (
            f"{counted(self.awaited, 'node')} of the process to take images, so far {there}{names}")

    def expect(self, name: str) -> None:
        """See `ImageSource`."""
        with self._lock:
            self._expected.add(name)

    def expect_no_more(self, name: str) -> None:
        """See `ImageSource`."""
        with self._lock:
            self._joined.add(name)
            self._open()

    def join(self, node: Node, topic: str, compressed: bool, keep_all: bool,
             take: Callable[[ReceivedImage], None]) -> ImageSubscription:
        """See `ImageSource`."""
        wish, name = _Wish(topic, compressed, keep_all), node.get_fully_qualified_name()
        with self._lock, ExitStack() as undo:
            if wish not in self._channels:
                self._channels[wish] = _Channel(self, wish, self._lock)
            member = _Member(node, self._channels[wish], take, self._leave, self._tell_obstacle)
            undo.callback(member.close)
            if name not in self._joined:
                undo.callback(self._joined.discard, name)
            self._joined.add(name)
            self._open()
            undo.pop_all()
        return member

    def supply(self, topic: str, msgtype: str) -> ImageSupply:
        """See `ImageSource`."""
        with self._lock:
            self._supplied.add(topic)
            for channel in self._channels.values():
                if channel.wish.topic == topic:
                    channel.close()
        return _Supply(topic, msgtype, lambda: self._takers(topic, msgtype), self._lock, self._end_supply)

    def supplies(self, topic: str) -> bool:
        """Whether a node of the process publishes this topic."""
        return topic in self._supplied

    def _takers(self, topic: str, msgtype: str) -> list[_Member]:
        return [member for channel in self._channels.values()
                if (channel.wish.topic, channel.msgtype) == (topic, msgtype) for member in channel.members]

    def _end_supply(self, topic: str) -> None:
        with self._lock:
            self._supplied.discard(topic)
            self._open()

    def _open(self) -> None:
        """Subscribes to what nodes take, once enough of them do, and no node of the process publishes it."""
        for channel in self._channels.values():
            if len(self._joined) >= self.awaited and channel.wish.topic not in self._supplied:
                channel.open()

    def _leave(self, member: _Member) -> None:
        with self._lock:
            member.channel.members.remove(member)
            if not member.channel.members:
                self._channels.pop(member.channel.wish).end()

    def _tell_obstacle(self) -> None:
        """Why a node has waited for some time, each reason once; not so where nobody publishes images."""
        with self._lock:
            if not (self._is_spun or self._idleness_is_told):
                self._idleness_is_told = True
                self.get_logger().warning("no images are taken: nobody spins this node, which takes them for others; "
                                          "add it to an executor too")
            elif self._is_spun and self.obstacle and not self._obstacle_is_told:
                self._obstacle_is_told = True
                self.get_logger().warning(f"no images are taken: they wait for {self.obstacle}")

    def _refresh(self) -> None:
        self._is_spun = True
        with self._lock:
            for channel in self._channels.values():
                channel.refresh()


class _WhileRoom(MutuallyExclusiveCallbackGroup):
    """Callbacks that an executor runs only while there is room for what they bring."""

    def __init__(self, has_room: Callable[[], bool]) -> None:
        super().__init__()
        self._has_room = has_room

    def can_execute(self, entity: Any) -> bool:
        """As executors ask before they wait."""
        return self._has_room() and super().can_execute(entity)


class _Channel:
    """A subscription and the nodes that share it."""

    def __init__(self, hub: ImageHub, wish: _Wish, lock: RLock) -> None:
        self.wish, self._hub, self._lock = wish, hub, lock
        self.members: list[_Member] = []
        self.msgtype = COMPRESSED_IMAGE if wish.compressed else IMAGE
        self._subscription: AdaptiveSubscription | None = None
        self._while_room = _WhileRoom(self._has_room)
        self._look_again = hub.create_guard_condition(lambda: None)  # an executor that waits asks only once

    def open(self) -> None:
        """Subscribes, once."""
        if self._subscription is None:
            self._subscription = AdaptiveSubscription(
                self._hub, CompressedImage if self.wish.compressed else Image, self.wish.topic, self._on_cdr,
                keep_all_reliable if self.wish.keep_all else newest_only, RELIABLE_FIX, self._while_room)

    def close(self) -> None:
        """Ends the subscription, until `open` is called again."""
        if self._subscription is not None:
            self._subscription.close()
            self._subscription = None

    def end(self) -> None:
        """Ends it for good."""
        self.close()
        self._hub.destroy_guard_condition(self._look_again)

    def refresh(self) -> None:
        """Follows the publishers' QoS."""
        if self._subscription is not None:
            self._subscription.refresh()

    @property
    def publishers(self) -> int:
        return self._hub.supplies(self.wish.topic) if self._subscription is None else self._subscription.publishers

    def taken(self) -> None:
        """A member has taken an image, and may have room again."""
        if self.wish.keep_all and self._has_room():
            self._look_again.trigger()

    def _has_room(self) -> bool:
        return not self.wish.keep_all or all(member.waiting < _MOST_WAITING for member in [*self.members])

    def _on_cdr(self, cdr: bytes, info: Mapping[str, int]) -> None:
        image = ReceivedImage(cdr, self.msgtype, info)
        with self._lock:
            for member in self.members:
                member.offer(image)


class _Member:
    """The images of one node: all of them wait for it, or the newest."""

    def __init__(self, node: Node, channel: _Channel, take: Callable[[ReceivedImage], None],
                 leave: Callable[[_Member], None], waited_long: Callable[[], None]) -> None:
        self._node, self.channel, self._take, self._leave = node, channel, take, leave
        self._waited_long, self._looks = waited_long, 0
        self._waiting: deque[ReceivedImage] = deque(maxlen=None if channel.wish.keep_all else 1)
        self._ready = node.create_guard_condition(self._take_one)
        channel.members.append(self)

    @property
    def topic(self) -> str:
        return self.channel.wish.topic

    @property
    def publishers(self) -> int:
        return self.channel.publishers

    def refresh(self) -> None:
        """The hub follows the publishers by itself, if it is spun."""
        self._looks += 1
        if self._looks % _LOOKS == 0:
            self._waited_long()

    def close(self) -> None:
        """Ends it; the images that wait are dropped."""
        self._leave(self)
        self._node.destroy_guard_condition(self._ready)

    @property
    def waiting(self) -> int:
        """Number of images."""
        return len(self._waiting)

    def offer(self, image: ReceivedImage) -> None:
        """Has the node take an image, or the newest one; called from whatever thread."""
        self._waiting.append(image)
        self._ready.trigger()

    def _take_one(self) -> None:
        """One image in a callback, so that other callbacks of the node have their turn between two of them."""
        if not self._waiting:
            return
        image = self._waiting.popleft()
        if self._waiting:
            self._ready.trigger()
        self.channel.taken()
        self._take(image)


class _Supply:
    """Images of a node of the process, numbered as a publisher numbers them."""

    def __init__(self, topic: str, msgtype: str, takers: Callable[[], list[_Member]], lock: RLock,
                 end: Callable[[str], None]) -> None:
        self._topic, self._msgtype, self._takers, self._lock, self._end = topic, msgtype, takers, lock, end
        self._number = 0

    @property
    def takers(self) -> int:
        with self._lock:
            return len(self._takers())

    @property
    def backlog(self) -> int:
        with self._lock:
            return max((member.waiting for member in self._takers()), default=0)

    def hand_over(self, cdr: bytes) -> None:
        """See `ImageSupply`."""
        self._number += 1
        info = {"publication_sequence_number": self._number, "source_timestamp": time.time_ns()}
        image = ReceivedImage(cdr, self._msgtype, info)
        with self._lock:
            for member in self._takers():
                member.offer(image)

    def close(self) -> None:
        """See `ImageSupply`."""
        self._end(self._topic)
