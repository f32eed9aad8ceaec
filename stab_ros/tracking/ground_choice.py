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
from stab_ros.core.types import FloatArray, Homography, IdArray
from stab_ros.tracking.planes import Plane

_PERSISTENCE, _SPREAD, _SIZE = 2.0, 3.5, 0.25  # odds, in units of their logarithms
_MOST_BY_DRIFT = 1.0  # after a second; evidence grows with time
_HOVERING = 0.0015  # of the picture's width: a hovering camera drifts that much while a start lasts
_AMBIGUOUS = 1.65  # odds of 5 to 1, more than drift and size alone can give
_APART_PX = 1.0  # planes that part by less are no different choice
_UNSTEADY = 0.3  # of the way that two planes part, at most, is not in proportion to the time
_LEAST_SHARE = 0.1  # of both planes' features: a rival has at least that many


Rate: TypeAlias = tuple[float, float]  # (x, y) px/s


@dataclass(frozen=True, eq=False)
class CompetingHypothesis:
    """A plane that may be the ground as well as the chosen one.

    share: of the features of both planes that are the rival's. rate_px: (x, y) px/s, where the rival goes in the
    reference while the chosen plane stands still. ground_drift_px, drift_px: (x, y) px/s, where the chosen plane and
    the rival go in the picture. odds: logarithm of how much more likely the choice is than the rival;
    odds_without_drift: by all cues but the drift.
    """

    plane: Plane
    share: float
    rate_px: Rate
    ground_drift_px: Rate
    drift_px: Rate
    odds: float
    odds_without_drift: float

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
    rival: CompetingHypothesis | None = None


@dataclass(frozen=True, eq=False)
class Observations:
    """What the choice is made from: places (N, 2) px of all features, size (width, height), and seconds per frame."""

    reference_px: FloatArray
    size: tuple[int, int]
    elapsed_s: FloatArray


def choose_ground(planes: list[Plane], scene: Observations, provisional: bool = False) -> Choice:
    """The plane, of at least one, that is more likely the ground than any other.

    provisional: too little was seen to be certain, so each other plane is a rival, whatever the odds.
    """
    cues = _cues(planes, scene)
    odds = np.array([[a.odds_against(b) for b in cues] for a in cues])
    best = int(np.argmax(np.min(odds, axis=1)))
    others = [k for k in np.argsort(odds[best]).tolist() if k != best]  # the most likely one first
    certain = math.inf if provisional else _AMBIGUOUS
    rivals = (_rival(planes[best], planes[k], cues[best], cues[k], scene, certain) for k in others)
    return Choice(planes[best], next((rival for rival in rivals if rival is not None), None))


@dataclass(frozen=True, eq=False)
class _Cues:
    """persistence: share of its territory. hull: (n, 2). places: (n, 2) of its features. drift_px: until the end.

    width_px: of the picture. elapsed_s: how long the start was.
    """

    persistence: float
    hull: FloatArray
    places: FloatArray
    drift_px: float
    width_px: int
    elapsed_s: float

    def odds_against(self, other: _Cues) -> float:
        """Logarithm of the odds that this plane is the ground and not the other one."""
        return self.odds_without_drift(other) + drift_odds(self.drift_px, other.drift_px, self.width_px, self.elapsed_s)

    def odds_without_drift(self, other: _Cues) -> float:
        """The same by all cues but the drift."""
        spread = _enclosed(other.places, self.hull) - _enclosed(self.places, other.hull)
        return (_PERSISTENCE * math.log(self.persistence / other.persistence) + _SPREAD * spread
                + _SIZE * math.log(len(self.places) / len(other.places)))


def drift_odds(own_px: float, other_px: float, width_px: int, elapsed_s: float) -> float:
    """Logarithm of the odds that a plane is the ground, which was carried by `own_px`, and not another.

    A Cauchy distribution of the camera's drift: it hovers, but now and then it does not.
    """
    time = math.sqrt(max(elapsed_s, 1.0))
    usual_px, most = _HOVERING * width_px * time, _MOST_BY_DRIFT * time
    odds = math.log((usual_px**2 + other_px**2) / (usual_px**2 + own_px**2))
    return max(-most, min(odds, most))


def drift_px(ref_H_cur: Homography, size: tuple[int, int]) -> float:
    """How far a frame of `size` (width, height) has been carried, on average over its grid, px."""
    return math.hypot(*np.mean(apply(ref_H_cur, grid(size)) - grid(size), axis=0))


def _cues(planes: list[Plane], scene: Observations) -> list[_Cues]:
    found = []
    for plane, persistence in zip(planes, _persistences(planes, scene), strict=True):
        places = scene.reference_px[plane.member]
        hull = np.asarray(cv2.convexHull(places.astype(np.float32)).reshape(-1, 2))
        found.append(_Cues(persistence, hull, places, drift_px(plane.last, scene.size), scene.size[0],
                           float(scene.elapsed_s[-1])))
    return found


def _persistences(planes: list[Plane], scene: Observations) -> list[float]:
    """The share of each plane's features among all that are nearer to one of them than to any other plane's."""
    owner = np.full(len(scene.reference_px), -1)
    for k, plane in enumerate(planes):
        owner[plane.member] = k
    lost, kept = scene.reference_px[owner < 0], scene.reference_px[owner >= 0]
    strays = np.bincount(owner[owner >= 0][_nearest(lost, kept)], minlength=len(planes))
    return [len(plane) / (len(plane) + int(astray)) for plane, astray in zip(planes, strays, strict=True)]


def _nearest(points: FloatArray, others: FloatArray) -> IdArray:
    """(n,) which of the `others` (m, 2) is nearest to each of the points (n, 2)."""
    matches = cv2.BFMatcher(cv2.NORM_L2).match(points.astype(np.float32), others.astype(np.float32))
    return np.array([match.trainIdx for match in matches], np.int64)


def _enclosed(places: FloatArray, hull: FloatArray) -> float:
    """Share of the places (n, 2) inside a convex outline (m, 2)."""
    outline = hull.reshape(-1, 1, 2).astype(np.float32)
    return float(np.mean([cv2.pointPolygonTest(outline, (x, y), False) >= 0 for x, y in places.tolist()]))


def _rival(chosen: Plane, other: Plane, cues: _Cues, of_other: _Cues, scene: Observations,
           certain: float) -> CompetingHypothesis | None:
    """The other plane as a rival; None where the odds are `certain`, or the two do not part, or not steadily."""
    odds, share = cues.odds_against(of_other), len(other) / (len(chosen) + len(other))
    if odds >= certain or share < _LEAST_SHARE:
        return None
    both = np.flatnonzero(~np.isnan(chosen.ref_H_cur[:, 0, 0]) & ~np.isnan(other.ref_H_cur[:, 0, 0]))
    centre = np.array([[scene.size[0] / 2, scene.size[1] / 2]])
    ground_px = np.array([apply(np.linalg.inv(chosen.ref_H_cur[f]), centre)[0] for f in both])
    other_px = np.array([apply(np.linalg.inv(other.ref_H_cur[f]), centre)[0] for f in both])
    away_px = np.array([apply(chosen.ref_H_cur[f], at[None])[0] for f, at in zip(both, other_px, strict=True)]) - centre
    elapsed_s = scene.elapsed_s[both]
    rate, ground_drift, drift = (_rate(elapsed_s, far) for far in (away_px, ground_px - centre, other_px - centre))
    if np.abs(away_px).max(initial=0) < _APART_PX or not _goes_on(elapsed_s, away_px, rate):
        return None
    return CompetingHypothesis(other, share, rate, ground_drift, drift, odds, cues.odds_without_drift(of_other))


def _goes_on(elapsed_s: FloatArray, away_px: FloatArray, rate: Rate) -> bool:
    """Whether a plane parts steadily, as water does; blur sets edges off, too, but they stay where they are."""
    unsteady = away_px - elapsed_s[:, None] * np.array(rate)
    return bool(np.sum(unsteady**2) < _UNSTEADY**2 * np.sum(away_px**2))


def _rate(elapsed_s: FloatArray, away_px: FloatArray) -> Rate:
    """px/s of the line through the origin and (n, 2) px after (n,) s; zero where no time has passed."""
    x, y = elapsed_s @ away_px / max(float(elapsed_s @ elapsed_s), 1e-9)
    return float(x), float(y)
