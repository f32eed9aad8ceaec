"""What the tracker tells of each frame: `homography` and `track`, paired by stamp."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo

from stab_ros.core.errors import MessageError
from stab_ros.core.types import Homography
from stab_ros.georeferencing.placement import Motion
from stab_ros.imaging.camera import Camera
from stab_ros.io.camera_message import read_corrected
from stab_ros.io.homography_message import read_homography
from stab_ros.io.topics import HOMOGRAPHY_TOPIC, TRACK_TOPIC
from stab_ros.io.track_message import TrackValues, read_track
from stab_ros.nodes.qos import AdaptiveSubscription, keep_all_offered
from stab_ros.nodes.stamp_pairing import Pair, StampPairing
from stab_ros.nodes.tracker_subscription import TrackerSubscription

_FIX = "let it offer RELIABLE or BEST_EFFORT, VOLATILE or TRANSIENT_LOCAL"
_WAITING = 1000  # homographies whose track has not come
_LOOKS = 2  # by which the publishers of both topics are found; a track tells what image_stabilized shows


@dataclass(frozen=True, eq=False)
class Told:
    """What the tracker told of a frame. motion: None while lost. window_H_ref: to pixels of image_stabilized."""

    stamp_ns: int
    motion: Motion | None
    window_H_ref: Homography


class MotionInput:
    """Passes on each homography with its covariance and `reset_counter`, which are in `track`; without if none comes.

    received: number of homographies. reference_size: width and height, px; None: no frame was tracked yet. camera:
    whose lens distortion the tracker removes; None: it removes none.
    """

    def __init__(self, node: Node, take: Callable[[Told], None], refused: Callable[[str], None]) -> None:
        self.received = 0
        self.reference_size: tuple[int, int] | None = None
        self.camera: Camera | None = None
        self._take, self._refused = take, refused
        self._alone = 0  # looks in a row at which homographies had come, and nobody published tracks
        self._pairing: StampPairing[Homography | None, TrackValues] = StampPairing(_WAITING)
        self._track = TrackerSubscription(node, DiagnosticArray, TRACK_TOPIC, self._on_track, keep_all_offered,
                                          "homographies are taken without covariance and reset_counter")
        # the last one: a tracker that waits for subscribers of `homography` starts now
        self._homography = AdaptiveSubscription(node, CameraInfo, HOMOGRAPHY_TOPIC, self._on_homography,
                                                keep_all_offered, _FIX)
        self.topic = self._homography.topic

    @property
    def publishers(self) -> int:
        """Of homographies, at the last `refresh`."""
        return self._homography.publishers

    def refresh(self) -> None:
        """Follows the publishers' QoS."""
        self._homography.refresh()
        self._track.refresh(needed=self.received > 0)
        self._alone = 0 if self._track.publishers else self._alone + (self.received > 0)
        if self._alone >= _LOOKS:
            self.flush()

    def close(self) -> None:
        """Passes on what waits, and ends the subscriptions."""
        self.flush()
        self._homography.close()
        self._track.close()

    def flush(self) -> None:
        """Passes on the homographies that wait for their track: it will not come."""
        self._pass_on(self._pairing.flush())

    def _on_homography(self, cdr: bytes, _info: Mapping[str, int]) -> None:
        self.received += 1
        try:
            stamp_ns, ref_H_cur = read_homography(cdr)
            self._learn(cdr, ref_H_cur)
        except MessageError as error:
            self._refused(f"{self.topic}: {error}")
            return
        pairs = self._pairing.ask(stamp_ns, ref_H_cur)
        self._pass_on(pairs if self._alone < _LOOKS else [*pairs, *self._pairing.flush()])

    def _learn(self, cdr: bytes, ref_H_cur: Homography | None) -> None:
        """Size and calibration, from the first homography that has them; those of other programs may lack them."""
        if ref_H_cur is not None and self.reference_size is None:
            with suppress(MessageError):
                self.reference_size, self.camera = read_corrected(cdr)

    def _on_track(self, cdr: bytes, _info: Mapping[str, int]) -> None:
        try:
            values = read_track(cdr)
        except MessageError as error:
            self._refused(f"{self._track.topic}: {error}")
            return
        self._pass_on(self._pairing.answer(values.stamp_ns, values))

    def _pass_on(self, pairs: Iterable[Pair[Homography | None, TrackValues]]) -> None:
        for pair in pairs:
            self._take(_told(pair.stamp_ns, pair.question, pair.answer))


def _told(stamp_ns: int, ref_H_cur: Homography | None, track: TrackValues | None) -> Told:
    window_H_ref = np.eye(3) if track is None else track.window_H_ref
    if ref_H_cur is None:
        return Told(stamp_ns, None, window_H_ref)
    motion = Motion(ref_H_cur) if track is None else Motion(ref_H_cur, track.covariance, track.reset_counter)
    return Told(stamp_ns, motion, window_H_ref)
