"""Whatever the pictures show, no method raises, and what is TRACKED has a finite homography and uncertainty."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from truth import frame, picture

from stab_ros.core.geometry import shift
from stab_ros.core.types import Gray, Image, Track
from stab_ros.methods import METHODS
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.tracking.stabilizer import Stabilizer

SIZES = ((64, 64), (65, 97), (131, 64), (160, 120), (200, 71))
_BARS = np.repeat(np.array([235, 210, 170, 145, 106, 81, 41, 16], np.uint8), 8)


def _scene(size: tuple[int, int], dx: int) -> Gray:
    seen: Gray = picture(shift(dx, 0.5 * dx), (160, 120), noise=1.0)[: size[1], : size[0]]
    return seen.copy()


def _fitted(image: Gray, size: tuple[int, int]) -> Gray:
    rows, columns = np.arange(size[1]) % image.shape[0], np.arange(size[0]) % image.shape[1]
    return np.ascontiguousarray(image[np.ix_(rows, columns)])


@st.composite
def contents(draw: st.DrawFn, size: tuple[int, int]) -> Gray:
    """One picture of (width, height): a scene or a test pattern, and what covers a part of it."""
    width, height = size
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    scene = _fitted(_scene(size, draw(st.integers(-3, 3))), size)
    kind = draw(st.sampled_from(
        ["scene", "scene", "scene", "constant", "bars", "checks", "ramp", "pixel", "line", "noise"]))
    level, step = draw(st.sampled_from([0, 16, 128, 254, 255])), draw(st.sampled_from([1, 2, 3, 8, 16, 40]))
    patterns: dict[str, Image] = {
        "scene": scene, "constant": np.full_like(scene, level), "bars": _BARS[x % 64],
        "checks": 255 * ((x // step + y // step) % 2), "ramp": 255 * (x + y) / (width + height),
        "pixel": np.where((x == width // 2) & (y == height // 2), 255, level),
        "line": np.where(x == step, 255 - level, level),
        "noise": np.random.default_rng(step).integers(0, 256, scene.shape),
    }
    image = patterns[kind].astype(np.uint8)
    cover = draw(st.sampled_from(["none", "letterbox", "pillars", "round", "half", "saturated", "line"]))
    margin = draw(st.integers(1, min(size) // 2))
    covers = {
        "none": x < 0, "half": x >= margin, "line": y == margin, "saturated": scene > 128,
        "letterbox": (y < margin) | (y >= height - margin), "pillars": (x < margin) | (x >= width - margin),
        "round": np.hypot(x - width / 2, y - height / 2) > margin,
    }
    image[covers[cover]] = level
    return image


@st.composite
def streams(draw: st.DrawFn) -> list[Gray]:
    """Some pictures of one size; often the same content again."""
    size = draw(st.sampled_from(SIZES))
    made = [draw(contents(size)) for _ in range(draw(st.integers(1, 3)))]
    return [made[index % len(made)] for index in draw(st.lists(st.integers(0, 2), min_size=2, max_size=5))]


def _check(tracks: list[Track]) -> None:
    for track in tracks:
        if track.tracked:
            assert track.ref_H_cur is not None
            assert track.covariance is not None
            assert np.isfinite(track.ref_H_cur).all()
            assert np.isfinite(track.covariance).all()
            assert track.sigma_px is not None
            assert track.rmse_px is not None
            assert np.isfinite([track.sigma_px, track.rmse_px]).all()
            assert track.ref_H_cur[2, 2] == 1
        else:
            assert track.ref_H_cur is None


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=12, deadline=None)
@given(stream=streams(), start_s=st.sampled_from([0.0, 0.1]))
def test_no_content_is_an_error(method: str, stream: list[Gray], start_s: float) -> None:
    stabilizer: Stabilizer = make_stabilizer({"method": method, "start_s": start_s})
    tracks: list[Track] = []
    for index, image in enumerate(stream):
        one = frame(image, index)
        answered = stabilizer.answers(one)
        tracks += answered
        if answered and answered[-1].tracked:
            assert stabilizer.warp(one, answered[-1]) is not None
    _check([*tracks, *stabilizer.finish()])
