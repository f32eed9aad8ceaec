"""Keyframes: frames that carry on where the view leaves the reference, each placed by one that came before it.

The frame is compared with the best placed keyframe that it overlaps enough, so the reference itself whenever that is in
view again. The keyframe left behind then gets the better place that the frame has told it, and with it all that were
placed by it: the loop is closed. Keyframes are few, and far ones are forgotten.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.geometry import apply, normalized, product_jacobians, sigma_px
from stab_ros.core.types import Fit, FloatArray, Homography
from stab_ros.tracking.anchor import Anchor, Placement

_ENOUGH = 0.5  # of a keyframe's trusted features in view: a better placed one is taken
_SCARCE = 0.35  # with fewer, any keyframe that shows more is taken
_NEW = 0.7  # with fewer, a new one is made


@dataclass(eq=False)
class _Keyframe:
    base: Anchor
    parent: _Keyframe | None
    sigma_px: float


class Keyframes:
    """All keyframes of one reference, that one first."""

    def __init__(self, reference: Anchor, size: tuple[int, int], most: int) -> None:
        """size: width, height, px, of all frames. most: so many are kept, the reference among them."""
        self._size, self._most = size, most
        self._all = [_Keyframe(reference, None, 0.0)]
        self._current = self._all[0]

    def __len__(self) -> int:
        return len(self._all)

    @property
    def base(self) -> Anchor:
        """What frames are compared with now."""
        return self._current.base

    def choose(self, ref_H_cur: Homography) -> Anchor:
        """The base for a frame that is expected there: the best placed one that shows enough of it."""
        shares = {id(one): one.base.share_in_view(ref_H_cur) for one in self._all}
        enough = [one for one in self._all if shares[id(one)] >= _ENOUGH]
        best = min(enough, key=lambda one: one.sigma_px, default=None)
        if best is not None and (best.sigma_px < self._current.sigma_px or shares[id(self._current)] < _SCARCE):
            self._current = best
        elif shares[id(self._current)] < _SCARCE:
            self._current = max(self._all, key=lambda one: shares[id(one)])
        return self._current.base

    def others(self, ref_H_cur: Homography) -> list[Anchor]:
        """All other bases, those nearest to where a frame was first."""
        rest = [one for one in self._all if one is not self._current]
        return [one.base for one in sorted(rest, key=lambda one: self._apart(one, ref_H_cur))]

    def take(self, base: Anchor) -> None:
        """A frame has been found by another of the bases."""
        self._current = next(one for one in self._all if one.base is base)

    def wants_new(self, ref_H_cur: Homography) -> bool:
        """Whether a frame there should become a keyframe: no keyframe shows most of it."""
        return max(one.base.share_in_view(ref_H_cur) for one in self._all) < _NEW

    @property
    def bases(self) -> list[Anchor]:
        """All of them, the reference first."""
        return [one.base for one in self._all]

    def add(self, base: Anchor) -> None:
        """A keyframe placed by the current base; the farthest from it is forgotten if there are too many."""
        sigma = sigma_px(base.place.ref_H_base, base.place.covariance, self._size)
        self._all.append(_Keyframe(base, self._current, sigma))
        if len(self._all) > self._most:
            old = [one for one in self._all[1:] if one is not self._current]
            self._forget(max(old, key=lambda one: self._apart(one, base.place.ref_H_base)))

    def _forget(self, gone: _Keyframe) -> None:
        self._all.remove(gone)
        for one in self._all:
            if one.parent is gone:
                one.parent = gone.parent

    def correct(self, younger: Anchor, base_H_cur: Homography, fit: Fit) -> None:
        """`younger` sees a frame at `base_H_cur` whose place, `fit`, a better placed base has told."""
        keyframe = next((one for one in self._all if one.base is younger), None)
        sigma = sigma_px(fit.ref_H_cur, fit.covariance, self._size)
        if keyframe is None or keyframe.parent is None or sigma >= keyframe.sigma_px:
            return
        place = normalized(fit.ref_H_cur @ np.linalg.inv(base_H_cur))
        by_fit, _ = product_jacobians(fit.ref_H_cur, np.linalg.inv(base_H_cur))
        moved = place @ np.linalg.inv(younger.place.ref_H_base)
        for one in self._all:
            if one is not keyframe and self._descends(one, keyframe):
                one.base.place = Placement(normalized(moved @ one.base.place.ref_H_base), one.base.place.covariance)
        younger.place = Placement(place, by_fit @ fit.covariance @ by_fit.T)
        keyframe.sigma_px = sigma

    @staticmethod
    def _descends(one: _Keyframe, ancestor: _Keyframe) -> bool:
        while one.parent is not None:
            if one.parent is ancestor:
                return True
            one = one.parent
        return False

    def _apart(self, one: _Keyframe, ref_H_cur: Homography) -> float:
        """Between the middles of a keyframe and of a frame, px of the reference."""
        middle = np.array([[self._size[0] / 2, self._size[1] / 2]])
        away: FloatArray = apply(one.base.place.ref_H_base, middle) - apply(ref_H_cur, middle)
        return float(np.hypot(*away[0]))
