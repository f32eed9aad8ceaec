"""The cues by which a plane is the ground, in the order of their weight.

Motion alone does not tell: a camera that drifts with the water sees what a camera that hovers over the ground sees.
So each pair of planes is compared by

1. persistence: ground keeps its texture; the share of inliers among the features in a plane's Voronoi cells, of those
   that have as much texture as most of either plane: weaker ones are lost to noise, on banks and on water alike. What
   the other plane's motion takes out of view, and this one's does not, may have been the other's and is gone, not lost,
2. spread: banks lie on either side of the water; the share of the other plane's features inside the convex hull of this
   plane's features,
3. drift: a hovering camera moves little; how far each plane moved during the start-up,
4. size,
5. motion, where one of the planes has not moved at all in the image: then it is fixed to the camera, as an overlay, or
   the camera is fixed and the other one is water. A camera turns and sways, water moves on steadily and shears. And
   what is fixed to the camera is scattered over the scene,

as log odds that add up. Each of them is bounded, so none can outweigh all others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.geometry import point_jacobian
from stab_ros.core.types import BoolArray, FloatArray, IdArray
from stab_ros.tracking.drift import drift_odds, drift_px
from stab_ros.tracking.planes import Plane
from stab_ros.tracking.steady_motion import unsteady_px

_PERSISTENCE, _SPREAD, _SIZE = 2.0, 3.5, 0.25  # log odds
_SWAY_PX = 0.5  # of a plane beyond a steady motion: neither for nor against a moving camera
_MOTION, _MOST_BY_MOTION = 1.5, 3.0
_SCATTERED = 4.0
_BESIDE = 1.6  # times the mean distance of the features


@dataclass(frozen=True, eq=False)
class Observations:
    """reference_px: (N, 2) of all features. power: (N,) as of `Patches`. size: width, height, px. elapsed_s: (F,)."""

    reference_px: FloatArray
    power: FloatArray
    size: tuple[int, int]
    elapsed_s: FloatArray

    @property
    def beside_px(self) -> float:
        """Largest distance of features that lie side by side."""
        return _BESIDE * math.sqrt(self.size[0] * self.size[1] / len(self.reference_px))


@dataclass(frozen=True, eq=False)
class GroundCues:
    """Cues of one plane.

    lost, stays: (N,) bool, the features that were lost in the Voronoi cells of its own, and all that its motion keeps
    in view. features_px, hull: (n, 2) and (m, 2) px in the reference, of its own. away_px: (F, 2) how far its centre
    has moved in the image, NaN where that is not known. turn_px: how far its features have by rotation and scale.
    drift_px: at the end of the start-up. scattered: log odds that it is scattered over the scene.
    """

    plane: Plane
    seen: Observations
    lost: BoolArray
    stays: BoolArray
    features_px: FloatArray
    hull: FloatArray
    away_px: FloatArray
    turn_px: float
    drift_px: float
    scattered: float

    def odds_against(self, other: GroundCues) -> float:
        """Log odds that this plane is the ground and not the other one."""
        elapsed_s = float(self.seen.elapsed_s[-1])
        return self.odds_without_drift(other) + drift_odds(self.drift_px, other.drift_px, self.seen.size[0], elapsed_s)

    def odds_without_drift(self, other: GroundCues) -> float:
        """The same by all cues but drift."""
        return (_PERSISTENCE * self._persistence_odds(other)
                + _SIZE * math.log(len(self.features_px) / len(other.features_px))
                + (self._spread(other) if self.plane.at_rest is other.plane.at_rest else self._motion(other)))

    def _persistence_odds(self, other: GroundCues) -> float:
        """Log ratio of both planes' persistence, among features of equal texture unless one is an overlay.

        Noise takes the weaker ones, so what of all was kept is a lower bound, also where hardly any is as strong.
        """
        overlaid = self.plane.at_rest is not other.plane.at_rest
        usual = 0.0 if overlaid else max(self._usual_power, other._usual_power)
        own, others = (max(one._persistence(two, 0.0), one._persistence(two, usual))
                       for one, two in ((self, other), (other, self)))
        return math.log(own / others)

    def _persistence(self, other: GroundCues, least_power: float) -> float:
        """Share of the features with so much power that were not lost, as Laplace estimates it from few.

        What the other plane takes out of view, and this one does not, can have left the picture with it.
        """
        lost = self.lost & ~(self.stays & ~other.stays)
        kept_n, lost_n = (np.sum(self.seen.power[of] >= least_power) for of in (self.plane.member, lost))
        return float((kept_n + 1) / (kept_n + lost_n + 2))

    @property
    def _usual_power(self) -> float:
        return float(np.median(self.seen.power[self.plane.member]))

    def _spread(self, other: GroundCues) -> float:
        return _SPREAD * (_enclosed(other.features_px, self.hull) - _enclosed(self.features_px, other.hull))

    def _motion(self, other: GroundCues) -> float:
        """Where one of the two is at rest: log odds that it is fixed to the camera, if that is the other one."""
        if self.plane.at_rest:
            return -other._motion(self)
        return _motion_odds(math.hypot(self.turn_px, self._sway_beside(other))) + other.scattered

    def _sway_beside(self, other: GroundCues) -> float:
        """RMS distance from a steady motion, seen from the other plane, px: a camera at rest sways in the wind."""
        away_px = self.away_px - other.away_px
        known = ~np.isnan(away_px[:, 0])
        return unsteady_px(self.seen.elapsed_s[known], away_px[known])


def cues_of(planes: list[Plane], seen: Observations) -> list[GroundCues]:
    """The cues of each plane, among these planes."""
    return [_cues(plane, lost, seen) for plane, lost in zip(planes, _lost_beside(planes, seen), strict=True)]


def _cues(plane: Plane, lost: BoolArray, seen: Observations) -> GroundCues:
    features_px = seen.reference_px[plane.member]
    hull = np.asarray(cv2.convexHull(features_px.astype(np.float32)).reshape(-1, 2))
    centre = features_px.mean(axis=0)
    away_px = plane.current_px(centre[None])[:, 0] - centre
    return GroundCues(plane, seen, lost, _stays_in_view(plane, seen), features_px, hull, away_px,
                      _turn_px(plane, features_px), drift_px(plane.last, seen.size), _scattered_odds(plane, seen))


def _scattered_odds(plane: Plane, seen: Observations) -> float:
    """Log odds that the plane is scattered over a scene as an overlay is, whose features lie among those of the scene.

    Banks have their features among themselves, but for the waterline.
    """
    own, others = seen.reference_px[plane.member], seen.reference_px[~plane.member]
    if not len(others):
        return -_SCATTERED
    return _SCATTERED * (_share_near(own, others, seen.beside_px) - _share_near(others, own, seen.beside_px))


def _motion_odds(moved_px: float) -> float:
    """Log odds that a plane moves as a scene does before a camera, and not as water before a camera at rest.

    moved_px: other than steadily and by shear.
    """
    odds = _MOTION * math.log(max(moved_px, 1e-3) / _SWAY_PX)
    return max(-_MOST_BY_MOTION, min(odds, _MOST_BY_MOTION))


def _turn_px(plane: Plane, features_px: FloatArray) -> float:
    """How far its features (n, 2) have moved by rotation and scale, beyond what they have by shear and strain, px."""
    centre = features_px.mean(axis=0)
    (a, b), (c, d) = point_jacobian(np.linalg.inv(plane.last), centre[None])[0] - np.eye(2)
    similar, strained = math.hypot(a + d, c - b) / 2, math.hypot(a - d, b + c) / 2
    return max(0.0, similar - strained) * float(np.sqrt(np.mean(np.sum((features_px - centre) ** 2, axis=1))))


def _share_near(points: FloatArray, others: FloatArray, within_px: float) -> float:
    """Share of the points (n, 2) that have one of the others (m, 2) near by."""
    nearest = others[_nearest(points, others)]
    return float(np.mean(np.hypot(*(points - nearest).T) < within_px))


def _stays_in_view(plane: Plane, seen: Observations) -> BoolArray:
    """(N,) bool: which features lie in every frame where the reference has any, if they move with the plane."""
    low, high = seen.reference_px.min(axis=0), seen.reference_px.max(axis=0)
    at_px = plane.current_px(seen.reference_px)[plane.known]
    return np.asarray(np.all((at_px >= low) & (at_px <= high), axis=(0, 2)))


def _lost_beside(planes: list[Plane], seen: Observations) -> list[BoolArray]:
    """For each plane, (N,) bool: which of the features that are on no plane lie in the Voronoi cells of its own."""
    owner = np.full(len(seen.reference_px), -1)
    for k, plane in enumerate(planes):
        owner[plane.member] = k
    lost, kept = np.flatnonzero(owner < 0), np.flatnonzero(owner >= 0)
    beside = owner[kept][_nearest(seen.reference_px[lost], seen.reference_px[kept])]
    owner[kept] = -1
    owner[lost] = beside
    return [owner == k for k in range(len(planes))]


def _nearest(points: FloatArray, others: FloatArray) -> IdArray:
    """(n,) which of the `others` (m, 2) is nearest to each of the points (n, 2)."""
    matches = cv2.BFMatcher(cv2.NORM_L2).match(points.astype(np.float32), others.astype(np.float32))
    return np.array([match.trainIdx for match in matches], np.int64)


def _enclosed(points: FloatArray, hull: FloatArray) -> float:
    """Share of the points (n, 2) inside a convex hull (m, 2)."""
    outline = hull.reshape(-1, 1, 2).astype(np.float32)
    return float(np.mean([cv2.pointPolygonTest(outline, (x, y), False) >= 0 for x, y in points.tolist()]))
