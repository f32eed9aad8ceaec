"""Registers a frame whose rows swing: the rows may have spoilt the homography, or kept it from being found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from stab_ros.core.row_shifts import RowShifts
from stab_ros.core.types import Correspondences, Fit, FloatArray, Gray, Homography
from stab_ros.estimation.rows import RowResiduals, residuals_by_rows
from stab_ros.tracking.anchor import Anchor
from stab_ros.tracking.registration import Registration

Match: TypeAlias = tuple[Correspondences, Fit | None]

_MOST = 0.7  # of the features that a frame should show


@dataclass(frozen=True)
class RowRegistration:
    """By the settings of `registration`; size: width and height of the frames, px."""

    registration: Registration
    size: tuple[int, int]

    def residuals(self, pairs: Correspondences, trust: FloatArray, fit: Fit) -> RowResiduals:
        """What the homography alone leaves over the rows."""
        return residuals_by_rows(pairs, trust, fit.ref_H_cur, self.size)

    def solve(self, pairs: Correspondences, guess: Homography, trust: FloatArray,
              rows: RowShifts | None = None) -> Fit | None:
        """As `Registration.solve_rows`."""
        return self.registration.solve_rows(pairs, guess, trust, rows)

    def near(self, anchor: Anchor, gray: Gray, guess: Homography, chains: bool) -> Match | None:
        """A registration with displacements of the rows that explains most features; None where there is none.

        gray: (h, w) uint8. guess: predicted ref_H_cur. chains: see `Anchor.register`.
        """
        found = anchor.register_rows(gray, guess, self.solve, chains)
        return found if found is not None and _explains_most(found, anchor) else None

    def improved(self, anchor: Anchor, gray: Gray, match: Match, chains: bool) -> Match:
        """A registration without rows, or one with displacements of the rows from there on."""
        pairs, fit = match
        if fit is None:
            return match
        if not self.residuals(pairs, anchor.trust[pairs.feature_id], fit).hint and _explains_most(match, anchor):
            return match
        found = anchor.register_rows(gray, fit.ref_H_cur, self.solve, chains)
        return match if found is None else found


def _inliers(match: Match) -> int:
    return 0 if match[1] is None else int(match[1].inlier.sum())


def _explains_most(match: Match, anchor: Anchor) -> bool:
    """Whether most of the features that the frame should show agree with the fit."""
    pairs, fit = match
    return fit is not None and anchor.support(pairs, fit).share >= _MOST
