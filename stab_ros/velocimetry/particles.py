"""Particle tracking: features of the water are followed through an interval, and each gives one vector.

As KLT-IV (Perks 2020, section 2.1): from the first to the last position of each, then features are detected anew. The
last frame of an interval is the first of the next one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from stab_ros.core.types import BoolArray, FloatArray, Gray
from stab_ros.velocimetry.dropped import repeats_doubt
from stab_ros.velocimetry.filters import PARTS, Candidates, filtered
from stab_ros.velocimetry.follow import Follower
from stab_ros.velocimetry.follow_klt import KltFollower
from stab_ros.velocimetry.follow_template import TemplateFollower
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.places import places_of
from stab_ros.velocimetry.plane_mask import PlaneMask
from stab_ros.velocimetry.repeating import usual_period_px
from stab_ros.velocimetry.seeding import seeds
from stab_ros.velocimetry.settings import VelocityConfig
from stab_ros.velocimetry.tracks import Tracks
from stab_ros.velocimetry.vector_errors import vectors_of
from stab_ros.velocimetry.vectors import Unit, Vectors

_NEIGHBOURS = 3  # vectors of the last interval from which the velocity of a new feature is expected
_MANY = 0.2  # share of features that are lost or dropped from which on the texture is asked whether it repeats
_EARLY_NS = 2_000_000  # by which stamps may fall short of `extract_s`


@dataclass(frozen=True, eq=False)
class Interval:
    """What became of the features of an interval.

    Attributes:
        start_ns: stamp of its first frame.
        end_ns: stamp of its last frame.
        frames: number of them.
        seeded: number of features that were detected.
        lost: of those, how many were lost before they gave a vector.
        dropped: how many vectors each filter has dropped, by its name; before those `dragged`: features that a bed or
            waves have pulled off the water, see `second_look`.
        kept: number of vectors that are left.
        doubts: what is doubtful of them, by kind.
    """

    start_ns: int
    end_ns: int
    frames: int
    seeded: int
    lost: int
    dropped: Mapping[str, int] = field(default_factory=dict)
    kept: int = 0
    doubts: Mapping[str, str] = field(default_factory=dict)


class Particles:
    """`Method` by particle tracking.

    Attributes:
        last: what became of the features of the last interval; None: none has ended yet.
        tracks: those of the last interval, with their places in every frame; None as `last`.
    """

    follows = True  # see `Method`

    def __init__(self, config: VelocityConfig, water: PlaneMask | None = None, unit: Unit = "m") -> None:
        """Prepares for a stream.

        Args:
            config: the settings.
            water: where on the plane features may begin; None: everywhere.
            unit: of the plane of the frames.
        """
        self._config, self._water, self._unit = config, water, unit
        self._follower: Follower | None = None
        self._previous: PlacedFrame | None = None
        self._next_id = 0
        self._gray: Gray = np.zeros((0, 0), np.uint8)  # of the first frame of the interval
        self._vectors: Vectors | None = None  # of the interval before; None: of another reference, or there are none
        self.last: Interval | None = None
        self.tracks: Tracks | None = None

    @property
    def dropped(self) -> Mapping[str, int]:
        """See `Method`."""
        return {} if self.last is None else self.last.dropped

    @property
    def doubts(self) -> Mapping[str, str]:
        """See `Method`."""
        return {} if self.last is None else self.last.doubts

    def add(self, frame: PlacedFrame) -> Vectors | None:
        """Takes the next frame; see `Method.add`.

        Where the frame cannot belong to the interval (another epoch, or a gap), the interval ends with the frame
        before it.
        """
        if self._follower is None or self._is_apart(frame):
            vectors, self._vectors = self.finish(), None
            self._begin(frame)
            return vectors
        self._follower.follow(frame)
        self._previous = frame
        if frame.stamp_ns - self._start_ns < self._config.extract_s * 1e9 - _EARLY_NS:
            return None
        vectors = self._vectors = self.finish()
        self._begin(frame)
        return vectors

    def finish(self) -> Vectors | None:
        """The vectors of the interval under way; None: it has no second frame."""
        follower, self._follower = self._follower, None
        if follower is None or len(follower.tracks.frames) < 2:
            return None
        tracks = follower.finish()
        found = tracks.end_frame > 0
        vectors = vectors_of(tracks, found, self._next_id, self._config.time_sigma_s, self._unit)
        result = filtered(Candidates(vectors, parts_m_s(tracks, found)), self._config)
        self.tracks, self._next_id = tracks, self._next_id + len(tracks)
        stamps_ns, dropped = tracks.stamps_ns, {"dragged": int(np.count_nonzero(tracks.dragged)), **result.dropped}
        self.last = Interval(int(stamps_ns[0]), int(stamps_ns[-1]), len(stamps_ns), len(tracks),
                             int(np.count_nonzero(~found & ~tracks.dragged)), dropped, len(result.vectors),
                             self._doubts(tracks, len(result.vectors)))
        return result.vectors

    def _doubts(self, tracks: Tracks, kept: int) -> Mapping[str, str]:
        """Whether features are lost since their texture repeats, and those that are left may be wrong alike."""
        gone = len(tracks) - kept
        period_px = np.inf if gone <= _MANY * len(tracks) else usual_period_px(self._gray, tracks.start_px)
        return {"repeats": repeats_doubt(period_px, gone, len(tracks))} if np.isfinite(period_px) else {}

    @property
    def _start_ns(self) -> int:
        assert self._follower is not None
        return self._follower.tracks.frames[0].stamp_ns

    def _begin(self, frame: PlacedFrame) -> None:
        start_px = seeds(frame, self._water, self._config)
        self._previous, self._gray = frame, frame.gray
        if self._config.follow == "klt":
            self._follower = KltFollower(frame, start_px, self._config)
        else:
            expected = None if self._vectors is None else nearby(self._vectors, places_of(frame, start_px))
            self._follower = TemplateFollower(frame, start_px, self._config, expected)

    def _is_apart(self, frame: PlacedFrame) -> bool:
        before = self._previous
        if before is None or frame.epoch != before.epoch or frame.gray.shape != before.gray.shape:
            return True
        return not 0 < frame.stamp_ns - before.stamp_ns <= self._config.max_gap_s * 1e9


def parts_m_s(tracks: Tracks, found: BoolArray) -> FloatArray:
    """Velocities (n, 3, 2) in the thirds of the tracks `found`, (N,) bool; NaN where a track has fewer steps."""
    which, places_m = np.flatnonzero(found), np.stack(tracks.places_m)
    ends = tracks.end_frame[which]
    bounds = np.round(np.linspace(0, 1, PARTS + 1)[:, None] * ends).astype(np.int64)  # (4, n)
    at_m = places_m[bounds, which]
    dt_s = np.diff(tracks.stamps_ns[bounds] * 1e-9, axis=0)[:, :, None]
    velocity = np.divide(np.diff(at_m, axis=0), dt_s, out=np.full_like(at_m[1:], np.nan), where=dt_s > 0)
    return np.asarray(velocity.transpose(1, 0, 2))


def nearby(vectors: Vectors, places_m: FloatArray) -> FloatArray:
    """Velocities (N, 2) to be expected at places (N, 2): the median of the nearest ends; NaN where there are few."""
    shown = np.isfinite(places_m).all(axis=1)
    expected = np.full_like(places_m, np.nan)
    if len(vectors) >= _NEIGHBOURS:
        _, nearest = cKDTree(vectors.end_m).query(places_m[shown], k=_NEIGHBOURS)
        expected[shown] = np.median(vectors.velocity_m_s[nearest], axis=1)
    return expected
