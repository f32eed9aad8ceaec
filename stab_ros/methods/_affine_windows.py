"""Square windows about many points at once, each sampled through its own affine map.

Over a window of a few dozen px, a homography differs from its first-order expansion at the window's centre by less
than 0.01 px. The template methods sample the current frame through these affine maps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.kernels import F32, F64, U8, filled, kernel, read
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography, IdArray, Image

_CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]])


@dataclass(frozen=True, eq=False)
class AffineMaps:
    """Affine maps of N windows into an image: offset u from a window's centre maps to `centres + linear @ u`.

    Attributes:
        centres: (N, 2) float64, px.
        linear: (N, 2, 2) float64, the linear part.
    """

    centres: FloatArray
    linear: FloatArray

    @staticmethod
    def identity(centres: FloatArray) -> AffineMaps:
        """Windows about `centres` (N, 2), not moved and not deformed."""
        return AffineMaps(centres, np.tile(np.eye(2), (len(centres), 1, 1)))

    @staticmethod
    def linearized(H: Homography, centres: FloatArray) -> AffineMaps:
        """H expanded to first order at each of `centres` (N, 2), px."""
        mapped = apply(H, centres)
        w = centres @ H[2, :2] + H[2, 2]
        return AffineMaps(mapped, (H[:2, :2] - mapped[:, :, None] * H[2, :2]) / w[:, None, None])

    def __getitem__(self, keep: BoolArray | IdArray) -> AffineMaps:
        return AffineMaps(self.centres[keep], self.linear[keep])

    def rounded(self) -> AffineMaps:
        """Translations only, by whole pixels, so that sampling needs no interpolation."""
        return AffineMaps.identity(np.round(self.centres))

    def displaced(self, shift_px: FloatArray | IdArray, gradient: FloatArray) -> AffineMaps:
        """The maps preceded by the displacement field `shift_px + gradient @ u`.

        shift_px: (N, 2), px. gradient: (N, 2, 2).
        """
        centres = self.centres + np.einsum("nij,nj->ni", self.linear, shift_px)
        return AffineMaps(centres, self.linear @ (np.eye(2) + gradient))

    def apply_to(self, offsets_px: FloatArray) -> FloatArray:
        """Image positions (N, k, 2), px, of the offsets (k, 2) from each centre."""
        return np.asarray(self.centres[:, None] + np.einsum("nij,kj->nki", self.linear, offsets_px))

    def inside(self, gray: Gray, side: int) -> BoolArray:
        """(N,) bool: whether the window of `side` px lies completely inside the image."""
        corners, last = self.apply_to(_CORNERS * (side - 1)), np.array(gray.shape[::-1]) - 1
        tiny = 1e-6  # px, of rounding
        beyond = np.maximum(-corners, corners - last).max(axis=(1, 2))
        return np.asarray(beyond <= tiny)  # NaN compares false


def sample(image: Image, maps: AffineMaps, side: int) -> FloatArray:
    """The windows, (N, side, side) float32, by cubic convolution (Keys 1981).

    image: (h, w) uint8 or float32; outside it, the border pixel is repeated. Maps that are not finite give zeros.
    """
    finite = np.asarray(np.isfinite(maps.centres).all(axis=1) & np.isfinite(maps.linear).all(axis=(1, 2)))
    values = np.zeros((len(maps.centres), side, side), np.float32)
    centres = np.where(finite[:, None], maps.centres, 0.0)
    linear = np.where(finite[:, None, None], maps.linear, 0.0)
    _sample(image, np.ascontiguousarray(centres), np.ascontiguousarray(linear), values)
    return values


@kernel(*((read(pixel, 2), read(F64, 2), read(F64, 3), filled(F32, 3)) for pixel in (U8, F32)))
def _sample(image: Image, centres: FloatArray, linear: FloatArray, values: FloatArray) -> None:
    height, width = image.shape
    n, side, _ = values.shape
    middle = (side - 1) / 2
    near, wx, wy = np.empty((4, 4), np.float32), np.empty(4, np.float32), np.empty(4, np.float32)
    for i in range(n):
        for row in range(side):
            for column in range(side):
                u, v = column - middle, row - middle
                x = min(max(centres[i, 0] + linear[i, 0, 0] * u + linear[i, 0, 1] * v, 0.0), width - 1.0)
                y = min(max(centres[i, 1] + linear[i, 1, 0] * u + linear[i, 1, 1] * v, 0.0), height - 1.0)
                left, top = int(x), int(y)
                for weights, f in ((wx, x - left), (wy, y - top)):
                    weights[0] = ((-0.5 * f + 1.0) * f - 0.5) * f
                    weights[1] = (1.5 * f - 2.5) * f * f + 1.0
                    weights[2] = ((-1.5 * f + 2.0) * f + 0.5) * f
                    weights[3] = (0.5 * f - 0.5) * f * f
                within = 1 <= left < width - 2 and 1 <= top < height - 2
                for a in range(4):
                    line = top - 1 + a if within else min(max(top - 1 + a, 0), height - 1)
                    for b in range(4):
                        near[a, b] = image[line, left - 1 + b if within else min(max(left - 1 + b, 0), width - 1)]
                total = np.float32(0)
                for a in range(4):
                    total += wy[a] * (wx[0] * near[a, 0] + wx[1] * near[a, 1] + wx[2] * near[a, 2] + wx[3] * near[a, 3])
                values[i, row, column] = total
