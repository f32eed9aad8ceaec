"""Bars at the edges of the picture are no ground."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from flights import SIZE, fly
from truth import picture

from stab_ros.core.types import Gray
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.flight import Flight, preset
from stab_ros.tracking.letterbox import within_bars

PATCH_PX = 8


def with_bars(image: Gray, width_px: int, quality: int = 100) -> Gray:
    shown = image.copy()
    shown[:width_px] = shown[len(shown) - width_px :] = 16
    return np.asarray(cv2.imdecode(cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], 0))


@pytest.mark.parametrize("upright", [False, True])
@pytest.mark.parametrize("quality", [100, 60])
def test_bars_and_what_patches_see_of_them_are_left_out(quality: int, upright: bool) -> None:
    barred = with_bars(picture(), 40, quality)
    inside = within_bars(barred.T).T if upright else within_bars(barred)
    height = len(barred)
    assert not inside[: 40 + PATCH_PX].any()
    assert not inside[height - 40 - PATCH_PX :].any()
    assert inside[80 : height - 80].all()


@pytest.mark.parametrize("quality", [100, 60])
@pytest.mark.parametrize("black", [0, 16])
def test_the_black_around_a_round_view_is_left_out(quality: int, black: int) -> None:
    image = picture()
    y, x = np.ogrid[: image.shape[0], : image.shape[1]]
    from_centre_px = np.hypot(x - image.shape[1] / 2, y - image.shape[0] / 2)
    image[from_centre_px > 140] = black
    soft = np.asarray(cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], 0))
    inside = within_bars(soft)
    assert not inside[from_centre_px > 140 - PATCH_PX].any()
    assert inside[from_centre_px < 115].all()


def test_a_dark_corner_is_no_round_view() -> None:
    image = picture()
    image[:60, :60] = image[-60:, -60:] = image[:60, -60:] = 0
    assert within_bars(image).all()


def test_a_picture_without_bars_is_used_to_its_edges() -> None:
    assert within_bars(picture()).all()
    assert within_bars(np.zeros((300, 400), np.uint8)).all()


def test_bars_cost_no_more_than_the_ground_that_they_hide() -> None:
    flight, (width, height) = Flight(preset("basento"), SIZE, 36), SIZE
    hidden = [[[0, y], [width, y], [width, y + 40], [0, y + 40]] for y in (0, height - 40)]
    barred = fly(make_stabilizer({}), flight, lambda _, image: with_bars(image, 24, 95))
    excluded = fly(make_stabilizer({"exclude": json.dumps(hidden)}), flight)
    assert not barred.lost
    assert np.max(barred.error_px[1:] / barred.sigma_px[1:]) < 3.5
    assert np.median(barred.error_px[1:]) < 1.5 * np.median(excluded.error_px[1:])
