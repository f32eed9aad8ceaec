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

    def improved(self, anchor: Anchor, gray: Gray, guess: Homography, match: Match, chains: bool) -> Match:
        """The match, or one with displacements of the rows; these are sought from the guess as well.

        match: a registration of `gray`, (h, w) uint8, to the anchor, without rows. guess: initial ref_H_cur. chains:
        see `Anchor.register`.
        """
        pairs, fit = match
        trust = anchor.trust[pairs.feature_id]
        if fit is not None and not self.residuals(pairs, trust, fit).hint and _explains_most(match, anchor):
            return match
        for start in [guess] if fit is None else [fit.ref_H_cur, guess]:
            found = anchor.register_rows(gray, start, self.solve, chains)
            if found is not None and (not _has_rows(match) or _inliers(found) > _inliers(match)):
                match = found
            if _has_rows(match) and _explains_most(match, anchor):
                break
        return match


def _has_rows(match: Match) -> bool:
    return match[1] is not None and match[1].rows is not None


def _inliers(match: Match) -> int:
    return 0 if match[1] is None else int(match[1].inlier.sum())


def _explains_most(match: Match, anchor: Anchor) -> bool:
    """Whether most of the features that the frame should show agree with the fit."""
    pairs, fit = match
    return fit is not None and anchor.support(pairs, fit).share >= _MOST
