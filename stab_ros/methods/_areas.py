"""Square areas of a picture about many points at once, each seen through its own local affine map.

What a homography does to an area of a few dozen px is, but for less than 0.01 px, the affine map that touches it at the
area's centre. The template methods look at the current frame through such maps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.core.geometry import apply
from stab_ros.core.kernels import F32, F64, U8, filled, kernel, read
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography, IdArray, Image

_CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]])


@dataclass(frozen=True, eq=False)
class Maps:
    """Where N areas of one picture lie in another: offset u from an area's centre lies at centre + shape u.

    centres: (N, 2) px. shape: (N, 2, 2).
    """

    centres: FloatArray
    shape: FloatArray

    @staticmethod
    def standing(centres: FloatArray) -> Maps:
        """Areas that are where they were."""
        return Maps(centres, np.tile(np.eye(2), (len(centres), 1, 1)))

    @staticmethod
    def through(H: Homography, centres: FloatArray) -> Maps:
        """Areas about `centres` (N, 2) as H maps them."""
        mapped = apply(H, centres)
        w = centres @ H[2, :2] + H[2, 2]
        return Maps(mapped, (H[:2, :2] - mapped[:, :, None] * H[2, :2]) / w[:, None, None])

    def __getitem__(self, keep: BoolArray | IdArray) -> Maps:
        return Maps(self.centres[keep], self.shape[keep])

    def whole_pixels(self) -> Maps:
        """Only shifted, and by whole pixels, so that nothing needs to be interpolated."""
        return Maps.standing(np.round(self.centres))

    def moved(self, shift_px: FloatArray | IdArray, gradient: FloatArray) -> Maps:
        """With the displacement field shift + gradient u, (N, 2) px and (N, 2, 2), applied before."""
        centres = self.centres + np.einsum("nij,nj->ni", self.shape, shift_px)
        return Maps(centres, self.shape @ (np.eye(2) + gradient))

    def at(self, offsets_px: FloatArray) -> FloatArray:
        """(N, k, 2): where the offsets (k, 2) lie."""
        return np.asarray(self.centres[:, None] + np.einsum("nij,kj->nki", self.shape, offsets_px))

    def inside(self, gray: Gray, side: int) -> BoolArray:
        """(N,) bool: the area of `side` px lies wholly in the picture."""
        corners, last = self.at(_CORNERS * (side - 1)), np.array(gray.shape[::-1]) - 1
        tiny = 1e-6  # px, of rounding
        beyond = np.maximum(-corners, corners - last).max(axis=(1, 2))
        return np.asarray(beyond <= tiny)  # NaN compares false


def sample(image: Image, maps: Maps, side: int) -> FloatArray:
    """(N, side, side) float32: the areas, by cubic convolution (Keys 1981); beyond the picture its edge goes on."""
    sane = np.asarray(np.isfinite(maps.centres).all(axis=1) & np.isfinite(maps.shape).all(axis=(1, 2)))
    values = np.zeros((len(maps.centres), side, side), np.float32)
    centres = np.where(sane[:, None], maps.centres, 0.0)
    shape = np.where(sane[:, None, None], maps.shape, 0.0)
    _sample(image, np.ascontiguousarray(centres), np.ascontiguousarray(shape), values)
    return values


@kernel(*((read(pixel, 2), read(F64, 2), read(F64, 3), filled(F32, 3)) for pixel in (U8, F32)))
def _sample(image: Image, centres: FloatArray, shape: FloatArray, values: FloatArray) -> None:
    height, width = image.shape
    n, side, _ = values.shape
    middle = (side - 1) / 2
    near, wx, wy = np.empty((4, 4), np.float32), np.empty(4, np.float32), np.empty(4, np.float32)
    for i in range(n):
        for row in range(side):
            for column in range(side):
                u, v = column - middle, row - middle
                x = min(max(centres[i, 0] + shape[i, 0, 0] * u + shape[i, 0, 1] * v, 0.0), width - 1.0)
                y = min(max(centres[i, 1] + shape[i, 1, 0] * u + shape[i, 1, 1] * v, 0.0), height - 1.0)
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
