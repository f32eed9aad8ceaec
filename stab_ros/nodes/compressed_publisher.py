"""Publishes `image_stabilized/compressed`, encoded and sent beside the tracking, however slow the link is."""

from __future__ import annotations

from dataclasses import dataclass

from rclpy.qos import QoSProfile
from sensor_msgs.msg import CompressedImage

from stab_ros.core.types import Image
from stab_ros.io.cdr import Header
from stab_ros.io.compressed_message import Codec, compressed_cdr
from stab_ros.nodes.cdr_publisher import CdrPublisher
from stab_ros.nodes.failures import Failures
from stab_ros.nodes.latest_worker import LatestWorker
from stab_ros.nodes.managed_node import StabNode
from stab_ros.nodes.own_participant import OwnParticipant
from stab_ros.nodes.rate_limit import RateLimit
from stab_ros.parameters.node_settings import CompressedSettings

_PATIENCE_S = 5.0  # with one picture


@dataclass(frozen=True, eq=False)
class _Job:
    """A picture to be encoded. owner: of its memory."""

    image: Image
    owner: object
    encoding: str
    header: Header
    codec: Codec


class CompressedPublisher:
    """settings: may be replaced at any time. lossless: every picture is published, the tracker waits for it."""

    def __init__(self, node: StabNode, topic: str, settings: CompressedSettings, failures: Failures,
                 lossless: bool) -> None:
        self.settings = settings
        self._participant = OwnParticipant(node, "compressed")
        node.at_cleanup(self._participant.close)
        self._publisher = CdrPublisher(node, CompressedImage, topic, QoSProfile(depth=1), lossless, self._participant)
        self._lossless, self._sending = lossless, False
        self._limit = RateLimit()
        self._worker = LatestWorker(self._publish, failures, lossless)

    @property
    def subscribers(self) -> int:
        return self._publisher.subscribers

    def wants(self, stamp_ns: int) -> bool:
        """Whether the picture with this stamp is to be published; to be asked once for each.

        While a picture is under way no other one is wanted, unless lossless: it would be old when its turn comes.
        """
        busy = self._sending and not self._lossless
        return self.subscribers > 0 and not busy and self._limit.passes(stamp_ns, self.settings.rate)

    def refresh(self) -> None:
        """To be called periodically."""
        self._participant.poll()

    def take(self, image: Image, owner: object, encoding: str, header: Header) -> None:
        """A picture, which must not be written to any more. owner: without which its memory is not valid.

        Returns at once, unless lossless.
        """
        codec = Codec(self.settings.format, self.settings.jpeg_quality, self.settings.png_level)
        self._worker.put(_Job(image, owner, encoding, header, codec))

    def flush(self) -> None:
        """Waits for the acknowledgement of the last picture."""
        self._worker.flush()
        self._publisher.flush()

    def close(self) -> None:
        """To be called before the node is destroyed."""
        self._worker.close()
        self._participant.close()

    def _publish(self, job: _Job) -> None:
        cdr = compressed_cdr(job.image, job.encoding, job.header, job.codec)
        self._sending = True
        try:
            self._publisher.send(cdr)
            if not self._lossless:  # a newer one would take the place of this one in the midst of it
                self._publisher.wait_until_taken(_PATIENCE_S)
        finally:
            self._sending = False
