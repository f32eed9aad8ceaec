"""Fine gravel with known homographies: grains of two or three px, of which nothing is left once they are averaged."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

from stab_ros.core.types import FloatArray, Gray, Homography

SIZE = (480, 320)
_FINER, _MARGIN_PX = 3, 200  # texels to a pixel
_GRAIN_TEXELS = 2.0


@cache
def _surface(size: tuple[int, int], seed: int) -> FloatArray:
    shape = tuple(_FINER * (n + 2 * _MARGIN_PX) for n in size[::-1])
    grains = cv2.GaussianBlur(np.random.default_rng(seed).standard_normal(shape), (0, 0), _GRAIN_TEXELS)
    return np.asarray(120 + 25 * grains / grains.std(), np.float32)


def gravel(ref_H_cur: Homography, size: tuple[int, int] = SIZE, seed: int = 1) -> Gray:
    """What the camera sees when its pixels lie at `ref_H_cur` p, averaged over 3x3 samples, with noise.

    True within 0.02 px: OpenCV rounds its maps to 1/32 texel.
    """
    texels_H_ref = np.array([[_FINER, 0, _FINER * _MARGIN_PX], [0, _FINER, _FINER * _MARGIN_PX], [0, 0, 1.0]])
    cur_H_samples = np.array([[1 / 3, 0, -1 / 3], [0, 1 / 3, -1 / 3], [0, 0, 1]])
    samples = cv2.warpPerspective(_surface(size, seed), texels_H_ref @ ref_H_cur @ cur_H_samples,
                                  (3 * size[0], 3 * size[1]), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)
    mean = cv2.resize(samples, size, interpolation=cv2.INTER_AREA)
    noise = np.random.default_rng([seed, *ref_H_cur.tobytes()]).normal(0, 1.5, mean.shape)
    return np.asarray(np.clip(np.round(mean + noise), 0, 255), np.uint8)
