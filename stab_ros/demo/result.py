"""What the live nodes answered, beside the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
from rosbags.typesys.stores import ros2_jazzy as ros

from stab_ros.core.geometry import rms_distance
from stab_ros.core.stabilizer import StabilizerConfig
from stab_ros.core.types import FloatArray, Homography, State, Track
from stab_ros.demo.replay import HOMOGRAPHY, STABILIZED, TRACK
from stab_ros.io.bag import open_bag
from stab_ros.io.homographies import HomographyRow, HomographyWriter
from stab_ros.io.messages import CAMERA_INFO, DIAGNOSTIC_ARRAY, read_homography, read_stamp, typestore

_START_NS = round(StabilizerConfig().start_s * 1e9)


@dataclass(frozen=True, eq=False)
class Answers:
    """By the stamp of the frame: its homography, what else is known of its track; the stamps of the pictures."""

    homographies: Mapping[int, Homography | None]
    tracks: Mapping[int, Mapping[str, str]]
    images: frozenset[int]
    size: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Result:
    """How many frames there were and what became of them; errors in px, RMS over the 9x9 grid, of the tracked ones.

    deferred: those that are answered late, without a picture: the start.
    """

    frames: int
    deferred: int
    answered: int
    tracked: int
    images: int
    motion_px: FloatArray
    error_px: FloatArray

    def text(self) -> str:
        """A few lines to read."""
        head = f"{self.answered} of {self.frames} frames answered, {self.tracked} tracked, {self.images} pictures "
        head += f"(none of the start, {self.deferred} frames)"
        title = f"{'distance to the truth, px':<28}{'median':>9}{'95 %':>9}{'max':>9}"
        rows = (("as recorded", self.motion_px), ("stabilised", self.error_px))
        return "\n".join([head, "", title, *(f"{name:<28}{_statistics(values)}" for name, values in rows)])


def _statistics(values: FloatArray) -> str:
    if not len(values):
        return f"{'-':>9}{'-':>9}{'-':>9}"
    return "".join(f"{value:9.3f}" for value in np.percentile(values, [50, 95, 100]))


def read_answers(path: Path) -> Answers:
    """What is in the bag that the recorder made.

    Raises:
        InputError: it cannot be read.
    """
    homographies: dict[int, Homography | None] = {}
    tracks: dict[int, Mapping[str, str]] = {}
    images: set[int] = set()
    size = (0, 0)
    with open_bag(path) as bag:
        for message in bag.messages({HOMOGRAPHY, TRACK, STABILIZED} & set(bag.topics)):
            if message.topic == HOMOGRAPHY:
                stamp_ns, ref_H_cur = read_homography(message.data)
                homographies[stamp_ns] = ref_H_cur
                size = _reference_size(message.data)
            elif message.topic == TRACK:
                tracks[read_stamp(message.data)] = status_values(message.data)
            else:
                images.add(read_stamp(message.data))
    return Answers(homographies, tracks, frozenset(images), size)


def _reference_size(cdr: bytes) -> tuple[int, int]:
    message = cast(ros.sensor_msgs__msg__CameraInfo, typestore().deserialize_cdr(cdr, CAMERA_INFO))
    return message.width, message.height


def status_values(cdr: bytes) -> Mapping[str, str]:
    """The keys and values of a DiagnosticArray with one status."""
    message = cast(ros.diagnostic_msgs__msg__DiagnosticArray, typestore().deserialize_cdr(cdr, DIAGNOSTIC_ARRAY))
    return {item.key: item.value for item in message.status[0].values}


def compare(truth: Sequence[HomographyRow], answers: Answers) -> Result:
    """Joined by stamp; the reference frame itself has no error and does not count."""
    pairs = [(row.ref_H_cur, answers.homographies.get(row.stamp_ns)) for row in truth]
    known = [(true, found) for true, found in pairs[1:] if true is not None and found is not None]
    return Result(
        frames=len(truth),
        deferred=sum(0 < row.stamp_ns - truth[0].stamp_ns < _START_NS for row in truth),
        answered=sum(row.stamp_ns in answers.homographies for row in truth),
        tracked=sum(found is not None for _, found in pairs),
        images=sum(row.stamp_ns in answers.images for row in truth),
        motion_px=np.array([rms_distance(np.eye(3), true, answers.size) for true, _ in known]),
        error_px=np.array([rms_distance(found, true, answers.size) for true, found in known]),
    )


def write_table(path: Path, truth: Sequence[HomographyRow], answers: Answers) -> None:
    """H.csv of the live run: a row for every frame of the recording, LOST where no answer came."""
    with HomographyWriter(path) as table:
        for row in truth:
            values = answers.tracks.get(row.stamp_ns, {})
            table.write(row.frame, _track(row, answers.homographies.get(row.stamp_ns), values))


def _track(row: HomographyRow, ref_H_cur: Homography | None, values: Mapping[str, str]) -> Track:
    rmse_px, sigma_px = (float(values[key]) if values.get(key) else None for key in ("rmse_px", "sigma_px"))
    return Track(
        State.LOST if ref_H_cur is None else State.TRACKED, row.frame, row.stamp_ns,
        int(values.get("reference_stamp_ns", 0)), int(values.get("reset_counter", 0)),
        int(values.get("matches", 0)), int(values.get("inliers", 0)), ref_H_cur, rmse_px=rmse_px, sigma_px=sigma_px,
    )  # fmt: skip
