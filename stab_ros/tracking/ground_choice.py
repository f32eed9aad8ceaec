"""Which of the moving planes is the ground, and how sure that is.

The likeliest by its cues (`ground_cues`). (A polygon or a static map replaces them all.) Where the log odds against
another plane stay small, the choice is ambiguous, and that plane is kept as a competing hypothesis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stab_ros.core.types import FloatArray
from stab_ros.tracking.distinct_planes import distinct
from stab_ros.tracking.ground_cues import GroundCues, Observations, cues_of
from stab_ros.tracking.planes import Plane
from stab_ros.tracking.steady_motion import Rate, rate_of, unsteady_px

CERTAIN_ODDS = 1.65  # odds of 5 to 1, more than drift and size alone can give
_CAUTION = 1.0
_APART_PX = 1.0  # planes that separate by less make no difference
_UNSTEADY = 0.3  # largest share of the separation that is not in proportion to time


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


def choose_ground(planes: list[Plane], seen: Observations, provisional: bool = False) -> Choice:
    """The most likely ground among one or more planes.

    provisional: too little was seen to be certain, so any other plane is a competing hypothesis, whatever the odds.
    """
    cues = cues_of(distinct(planes, seen.reference_px), seen)
    odds = np.array([[a.odds_against(b) for b in cues] for a in cues])
    best = int(np.argmax(np.min(odds - _cautions(cues), axis=1)))
    others = [k for k in np.argsort(odds[best]).tolist() if k != best]  # the most likely one first
    certain = math.inf if provisional else CERTAIN_ODDS
    found = (_competing(cues[best], cues[k], certain) for k in others)
    return Choice(cues[best].plane, tuple(other for other in found if other is not None))


def _cautions(cues: list[GroundCues]) -> FloatArray:
    """(n, n) log odds that a plane at rest needs against one that moves.

    If that is water, the uncertainty spans both. If it is not, the other one is an overlay, and nothing would tell once
    the view moves.
    """
    at_rest = np.array([of.plane.at_rest for of in cues])
    return np.asarray(_CAUTION * (at_rest[:, None] & ~at_rest))


def _competing(chosen: GroundCues, other: GroundCues, certain: float) -> CompetingHypothesis | None:
    """The other plane as a hypothesis; None where the odds are `certain`, or the two do not separate steadily."""
    odds, ground, plane = chosen.odds_against(other), chosen.plane, other.plane
    if odds >= certain:
        return None
    both, centre = ground.known & plane.known, other.features_px.mean(axis=0)[None]  # where it is known best
    at_px = plane.current_px(centre)
    away_px, ground_px, plane_px = (px[both, 0] - centre
                                    for px in (ground.reference_px(at_px), ground.current_px(centre), at_px))
    elapsed_s = chosen.seen.elapsed_s[both]
    rate, ground_drift, drift = (rate_of(elapsed_s, far) for far in (away_px, ground_px, plane_px))
    sway_px, overlaid = unsteady_px(elapsed_s, away_px), ground.at_rest is not plane.at_rest
    steady = sway_px < _UNSTEADY * float(np.sqrt(np.mean(np.sum(away_px**2, axis=1))))
    if np.abs(away_px).max(initial=0) < _APART_PX or not (steady or overlaid):
        return None  # water moves off steadily; blur shifts edges, too, but they stay where they are
    share = len(plane) / (len(ground) + len(plane))
    return CompetingHypothesis(plane, share, rate, ground_drift, drift, odds, chosen.odds_without_drift(other), sway_px,
                               overlaid)
