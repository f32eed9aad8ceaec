"""From matches to a homography, and why it is not accepted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stab_ros.core.geometry import apply, grid, is_plausible, rms_distance, sigma_px
from stab_ros.core.row_shifts import RowShifts
from stab_ros.core.types import BoolArray, Correspondences, Fit, FloatArray, Homography, LostReason
from stab_ros.estimation import estimators
from stab_ros.estimation.aliasing import with_aliasing
from stab_ros.estimation.models import PARAMETERS, Basis, nearest
from stab_ros.estimation.problem import TRUSTED
from stab_ros.estimation.rows import fit_rows
from stab_ros.methods import METHODS
from stab_ros.tracking.anchor_pose import AnchorPose
from stab_ros.tracking.frozen_blocks import no_better
from stab_ros.tracking.settings import StabilizerConfig
from stab_ros.tracking.support import Support

# median residuals are 0.1 to 0.4 px, 0.5 px with 9 px of motion blur, and 0.8 px where the homography is 1 px off
_MOST_MEDIAN_PX = 0.65
_SIMPLE = "similarity"
_TILT = 0.001  # of the longer side, where nothing is known yet
_TILT_DECAY = 0.98  # per frame
_AGREES = 0.8  # of the inliers of the projective fit: with fewer, the view has tilted too far for the simple model
_LEAST_NEW = 24.0  # matches that no codec has copied, to tell where the ground is by themselves
_MANY_NEW = 0.3  # of all weight: then the copied ones are not needed
_MORE = 1.5  # times as many of those agree with each other as with all
_KNOWN = 0.5  # of the squared distance between the fits, beyond the uncertainty of new ones


@dataclass(frozen=True)
class Registration:
    """Fits and judges by the settings.

    size: width, height of the reference, px. scatter: how many times further than usual features lie off their plane.
    tilt_px: how far the last frames were from a similarity, the most of it (RMS over the grid).
    """

    config: StabilizerConfig
    size: tuple[int, int]
    scatter: float = 1.0
    tilt_px: float = 0.0

    def after(self, fit: Fit) -> Registration:
        """With the tilt that an accepted fit shows."""
        if fit.model == _SIMPLE:
            return self
        similar = nearest(_SIMPLE, fit.ref_H_cur, grid(self.size))
        now_px = rms_distance(fit.ref_H_cur, similar, self.size)
        return replace(self, tilt_px=max(_TILT_DECAY * self.tilt_px, now_px))

    @property
    def threshold_px(self) -> float:
        """Largest residual of an inlier."""
        return self.scatter * self.config.threshold

    def solve(self, pairs: Correspondences, guess: Homography, trust: FloatArray, frozen: BoolArray) -> Fit | None:
        """The homography from the current frame to where the pairs' reference_px lie; None where nothing fits.

        guess: the homography to start from. trust: (N,) weight of each pair, in [0, 1]. frozen: (N,) bool, copied by
        the codec from an earlier frame.
        """
        trust = _relied_on(trust)
        if not frozen.any():
            return self._fitted(pairs, guess, trust)
        new = self._fitted(pairs[~frozen], guess, trust[~frozen])
        new = None if new is None else replace(new, inlier=self._agreeing(pairs, new, frozen))
        by_new = 0.0 if new is None else float(trust[new.inlier & ~frozen].sum())
        if by_new > max(_LEAST_NEW, _MANY_NEW * float(trust.sum())):
            return new
        fit = self._fitted(no_better(pairs, frozen), guess, trust)
        if fit is None or new is None or by_new < _LEAST_NEW:
            return fit
        return self._reconciled(fit, new, by_new > _MORE * float(trust[fit.inlier & ~frozen].sum()))

    def _agreeing(self, pairs: Correspondences, new: Fit, frozen: BoolArray) -> BoolArray:
        """(N,) bool: the inliers of a fit to the new pairs, and the copied ones that agree with it."""
        agreeing = frozen & (_off_px(new, pairs) < self.threshold_px)
        agreeing[~frozen] = new.inlier
        return np.asarray(agreeing)

    def _reconciled(self, fit: Fit, new: Fit, differs: bool) -> Fit:
        """The fit to all matches, with an uncertainty that spans the fit to new ones alone; that one if it is far off.

        differs: whether the new ones agree with each other and not with the fit. Their distance counts as far as it is
        certain: before a camera that stands still, the new ones are the leaves in the wind.
        """
        apart_px = rms_distance(fit.ref_H_cur, new.ref_H_cur, self.size)
        known = max(0.0, 1 - (self._sigma_px(new) / max(apart_px, 1e-9)) ** 2)
        if differs and known > _KNOWN and apart_px > self.threshold_px:
            return new
        apart = (new.ref_H_cur - fit.ref_H_cur).ravel()[:8]
        return replace(fit, covariance=fit.covariance + known * np.outer(apart, apart))

    def _fitted(self, pairs: Correspondences, guess: Homography, trust: FloatArray) -> Fit | None:
        """By the model of the settings, or a similarity where the ground is too narrow to support more."""
        fit = self._by_model(self.config.model, pairs, guess, trust)
        if fit is None or PARAMETERS[self.config.model] <= PARAMETERS[_SIMPLE] or not self._too_uncertain(fit):
            return fit
        simple = self._by_model(_SIMPLE, pairs, guess, trust)
        simple = None if simple is None else self._tilted(simple, pairs)
        if simple is None or simple.inlier.sum() < _AGREES * fit.inlier.sum():
            return fit
        return fit if self._too_uncertain(simple) else simple

    def _by_model(self, model: str, pairs: Correspondences, guess: Homography, trust: FloatArray) -> Fit | None:
        config = self.config
        fit = estimators.fit(pairs, model, config.estimator, self.threshold_px, guess, trust, config.ransac_threshold)
        return None if fit is None else with_aliasing(fit, pairs)

    def solve_rows(self, pairs: Correspondences, guess: Homography, trust: FloatArray,
                   rows: RowShifts | None) -> Fit | None:
        """As `solve`, with displacements of the rows, from `rows` on; None where held-out features confirm none."""
        found = fit_rows(pairs, trust, self.config.model, self.threshold_px, guess, self.size, rows)
        return found.fit if found is not None and found.holds else None

    def _tilted(self, fit: Fit, pairs: Correspondences) -> Fit:
        """A similarity with the uncertainty of what it leaves out: the other four parameters, of which 0 is known."""
        width, height = self.size
        around = Basis("projective", pairs.reference_px[fit.inlier].mean(axis=0), float(np.hypot(width, height)) / 2)
        left_out = around.entry_jacobian(fit.ref_H_cur)[:, PARAMETERS[_SIMPLE] :] * self._usual_tilt_px
        return replace(fit, covariance=fit.covariance + left_out @ left_out.T, model=_SIMPLE)

    @property
    def _usual_tilt_px(self) -> float:
        """What tilt and relief displace half a diagonal from the ground (standard deviation)."""
        return max(_TILT * max(self.size), self.tilt_px)

    def _too_uncertain(self, fit: Fit) -> bool:
        return self._sigma_px(fit) > self.config.max_sigma * max(self.size) / 1000

    def _sigma_px(self, fit: Fit) -> float:
        return sigma_px(fit.ref_H_cur, fit.covariance, self.size)

    def _blurred(self, fit: Fit, pairs: Correspondences, trust: FloatArray) -> bool:
        """Whether most of the trusted features lie off the fit.

        In a strongly blurred frame each patch is still found, but displaced in a direction that depends on its texture.
        The large number of patches would make such a result look certain, although it is off by pixels.
        """
        if not METHODS[self.config.method].seeks_all:
            return False
        off_px = _off_px(fit, pairs[trust > TRUSTED])
        return len(off_px) > 0 and float(np.median(off_px)) > self.scatter * _MOST_MEDIAN_PX

    def rejected(self, fit: Fit, pose: AnchorPose, pairs: Correspondences, trust: FloatArray,
                 support: Support) -> LostReason | None:
        """Why the fit is not accepted: the camera cannot move so, too few features agree, or it is too uncertain.

        pose: of the anchor. trust: (N,) of the pairs. None: it is accepted.
        """
        if not is_plausible(pose.in_anchor(fit.ref_H_cur), self.size):
            return LostReason.IMPLAUSIBLE
        agree = support.is_enough and support.share >= self.config.min_inlier_share
        many = agree and not self._blurred(fit, pairs, trust)
        if fit.inlier.sum() < self.config.min_inliers or not (many or support.is_solid):
            return LostReason.FEW_INLIERS
        return LostReason.UNCERTAIN if self._too_uncertain(fit) else None


def _relied_on(trust: FloatArray) -> FloatArray:
    """The weights (N,), smaller still for features that are not trusted.

    Of water, some features agree with any homography by chance, and where they lie far from the ground they would seem
    to confirm it there.
    """
    return np.asarray(trust * np.minimum(1.0, (trust / TRUSTED) ** 2))


def _off_px(fit: Fit, pairs: Correspondences) -> FloatArray:
    """(N,) px: how far each pair lies off the fit, reference side."""
    return np.asarray(np.hypot(*(apply(fit.ref_H_cur, pairs.current_px) - pairs.reference_px).T))
