"""Features that are followed from frame to frame by pyramidal optical flow alone, as in KLT-IV (Perks 2020).

Errors of the steps add up, and a window that is sheared drifts off the water it began on. How far is measured once, at
the end of the interval, against how the feature looked first.
"""

from __future__ import annotations

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.velocimetry.carried import Footprints
from stab_ros.velocimetry.comparison import compared
from stab_ros.velocimetry.optical_flow import followed
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.places import pixels_of, place_derivatives, places_of
from stab_ros.velocimetry.settings import VelocityConfig
from stab_ros.velocimetry.tracks import Tracks
from stab_ros.velocimetry.windows import TERMS, cut_windows

_EXACT_PX = 0.01


class KltFollower:
    """`Follower` by optical flow from frame to frame."""

    def __init__(self, frame: PlacedFrame, start_px: FloatArray, config: VelocityConfig) -> None:
        """frame: the first one of the interval. start_px: (N, 2), pixels as taken. config: the settings."""
        self._config, self._last = config, frame
        self._tracks = Tracks.begun(frame, start_px, places_of(frame, start_px))
        self._windows = cut_windows(frame.gray, start_px, config.block_px // 2)
        self._footprints = Footprints.of(frame, start_px)
        self._tracks.alive &= np.isfinite(self._footprints.corners_m).all(axis=(1, 2))

    @property
    def tracks(self) -> Tracks:
        return self._tracks

    def follow(self, frame: PlacedFrame) -> None:
        alive = np.flatnonzero(self._tracks.alive)
        at_rest_px = pixels_of(frame, self._tracks.places_m[-1][alive])
        before_px = self._tracks.end_px[alive]
        guess_px = np.where(np.isfinite(at_rest_px), at_rest_px, before_px)
        at_px, consistent = followed(self._last.gray, frame.gray, before_px, guess_px, self._config)
        places_m = places_of(frame, at_px)
        seen = consistent & np.isfinite(places_m).all(axis=1)
        self._tracks.seen(frame, alive[seen], at_px[seen], places_m[seen])
        self._last = frame

    def finish(self) -> Tracks:
        """The tracks, with the drift of each as part of its covariance.

        That of features that cannot be compared with how they looked first, or were lost before the end, is what the
        forward-backward check lets through.
        """
        tracks, n = self._tracks, len(self._tracks)
        covariance_px2 = np.tile(self._config.max_bidirectional_px**2 * np.eye(2), (n, 1, 1))
        last = np.flatnonzero(tracks.alive)
        aligned, good = compared(self._windows, last, self._footprints[last], self._last, tracks.end_px[last],
                                 np.zeros((len(last), 2, TERMS)), self._config, _EXACT_PX)
        drift_px = (tracks.end_px[last] - aligned.pose.at_px)[good]
        covariance_px2[last[good]] = aligned.covariance_px2[good] + drift_px[:, :, None] * drift_px[:, None, :]
        J, _ = place_derivatives(self._last, tracks.end_px)
        tracks.covariance_m2 = J @ covariance_px2 @ J.transpose(0, 2, 1)
        return tracks
