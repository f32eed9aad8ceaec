"""Reference strategies: which anchor frame a frame is registered to, and which frames become anchor frames.

* `fixed`: the reference, always; no error adds up.
* `updated`: features are detected again in a later frame and transferred to the reference by its homography; the fit is
  between those and the current frame (Ljubicic et al. 2021, section 2: for large rotation or scale, less accurate).
* `adjacent`: each frame is registered to the previous one, and the homographies are multiplied (Zhang et al. 2023,
  section 2, who register neighbours; a product needs no second interpolation).
* `keyframe`: as `updated`, but a frame becomes an anchor frame only where the view leaves the others, and stays one
  (`keyframes`).

Except with `fixed`, the anchor frame's covariance is propagated, to first order, into that of every frame, so that
`sigma_px` shows the drift. Each registration sees the same ground, water and interpolation as the previous one, so
their errors are alike: measured, they grow with the number of registrations and not with its root. So sigmas add up,
not variances.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from stab_ros.core.types import Fit, Homography
from stab_ros.tracking.anchor import Anchor
from stab_ros.tracking.settings import StabilizerConfig

Check = Callable[[Anchor], Fit | None]  # registers the frame to another anchor frame, too; None: rejected


class Strategy(Protocol):
    """Decides on anchor frames. anchor: of the last tracked frame. chains: whether homographies are multiplied."""

    anchor: Anchor
    chains: bool

    def __len__(self) -> int:
        """Number of anchor frames that are kept."""

    @property
    def anchors(self) -> list[Anchor]:
        """All anchor frames that are kept."""

    def choose(self, ref_H_cur: Homography) -> Anchor:
        """The anchor frame for a frame that is expected there."""

    def others(self, ref_H_cur: Homography) -> list[Anchor]:
        """Further anchor frames to search for a lost frame; ref_H_cur: of the last tracked frame."""

    def registered(self, anchor: Anchor, fit: Fit, check: Check) -> None:
        """A frame has been registered to one of the anchor frames."""

    def wants_anchor(self, ref_H_cur: Homography, config: StabilizerConfig) -> bool:
        """Whether the frame just registered should become an anchor frame; called once for each frame."""

    def add(self, anchor: Anchor) -> None:
        """Takes the frame just registered as an anchor frame."""


class Fixed:
    """The reference is the only anchor frame."""

    chains = False

    def __init__(self, anchor: Anchor) -> None:
        self.anchor = anchor

    def __len__(self) -> int:
        return 1

    @property
    def anchors(self) -> list[Anchor]:
        return [self.anchor]

    def choose(self, _ref_H_cur: Homography) -> Anchor:
        return self.anchor

    def others(self, _ref_H_cur: Homography) -> list[Anchor]:
        return []

    def registered(self, anchor: Anchor, fit: Fit, check: Check) -> None:
        """Nothing follows from it."""

    def wants_anchor(self, _ref_H_cur: Homography, _config: StabilizerConfig) -> bool:
        return False

    def add(self, anchor: Anchor) -> None:
        self.anchor = anchor


class Updated(Fixed):
    """A later frame replaces the anchor frame, after each `update_every` tracked ones."""

    def __init__(self, anchor: Anchor) -> None:
        super().__init__(anchor)
        self._age = 0  # tracked frames since the anchor frame

    def wants_anchor(self, _ref_H_cur: Homography, config: StabilizerConfig) -> bool:
        self._age += 1
        return self._age >= config.update_every

    def add(self, anchor: Anchor) -> None:
        super().add(anchor)
        self._age = 0


class Adjacent(Fixed):
    """The previous tracked frame is the anchor frame."""

    chains = True

    def wants_anchor(self, _ref_H_cur: Homography, _config: StabilizerConfig) -> bool:
        return True
