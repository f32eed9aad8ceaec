"""Features that are compared, in every frame, with how they looked first.

Where a feature goes is predicted by its motion on the water plane, so that the camera's motion and its lens are no part
of the search; only in its first step, if no velocity is known, is it sought by pyramidal optical flow. As it is
compared with its first look, errors do not add up from frame to frame. A feature that no longer looks as it did is
compared with how it looked last; its errors up to there remain.

Where one pattern A fades into another B, the picture being cos(a) A + sin(a) B, a window goes astray by <A', B>, what
the gradient of A has in common with B; and a window that is cut at a later a by the same, as <A', B> = -<B', A>. So the
errors of successive windows are of one sign, and their standard deviations are added, not their variances.
"""

from __future__ import annotations

import numpy as np

from stab_ros.core.covariance import roots
from stab_ros.core.types import FloatArray, IdArray
from stab_ros.velocimetry.carried import Footprints
from stab_ros.velocimetry.comparison import compared
from stab_ros.velocimetry.optical_flow import followed
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.places import pixels_of, place_derivatives, places_of
from stab_ros.velocimetry.second_look import look_again
from stab_ros.velocimetry.settings import VelocityConfig
from stab_ros.velocimetry.tracks import Tracks
from stab_ros.velocimetry.windows import TERMS, cut_windows

_ROUGH_PX, _EXACT_PX = 0.1, 0.01  # where alignments end: in the frames between, and in the last one


class TemplateFollower:
    """`Follower` by templates."""

    def __init__(self, frame: PlacedFrame, start_px: FloatArray, config: VelocityConfig,
                 velocity_m_s: FloatArray | None = None) -> None:
        """Cuts the templates.

        Args:
            frame: the first one of the interval.
            start_px: (N, 2), pixels as taken.
            config: the settings.
            velocity_m_s: (N, 2), expected; NaN or None: unknown.
        """
        n = len(start_px)
        self._config, self._first, self._last = config, frame, frame
        self._tracks = Tracks.begun(frame, start_px, places_of(frame, start_px))
        self._windows = cut_windows(frame.gray, start_px, config.block_px // 2)
        self._footprints = Footprints.of(frame, start_px)
        self._tracks.alive &= np.isfinite(self._footprints.corners_m).all(axis=(1, 2))
        self._velocity = np.full((n, 2), np.nan) if velocity_m_s is None else velocity_m_s.copy()  # in the last step
        self._bent_px_s = np.zeros((n, 2, TERMS))  # by how much windows deform
        self._before_m = np.zeros((n, 2, 2))  # root of the covariance of the places at which windows were cut
        self._since_m2 = np.zeros((n, 2, 2))  # of the places relative to those
        self._at_px, self._found = start_px.copy(), np.zeros(n, bool)

    @property
    def tracks(self) -> Tracks:
        return self._tracks

    def follow(self, frame: PlacedFrame) -> None:
        self._found[:] = False
        alive, known = self._tracks.alive, np.isfinite(self._velocity[:, 0])
        expected_px = self._expected_px(frame)
        self._seek(frame, np.flatnonzero(alive & known), expected_px)
        changed = np.flatnonzero(alive & known & ~self._found & (self._footprints.stamp_ns < self._last.stamp_ns))
        self._renew(changed)
        self._seek(frame, changed, expected_px)
        if self._last is self._first:
            self._seek_by_flow(frame, np.flatnonzero(alive & ~self._found))
        self._keep(frame)

    def finish(self) -> Tracks:
        if self._last is not self._first:
            self._refine()
            self._check_backward()
        self._tracks.covariance_m2 = self._covariance_m2()
        if self._last is not self._first:
            look_again(self._tracks, self._footprints.stamp_ns == self._first.stamp_ns, self._first, self._last,
                       self._config)
        return self._tracks

    def _covariance_m2(self) -> FloatArray:
        """(N, 2, 2), of the places relative to the start: the square of the sum of the roots."""
        before, since = self._before_m, self._since_m2
        both = before @ roots(since)
        return np.asarray(before @ before + both + both.transpose(0, 2, 1) + since)

    def _expected_px(self, frame: PlacedFrame) -> FloatArray:
        """(N, 2), where the features should be if they keep their velocity; those without one are taken to rest."""
        step_s = (frame.stamp_ns - self._last.stamp_ns) * 1e-9
        expected = pixels_of(frame, self._tracks.places_m[-1] + np.nan_to_num(self._velocity) * step_s)
        return np.where(np.isfinite(expected), expected, self._tracks.end_px)

    def _seek(self, frame: PlacedFrame, which: IdArray, near_px: FloatArray, within_px: float = _ROUGH_PX) -> None:
        """Compares the windows `which`, (n,), with the frame near pixels (N, 2), until they move less than so much."""
        elapsed_s = self._footprints.elapsed_s(frame)
        assumed_px = self._bent_px_s[which] * elapsed_s[which, None, None]
        aligned, good = compared(self._windows, which, self._footprints[which], frame, near_px[which], assumed_px,
                                 self._config, within_px)
        which, pose = which[good], aligned.pose[good]
        self._found[which], self._at_px[which] = True, pose.at_px
        self._bent_px_s[which] = pose.bent_px / elapsed_s[which, None, None]
        J, _ = place_derivatives(frame, pose.at_px)
        self._since_m2[which] = J @ aligned.covariance_px2[good] @ J.transpose(0, 2, 1)

    def _seek_by_flow(self, frame: PlacedFrame, which: IdArray) -> None:
        """Finds the features `which`, (n,), of which no velocity is known that holds, by pyramidal optical flow."""
        places_m, start_px = self._tracks.places_m[0][which], self._tracks.start_px[which]
        at_rest_px = pixels_of(frame, places_m)
        at_rest_px = np.where(np.isfinite(at_rest_px), at_rest_px, start_px)
        near_px = self._at_px.copy()
        near_px[which], consistent = followed(self._first.gray, frame.gray, start_px, at_rest_px, self._config)
        self._seek(frame, which[consistent], near_px)

    def _renew(self, which: IdArray) -> None:
        """Cuts the windows `which`, (n,), anew where they were in the last frame."""
        if not len(which):
            return
        at_px = self._tracks.end_px[which]
        self._windows.put(which, cut_windows(self._last.gray, at_px, self._windows.radius))
        self._footprints.put(which, Footprints.of(self._last, at_px))
        self._before_m[which] += roots(self._since_m2[which])
        self._since_m2[which], self._bent_px_s[which] = 0.0, 0.0

    def _keep(self, frame: PlacedFrame) -> None:
        which = np.flatnonzero(self._found)
        places_m, step_s = places_of(frame, self._at_px[which]), (frame.stamp_ns - self._last.stamp_ns) * 1e-9
        self._velocity[which] = (places_m - self._tracks.places_m[-1][which]) / step_s
        self._tracks.seen(frame, which, self._at_px[which], places_m)
        self._last = frame

    def _refine(self) -> None:
        """Finds those that are seen in the last frame to the last hundredth of a pixel."""
        tracks = self._tracks
        which = np.flatnonzero(tracks.alive)
        self._seek(self._last, which, tracks.end_px, _EXACT_PX)
        tracks.end_px[which] = self._at_px[which]
        tracks.places_m[-1][which] = places_of(self._last, self._at_px[which])

    def _check_backward(self) -> None:
        """Drops features that are not found where they began, seen from the last frame."""
        tracks = self._tracks
        whole = np.flatnonzero(tracks.alive & (self._footprints.stamp_ns == self._first.stamp_ns))
        if not len(whole):
            return
        windows = cut_windows(self._last.gray, tracks.end_px[whole], self._windows.radius)
        footprints = Footprints.of(self._last, tracks.end_px[whole])
        backward_px = -self._bent_px_s[whole] * footprints.elapsed_s(self._first)[:, None, None]
        aligned, good = compared(windows, np.arange(len(whole)), footprints, self._first, tracks.start_px[whole],
                                 backward_px, self._config, _ROUGH_PX)
        off_px = np.hypot(*(aligned.pose.at_px - tracks.start_px[whole]).T)
        tracks.drop(whole[~good | (off_px > self._config.max_bidirectional_px)])
