"""Features that two patterns pull at, as where the bed shows through the water: they are looked for once more.

From one frame to the next two patterns that move apart are one picture to a window, which follows a mean of both. Soon
it no longer looks as it did, is cut anew, and its track goes on wrong, with a small sigma at each step. At the end of
the interval the patterns lie apart: there the first look is found with the water it began on, or with the bed. So
where something is seen to stand (`particles_standing`), features that have lost their first look are sought by it in
the last frame, and what their tracks say is not trusted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from stab_ros.core.types import BoolArray, FloatArray, IdArray
from stab_ros.velocimetry.carried import Footprints
from stab_ros.velocimetry.comparison import compared
from stab_ros.velocimetry.particles_standing import CHI2_99, over_what_stands, squares
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.places import pixels_of, place_derivatives, places_of
from stab_ros.velocimetry.settings import VelocityConfig
from stab_ros.velocimetry.tracks import Tracks
from stab_ros.velocimetry.windows import TERMS, cut_windows

# Correlation with the first look at which a feature counts as found, and how much above that at any other place. Found
# with the bed of bench/velocimetry/peers_disturbances.py: of features that had lost it two thirds are found.
_LEAST_ALIKE, _AHEAD = 0.45, 0.1
_SAME_PX = 2.0  # places so near to each other are one
_REST_PX = 3.0  # by which the water may draw aside what rests
_NEIGHBOURS, _ROUNDS = 8, 2
_BEHIND = 0.5  # of the way of the neighbours; who has gone less is bed
_EXACT_PX = 0.01


@dataclass(frozen=True, eq=False)
class Sightings:
    """Where n features were found best so far.

    Attributes:
        at_px: (n, 2), pixels of the last frame.
        moved_m: (n, 2), since the first frame.
        way_px: (n,), length of `moved_m` in pixels of the first frame.
        covariance_m2: (n, 2, 2), of `moved_m`.
        correlation: (n,) with the first look; 0: not found.
        rival: (n,), the largest correlation at another place.
    """

    at_px: FloatArray
    moved_m: FloatArray
    way_px: FloatArray
    covariance_m2: FloatArray
    correlation: FloatArray
    rival: FloatArray

    @property
    def sure(self) -> BoolArray:
        """(n,) bool, which are found at one place only."""
        return np.asarray((self.correlation >= _LEAST_ALIKE) & (self.correlation - self.rival >= _AHEAD))

    @property
    def at_rest(self) -> BoolArray:
        """(n,) bool, which have not moved as far as can be told beside another pattern."""
        return np.asarray((self.way_px < _REST_PX) | (squares(self.moved_m, self.covariance_m2) <= CHI2_99))

    def take(self, which: IdArray, other: Sightings) -> None:
        """Compares what was found of the features `which`, (m,), with what was found of them elsewhere."""
        apart = np.hypot(*(self.at_px[which] - other.at_px).T) > _SAME_PX
        better = other.correlation > self.correlation[which]
        lesser = np.where(apart, np.minimum(self.correlation[which], other.correlation), 0.0)
        self.rival[which] = np.maximum(self.rival[which], lesser)
        for name in ("at_px", "moved_m", "way_px", "covariance_m2", "correlation"):
            getattr(self, name)[which[better]] = getattr(other, name)[better]


class SecondLook:
    """Seeks features of the first frame of an interval in its last one, by their first look."""

    def __init__(self, tracks: Tracks, which: IdArray, first: PlacedFrame, last: PlacedFrame,
                 config: VelocityConfig) -> None:
        """tracks: finished. which: (n,) of them, that have lost their first look. first, last: with their images."""
        self._tracks, self._which, self._last, self._config = tracks, which, last, config
        self._start_m = tracks.places_m[0]
        self._windows = cut_windows(first.gray, tracks.start_px[which], config.block_px // 2)
        self._footprints = Footprints.of(first, tracks.start_px[which])

    def along_tracks(self) -> Sightings:
        """Sightings of all where their tracks end, with those where they would be at rest as rivals."""
        every, moved_m = np.arange(len(self._which)), self._tracks.places_m[-1] - self._start_m
        found = self._near(every, moved_m[self._which])
        found.take(every, self._near(every, np.zeros((len(every), 2))))
        return found

    def beside_neighbours(self, found: Sightings, trusted: IdArray) -> None:
        """Looks for those that are not surely found where their neighbours have gone.

        trusted: (m,) of all tracks, those over which nothing stands, or that kept their first look.
        """
        moved_m = self._tracks.places_m[-1] - self._start_m
        for _ in range(_ROUNDS):
            sure = found.sure & ~found.at_rest
            known = np.concatenate([self._start_m[trusted], self._start_m[self._which[sure]]])
            gone_m = np.concatenate([moved_m[trusted], found.moved_m[sure]])
            rest = np.flatnonzero(~found.sure)
            if len(known) < _NEIGHBOURS or not len(rest):
                return
            nearest = np.asarray(cKDTree(known).query(self._start_m[self._which[rest]], k=_NEIGHBOURS)[1])
            for k in range(_NEIGHBOURS):
                found.take(rest, self._near(rest, gone_m[nearest[:, k]]))

    def _near(self, these: IdArray, moved_m: FloatArray) -> Sightings:
        """What is seen of `these`, (m,) of the n, where they have moved by so much (m, 2)."""
        start_m = self._start_m[self._which[these]]
        near_px = pixels_of(self._last, start_m + moved_m)
        aligned, _ = compared(self._windows, these, self._footprints[these], self._last,
                              np.where(np.isfinite(near_px), near_px, -1e6), np.zeros((len(these), 2, TERMS)),
                              self._config, _EXACT_PX)
        at_px = aligned.pose.at_px
        J, _ = place_derivatives(self._last, at_px)
        moved_m, near = places_of(self._last, at_px) - start_m, np.hypot(*(at_px - near_px).T)
        usable = np.isfinite(moved_m).all(axis=1) & (near < self._config.block_px / 3)
        way_px = np.nan_to_num(self._footprints[these].moved_px(start_m + moved_m))
        return Sightings(at_px, moved_m, way_px, J @ aligned.covariance_px2 @ J.transpose(0, 2, 1),
                         np.where(usable, aligned.correlation, 0.0), np.zeros(len(these)))


def look_again(tracks: Tracks, kept_look: BoolArray, first: PlacedFrame, last: PlacedFrame,
               config: VelocityConfig) -> None:
    """Mends tracks that were dragged off the water by what stands, or lets go of them.

    Tracks that kept their first look, and all where nothing is seen to stand, are as they were. What is found at rest,
    or far behind its neighbours, counts as bed.

    Args:
        tracks: finished; those that are let go are marked in `tracks.dragged`.
        kept_look: (N,) bool, which were compared with their first look to the end.
        first: frame of the interval.
        last: frame of the interval.
        config: the settings.
    """
    lost_look = np.flatnonzero((tracks.end_frame > 0) & ~kept_look)
    doubtful = np.zeros(len(tracks), bool)
    doubtful[lost_look] = over_what_stands(tracks, lost_look, first, last, config)
    which, sound = np.flatnonzero(doubtful & tracks.alive), np.flatnonzero(tracks.alive & ~doubtful)
    tracks.dragged = doubtful
    if len(which):
        look = SecondLook(tracks, which, first, last, config)
        found = look.along_tracks()
        look.beside_neighbours(found, sound)
        sure = found.sure & ~_left_behind(tracks, which, found, np.flatnonzero(tracks.alive & kept_look))
        tracks.put_end(which[sure], found.at_px[sure], found.moved_m[sure], found.covariance_m2[sure])
        tracks.dragged[which[sure]] = False
    tracks.drop(np.flatnonzero(tracks.dragged))


def _left_behind(tracks: Tracks, which: IdArray, found: Sightings, kept: IdArray) -> BoolArray:
    """(n,) bool, which of `which`, (n,) tracks, were found at rest, or far behind those of `kept`, (m,), that go."""
    start_m = tracks.places_m[0]
    moved_m = tracks.places_m[-1] - start_m
    go = kept[squares(moved_m[kept], tracks.covariance_m2[kept]) > CHI2_99]
    if len(go) < _NEIGHBOURS:
        return found.at_rest
    nearest = np.asarray(cKDTree(start_m[go]).query(start_m[which], k=_NEIGHBOURS)[1])
    way_m = np.median(np.hypot(*moved_m[go].T)[nearest], axis=1)
    return np.asarray(found.at_rest | (np.hypot(*found.moved_m.T) < _BEHIND * way_m))
