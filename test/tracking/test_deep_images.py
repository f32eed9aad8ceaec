"""Images of more than 8 bits are tracked whatever their range, and leave as the contract says."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from truth import error_px, frame, picture

from stab_ros.core.geometry import shift
from stab_ros.core.types import Image, Track
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.tracking.stabilizer import Stabilizer

MOVED = shift(1.7, -0.6)


def whole(low: float, high: float, channels: int = 1) -> Callable[[Image], Image]:
    def make(image: Image) -> Image:
        values = np.round(low + image / 255 * (high - low)).astype(np.uint16)
        return values if channels == 1 else np.dstack([values] * channels)
    return make


def floating(low: float, high: float, no_data: float) -> Callable[[Image], Image]:
    def make(image: Image) -> Image:
        values = (low + image / 255 * (high - low)).astype(np.float32)
        values[20:60, 30:200] = no_data  # as a sensor's blind spot
        return values
    return make


KINDS: dict[str, tuple[str, Callable[[Image], Image]]] = {
    "thermal": ("mono16", whole(7400, 7900)), "narrow": ("mono16", whole(30000, 30060)),
    "12 bit": ("mono16", whole(0, 4095)), "colour of 10 bit": ("bgr16", whole(0, 1023, 3)),
    "colour of a narrow range": ("bgr16", whole(7400, 7900, 3)), "full colour": ("bgr16", whole(0, 65535, 3)),
    "kelvin": ("32FC1", floating(290, 295, np.nan)), "Celsius": ("32FC1", floating(-3, 2, np.inf)),
    "metres": ("32FC1", floating(3, 40, 0.0)), "up to 1": ("32FC1", floating(0, 1, np.nan)),
}


@pytest.mark.parametrize("kind", list(KINDS))
def test_any_range_is_tracked_as_8_bits_are(kind: str) -> None:
    encoding, make = KINDS[kind]
    stabilizer: Stabilizer = make_stabilizer({"start_s": 0.0})
    stabilizer.track(frame(make(picture()), 0, encoding))
    done = stabilizer.step(frame(make(picture(MOVED)), 1, encoding))
    assert error_px(done.track, MOVED) < 0.05
    assert done.image is not None
    expected = make(picture())
    assert done.image.shape == expected.shape
    assert done.image.dtype == (np.uint8 if encoding == "bgr16" else expected.dtype)
    inner = np.s_[100:250, 50:350]
    off = np.abs(done.image[inner].astype(float) - expected[inner])
    if encoding != "bgr16":
        assert np.median(off) < 0.03 * (float(np.nanmax(expected)) - float(np.nanmin(expected[expected != 0])))


def test_16_bit_colour_leaves_in_the_range_of_the_reference() -> None:
    encoding, make = KINDS["colour of a narrow range"]
    stabilizer: Stabilizer = make_stabilizer({"start_s": 0.0, "on_lost": "pass"})
    first = stabilizer.step(frame(make(picture()), 0, encoding)).image
    raised: Image = make(picture()) + np.uint16(60)
    brighter = stabilizer.step(frame(raised, 1, encoding)).image
    black = stabilizer.step(frame(np.zeros_like(make(picture())), 2, encoding)).image
    assert first is not None
    assert brighter is not None
    assert black is not None
    assert np.ptp(first) > 100
    grey = cv2.cvtColor(first, cv2.COLOR_BGR2GRAY).astype(float)
    assert np.corrcoef(grey.ravel(), picture().ravel())[0, 1] > 0.99
    assert np.median(brighter.astype(float) - first) == pytest.approx(60 / 500 * 255, rel=0.6)
    assert not black.any()


def test_exposure_may_halve() -> None:
    stabilizer: Stabilizer = make_stabilizer({"start_s": 0.0})
    bright, dark = whole(0, 4000), whole(0, 2000)
    stabilizer.track(frame(bright(picture()), 0, "mono16"))
    assert error_px(stabilizer.track(frame(dark(picture(MOVED)), 1, "mono16")), MOVED) < 0.05


def test_a_flat_scene_is_lost_for_its_lack_of_texture() -> None:
    stabilizer: Stabilizer = make_stabilizer({"start_s": 0.0})
    rng = np.random.default_rng(1)
    flat: list[Image] = [np.round(rng.normal(7500, 3, (300, 400))).astype(np.uint16) for _ in range(3)]
    tracks: list[Track] = [stabilizer.track(frame(image, k, "mono16")) for k, image in enumerate(flat)]
    assert [track.lost_reason.value for track in tracks if track.lost_reason] == ["no texture"] * 3
