"""The gray image of frames of more than 8 bits: the range of values is measured, and nothing else is thrown away."""

from __future__ import annotations

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
