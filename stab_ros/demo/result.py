"""The results of the live nodes, compared with the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stab_ros.core.geometry import rms_distance
from stab_ros.core.types import FloatArray, Homography, LostReason, State, Track
from stab_ros.demo.replay import HOMOGRAPHY, STABILIZED, TRACK
from stab_ros.io.bag import open_bag
from stab_ros.io.camera_message import read_size
from stab_ros.io.cdr import read_stamp
from stab_ros.io.diagnostics_message import read_values
from stab_ros.io.homographies import HomographyRow, HomographyWriter
from stab_ros.io.homography_message import read_homography
from stab_ros.tracking.settings import StabilizerConfig

_START_NS = round(StabilizerConfig().start_s * 1e9)


@dataclass(frozen=True, eq=False)
class Answers:
    """Homographies and track values by the stamp of the frame. images: stamps of the stabilised images."""

    homographies: Mapping[int, Homography | None]
    tracks: Mapping[int, Mapping[str, str]]
    images: frozenset[int]
    size: tuple[int, int]


@dataclass(frozen=True, eq=False)
class ReplayResult:
    """The results of all frames, by number; errors in px, RMS over the 9x9 grid, of the compared ones.

    late: frames in the start-up buffer, which are answered without an image. at_once: tracked and not late; they have
    images, except those `without_picture`.
    """

    frames: int
    late: Sequence[int]
    unanswered: Sequence[int]
    lost: Sequence[int]
    at_once: Sequence[int]
    without_picture: Sequence[int]
    pictures: int
    compared: Sequence[int]
    motion_px: FloatArray
    error_px: FloatArray

    @property
    def answered(self) -> int:
        return self.frames - len(self.unanswered)

    @property
    def tracked(self) -> int:
        return self.answered - len(self.lost)

    def text(self) -> str:
        """The counts, and the errors as a table."""
        head = f"{self.answered} of {self.frames} frames answered, {self.tracked} tracked, {self.pictures} pictures "
        head += f"(none of the start, {len(self.late)} frames)"
        title = f"{'distance to the truth, px':<28}{'median':>9}{'95 %':>9}{'max':>9}"
        rows = (("as recorded", self.motion_px), ("stabilised", self.error_px))
        return "\n".join([head, "", title, *(f"{name:<28}{_statistics(values)}" for name, values in rows)])


def _statistics(values: FloatArray) -> str:
    if not len(values):
        return f"{'-':>9}{'-':>9}{'-':>9}"
    return "".join(f"{value:9.3f}" for value in np.percentile(values, [50, 95, 100]))


def read_answers(path: Path) -> Answers:
    """Reads the bag of the recorder.

    Raises:
        InputError: it is unreadable.
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
                size = read_size(message.data) or size
            elif message.topic == TRACK:
                tracks[read_stamp(message.data)] = read_values(message.data)
            else:
                images.add(read_stamp(message.data))
    return Answers(homographies, tracks, frozenset(images), size)


def compare(truth: Sequence[HomographyRow], answers: Answers) -> ReplayResult:
    """Joins both by stamp; the reference frame has no error and is left out."""
    found, size = answers.homographies, answers.size
    known = [(row.frame, row.ref_H_cur, ref_H_cur) for row in truth[1:]
             if row.ref_H_cur is not None and (ref_H_cur := found.get(row.stamp_ns)) is not None]
    late = [row.frame for row in truth if _is_late(row, truth[0], answers)]
    at_once = [row for row in truth if found.get(row.stamp_ns) is not None and row.frame not in late]
    return ReplayResult(
        frames=len(truth),
        late=late,
        unanswered=[row.frame for row in truth if row.stamp_ns not in found],
        lost=[row.frame for row in truth if row.stamp_ns in found and found[row.stamp_ns] is None],
        at_once=[row.frame for row in at_once],
        without_picture=[row.frame for row in at_once if row.stamp_ns not in answers.images],
        pictures=sum(row.stamp_ns in answers.images for row in truth),
        compared=[frame for frame, _, _ in known],
        motion_px=np.array([rms_distance(np.eye(3), true, size) for _, true, _ in known]),
        error_px=np.array([rms_distance(ref_H_cur, true, size) for _, true, ref_H_cur in known]),
    )


def _is_late(row: HomographyRow, first: HomographyRow, answers: Answers) -> bool:
    """Whether a frame was in the start-up buffer: by its stamp and that of its reference."""
    reference_ns = int(answers.tracks.get(row.stamp_ns, {}).get("reference_stamp_ns") or first.stamp_ns)
    return 0 < row.stamp_ns - reference_ns < _START_NS


def write_table(path: Path, truth: Sequence[HomographyRow], answers: Answers) -> None:
    """Writes H.csv of the live run: a row for every frame of the recording, LOST without an answer."""
    with HomographyWriter(path) as table:
        for row in truth:
            values = answers.tracks.get(row.stamp_ns, {})
            table.write(row.frame, _track(row, answers.homographies.get(row.stamp_ns), values))


def _track(row: HomographyRow, ref_H_cur: Homography | None, values: Mapping[str, str]) -> Track:
    rmse_px, sigma_px = (float(values[key]) if values.get(key) else None for key in ("rmse_px", "sigma_px"))
    reason = LostReason(values.get("lost_reason") or LostReason.UNANSWERED)
    return Track(
        State.LOST if ref_H_cur is None else State.TRACKED, row.frame, row.stamp_ns,
        int(values.get("reference_stamp_ns", 0)), int(values.get("reset_counter", 0)),
        int(values.get("matches", 0)), int(values.get("inliers", 0)), ref_H_cur, rmse_px=rmse_px, sigma_px=sigma_px,
        lost_reason=reason if ref_H_cur is None else None,
    )  # fmt: skip
