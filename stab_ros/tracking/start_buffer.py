"""The start-up: the frames after a reference are buffered until it is known what is static ground.

No images are kept, only the trajectory of each feature. Once the start-up is over, all frames are answered at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from stab_ros.core.geometry import apply, inside
from stab_ros.core.types import BoolArray, Correspondences, Fit, FloatArray, Gray, Homography
from stab_ros.tracking.ambiguity import Ambiguity
from stab_ros.tracking.feature_tracks import FeatureTracks, Trajectories
from stab_ros.tracking.frame_stamp import FrameStamp
from stab_ros.tracking.ground_choice import Choice, choose_ground
from stab_ros.tracking.ground_cues import Observations
from stab_ros.tracking.planes import LEAST_FEATURES, THRESHOLD_PX, Plane, find_planes
from stab_ros.tracking.reference import Reference, is_textured
from stab_ros.tracking.row_motion import Straightened, regrown, without_rows
from stab_ros.tracking.sensor_fixed import SensorFixed
from stab_ros.tracking.static_map import StaticMap
from stab_ros.tracking.support import Support, support_of

_LEAST_FEATURES = 48  # with fewer there is nothing to choose between
# if less of it was seen, as where the first frames were dropped, it takes up to so many times as long
_SEEN_SHARE, _PATIENCE = 0.5, 3
_MOVED_PX = 1.5  # between a plane that is fixed to the camera and one that is not
_RESTING_PX, _TIMES_RESTING = 0.6, 3.5  # at most, while another one moves so many times as far
# features that show no plane, but are where most are: px; in this share of the frames that show them; of all frames
_AGREEING_PX, _AGREES, _SHOWN = 0.6, 0.7, 0.2
_MOST_FRAMES = 120  # where time does not advance


class GroundState(Enum):
    """How far it is known what is ground. PROVISIONAL: frames had to be answered before enough was seen."""

    UNDECIDED = "undecided"
    PROVISIONAL = "provisional"
    DECIDED = "decided"


@dataclass(frozen=True, eq=False)
class BufferedFrame:
    """A frame of the start-up: its matches with the reference, and roughly its homography.

    trust: (N,) weight of each pair, 1 for ground, 0 for the rest. frozen: (N,) bool, what the codec has copied.
    guess: ref_H_cur for the fit to start from. textured: whether it shows anything that could be matched.
    """

    stamp: FrameStamp
    pairs: Correspondences
    trust: FloatArray
    frozen: BoolArray
    guess: Homography
    textured: bool


@dataclass(frozen=True, eq=False)
class StartResult:
    """What the start-up has found.

    frames: those that have no answer yet. reference_px: (N, 2) all features. ground: (N,) bool, those on it.
    fixed_px: (n, 2) features that are fixed to the camera. size: width, height of the reference, px. ambiguities: with
    each other plane that can be the ground as well. turned: whether an earlier result took another plane for it.
    scatter: of that `Plane`. provisional: too little was seen to be certain. rows_swing: by a rolling shutter.
    planeless: as of `Choice`.
    """

    frames: list[BufferedFrame]
    reference_px: FloatArray
    ground: BoolArray
    fixed_px: FloatArray
    static_map: StaticMap
    ambiguities: tuple[Ambiguity, ...]
    size: tuple[int, int]
    turned: bool
    scatter: float
    provisional: bool
    rows_swing: bool
    planeless: bool

    def support(self, pairs: Correspondences, fit: Fit) -> Support:
        """How much of the ground in view agrees with a fit to matches of the features."""
        agrees = np.zeros(len(self.ground), bool)
        agrees[pairs.feature_id[fit.inlier]] = True
        shown = self.ground & inside(apply(np.linalg.inv(fit.ref_H_cur), self.reference_px), self.size)
        return support_of(self.reference_px[shown], np.ones(int(shown.sum())), agrees[shown], self.size)


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
        self._textured: list[bool] = []
        self._answered = 0  # of the frames so far
        self._ground: BoolArray | None = None  # (N,) the features last taken for ground
        self._sensor = SensorFixed(self._tracks.patches)
        self._fixed: BoolArray = np.zeros(len(self._tracks.reference_px), bool)

    @property
    def useful(self) -> bool:
        """Whether the reference has enough features to follow."""
        return len(self._tracks.reference_px) >= _LEAST_FEATURES

    @property
    def has_jumped(self) -> bool:
        """Whether the last frame lies far from the one before it."""
        return self._tracks.has_jumped

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
        return len(self.unanswered)

    @property
    def unanswered(self) -> list[FrameStamp]:
        """The frames that have no answer yet."""
        return self._stamps[self._answered :]

    def follow(self, stamp: FrameStamp, gray: Gray) -> float:
        """Takes the next frame, (h, w) uint8; the share of the features that it shows, 0 if it is not followed."""
        shown = self._tracks.follow(gray)
        self._textured.append(shown > 0 or is_textured(gray))
        self._sensor.add(gray)
        self._stamps.append(stamp)
        return shown

    def result(self, provisional: bool = False) -> StartResult:
        """What is ground, and by that the frames without an answer.

        If no features show a plane, those are ground that are seen now and then where most are (snow hides them in
        turn); if these are too few, all are.

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
        reference_px = trajectories.reference_px
        return StartResult(self._frames(choice.ground, trajectories), reference_px, member,
                           reference_px[self._fixed], self._map(choice.ground), self._ambiguities(choice), self._size,
                           bool(turned), choice.ground.scatter, provisional or not self.enough, straight is not None,
                           choice.planeless)

    def _choice(self, straight: Straightened, provisional: bool) -> Choice:
        trajectories = straight.trajectories
        elapsed_s = (np.array([stamp.time_ns for stamp in self._stamps]) - self._start_ns) / 1e9
        seen = Observations(trajectories.reference_px, self._tracks.patches.power, self._size, elapsed_s)
        before_camera = self._before_camera(straight, seen, provisional)
        if before_camera is not None:
            return before_camera
        self._fixed[:] = False
        planes = find_planes(trajectories, threshold_px=straight.threshold_px)
        if not planes:
            return Choice(Plane(_with_shapes(trajectories), trajectories.shapes), planeless=True)
        return choose_ground(_with_rest(planes, seen), seen, provisional)

    def _before_camera(self, straight: Straightened, seen: Observations, provisional: bool) -> Choice | None:
        """The choice if part of the picture is fixed to the camera; None where nothing is, or the camera is at rest.

        A plane that hardly moves while another one does goes with what is fixed: it shows the scene behind, too.
        """
        fixed = self._sensor.features()
        trajectories = straight.trajectories
        others = find_planes(trajectories, ~fixed, straight.threshold_px) if fixed.any() else []
        moving = [plane for plane in others if _moves(plane, seen)]
        if not moving:
            return None
        fixed = self._fixed = np.any([fixed, *(plane.member for plane in others if plane not in moving)], axis=0)
        at_rest = Plane(fixed, np.tile(np.eye(3), (len(trajectories.shapes), 1, 1)), at_rest=True)
        planes = [*moving, at_rest] if np.sum(fixed) >= LEAST_FEATURES else moving
        choice = choose_ground(planes, seen, provisional)
        return None if choice.ground is at_rest else choice

    def _ambiguities(self, choice: Choice) -> tuple[Ambiguity, ...]:
        return tuple(Ambiguity(other, self._map(other.plane), self._start_ns, self._size) for other in choice.others)

    def _frames(self, ground: Plane, trajectories: Trajectories) -> list[BufferedFrame]:
        """The frames that have no answer yet; they have one with this."""
        first, self._answered = self._answered, len(self._stamps)
        guesses = np.where(np.isnan(ground.ref_H_cur), trajectories.shapes, ground.ref_H_cur)
        frames = []
        for k in range(first, self._answered):
            pairs = trajectories.pairs(k)
            frames.append(BufferedFrame(self._stamps[k], pairs, ground.member[pairs.feature_id].astype(float),
                                        trajectories.frozen[k, pairs.feature_id], guesses[k],
                                        self._textured[k]))
        return frames

    def _map(self, plane: Plane) -> StaticMap:
        return StaticMap.of_features(self._tracks.reference_px, plane.member.astype(float), self._size)


def _with_rest(planes: list[Plane], seen: Observations) -> list[Plane]:
    """The planes, with those told that hardly move while another one does; a scattered one is known less well."""
    moved_px = [plane.moved_px(seen.reference_px) for plane in planes]
    far_less_px = max(moved_px) / _TIMES_RESTING
    return [replace(plane, at_rest=px < min(_RESTING_PX * plane.scatter, far_less_px))
            for plane, px in zip(planes, moved_px, strict=True)]


def _moves(plane: Plane, seen: Observations) -> bool:
    """Whether the plane's features have moved in the image, so far that their templates cannot match in place."""
    return plane.moved_px(seen.reference_px) > _MOVED_PX


def _with_shapes(trajectories: Trajectories) -> BoolArray:
    """(N,) bool: the features that agree with the rough homographies whenever they are seen; all, if they are few."""
    off_px = np.full(trajectories.seen.shape, np.inf)
    for own_px, H, at_px in zip(off_px, trajectories.shapes, trajectories.current_px, strict=True):
        own_px[:] = np.hypot(*(apply(H, at_px) - trajectories.reference_px).T)
    seen = trajectories.seen.sum(axis=0)
    agreed = np.sum(trajectories.seen & (off_px < _AGREEING_PX), axis=0)
    member = (agreed >= _SHOWN * len(trajectories.seen)) & (agreed >= _AGREES * seen)
    return member if np.sum(member) >= LEAST_FEATURES else np.ones(len(member), bool)
