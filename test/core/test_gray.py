"""The gray image of frames of more than 8 bits: the range of values is measured, and nothing else is thrown away."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from truth import picture

from stab_ros.core.gray import grey_range, to_gray, without_colour
from stab_ros.core.types import Frame, Gray, Image
from stab_ros.tracking.reference import is_textured


def gray_of(image: Image, encoding: str) -> Gray:
    frame = Frame(image, encoding, 0)
    return to_gray(frame, grey_range(frame))


def contrast(gray: Gray) -> float:
    low, high = np.percentile(gray, (1, 99))
    return float(high - low)


@pytest.mark.parametrize(("low", "high"), [
    (0, 65535), (0, 1023), (0, 4095), (7400, 7900), (16000, 16050), (65000, 65535)])
def test_any_range_of_16_bits_fills_the_gray_image(low: int, high: int) -> None:
    values = np.round(low + picture() / 255 * (high - low)).astype(np.uint16)
    assert contrast(gray_of(values, "mono16")) > 0.6 * contrast(picture())
    assert contrast(gray_of(np.dstack([values] * 3), "bgr16")) > 0.6 * contrast(picture())


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (290.0, 295.0), (-3.0, 2.0), (0.5, 80.0)])
@pytest.mark.parametrize("no_data", [np.nan, np.inf, -np.inf, 0.0])
def test_floating_values_fill_the_gray_image_without_those_for_no_data(low: float, high: float, no_data: float) -> None:
    values = (low + picture() / 255 * (high - low)).astype(np.float32)
    values[100:150, 100:300] = no_data
    gray = gray_of(values, "32FC1")
    assert contrast(gray[:100]) > 0.5 * contrast(picture()[:100])
    assert no_data == 0 or not gray[100:150, 100:300].any()


def test_zeros_of_a_depth_image_do_not_count() -> None:
    depth = (2000 + 4.0 * picture()).astype(np.uint16)
    holed = depth.copy()
    holed[:, :150] = 0
    assert contrast(gray_of(holed, "mono16")[:, 150:]) == pytest.approx(contrast(gray_of(depth, "mono16")), rel=0.2)


def stuck(values: Image, value: float) -> None:
    rng = np.random.default_rng(2)
    values[rng.random(values.shape) < 0.01] = value


def bars(values: Image, value: float) -> None:
    values[:40], values[-40:] = value, value


def text(values: Image, value: float) -> None:
    drawn = np.zeros(values.shape, np.uint8)
    for row in range(3):
        cv2.putText(drawn, "46.0123 N 7.4567 E 58 m", (8, 20 + 16 * row), cv2.FONT_HERSHEY_SIMPLEX, 0.45, 255, 1)
    values[drawn > 0] = value


def scale(values: Image, value: float) -> None:
    values[20:-20, -24:-8] = np.linspace(1, value, values.shape[0] - 40)[:, None].astype(values.dtype)


@pytest.mark.parametrize("spoil", [stuck, bars, text, scale])
@pytest.mark.parametrize(("dtype", "value"), [
    (np.uint16, 64), (np.uint16, 12000), (np.uint16, 16383), (np.uint16, 65535), (np.float32, -9999.0),
    (np.float32, 1e5)])
def test_what_is_no_scene_does_not_stretch_the_range(
    spoil: Callable[[Image, float], None], dtype: type[np.generic], value: float
) -> None:
    """Pixels of any value that are stuck, bars, text and a colour scale over a thermal scene."""
    scene = np.round(7400 + picture() * 2.0).astype(dtype)
    spoilt = scene.copy()
    spoil(spoilt, value)
    encoding = "mono16" if dtype is np.uint16 else "32FC1"
    middle = (slice(80, -80), slice(20, -40))
    whole = contrast(gray_of(scene, encoding)[middle])
    assert contrast(gray_of(spoilt, encoding)[middle]) > 0.4 * whole


def test_a_bright_bank_beside_dark_water_is_shown() -> None:
    """A corner of the picture is ground enough."""
    values = np.round(100 + 0.04 * picture()).astype(np.uint16)
    values[-80:, -80:] = 3000 + 4 * picture()[-80:, -80:].astype(np.uint16)
    assert contrast(gray_of(values, "mono16")[-80:, -80:]) > 0.2 * contrast(picture()[-80:, -80:])


def test_a_few_targets_on_a_constant_ground_are_shown() -> None:
    values = np.full((300, 400), 0.5, np.float32)
    values[100:112, 50:150] = np.linspace(0.6, 1.0, 100)
    gray = gray_of(values, "32FC1")[100:112, 50:150]
    assert int(gray.max()) - int(gray.min()) > 100


def test_brighter_and_darker_frames_keep_the_range_and_saturate() -> None:
    values = np.round(7400 + picture() * 2.0).astype(np.uint16)
    shown = grey_range(Frame(values, "mono16", 0))
    brighter = to_gray(Frame(values + np.uint16(5000), "mono16", 1), shown)
    darker = to_gray(Frame(values - np.uint16(7000), "mono16", 2), shown)
    assert (brighter == 255).all()
    assert (darker == 0).all()


@pytest.mark.parametrize("sigma", [0.3, 3.0, 40.0])
def test_the_noise_of_a_scene_without_contrast_is_no_texture(sigma: float) -> None:
    noise = np.random.default_rng(1).normal(7500, sigma, (300, 400))
    assert not is_textured(gray_of(np.round(noise).astype(np.uint16), "mono16"))
    assert not is_textured(gray_of(noise.astype(np.float32), "32FC1"))


@pytest.mark.parametrize("image", [
    np.zeros((300, 400), np.uint16), np.full((300, 400), 7400, np.uint16), np.full((300, 400), np.nan, np.float32),
    np.full((300, 400), 0.1, np.float32), np.full((1, 1), 9, np.uint16)])
def test_a_constant_image_is_flat(image: Image) -> None:
    gray = gray_of(image, "mono16" if image.dtype == np.uint16 else "32FC1")
    assert gray.min() == gray.max()


def test_8_bits_are_as_they_were() -> None:
    frame = Frame(picture(), "mono8", 0)
    assert to_gray(frame, grey_range(frame)) is frame.image
    colour = np.dstack([picture()] * 3)
    np.testing.assert_array_equal(gray_of(colour, "bgr8"), picture())


def test_without_colour_keeps_16_bits() -> None:
    values = np.round(7400 + picture() * 2.0).astype(np.uint16)
    grey = without_colour(Frame(np.dstack([values] * 3), "bgr16", 5))
    assert (grey.encoding, grey.stamp_ns) == ("mono16", 5)
    np.testing.assert_array_equal(grey.image, values)
