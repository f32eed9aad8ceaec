"""A rating curve: discharge as a power law of stage, Q = a (h - h0)^b."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from stab_ros.core.errors import InputError
from stab_ros.core.text import counted
from stab_ros.core.types import FloatArray
from stab_ros.discharge.iso748 import sigma_by_number

_LEAST_EXPONENT, _LARGEST_EXPONENT = 0.3, 8.0  # of b
_STARTS = (0.03, 0.1, 0.3, 1.0, 3.0)  # distance of h0 below the lowest stage, over the range of stages
_NEAREST = 1e-4  # of h0 to the lowest stage, over the range
_FARTHEST = 20.0  # likewise
_LEAST_SIGMA = sigma_by_number(35)  # relative: no gauging has more verticals in the table of ISO 748


@dataclass(frozen=True)
class Gauging:
    """One pair of stage and discharge.

    Attributes:
        stage_m: h.
        q_m3_s: Q.
        sigma_m3_s: its standard deviation; 0: not known.
        shared_sigma: the part of it that all gaugings share, over Q, as the error of one alpha.
        source: where it is from.
        own_sigma: the part of it that the gauging has by itself, over Q; None: what the other two leave.
        recording: digest of the velocities, by which the gauging is known again; empty: not known.

    Raises:
        InputError: not finite, or no discharge above 0.
    """

    stage_m: float
    q_m3_s: float
    sigma_m3_s: float = 0.0
    shared_sigma: float = 0.0
    source: str = ""
    own_sigma: float | None = None
    recording: str = ""

    def __post_init__(self) -> None:
        sigmas = self.sigma_m3_s, self.shared_sigma, self.own_sigma or 0.0
        if not np.isfinite((self.stage_m, self.q_m3_s, *sigmas)).all() or self.q_m3_s <= 0 or min(sigmas) < 0:
            raise InputError(f"a gauging of {self.q_m3_s:g} m3/s +- {self.sigma_m3_s:g} at {self.stage_m:g} m, it must "
                             "have a discharge above 0, no sigma below 0, and finite numbers")

    @property
    def own(self) -> float | None:
        """Relative standard deviation by itself; None: not known.

        Where only the whole and the shared part are known it is what they leave, which is coarse where the whole is
        little more than the shared part: the whole is that of a Monte Carlo, to some per cent of itself.
        """
        if self.own_sigma is not None or not self.sigma_m3_s:
            return self.own_sigma
        return float(np.sqrt(max((self.sigma_m3_s / self.q_m3_s) ** 2 - self.shared_sigma**2, 0.0)))


@dataclass(frozen=True, eq=False)
class Rating:
    """A fitted curve.

    Attributes:
        a: Q at h - h0 = 1 m, m3/s.
        b: the exponent.
        h0_m: the stage of no flow.
        covariance: (3, 3) of ln a, b, h0, without what gaugings share.
        shared: (3,), change of ln a, b, h0 by one standard deviation of what gaugings share.
        shared_sigma: median of that over Q, of the gaugings.
        scatter: standard deviation of ln Q around the curve over what the gaugings' own sigma, of 1 % at least, says;
            1 where that is not known.
        gaugings: what it was fitted to.
        warnings: one line each.
    """

    a: float
    b: float
    h0_m: float
    covariance: FloatArray
    shared: FloatArray
    shared_sigma: float
    scatter: float
    gaugings: tuple[Gauging, ...]
    warnings: tuple[str, ...] = ()

    def at(self, stage_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Discharges, m3/s, of stages of any shape, and the relative standard deviation of each; 0 and 0 below h0."""
        above = np.asarray(stage_m, float) - self.h0_m
        flows = above > 0
        safe = np.where(flows, above, 1.0)
        jacobian = np.stack([np.ones_like(safe), np.log(safe), -self.b / safe], axis=-1)
        variance = np.einsum("...i,ij,...j->...", jacobian, self.covariance, jacobian) + (jacobian @ self.shared) ** 2
        return np.where(flows, self.a * safe**self.b, 0.0), np.where(flows, np.sqrt(variance), 0.0)


def fit_rating(gaugings: Sequence[Gauging], h0_m: float | None = None) -> Rating:
    """Fits the curve by least squares of ln Q, each weighted by its own relative standard deviation, 1 % at least.

    No gauging counts as better than 1 %, u_m of ISO 748 for 35 verticals and more: its standard deviation does not hold
    all that it errs by, and a few that seem exact would force the curve through themselves. Where the gaugings scatter
    more than their standard deviations say, the covariance grows accordingly.

    Args:
        gaugings: at least three stages, or four where no standard deviation is known; one less with `h0_m`.
        h0_m: the stage of no flow, where it is known.

    Raises:
        InputError: too few stages, or one that is not above `h0_m`.
    """
    stage, log_q = np.array([one.stage_m for one in gaugings]), np.log([one.q_m3_s for one in gaugings])
    sigma, known = _own_sigmas(gaugings)
    free = 2 if h0_m is not None else 3
    needed = free if known else free + 1
    if len(np.unique(stage)) < needed:
        stages = counted(len(np.unique(stage)), "different stage tells", "different stages tell")
        raise InputError(f"{stages} no rating curve, there must be at least {needed}"
                         + ("" if h0_m is not None else "; or give the stage of no flow"))
    if h0_m is not None and stage.min() <= h0_m:
        raise InputError(f"a gauging at {stage.min():g} m, it must lie above the stage of no flow, {h0_m:g} m")
    values = _solved(stage, log_q, sigma, h0_m)
    residual, jacobian = _linearized(values, stage, log_q, sigma)
    spare = len(stage) - free
    chi2 = float((residual**2).sum()) / spare if spare else 1.0
    normal = jacobian[:, :free].T @ jacobian[:, :free]
    covariance, shared, common = np.zeros((3, 3)), np.zeros(3), np.array([one.shared_sigma for one in gaugings])
    covariance[:free, :free] = np.linalg.pinv(normal) * (max(chi2, 1.0) if known else chi2)
    shared[:free] = np.linalg.pinv(normal) @ jacobian[:, :free].T @ (common / sigma)
    rating = Rating(float(np.exp(values[0])), float(values[1]), float(values[2]), covariance, shared,
                    float(np.median(common)), float(np.sqrt(chi2)) if known else 1.0, tuple(gaugings))
    return Rating(**{**vars(rating), "warnings": tuple(_doubts(rating, known))})


def _own_sigmas(gaugings: Sequence[Gauging]) -> tuple[FloatArray, bool]:
    """Relative standard deviation of each by itself, and whether it is known; all alike where it is not."""
    own = [one.own for one in gaugings]
    if None in own:
        return np.ones(len(gaugings)), False
    return np.maximum(np.array(own, float), _LEAST_SIGMA), True


def _solved(stage_m: FloatArray, log_q: FloatArray, sigma: FloatArray, h0_m: float | None) -> FloatArray:
    """(3,), ln a, b and h0."""
    if h0_m is not None:
        return _line(stage_m, log_q, sigma, h0_m)
    lowest, reach = float(stage_m.min()), float(np.ptp(stage_m))
    starts = [_line(stage_m, log_q, sigma, lowest - share * reach) for share in _STARTS]
    start = min(starts, key=lambda values: float((_linearized(values, stage_m, log_q, sigma)[0] ** 2).sum()))
    bounds = ([-np.inf, _LEAST_EXPONENT, lowest - _FARTHEST * reach],
              [np.inf, _LARGEST_EXPONENT, lowest - _NEAREST * reach])
    inside = np.clip(start, np.array(bounds[0]) + 1e-9, np.array(bounds[1]) - 1e-9)

    def residuals(values: FloatArray) -> FloatArray:
        return _linearized(values, stage_m, log_q, sigma)[0]

    def derivatives(values: FloatArray) -> FloatArray:
        return _linearized(values, stage_m, log_q, sigma)[1]

    found = least_squares(residuals, inside, derivatives, bounds, xtol=1e-12, ftol=1e-12, x_scale=[1.0, 1.0, reach])
    return np.asarray(found.x)


def _line(stage_m: FloatArray, log_q: FloatArray, sigma: FloatArray, h0_m: float) -> FloatArray:
    """Ln a and b for a known h0, by linear regression."""
    design = np.column_stack([np.ones_like(stage_m), np.log(stage_m - h0_m)])
    (log_a, b), *_ = np.linalg.lstsq(design / sigma[:, None], log_q / sigma, rcond=None)
    return np.array([log_a, b, h0_m])


def _linearized(values: FloatArray, stage_m: FloatArray, log_q: FloatArray, sigma: FloatArray
                ) -> tuple[FloatArray, FloatArray]:
    """(N,) weighted residuals of ln Q and their (N, 3) derivatives."""
    log_a, b, h0_m = values
    above = np.maximum(stage_m - h0_m, 1e-12)
    predicted = log_a + b * np.log(above)
    derivatives = np.column_stack([np.ones_like(above), np.log(above), -b / above])
    return (predicted - log_q) / sigma, derivatives / sigma[:, None]


def _doubts(rating: Rating, known: bool) -> list[str]:
    found = []
    if rating.b <= _LEAST_EXPONENT * 1.01 or rating.b >= _LARGEST_EXPONENT * 0.99:
        found.append(f"the exponent {rating.b:.2g} is at the bound of what rivers have: the stages do not tell a power "
                     "law")
    if known and rating.scatter > 2:
        found.append(f"the gaugings scatter {rating.scatter:.1f} times as much as their standard deviations say")
    if not known:
        found.append("not all gaugings have a standard deviation, so all count alike")
    return found
