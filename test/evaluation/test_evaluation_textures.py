"""A known residual on textures that are hard to read: grained one way, as grass is, and with much at the finest scale.

Both are periodic, so that their Fourier transform shifts them exactly.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from truth import frame

from stab_ros.core.types import FloatArray, Gray
from stab_ros.evaluation.evaluator import Arrival, Evaluator
from stab_ros.evaluation.settings import EvaluatorConfig

SIZE = (640, 480)
DIRECTIONS = (0.3, 1.9, 4.1)


@cache
def spectrum(kind: str) -> FloatArray:
    """Of a picture with mean 115 and standard deviation 32, white noise shaped by `kind`."""
    width, height = SIZE
    white = np.fft.rfft2(np.random.default_rng(8).standard_normal((height, width)))
    fy, fx = np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None]
    if kind == "grass":
        shape = np.exp(-2 * np.pi**2 * ((6 * fx) ** 2 + (2 * fy) ** 2))
    else:
        shape = np.hypot(fx, fy + (fx + fy == 0)) ** -1.0
    shape[0, 0] = 0
    shaped = white * shape
    picture = np.fft.irfft2(shaped, s=(height, width))
    return np.asarray(shaped * 32 / picture.std())


def displaced(kind: str, x_px: float, y_px: float) -> Gray:
    fy, fx = np.fft.fftfreq(SIZE[1])[:, None], np.fft.rfftfreq(SIZE[0])[None]
    moved = np.fft.irfft2(spectrum(kind) * np.exp(-2j * np.pi * (fx * x_px + fy * y_px)), s=SIZE[::-1])
    return np.asarray(np.clip(np.round(115 + moved), 0, 255), np.uint8)


@pytest.mark.parametrize(("kind", "distance_px"), [
    *(("grass", distance_px) for distance_px in (0.05, 0.2, 0.5, 1.0, 2.0)),
    ("sharp", 0.1), ("sharp", 0.2),  # further on, no polynomial of second degree follows such a texture
])
def test_a_residual_is_recovered(kind: str, distance_px: float) -> None:
    evaluator = Evaluator(EvaluatorConfig(rmse_every=1))
    pictures = [displaced(kind, 0, 0), *(displaced(kind, distance_px * np.cos(angle), distance_px * np.sin(angle))
                                         for angle in DIRECTIONS)]
    arrivals = (Arrival(index, frame(gray, index).stamp_ns, None, False, frame(gray, index))
                for index, gray in enumerate(pictures))
    found = [evaluator.step(arrival)["displacement_reference_px"] for arrival in arrivals][1:]
    assert found == pytest.approx([distance_px] * len(DIRECTIONS), abs=max(0.15 * distance_px, 0.05))
