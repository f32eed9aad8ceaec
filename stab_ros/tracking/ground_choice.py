"""Which of the moving planes is the ground: the cues, in the order of their weight, and the ambiguity they leave.

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

as log odds that add up. Each of them is bounded, so none can outweigh all others. (A polygon or a static map replaces
them all.) Where the sum stays small, the choice is ambiguous, and the other plane is kept as a competing hypothesis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypeAlias

import cv2
import numpy as np

from stab_ros.core.geometry import apply, grid, point_jacobian
from stab_ros.core.types import BoolArray, FloatArray, Homography, IdArray
from stab_ros.tracking.planes import Plane

_PERSISTENCE, _SPREAD, _SIZE = 2.0, 3.5, 0.25  # log odds
_MOST_BY_DRIFT = 1.0  # after a second; evidence grows with time
_HOVERING = 0.0015  # of the image width: drift of a hovering camera during the start-up
_SWAY_PX = 0.5  # of a plane beyond a steady motion: neither for nor against a moving camera
_MOTION, _MOST_BY_MOTION = 1.5, 3.0
_SCATTERED = 4.0
_BESIDE = 1.6  # times the mean distance of the features
CERTAIN_ODDS = 1.65  # odds of 5 to 1, more than drift and size alone can give
_CAUTION = 1.0
_APART_PX = 1.0  # planes that separate by less make no difference
_SAME_PX = 0.1  # planes that never separate by more are one, parted by frames that show neither well,
_SHOWN_TOGETHER = 0.5  # in at least so many of the frames
_UNSTEADY = 0.3  # largest share of the separation that is not in proportion to time


Rate: TypeAlias = tuple[float, float]  # (x, y) px/s


@dataclass(frozen=True, eq=False)
class CompetingHypothesis:
    """Another plane that can be the ground.

    share: of the features of both planes, in [0, 1]. rate_px: (x, y) px/s, velocity of this plane in the reference
    while the chosen one stands still. ground_drift_px, drift_px: (x, y) px/s, velocity of the chosen plane and of this
    one in the image. odds: log odds of the chosen plane against this one; odds_without_drift: by all cues but drift.
    sway_px: RMS of what is not steady in its motion against the chosen plane. overlaid: whether one of the two has not
    moved in the image, so that it can be fixed to the camera.
    """

    plane: Plane
    share: float
    rate_px: Rate
    ground_drift_px: Rate
    drift_px: Rate
    odds: float
    odds_without_drift: float
    sway_px: float = 0.0
    overlaid: bool = False


@dataclass(frozen=True, eq=False)
class Choice:
    """The plane taken for the ground, and the competing hypotheses, the likeliest first (none: the choice is clear).

    planeless: no features moved together as a plane; taken are those that do not contradict the rough homographies.
    """

    ground: Plane
    others: tuple[CompetingHypothesis, ...] = ()
    planeless: bool = False


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


def choose_ground(planes: list[Plane], seen: Observations, provisional: bool = False) -> Choice:
    """The most likely ground among one or more planes.

    provisional: too little was seen to be certain, so any other plane is a competing hypothesis, whatever the odds.
    """
    planes = _distinct(planes, seen)
    cues = _cues(planes, seen)
    odds = np.array([[a.odds_against(b) for b in cues] for a in cues])
    best = int(np.argmax(np.min(odds - _cautions(planes), axis=1)))
    others = [k for k in np.argsort(odds[best]).tolist() if k != best]  # the most likely one first
    certain = math.inf if provisional else CERTAIN_ODDS
    found = (_competing(planes[best], planes[k], cues[best], cues[k], seen, certain) for k in others)
    return Choice(planes[best], tuple(other for other in found if other is not None))


def _distinct(planes: list[Plane], seen: Observations) -> list[Plane]:
    """The planes, the largest first; one that moves as a larger one does is part of it."""
    kept: list[Plane] = []
    for plane in sorted(planes, key=len, reverse=True):
        same = next((k for k, other in enumerate(kept) if _are_one(plane, other, seen)), None)
        if same is None:
            kept.append(plane)
        else:
            kept[same] = replace(kept[same], member=kept[same].member | plane.member)
    return kept


def _are_one(plane: Plane, other: Plane, seen: Observations) -> bool:
    """Whether two planes never separate, where the features of the smaller one lie."""
    both = np.flatnonzero(~np.isnan(plane.ref_H_cur[:, 0, 0]) & ~np.isnan(other.ref_H_cur[:, 0, 0]))
    if plane.at_rest or other.at_rest or len(both) < _SHOWN_TOGETHER * len(seen.elapsed_s):
        return False
    at_px = seen.reference_px[plane.member]
    apart = [apply(other.ref_H_cur[f] @ np.linalg.inv(plane.ref_H_cur[f]), at_px) - at_px for f in both.tolist()]
    return max(float(np.median(np.hypot(*off.T))) for off in apart) < _SAME_PX


def _cautions(planes: list[Plane]) -> FloatArray:
    """(n, n) log odds that a plane at rest needs against one that moves.

    If that is water, the uncertainty spans both. If it is not, the other one is an overlay, and nothing would tell once
    the view moves.
    """
    at_rest = np.array([plane.at_rest for plane in planes])
    return np.asarray(_CAUTION * (at_rest[:, None] & ~at_rest))


@dataclass(frozen=True, eq=False)
class _Cues:
    """Cues of one plane.

    power: (N,) of all features. kept, lost, stays: (N,) bool, its own, those that were lost in its Voronoi cells, and
    all that its motion keeps in view. hull, features_px: (n, 2), of its own. away_px: (F, 2) how far its centre has
    moved in the image, NaN where that is not known. turn_px: how far its features have by rotation and scale.
    drift_px: at the end of the start-up. width_px: of the image. elapsed_s: (F,). at_rest: of `Plane`. scattered: log
    odds that it is scattered over the scene.
    """

    power: FloatArray
    kept: BoolArray
    lost: BoolArray
    stays: BoolArray
    hull: FloatArray
    features_px: FloatArray
    away_px: FloatArray
    turn_px: float
    drift_px: float
    width_px: int
    elapsed_s: FloatArray
    at_rest: bool
    scattered: float

    def odds_against(self, other: _Cues) -> float:
        """Log odds that this plane is the ground and not the other one."""
        elapsed_s = float(self.elapsed_s[-1])
        return self.odds_without_drift(other) + drift_odds(self.drift_px, other.drift_px, self.width_px, elapsed_s)

    def odds_without_drift(self, other: _Cues) -> float:
        """The same by all cues but drift."""
        return (_PERSISTENCE * self._persistence_odds(other)
                + _SIZE * math.log(len(self.features_px) / len(other.features_px))
                + (self._spread(other) if self.at_rest is other.at_rest else self._motion(other)))

    def _persistence_odds(self, other: _Cues) -> float:
        """Log ratio of both planes' persistence, among features of equal texture unless one is an overlay.

        Noise takes the weaker ones, so what of all was kept is a lower bound, also where hardly any is as strong.
        """
        overlaid = self.at_rest is not other.at_rest
        usual = 0.0 if overlaid else max(self._usual_power, other._usual_power)
        own, others = (max(one._persistence(two, 0.0), one._persistence(two, usual))
                       for one, two in ((self, other), (other, self)))
        return math.log(own / others)

    def _persistence(self, other: _Cues, least_power: float) -> float:
        """Share of the features with so much power that were not lost, as Laplace estimates it from few.

        What the other plane takes out of view, and this one does not, can have left the picture with it.
        """
        lost = self.lost & ~(self.stays & ~other.stays)
        kept_n, lost_n = (np.sum(self.power[of] >= least_power) for of in (self.kept, lost))
        return float((kept_n + 1) / (kept_n + lost_n + 2))

    @property
    def _usual_power(self) -> float:
        return float(np.median(self.power[self.kept]))

    def _spread(self, other: _Cues) -> float:
        return _SPREAD * (_enclosed(other.features_px, self.hull) - _enclosed(self.features_px, other.hull))

    def _motion(self, other: _Cues) -> float:
        """Where one of the two is at rest: log odds that it is fixed to the camera, if that is the other one."""
        if self.at_rest:
            return -other._motion(self)
        return _motion_odds(math.hypot(self.turn_px, self._sway_beside(other))) + other.scattered

    def _sway_beside(self, other: _Cues) -> float:
        """RMS distance from a steady motion, seen from the other plane, px: a camera at rest sways in the wind."""
        away_px = self.away_px - other.away_px
        known = ~np.isnan(away_px[:, 0])
        return _unsteady_px(self.elapsed_s[known], away_px[known])


def drift_odds(own_px: float, other_px: float, width_px: int, elapsed_s: float) -> float:
    """Log odds that a plane that moved by `own_px` is the ground, and not one that moved by `other_px`.

    The drift of the camera has a Cauchy distribution: it hovers, but now and then it does not.
    """
    time = math.sqrt(max(elapsed_s, 1.0))
    usual_px, most = _HOVERING * width_px * time, _MOST_BY_DRIFT * time
    odds = math.log((usual_px**2 + other_px**2) / (usual_px**2 + own_px**2))
    return max(-most, min(odds, most))


def drift_px(ref_H_cur: Homography, size: tuple[int, int]) -> float:
    """How far a frame of `size` (width, height) has moved, on average over its grid, px."""
    return math.hypot(*np.mean(apply(ref_H_cur, grid(size)) - grid(size), axis=0))


def _cues(planes: list[Plane], seen: Observations) -> list[_Cues]:
    found = []
    for plane, lost in zip(planes, _lost_beside(planes, seen), strict=True):
        features_px = seen.reference_px[plane.member]
        hull = np.asarray(cv2.convexHull(features_px.astype(np.float32)).reshape(-1, 2))
        found.append(_Cues(seen.power, plane.member, lost, _stays_in_view(plane, seen), hull, features_px,
                           _away_px(plane, features_px), _turn_px(plane, features_px), drift_px(plane.last, seen.size),
                           seen.size[0], seen.elapsed_s, plane.at_rest, _scattered_odds(plane, seen)))
    return found


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


def _away_px(plane: Plane, features_px: FloatArray) -> FloatArray:
    """(F, 2) how far the centre of its features (n, 2) has moved in the image, px; NaN where that is not known."""
    known = np.flatnonzero(~np.isnan(plane.ref_H_cur[:, 0, 0]))
    centre = features_px.mean(axis=0)[None]
    away_px = np.full((len(plane.ref_H_cur), 2), np.nan)
    away_px[known] = [apply(np.linalg.inv(plane.ref_H_cur[f]), centre)[0] for f in known] - centre
    return away_px


def _share_near(points: FloatArray, others: FloatArray, within_px: float) -> float:
    """Share of the points (n, 2) that have one of the others (m, 2) near by."""
    nearest = others[_nearest(points, others)]
    return float(np.mean(np.hypot(*(points - nearest).T) < within_px))


def _stays_in_view(plane: Plane, seen: Observations) -> BoolArray:
    """(N,) bool: which features lie in every frame where the reference has any, if they move with the plane."""
    low, high = seen.reference_px.min(axis=0), seen.reference_px.max(axis=0)
    known = plane.ref_H_cur[~np.isnan(plane.ref_H_cur[:, 0, 0])]
    at_px = np.stack([apply(np.linalg.inv(H), seen.reference_px) for H in known])
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


def _competing(chosen: Plane, other: Plane, cues: _Cues, of_other: _Cues, seen: Observations,
               certain: float) -> CompetingHypothesis | None:
    """The other plane as a hypothesis; None where the odds are `certain`, or the two do not separate steadily."""
    odds, share = cues.odds_against(of_other), len(other) / (len(chosen) + len(other))
    if odds >= certain:
        return None
    both = np.flatnonzero(~np.isnan(chosen.ref_H_cur[:, 0, 0]) & ~np.isnan(other.ref_H_cur[:, 0, 0]))
    centre = seen.reference_px[other.member].mean(axis=0)[None]  # where it is known best
    ground_px = np.array([apply(np.linalg.inv(chosen.ref_H_cur[f]), centre)[0] for f in both])
    other_px = np.array([apply(np.linalg.inv(other.ref_H_cur[f]), centre)[0] for f in both])
    away_px = np.array([apply(chosen.ref_H_cur[f], at[None])[0] for f, at in zip(both, other_px, strict=True)]) - centre
    elapsed_s = seen.elapsed_s[both]
    rate, ground_drift, drift = (_rate(elapsed_s, far) for far in (away_px, ground_px - centre, other_px - centre))
    sway_px, overlaid = _unsteady_px(elapsed_s, away_px), chosen.at_rest is not other.at_rest
    steady = sway_px < _UNSTEADY * float(np.sqrt(np.mean(np.sum(away_px**2, axis=1))))
    if np.abs(away_px).max(initial=0) < _APART_PX or not (steady or overlaid):
        return None  # water moves off steadily; blur shifts edges, too, but they stay where they are
    return CompetingHypothesis(other, share, rate, ground_drift, drift, odds, cues.odds_without_drift(of_other),
                               sway_px, overlaid)


def _unsteady_px(elapsed_s: FloatArray, away_px: FloatArray) -> float:
    """RMS distance of (n, 2) px after (n,) s from the steady motion that fits them best."""
    unsteady = away_px - elapsed_s[:, None] * np.array(_rate(elapsed_s, away_px))
    return float(np.sqrt(np.mean(np.sum(unsteady**2, axis=1))))


def _rate(elapsed_s: FloatArray, away_px: FloatArray) -> Rate:
    """px/s of the line through the origin and (n, 2) px after (n,) s; zero where no time has passed."""
    x, y = elapsed_s @ away_px / max(float(elapsed_s @ elapsed_s), 1e-9)
    return float(x), float(y)
