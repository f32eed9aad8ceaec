"""The part of the reference that `image_stabilized` shows, which may reach beyond the first view."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from stab_ros.core.errors import ConfigError
from stab_ros.core.geometry import shift
from stab_ros.core.types import Homography

_MOST_SIDE_PX, _MOST_PX = 16384, 100_000_000


@dataclass(frozen=True)
class Window:
    """x, y: its top left pixel in the reference, may be negative. width, height: px."""

    x: int
    y: int
    width: int
    height: int

    @staticmethod
    def of(text: str) -> Window:
        """From "x, y, width, height" or [x, y, width, height].

        Raises:
            ConfigError: something else, or too large.
        """
        words = re.fullmatch(r"\[?" + r"\s*,\s*".join([r"(-?\d{1,6})"] * 4) + r"\]?", text.strip())
        if words is None:
            raise ConfigError(f"output_roi: {text[:80]!r} must be 'x, y, width, height' in px of the reference")
        window = Window(*map(int, words.groups()))
        if not (0 < window.width <= _MOST_SIDE_PX and 0 < window.height <= _MOST_SIDE_PX
                and window.width * window.height <= _MOST_PX):
            raise ConfigError(f"output_roi: {window.width}x{window.height} px, it must have 1 to {_MOST_SIDE_PX} px a "
                              f"side and at most {_MOST_PX} in all")
        return window

    @property
    def size(self) -> tuple[int, int]:
        return self.width, self.height

    def window_H_cur(self, ref_H_cur: Homography) -> Homography:
        """From pixels of the frame to those of the window."""
        return np.asarray(shift(-self.x, -self.y) @ ref_H_cur)
