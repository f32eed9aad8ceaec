"""ECC, the yardstick: exact where only static ground is looked at, and lost where there is none of it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from truth import IDENTITY, SIZE, error_px, flat, frame, picture, projective, random_noise, translation

from stab_ros.core.errors import ConfigError
from stab_ros.core.geometry import apply, rms_distance
from stab_ros.core.types import Frame, State
from stab_ros.methods.ecc import Ecc, EccConfig
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.flight import Flight, preset

ALL = np.ones(SIZE[::-1], bool)
FLIGHT = (960, 540)


@pytest.mark.parametrize("name", ["kolubara", "alpine"])
def test_exact_with_the_static_mask(name: str, tmp_path: Path) -> None:
    flight = Flight(preset(name), size=FLIGHT, frames=9, seed=1)
    water = cv2.dilate(flight.water.astype(np.uint8) * 255, np.ones((17, 17), np.uint8))
    assert cv2.imwrite(str(tmp_path / "water.png"), water)
    stabilizer = make_stabilizer({"method": "ecc", "exclude": str(tmp_path / "water.png")})
    errors = []
    for shot in (flight[0], flight[4], flight[8]):
        track = stabilizer.track(Frame(shot.image, "mono8", shot.stamp_ns))
        assert track.ref_H_cur is not None
        assert track.sigma_px is not None
        errors.append(rms_distance(track.ref_H_cur, shot.ref_H_cur, FLIGHT))
        assert errors[-1] <= 6 * track.sigma_px
    assert np.median(errors[1:]) <= 0.015


def test_what_is_not_allowed_does_not_count() -> None:
    """The right half moves on its own; only the mask tells."""
    H, half = translation(1.3, 0.8), SIZE[0] // 2
    current = picture(H)
    current[:, half:] = picture(translation(-4.0, 3.0))[:, half:]
    allowed = ALL.copy()
    allowed[:, half - 20 :] = False
    method = Ecc(picture(), allowed, EccConfig())
    found = method.match(current, IDENTITY, np.ones(len(method.reference_px)))
    assert len(found) > 100
    np.testing.assert_allclose(apply(H, found.current_px), found.reference_px, atol=0.05)


def test_all_that_is_reported_lies_on_one_homography() -> None:
    method = Ecc(picture(), ALL, EccConfig())
    found = method.match(picture(projective()), IDENTITY, np.ones(len(method.reference_px)))
    H, _ = cv2.findHomography(found.current_px, found.reference_px)
    np.testing.assert_allclose(apply(H, found.current_px), found.reference_px, atol=1e-6)
    assert rms_distance(H, projective(), SIZE) < 0.05
    np.testing.assert_array_equal(found.reference_px, method.reference_px[found.feature_id])


@pytest.mark.parametrize("guess_px", [0.0, 6.0, 12.0])
def test_a_guess_that_is_off_is_corrected(guess_px: float) -> None:
    method, H = Ecc(picture(), ALL, EccConfig()), translation(1.3, 0.8)
    found = method.match(picture(H), translation(1.3 + guess_px, 0.8), np.ones(len(method.reference_px)))
    np.testing.assert_allclose(apply(H, found.current_px), found.reference_px, atol=0.05)
    assert len(found) > 100


@pytest.mark.parametrize("current", [flat(), random_noise(), picture(seed=2), picture(seed=3)])
def test_what_shows_something_else_reports_nothing(current: np.ndarray) -> None:
    method = Ecc(picture(), ALL, EccConfig())
    assert len(method.match(current, IDENTITY, np.ones(len(method.reference_px)))) == 0


def test_a_correlation_below_the_least_is_lost() -> None:
    noisy = picture(translation(1.3, 0.8), noise=60.0)
    for least, state in ((0.3, State.TRACKED), (0.95, State.LOST)):
        stabilizer = make_stabilizer({"method": "ecc", "ecc.min_correlation": least})
        stabilizer.track(frame(picture()))
        assert stabilizer.track(frame(noisy, 1)).state is state


def test_less_is_claimed_where_the_picture_fits_worse() -> None:
    sigmas = []
    for noise in (1.0, 15.0):
        stabilizer = make_stabilizer({"method": "ecc"})
        stabilizer.track(frame(picture()))
        track = stabilizer.track(frame(picture(translation(1.3, 0.8), noise=noise), 1))
        assert error_px(track, translation(1.3, 0.8)) < 0.05
        sigmas.append(track.sigma_px)
    assert sigmas[0] is not None
    assert sigmas[1] is not None
    assert sigmas[1] > 1.2 * sigmas[0]


def test_a_setting_out_of_range_is_refused() -> None:
    with pytest.raises(ConfigError, match="out of range"):
        make_stabilizer({"method": "ecc", "ecc.blur": 11})
