"""The part of an evaluation that depends only on the reference, computed once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stab_ros.core.gray import GreyRange, grey_range, to_gray
from stab_ros.core.region import Area
from stab_ros.core.types import BoolArray, FloatArray, Frame, Gray, Homography, IdArray
from stab_ros.evaluation.settings import EvaluatorConfig, NamedPoint
from stab_ros.metrics.alignment import follow
from stab_ros.metrics.camera_fixed import CameraFixed
from stab_ros.metrics.comparison import PointComparison, compare
from stab_ros.metrics.correlation import Correlator
from stab_ros.metrics.homologous import HomologousPoints
from stab_ros.metrics.hot_pixels import HotPixels
from stab_ros.metrics.noise import NoiseGauge, interpolated_share
from stab_ros.metrics.overlap import valid_overlap, windows_inside
from stab_ros.metrics.rmsd import cut
from stab_ros.metrics.velocity_field import VelocityField
from stab_ros.metrics.verification import VerificationPoint, calibrated_points, choose_points

_AREA_PX = 64  # interrogation area around a verification point
_USUAL_WINDOW_PX = 31  # Ljubicic et al. 2021, section 3.2


@dataclass(frozen=True, eq=False)
class View:
    """An image warped to the reference, at P verification points. valid: (h, w) bool, the overlap.

    windows: (P, N, N), usable: (P,) those within the overlap. shifts_px: (P, 2) against the reference, NaN where the
    correlation found no match; searched: (P,) where it was computed. noise_variance: (P,), grey levels^2. fixed_H_ref:
    (3, 3), from a place in the reference to where the same pixel of the camera is in this image; None: unknown.
    """

    gray: Gray
    valid: BoolArray
    windows: FloatArray
    usable: BoolArray
    shifts_px: FloatArray
    searched: BoolArray
    noise_variance: FloatArray
    fixed_H_ref: Homography | None


@dataclass(frozen=True, eq=False)
class ReferenceMeasures:
    """The reference and everything needed to measure frames against it.

    centres_px: (P, 2) int64, of the verification points. view: of the reference itself. ref_H_raw: (3, 3), by which it
    was itself warped. hot_pixels: of the camera, which are left out of every image.
    """

    frame: Frame
    shown: GreyRange
    points: tuple[VerificationPoint, ...]
    centres_px: IdArray
    window_px: int
    gauge: NoiseGauge
    correlator: Correlator
    homologous: HomologousPoints
    velocity: VelocityField
    view: View
    ref_H_raw: Homography
    hot_pixels: HotPixels

    def view_of(self, frame: Frame, ref_H_cur: Homography | None) -> View:
        """The view of `frame`, which has the size of the reference. ref_H_cur: the homography of its warp, if known."""
        fixed_H_ref = self._fixed_H_ref(ref_H_cur)
        gray = self.hot_pixels.removed(to_gray(frame, self.shown), fixed_H_ref)
        valid = valid_overlap(gray, ref_H_cur)
        searched = windows_inside(valid, self.correlator.areas_px, self.correlator.window_px)
        shifts_px = self.correlator.shifts(gray, searched, valid)
        usable = windows_inside(valid, self.centres_px, self.window_px)
        return View(gray, valid, cut(gray, self.centres_px, self.window_px), usable, shifts_px, searched,
                    self._noise_variance(gray, ref_H_cur), fixed_H_ref)

    def _fixed_H_ref(self, ref_H_cur: Homography | None) -> Homography | None:
        return None if ref_H_cur is None else np.asarray(ref_H_cur @ np.linalg.inv(self.ref_H_raw))

    def camera_fixed(self) -> CameraFixed:
        """The votes on what is fixed to the camera, at its beginning."""
        return CameraFixed(self.view.gray, self.view.windows, self.centres_px, self.gauge.sigma(self.view.gray))

    def _noise_variance(self, gray: Gray, ref_H_cur: Homography | None) -> FloatArray:
        """At least the known share of noise after bilinear warping, whose averaging the gauge underestimates."""
        measured = np.full(len(self.points), self.gauge.sigma(gray) ** 2)
        if ref_H_cur is None:
            return measured
        share = interpolated_share(ref_H_cur, self.centres_px, self.window_px)
        return np.asarray(np.maximum(measured, share * self.view.noise_variance))

    def compare(self, before: View, after: View, clear: BoolArray) -> PointComparison:
        """Compares the windows of two views at the points in `clear`, (P,) bool."""
        moved_px = after.shifts_px - before.shifts_px
        return compare(self.points, before.windows, after.windows,
                       follow(after.gray, self.centres_px, self.window_px, moved_px),
                       moved_px, before.usable & after.usable & clear,
                       before.noise_variance + after.noise_variance)


def measures_of(frame: Frame, config: EvaluatorConfig, named_points: Sequence[NamedPoint],
                area: Area, ref_H_raw: Homography) -> ReferenceMeasures:
    """The measures on the reference `frame`; its verification points are the named ones, if any, else chosen in it.

    ref_H_raw: (3, 3), by which it was itself warped.

    Raises:
        InputError: a region or a named point does not fit the image.
    """
    shown = grey_range(frame)
    gray = to_gray(frame, shown)
    hot_pixels = HotPixels(gray)
    gray = hot_pixels.removed(gray, np.eye(3))
    gauge = NoiseGauge(gray)
    sigma = gauge.sigma(gray)
    allowed = area.allowed(frame.size) & valid_overlap(gray, None)
    points = (calibrated_points(gray, named_points, config.window_px, sigma) if named_points
              else choose_points(gray, allowed, config.points, config.window_px, sigma))
    centres_px = np.array([(point.x_px, point.y_px) for point in points], np.int64).reshape(-1, 2)
    window_px = points[0].calibration.window_px if points else config.window_px or _USUAL_WINDOW_PX
    return ReferenceMeasures(
        frame, shown, points, centres_px, window_px, gauge, Correlator(gray, centres_px, _AREA_PX),
        HomologousPoints(gray, allowed), VelocityField(gray, allowed, config.svf_columns, config.svf_rows),
        _still(gray, centres_px, window_px, sigma), ref_H_raw, hot_pixels)


def _still(gray: Gray, centres_px: IdArray, window_px: int, sigma: float) -> View:
    count = len(centres_px)
    return View(gray, np.ones(gray.shape, bool), cut(gray, centres_px, window_px), np.ones(count, bool),
                np.zeros((count, 2)), np.ones(count, bool), np.full(count, sigma**2), np.eye(3))
