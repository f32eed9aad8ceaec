"""What a node needs to know of images that are not its own subscription: they come from its process."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Protocol

from rclpy.node import Node

from stab_ros.nodes.received_image import ReceivedImage


class ImageSubscription(Protocol):
    """A node's part in a subscription. topic: its full name. publishers: how many there are, as last looked at."""

    @property
    def topic(self) -> str: ...

    @property
    def publishers(self) -> int: ...

    def refresh(self) -> None:
        """Follows the publishers' QoS; to be called periodically."""

    def close(self) -> None:
        """Ends it."""


class ImageSupply(Protocol):
    """Images that a node of the process publishes. takers: nodes that take them. backlog: most that wait for one."""

    @property
    def takers(self) -> int: ...

    @property
    def backlog(self) -> int: ...

    def hand_over(self, cdr: bytes) -> None:
        """Gives an image to the takers."""

    def close(self) -> None:
        """Ends it: images come over DDS again."""


class ImageSource(Protocol):
    """Who subscribes for several nodes. parameters: names of its own, which reach those nodes too, in vain."""

    @property
    def parameters(self) -> Collection[str]: ...

    def join(self, node: Node, topic: str, compressed: bool, keep_all: bool,
             take: Callable[[ReceivedImage], None]) -> ImageSubscription:
        """Has `take` called with every image, in a callback of `node`.

        Args:
            node: that takes the images.
            topic: its full name.
            compressed: whether it is of CompressedImage.
            keep_all: every image counts, not only the newest.
            take: what becomes of an image.
        """

    def expect(self, name: str) -> None:
        """The node of this full name is to ask for images, sooner or later."""

    def expect_no_more(self, name: str) -> None:
        """The node of this full name will not ask for images, or not soon: it is not waited for."""

    def supply(self, topic: str, msgtype: str) -> ImageSupply:
        """Images that come from a node of the process from now on, and no longer over DDS.

        Args:
            topic: its full name.
            msgtype: of the images.
        """

    @property
    def obstacle(self) -> str:
        """What images of the process wait for, "" for nothing."""

    def is_used(self, override: str) -> bool:
        """Whether it uses this parameter of a quality of service."""
