"""The start-up: the frames after a reference are buffered until it is known what is static ground.

No images are kept, only the trajectory of each feature. Once the start-up is over, all frames are answered at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from stab_ros.core.geometry import apply, inside
from stab_ros.core.types import BoolArray, Correspondences, FloatArray, Gray, Homography
from stab_ros.tracking.ambiguity import Ambiguity
from stab_ros.tracking.feature_tracks import FeatureTracks, Trajectories
from stab_ros.tracking.frame_stamp import FrameStamp
from stab_ros.tracking.ground_choice import Choice, Observations, choose_ground
from stab_ros.tracking.planes import THRESHOLD_PX, Plane, find_planes
from stab_ros.tracking.reference import Reference
from stab_ros.tracking.row_motion import Straightened, regrown, without_rows
from stab_ros.tracking.static_map import StaticMap

_LEAST_FEATURES = 48  # with fewer there is nothing to choose between
# if less of it was seen, as where the first frames were dropped, it takes up to so many times as long
_SEEN_SHARE, _PATIENCE = 0.5, 3
_MOST_FRAMES = 120  # where time does not advance


class GroundState(Enum):
    """How far it is known what is ground. PROVISIONAL: frames had to be answered before enough was seen."""

    UNDECIDED = "undecided"
    PROVISIONAL = "provisional"
    DECIDED = "decided"


@dataclass(frozen=True, eq=False)
class BufferedFrame:
    """A frame of the start-up: its matches with the reference, and roughly its homography.

    trust: (N,) weight of each pair, 1 for ground, 0 for the rest. guess: ref_H_cur for the fit to start from.
    """

    stamp: FrameStamp
    pairs: Correspondences
    trust: FloatArray
    guess: Homography


@dataclass(frozen=True, eq=False)
class StartResult:
    """What the start-up has found.

    frames: those that have no answer yet. ground_px: (n, 2) features of the ground in the reference. size: width,
    height of the reference, px. ambiguity: if another plane can be the ground as well. turned: whether an earlier
    result took another plane for it. provisional: too little was seen to be certain. rows_swing: by a rolling shutter.
    """

    frames: list[BufferedFrame]
    ground_px: FloatArray
    static_map: StaticMap
    ambiguity: Ambiguity | None
    size: tuple[int, int]
    turned: bool
    provisional: bool
    rows_swing: bool

    def expected(self, ref_H_cur: Homography) -> float:
        """Number of ground features that a frame there should show."""
        return float(inside(apply(np.linalg.inv(ref_H_cur), self.ground_px), self.size).sum())


class StartBuffer:
    """Follows the features of the reference through the frames after it."""

    def __init__(self, reference: Reference, allowed: BoolArray, start_ns: int, duration_ns: int,
                 seek_rows: bool) -> None:
        """allowed: (h, w) bool, where ground can be. start_ns: time of the reference. duration_ns: from there on.

        seek_rows: whether rows may swing by a rolling shutter.
        """
        self._seek_rows = seek_rows
        self._size, self._start_ns, self._duration_ns = reference.frame.size, start_ns, duration_ns
        self._tracks = FeatureTracks(reference.gray, allowed)
        self._stamps: list[FrameStamp] = []
        self._answered = 0  # of the frames so far
        self._ground: BoolArray | None = None  # (N,) the features last taken for ground

    @property
    def useful(self) -> bool:
        """Whether the reference has enough features to follow."""
        return len(self._tracks.reference_px) >= _LEAST_FEATURES

    @property
    def over(self) -> bool:
        """Whether the last frame ends the start-up."""
        if not self._stamps:
            return False
        elapsed_ns = self._stamps[-1].time_ns - self._start_ns
        long = elapsed_ns >= self._duration_ns * (1 if self.enough else _PATIENCE)
        return long or elapsed_ns < 0 or len(self._stamps) >= _MOST_FRAMES

    @property
    def enough(self) -> bool:
        """Whether half of its length was seen."""
        seen_ns = self._stamps[-1].time_ns - self._stamps[0].time_ns if self._stamps else 0
        return seen_ns >= _SEEN_SHARE * self._duration_ns

    @property
    def ground(self) -> GroundState:
        """How far it is known what is ground."""
        return GroundState.PROVISIONAL if self._answered else GroundState.UNDECIDED

    @property
    def waiting(self) -> int:
        """Number of frames that have no answer yet."""
        return len(self._stamps) - self._answered

    def follow(self, stamp: FrameStamp, gray: Gray) -> None:
        """Takes the next frame, (h, w) uint8."""
        self._tracks.follow(gray)
        self._stamps.append(stamp)

    def result(self, provisional: bool = False) -> StartResult:
        """What is ground, and by that the frames without an answer; all is ground if the features show no plane.

        provisional: the start-up is not over; then any other plane counts as a competing hypothesis.
        """
        trajectories = self._tracks.trajectories()
        straight = without_rows(trajectories, self._size) if self._seek_rows else None
        choice = self._choice(straight or Straightened(trajectories, THRESHOLD_PX), provisional)
        if straight is not None:
            choice = replace(choice, ground=regrown(choice.ground, trajectories, self._size))
        member, before = choice.ground.member, self._ground
        turned = before is not None and 2 * np.sum(member & before) < min(np.sum(member), np.sum(before))
        self._ground = member
        return StartResult(self._frames(choice.ground, trajectories), trajectories.reference_px[member],
                           self._map(choice.ground), self._ambiguity(choice), self._size, bool(turned),
                           provisional or not self.enough, straight is not None)

    def _choice(self, straight: Straightened, provisional: bool) -> Choice:
        trajectories = straight.trajectories
        planes = find_planes(trajectories, straight.threshold_px)
        if not planes:
            return Choice(Plane(np.ones(len(trajectories.reference_px), bool), trajectories.shapes))
        elapsed_s = (np.array([stamp.time_ns for stamp in self._stamps]) - self._start_ns) / 1e9
        return choose_ground(planes, Observations(trajectories.reference_px, self._size, elapsed_s), provisional)

    def _ambiguity(self, choice: Choice) -> Ambiguity | None:
        other = choice.other
        return None if other is None else Ambiguity(other, self._map(other.plane), self._start_ns, self._size)

    def _frames(self, ground: Plane, trajectories: Trajectories) -> list[BufferedFrame]:
        """The frames that have no answer yet; they have one with this."""
        first, self._answered = self._answered, len(self._stamps)
        guesses = np.where(np.isnan(ground.ref_H_cur), trajectories.shapes, ground.ref_H_cur)
        frames = []
        for k in range(first, self._answered):
            pairs = trajectories.pairs(k)
            frames.append(BufferedFrame(self._stamps[k], pairs, ground.member[pairs.feature_id].astype(float),
                                        guesses[k]))
        return frames

    def _map(self, plane: Plane) -> StaticMap:
        return StaticMap.of_features(self._tracks.reference_px, plane.member.astype(float), self._size)
