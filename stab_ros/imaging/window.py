"""The output window: the part of the reference plane that `image_stabilized` shows, and its scale."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from stab_ros.core.downscale import Downscaling
from stab_ros.core.errors import ConfigError
from stab_ros.core.geometry import shift
from stab_ros.core.types import Homography

_MOST_SIDE_PX, _MOST_PX = 16384, 100_000_000


@dataclass(frozen=True)
class Window:
    """The part of the reference plane that the output image shows.

    Attributes:
        x, y: its top left pixel in the reference; may be negative.
        extent: width and height in reference pixels; None for those of the reference.
        scale: output pixels per reference pixel, at most 1.
    """

    x: int = 0
    y: int = 0
    extent: tuple[int, int] | None = None
    scale: float = 1.0

    @staticmethod
    def of(roi: str, scale: float = 1.0) -> Window:
        """The window of the parameters `output_roi` and `output_scale`.

        Args:
            roi: "x, y, width, height" or "[x, y, width, height]"; empty for the whole reference.
            scale: output pixels per reference pixel.

        Raises:
            ConfigError: `roi` has another format, or is too large.
        """
        if not roi.strip():
            return Window(scale=scale)
        words = re.fullmatch(r"\[?" + r"\s*,\s*".join([r"(-?\d{1,6})"] * 4) + r"\]?", roi.strip())
        if words is None:
            raise ConfigError(f"output_roi: {roi[:80]!r} must be 'x, y, width, height' in px of the reference")
        x, y, width, height = map(int, words.groups())
        if not (0 < width <= _MOST_SIDE_PX and 0 < height <= _MOST_SIDE_PX and width * height <= _MOST_PX):
            raise ConfigError(f"output_roi: {width}x{height} px, it must have 1 to {_MOST_SIDE_PX} px a side and at "
                              f"most {_MOST_PX} in all")
        return Window(x, y, (width, height), scale)

    def size(self, reference_size: tuple[int, int]) -> tuple[int, int]:
        """Width and height of the output image, px, for a reference of `reference_size`."""
        width, height = self.extent or reference_size
        return max(1, round(width * self.scale)), max(1, round(height * self.scale))

    @property
    def offset(self) -> tuple[float, float]:
        """Position in the reference of the centre of the top left output pixel, px.

        Output pixel (u, v) lies at offset + (u, v) / scale. The outer corners of output image and window coincide.
        """
        within = 0.5 / self.scale - 0.5
        return self.x + within, self.y + within

    def window_H_cur(self, ref_H_cur: Homography) -> Homography:
        """Homography from pixels of the frame to those of the output image."""
        x, y = self.offset
        return np.asarray(np.diag([self.scale, self.scale, 1.0]) @ shift(-x, -y) @ ref_H_cur)

    @property
    def downscaling(self) -> Downscaling:
        """Downscaling of the frame before the warp, to avoid aliasing with small scales."""
        return Downscaling(max(0, math.floor(math.log2(1 / self.scale))))
