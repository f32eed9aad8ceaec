"""Where a frame is looked for that is not where it was predicted, on a texture that does not survive shrinking."""

from __future__ import annotations

import numpy as np
import pytest
from gravel import SIZE, gravel
from truth import error_px, frame, random_noise, similarity, translation

from stab_ros.core.geometry import apply, rms_distance
from stab_ros.core.types import Homography
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.tracking import agreement
from stab_ros.tracking.area_search import find_by_areas
from stab_ros.tracking.full_size_features import FullSizeFeatures
from stab_ros.tracking.motion import CameraMotion

HERE = np.eye(3)
CENTRE = np.array(SIZE) / 2
GROUND = np.stack(np.meshgrid(np.arange(40, 440, 16.0), np.arange(40, 280, 16.0)), axis=-1).reshape(-1, 2)
TILTED = np.array([[1.01, 0.02, 12.0], [-0.02, 1.0, -17.0], [2e-5, -1e-5, 1.0]])


@pytest.mark.parametrize("H", [translation(21.3, -17.6), similarity(1.5, 1.01, -15.0, 20.0), TILTED])
def test_areas_find_fine_gravel_again(H: Homography) -> None:
    found = find_by_areas(gravel(HERE), gravel(H), HERE, GROUND, 32)
    assert found is not None
    assert rms_distance(found, H, SIZE) < 2.0


def test_areas_find_nothing_where_nothing_is() -> None:
    for number in range(3):
        assert find_by_areas(gravel(HERE), random_noise(number, SIZE), HERE, GROUND, 32) is None
        assert find_by_areas(gravel(HERE), gravel(HERE, seed=2 + number), HERE, GROUND, 128) is None


def test_areas_beyond_the_radius_are_not_found() -> None:
    far = translation(60.0, 0.0)
    assert find_by_areas(gravel(HERE), gravel(far), HERE, GROUND, 32) is None
    assert find_by_areas(gravel(HERE), gravel(far), HERE, GROUND, 96) is not None


@pytest.mark.parametrize("H", [translation(160.0, 40.0), similarity(25.0, 1.1, 120.0, -60.0),
                               similarity(170.0, 1.0, 20.0, 30.0)])
def test_features_at_full_size_find_fine_gravel_anywhere(H: Homography) -> None:
    found = FullSizeFeatures.of(gravel(HERE), CENTRE).locate(FullSizeFeatures.of(gravel(H), CENTRE))
    assert found is not None
    assert rms_distance(found, H, SIZE) < 6.0


def test_features_at_full_size_find_nothing_in_noise_or_on_other_gravel() -> None:
    features = FullSizeFeatures.of(gravel(HERE), CENTRE)
    flat = np.full(SIZE[::-1], 90, np.uint8)
    for other in (random_noise(0, SIZE), random_noise(1, SIZE), gravel(HERE, seed=2), flat):
        assert features.locate(FullSizeFeatures.of(other, CENTRE)) is None


def test_the_window_of_features_is_limited() -> None:
    """A large picture is searched around the point, moved into it."""
    large = random_noise(3, (2400, 1600))
    px = FullSizeFeatures.of(large, np.array([2300.0, 100.0])).px
    assert px.min(axis=0)[0] > 2400 - 962
    assert px.max(axis=0)[1] < 642


# --- a camera in gusts over fine gravel ------------------------------------------------------------------------------


def gusty(frames: int, seed: int) -> list[Homography]:
    """Steps of up to 20 px and a degree, each of another direction."""
    draw = np.random.default_rng(seed)
    path: list[Homography] = [HERE]
    for _ in range(frames - 1):
        turn, scale, x, y = draw.uniform((-1, 0.99, -20, -20), (1, 1.01, 20, 20))
        path.append(similarity(turn, scale, x, y) @ path[-1] if abs(path[-1][:2, 2]).max() < 80 else HERE)
    return path


@pytest.mark.parametrize("start_s", [0.0, 0.4])
def test_gusts_over_fine_gravel_lose_nothing(start_s: float) -> None:
    stabilizer, path = make_stabilizer({"start_s": start_s}), gusty(24, seed=3)
    tracks = [track for index, H in enumerate(path) for track in stabilizer.answers(frame(gravel(H), index))]
    assert len(tracks) == len(path)
    errors_px = [error_px(track, path[track.index], SIZE) for track in tracks[1:]]
    assert max(errors_px) < 0.15


@pytest.mark.thorough
def test_a_long_gap_over_fine_gravel_is_bridged() -> None:
    """Half of the reference is out of view, and the frame before it was a second ago."""
    stabilizer, far = make_stabilizer({"start_s": 0.0}), similarity(8.0, 1.05, 190.0, -40.0)
    for index in (0, 1):
        assert stabilizer.track(frame(gravel(HERE), index)).tracked
    for index in range(2, 26):
        assert not stabilizer.track(frame(random_noise(index, SIZE), index)).tracked
    assert error_px(stabilizer.track(frame(gravel(far), 26)), far, SIZE) < 0.1


# --- agreement -------------------------------------------------------------------------------------------------------


def test_false_alarms_follow_the_binomial_distribution() -> None:
    """Three matches, of which the third agrees by chance in one of 100 cases: three pairs to start from."""
    assert agreement.log10_false_alarms(3, 3, 0.01) == pytest.approx(np.log10(3 * 0.01))
    assert agreement.log10_false_alarms(4, 3, 0.1) == pytest.approx(np.log10(6 * (2 * 0.1 * 0.9 + 0.01)))
    assert agreement.log10_false_alarms(50, 2, 0.001) == pytest.approx(np.log10(50 * 49 / 2))


def test_few_right_matches_among_many_wrong_ones_are_found() -> None:
    draw, H = np.random.default_rng(5), similarity(10.0, 1.1, 30.0, -20.0)
    right, wrong = draw.uniform(0, 900, (30, 2)), draw.uniform(0, 900, (270, 2))
    there = np.concatenate([apply(H, right) + draw.normal(0, 0.5, right.shape), draw.uniform(0, 900, wrong.shape)])
    found = agreement.motion(np.concatenate([right, wrong]), there, 3.0, 900**2)
    assert found is not None
    assert rms_distance(found, H, (900, 900)) < 3.0


def test_wrong_matches_alone_agree_on_nothing() -> None:
    draw = np.random.default_rng(6)
    for _ in range(20):
        seen, there = draw.uniform(0, 900, (2, 300, 2))
        assert agreement.motion(seen, there, 3.0, 900**2) is None


# --- how far off a prediction usually is -----------------------------------------------------------------------------


def steady(steps_px: list[float]) -> CameraMotion:
    """A camera that makes these steps to the right, 40 ms each."""
    motion, x_px = CameraMotion(SIZE, HERE, 0), 0.0
    for number, step_px in enumerate(steps_px, 1):
        x_px += step_px
        motion = motion.then(translation(x_px, 0.0), number * 40_000_000)
    return motion


def test_predictions_fail_in_gusts() -> None:
    calm, gusts = steady([2.0] * 30), steady([2.0, 22.0] * 15)
    calm_px, in_gusts_px = (motion.usual_px(motion.last_ns + 40_000_000) for motion in (calm, gusts))
    assert calm_px is not None
    assert in_gusts_px is not None
    assert in_gusts_px > 5 * calm_px


def test_what_is_usual_grows_with_the_gap_and_needs_some_frames() -> None:
    lost = steady([5.0] * 30).standing()
    near, far = (lost.usual_px(lost.last_ns + gap * 40_000_000) for gap in (1, 10))
    assert near is not None
    assert far == pytest.approx(10 * near)
    assert steady([5.0, 5.0]).usual_px(120_000_000) is None
