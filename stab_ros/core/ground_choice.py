"""Which of the planes that move is the ground: the cues, in the order in which they count, and what they leave open.

Motion alone cannot say it: a camera that drifts with the water sees what a camera that stands over the ground sees.
So each pair of planes is weighed by

1. persistence: ground keeps its template; the share of the features in a plane's own territory that are on it,
2. spread: banks lie on either side of the water; how much of the other plane the convex hull of one encloses,
3. drift: a hovering camera moves little; how far each plane was carried during the start,
4. size,

as logarithms of odds that add up. Each of them is bounded, so none can silence the others. (A polygon or a static map
comes before them all: with either there is nothing to choose.) Where the sum stays small, the choice is ambiguous, and
that is said.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np

from stab_ros.core.geometry import apply, grid
from stab_ros.core.planes import Plane
from stab_ros.core.types import FloatArray, Homography, IdArray

_PERSISTENCE, _SPREAD, _SIZE = 2.0, 3.5, 0.25  # odds, in units of their logarithms
_MOST_BY_DRIFT = 2.0
_HOVERING = 0.0015  # of the picture's width: a hovering camera drifts that much while a start lasts
_AMBIGUOUS = 1.0  # odds of e to 1
_APART_PX = 1.0  # planes that part by less are no different choice
_LEAST_SHARE = 0.1  # of both planes' features: a rival has at least that many


Rate: TypeAlias = tuple[float, float]  # (x, y) px/s


@dataclass(frozen=True)
class Rival:
    """A plane that may be the ground as well as the chosen one.

    share: of the features of both planes that are the rival's. rate_px: (x, y) px/s, where the rival goes in the
    reference while the chosen plane stands still. ground_drift_px, drift_px: (x, y) px/s, where the chosen plane and
    the rival go in the picture. odds: logarithm of how much more likely the choice is than the rival.
    """

    share: float
    rate_px: Rate
    ground_drift_px: Rate
    drift_px: Rate
    odds: float

    def spread(self, ref_H_cur: Homography, elapsed_s: float) -> FloatArray:
        """Covariance (8, 8) of h00 .. h21 if the rival is the ground: where the frame would then be, squared."""
        away = np.array(self.rate_px) * elapsed_s
        change = np.concatenate([away[0] * ref_H_cur[2], away[1] * ref_H_cur[2], np.zeros(2)])
        return np.asarray(np.outer(change, change))

    def __str__(self) -> str:
        chosen, other = (f"goes {_heading(drift)}" for drift in (self.ground_drift_px, self.drift_px))
        return (f"what is ground is ambiguous: taken is a plane with {100 * (1 - self.share):.0f} % of the features, "
                f"which {chosen}; another with {100 * self.share:.0f} %, which {other}, may be it as well; "
                "name the water in exclude or the banks in roi")


def _heading(rate_px: Rate) -> str:
    """A speed as words; 0 degrees is to the right, 90 down."""
    degrees = round(math.degrees(math.atan2(rate_px[1], rate_px[0]))) % 360
    return f"{math.hypot(*rate_px):.1f} px/s towards {degrees} degrees"


@dataclass(frozen=True, eq=False)
class Choice:
    """The plane taken for the ground, and its strongest rival (None: there is no doubt)."""

    ground: Plane
    rival: Rival | None


@dataclass(frozen=True, eq=False)
class Scene:
    """What the choice is made from: places (N, 2) px of all features, size (width, height), and seconds per frame."""

    reference_px: FloatArray
    size: tuple[int, int]
    elapsed_s: FloatArray


def choose_ground(planes: list[Plane], scene: Scene) -> Choice:
    """The plane, of at least one, that is more likely the ground than any other."""
    cues = [_cues(plane, planes, scene) for plane in planes]
    odds = np.array([[a.odds_against(b) for b in cues] for a in cues])
    best = int(np.argmax(np.min(odds, axis=1)))
    rivals = [rival for k in range(len(planes)) if k != best
              if (rival := _rival(planes[best], planes[k], odds[best, k], scene)) is not None]
    return Choice(planes[best], min(rivals, key=lambda rival: rival.odds, default=None))


@dataclass(frozen=True, eq=False)
class _Cues:
    """persistence: share of its territory. hull: (n, 2). places: (n, 2) of its features. drift: of the width."""

    persistence: float
    hull: FloatArray
    places: FloatArray
    drift: float

    def odds_against(self, other: _Cues) -> float:
        """Logarithm of the odds that this plane is the ground and not the other one."""
        spread = _enclosed(other.places, self.hull) - _enclosed(self.places, other.hull)
        drift = math.log((_HOVERING**2 + other.drift**2) / (_HOVERING**2 + self.drift**2))
        return (_PERSISTENCE * math.log(self.persistence / other.persistence) + _SPREAD * spread
                + max(-_MOST_BY_DRIFT, min(drift, _MOST_BY_DRIFT))
                + _SIZE * math.log(len(self.places) / len(other.places)))


def _cues(plane: Plane, planes: list[Plane], scene: Scene) -> _Cues:
    places = scene.reference_px[plane.member]
    hull = cv2.convexHull(places.astype(np.float32)).reshape(-1, 2)
    last_px = apply(plane.last, grid(scene.size))
    drift_px = math.hypot(*np.mean(last_px - grid(scene.size), axis=0))
    return _Cues(_persistence(plane, planes, scene), np.asarray(hull), places, drift_px / scene.size[0])


def _persistence(plane: Plane, planes: list[Plane], scene: Scene) -> float:
    """The share of the plane's features among all that are nearer to one of them than to any other plane's."""
    owner = np.full(len(scene.reference_px), -1)
    for k, one in enumerate(planes):
        owner[one.member] = k
    lost, kept = np.flatnonzero(owner < 0), np.flatnonzero(owner >= 0)
    nearest = _nearest(scene.reference_px[lost], scene.reference_px[kept])
    own = planes.index(plane)
    return len(plane) / (len(plane) + int(np.sum(owner[kept][nearest] == own)))


def _nearest(points: FloatArray, others: FloatArray) -> IdArray:
    """(n,) which of the `others` (m, 2) is nearest to each of the points (n, 2)."""
    matches = cv2.BFMatcher(cv2.NORM_L2).match(points.astype(np.float32), others.astype(np.float32))
    return np.array([match.trainIdx for match in matches], np.int64)


def _enclosed(places: FloatArray, hull: FloatArray) -> float:
    """Share of the places (n, 2) inside a convex outline (m, 2)."""
    outline = hull.reshape(-1, 1, 2).astype(np.float32)
    return float(np.mean([cv2.pointPolygonTest(outline, (x, y), False) >= 0 for x, y in places.tolist()]))


def _rival(chosen: Plane, other: Plane, odds: float, scene: Scene) -> Rival | None:
    """The other plane as a rival, if it is one."""
    if odds >= _AMBIGUOUS or len(other) < _LEAST_SHARE * (len(chosen) + len(other)):
        return None
    both = np.flatnonzero(~np.isnan(chosen.ref_H_cur[:, 0, 0]) & ~np.isnan(other.ref_H_cur[:, 0, 0]))
    centre = np.array([[scene.size[0] / 2, scene.size[1] / 2]])
    ground_px = np.array([apply(np.linalg.inv(chosen.ref_H_cur[f]), centre)[0] for f in both])
    other_px = np.array([apply(np.linalg.inv(other.ref_H_cur[f]), centre)[0] for f in both])
    away_px = np.array([apply(chosen.ref_H_cur[f], at[None])[0] for f, at in zip(both, other_px, strict=True)]) - centre
    if np.abs(away_px).max(initial=0) < _APART_PX:
        return None
    elapsed_s = scene.elapsed_s[both]
    rate, ground_drift, drift = (_rate(elapsed_s, far) for far in (away_px, ground_px - centre, other_px - centre))
    return Rival(len(other) / (len(chosen) + len(other)), rate, ground_drift, drift, odds)


def _rate(elapsed_s: FloatArray, away_px: FloatArray) -> Rate:
    """px/s of the line through the origin and (n, 2) px after (n,) s; zero where no time has passed."""
    x, y = elapsed_s @ away_px / max(float(elapsed_s @ elapsed_s), 1e-9)
    return float(x), float(y)
