"""Where georeferencing gets the homographies of frames from: a recording, or the stabiliser on the fly."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stab_ros.core.errors import InputError, MessageError
from stab_ros.core.types import Homography
from stab_ros.georeferencing.placement import Motion
from stab_ros.imaging.camera import Camera
from stab_ros.io.bag import Topic, open_bag
from stab_ros.io.camera_message import read_corrected
from stab_ros.io.cdr import CAMERA_INFO
from stab_ros.io.homography_message import read_homography
from stab_ros.io.picture import Picture
from stab_ros.io.topics import HOMOGRAPHY_TOPIC, TRACK_TOPIC, topic_in
from stab_ros.io.track_message import TrackValues, read_track
from stab_ros.jobs.pipeline import PictureTracker

# how a frame lies to the reference; None: it is lost
MotionOf = Callable[[Picture], Motion | None]


@dataclass(eq=False)
class RecordedMotions:
    """The homographies that `stabilize` wrote.

    Attributes:
        camera: whose lens distortion was removed; None: none was.
        reference_size: width and height, px.
        image_H_ref: (3, 3), from pixels of the reference to those of image_stabilized.
        motions: by stamp, ns; None: lost.
        damaged: number of messages that could not be read.
    """

    camera: Camera | None = None
    reference_size: tuple[int, int] | None = None
    image_H_ref: Homography = field(default_factory=lambda: np.eye(3))
    motions: dict[int, Motion | None] = field(default_factory=dict)
    damaged: int = 0

    def of(self, picture: Picture) -> Motion | None:
        """The motion of the frame with this stamp."""
        return self.motions.get(picture.stamp_ns)


def read_motions(path: Path, namespace: str, topics: Mapping[str, Topic]) -> RecordedMotions | None:
    """Reads the homographies of a camera, and what its tracks tell of them; None: the recording has none.

    Args:
        path: the recording.
        namespace: of the camera.
        topics: of the recording, by name.
    """
    homography, track = topic_in(namespace, HOMOGRAPHY_TOPIC), topic_in(namespace, TRACK_TOPIC)
    known = topics.get(homography)
    if known is None or known.msgtype != CAMERA_INFO or not known.count:
        return None
    found, tracks = RecordedMotions(), dict[int, TrackValues]()
    with open_bag(path) as bag:
        for message in bag.messages([name for name in (homography, track) if name in topics]):
            try:
                if message.topic == track:
                    values = read_track(message.data)
                    tracks[values.stamp_ns] = values
                else:
                    _take(found, message.data)
            except MessageError:
                found.damaged += 1
    for values in tracks.values():
        _complete(found, values)
    return found


def _take(found: RecordedMotions, cdr: bytes) -> None:
    stamp_ns, H = read_homography(cdr)
    found.motions[stamp_ns] = None if H is None else Motion(H)
    if H is not None and found.reference_size is None:
        found.reference_size, found.camera = read_corrected(cdr)


def _complete(found: RecordedMotions, values: TrackValues) -> None:
    """Adds what the track of a frame tells: covariance, reset_counter, and the window of image_stabilized."""
    motion = found.motions.get(values.stamp_ns)
    if motion is not None:
        found.motions[values.stamp_ns] = Motion(motion.ref_H_cur, values.covariance, values.reset_counter)
        found.image_H_ref = values.window_H_ref


def stabilised_motion(tracker: PictureTracker) -> MotionOf:
    """The motions that the stabiliser finds, frame by frame."""

    def motion_of(picture: Picture) -> Motion | None:
        track = tracker.step(picture).track
        return None if track.ref_H_cur is None else Motion(track.ref_H_cur, track.covariance, track.reset_counter)

    return motion_of


def no_motion(_picture: Picture) -> Motion | None:
    """For orientations that take none."""
    return None


def check_homographies(path: Path, motions: RecordedMotions | None) -> RecordedMotions:
    """Raises InputError for stabilised images without homographies."""
    if motions is None:
        raise InputError(f"{path}: holds stabilised images without their homographies; it must hold both, as stabilize "
                         "writes them")
    return motions
