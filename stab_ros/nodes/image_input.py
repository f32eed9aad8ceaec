"""A node's subscription to images: transport, queue, lost messages, and images held until the camera is known."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping

from sensor_msgs.msg import CompressedImage, Image

from stab_ros.io.cdr import COMPRESSED_IMAGE, IMAGE
from stab_ros.io.topics import RAW_TOPIC, compressed_topic
from stab_ros.nodes.gap_counter import GapCounter
from stab_ros.nodes.image_hub import RELIABLE_FIX
from stab_ros.nodes.image_source import ImageSubscription
from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.qos import AdaptiveSubscription, keep_all_reliable, newest_only
from stab_ros.nodes.received_image import ReceivedImage

_HELD_IMAGES = 100


class ImageInput:
    """Passes every image on, of a subscription of its own or of the node's process (`images`).

    compressed: subscribe to the topic's compressed images. keep_all: every image counts, not only the newest. may_pass:
    while it is false, images are held until `release`, or dropped unless `keep_all`. dropped: is told how many images
    were lost. held_up: whether the last one that came could not pass.
    """

    def __init__(self, node: StabNode, compressed: bool, keep_all: bool, may_pass: Callable[[], bool],
                 take: Callable[[ReceivedImage], None], dropped: Callable[[int], None], topic: str = RAW_TOPIC) -> None:
        self.msgtype = COMPRESSED_IMAGE if compressed else IMAGE
        self._node, self._keep_all, self._topic = node, keep_all, topic
        self._may_pass, self._take, self._dropped = may_pass, take, dropped
        self._gaps, self.held_up = GapCounter(), False
        self._held: deque[ReceivedImage] = deque(maxlen=_HELD_IMAGES)
        self._subscription: ImageSubscription | None = None

    def open(self) -> None:
        """Subscribes, and says so."""
        topic = self._compressed_topic if self._compressed else self._node.resolve_topic_name(self._topic)
        images = self._node.images
        self._subscription = self._subscribe(topic) if images is None else images.join(
            self._node, topic, self._compressed, self._keep_all, self._on_image)
        taken = self._subscription.topic
        self._node.tell(f"ready for images from {taken}, waiting for {self._obstacle}" if self._obstacle
                        else f"ready, taking images from {taken}")

    def _subscribe(self, topic: str) -> AdaptiveSubscription:
        msg_class = CompressedImage if self._compressed else Image
        return AdaptiveSubscription(self._node, msg_class, topic, self._on_cdr,
                                    keep_all_reliable if self._keep_all else newest_only, RELIABLE_FIX)

    def close(self) -> None:
        """Ends the subscription, until `open` is called again; images that are held are dropped."""
        if self._subscription is not None:
            self._subscription.close()
        self._subscription = None
        self._gaps.suspend()
        self.held_up = False
        self._dropped(len(self._held))
        self._held.clear()

    @property
    def is_open(self) -> bool:
        return self._subscription is not None

    @property
    def awaited(self) -> str:
        """What is needed for images to come, for people; once it is open."""
        assert self._subscription is not None
        return self._obstacle or f"images on {self._subscription.topic}"

    @property
    def _obstacle(self) -> str:
        return "" if self._node.images is None else self._node.images.obstacle

    @property
    def publishers(self) -> int:
        """How many there are, at the last `refresh`."""
        return 0 if self._subscription is None else self._subscription.publishers

    @property
    def before(self) -> int:
        """How many images were published before the first that was received."""
        return self._gaps.before

    def refresh(self) -> None:
        """Follows the publishers' QoS; says where only the other transport is published."""
        if self._subscription is None:
            return
        self._subscription.refresh()
        other = self._node.resolve_topic_name(self._topic if self._compressed else self._compressed_topic)
        if not self._subscription.publishers and self._node.count_publishers(other):
            transport = "raw" if self._compressed else "compressed"
            self._node.get_logger().warning(f"nobody publishes {self._subscription.topic}, but {other} is published; "
                                            f"set image_transport:={transport} to take it", once=True)

    @property
    def _compressed_topic(self) -> str:
        """Below the name that the images' topic has been remapped to, as image_transport does it."""
        return compressed_topic(self._node.resolve_topic_name(self._topic))

    @property
    def _compressed(self) -> bool:
        return self.msgtype == COMPRESSED_IMAGE

    def release(self) -> None:
        """Passes the held images on."""
        self.held_up = False
        while self._held:
            self._take(self._held.popleft())

    def _on_cdr(self, cdr: bytes, info: Mapping[str, int]) -> None:
        self._on_image(ReceivedImage(cdr, self.msgtype, info))

    def _on_image(self, image: ReceivedImage) -> None:
        self._dropped(self._gaps.missed(image.number, self.publishers))
        self.held_up = not self._may_pass()
        if not self.held_up:
            self._take(image)
        else:
            self._hold(image)

    def _hold(self, image: ReceivedImage) -> None:
        room = _HELD_IMAGES if self._keep_all else 0
        self._dropped(int(len(self._held) >= room))
        if room:
            self._held.append(image)
