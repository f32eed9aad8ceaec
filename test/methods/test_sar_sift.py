"""SAR-SIFT under speckle: multiplicative noise of four looks, independent in every frame."""

from __future__ import annotations

import numpy as np
import pytest
from truth import IDENTITY, SIZE, error_px, frame, picture, similarity, translation

from stab_ros.core.geometry import apply, rms_distance
from stab_ros.core.types import Frame, Gray
from stab_ros.methods import _ratio_descriptor, _roewa
from stab_ros.methods.sar_sift import SarSift, SarSiftConfig
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.flight import Flight, preset

ALL = np.ones(SIZE[::-1], bool)
FLIGHT = (1280, 720)
LOOKS = 4.0


def speckled(gray: Gray, seed: int) -> Gray:
    """Intensity times gamma noise of mean 1 and variance 1/looks."""
    speckle = np.random.default_rng([5, seed]).gamma(LOOKS, 1 / LOOKS, gray.shape)
    return np.asarray(np.clip(np.round(gray * speckle), 0, 255), np.uint8)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["kolubara", "alpine"])
def test_speckled_flights(name: str) -> None:
    flight = Flight(preset(name), size=FLIGHT, frames=13, seed=1)
    stabilizer, errors = make_stabilizer({"method": "sar_sift"}), []
    for shot in (flight[0], flight[4], flight[8], flight[12]):
        track = stabilizer.track(Frame(speckled(shot.image, shot.index), "mono8", shot.stamp_ns))
        assert track.ref_H_cur is not None
        assert track.sigma_px is not None
        errors.append(rms_distance(track.ref_H_cur, shot.ref_H_cur, FLIGHT))
        assert errors[-1] <= 6 * track.sigma_px
    assert np.median(errors[1:]) <= 0.3


@pytest.mark.parametrize("upright", [True, False])
def test_correlation_places_matches_closer(upright: bool) -> None:
    H, median_px = translation(3.4, -2.7), {}
    for refine in (False, True):
        method = SarSift(speckled(picture(), 0), ALL, SarSiftConfig(refine=refine, upright=upright))
        found = method.match(speckled(picture(H), 1), IDENTITY, np.ones(len(method.reference_px)))
        assert len(found) > 30
        median_px[refine] = np.median(np.hypot(*(found.reference_px - apply(H, found.current_px)).T))
    assert median_px[True] < 0.7 * median_px[False]


def test_speckle_and_a_turn() -> None:
    size = (800, 600)
    H = similarity(25.0, 1.0, size=size)
    stabilizer = make_stabilizer({"method": "sar_sift"})
    stabilizer.track(frame(speckled(picture(size=size), 0)))
    assert error_px(stabilizer.track(frame(speckled(picture(H, size), 1), 1)), H, size) < 0.3


def test_the_ratio_gradient_does_not_know_how_bright_it_is() -> None:
    bright = np.clip(picture().astype(float), 40, 200)
    one, half = (_roewa.ratio_gradient(np.round(scale * bright).astype(np.uint8), 3.0) for scale in (1.0, 0.5))
    np.testing.assert_allclose(half.right, one.right, atol=0.03)
    np.testing.assert_allclose(half.down, one.down, atol=0.03)


def test_a_step_has_its_ratio_across_and_none_along() -> None:
    step = np.full((120, 120), 40, np.uint8)
    step[:, 60:] = 160
    scale = _roewa.ratio_gradient(step, 4.0)
    assert 0.8 * np.log(4) < scale.right[60, 60] <= np.log(4)
    assert abs(scale.down[60, 60]) < 1e-3
    assert _roewa.ratio_gradient(step.T.copy(), 4.0).down[60, 60] == pytest.approx(scale.right[60, 60], abs=1e-3)


def test_speckle_fires_alike_where_it_is_dark_and_bright() -> None:
    """The constant false alarm rate that ratios are for; differences would be five times larger."""
    flat = np.full((300, 400), 20, np.uint8)
    flat[:, 200:] = 100
    scale = _roewa.ratio_gradient(speckled(flat, 3), 3.0)
    spread = [np.std(scale.right[20:-20, part]) for part in (np.s_[20:180], np.s_[220:380])]
    assert spread[0] == pytest.approx(spread[1], rel=0.15)


def test_corners_are_placed_between_pixels() -> None:
    block = np.full((160, 160), 50, np.uint8)
    block[60:, 70:] = 200
    px, response = _roewa.corners(_roewa.ratio_gradient(block, 3.0), 0.1)
    nearest = px[response.argmax()]
    assert np.hypot(*(nearest - (69.5, 59.5))) < 4  # Harris' corners lie inside
    turned, strength = _roewa.corners(_roewa.ratio_gradient(np.ascontiguousarray(block[::-1, ::-1]), 3.0), 0.1)
    np.testing.assert_allclose(159 - turned[strength.argmax()], nearest, atol=0.01)


def test_descriptors_turn_with_the_picture() -> None:
    gray = picture()[:300, :300]
    quarter = np.ascontiguousarray(np.rot90(gray))
    scale, turned = (_roewa.ratio_gradient(image, 3.0) for image in (gray, quarter))
    px = np.array([[150.0, 140.0], [120.0, 170.0]])
    there = np.stack([px[:, 1], 299 - px[:, 0]], axis=1)  # rot90: the x axis points up
    found = _ratio_descriptor.orientations(scale, px)
    ones = _ratio_descriptor.describe(scale, px[found[0]], found[1])
    others = _ratio_descriptor.describe(turned, there[found[0]], found[1] - np.pi / 2)
    np.testing.assert_allclose(np.sum(ones * others, axis=1), 1.0, atol=0.05)
    np.testing.assert_allclose(np.linalg.norm(ones, axis=1), 1.0, atol=1e-5)


def test_no_more_than_asked_for_and_none_in_nothing() -> None:
    assert len(SarSift(np.full((300, 400), 90, np.uint8), ALL, SarSiftConfig()).reference_px) == 0
    few = SarSift(picture(), ALL, SarSiftConfig(features=80, upright=True)).reference_px
    assert 40 < len(few) <= 80
