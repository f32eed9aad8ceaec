"""RMSE of homologous points: against exact truth, and against a plain implementation over the whole picture."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import truth
from truth import IDENTITY, SIZE, flat, random_noise, similarity, translation

from stab_ros.core.geometry import rms_distance
from stab_ros.core.types import BoolArray, FloatArray, Frame, Gray, Homography
from stab_ros.imaging.warp import warp
from stab_ros.metrics.homologous import HomologousPoints, Rmse, rmse
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.flight import Flight, preset

LARGE = (720, 420)  # searched in tiles; SIZE is searched whole
LARGEST_NOISE_PX = 0.2  # of SIFT itself on these pictures, RMS of a point


def picture(ref_H_cur: Homography = IDENTITY, size: tuple[int, int] = SIZE, seed: int = 1, noise: float = 1.0,
            gain: float = 1.0, offset: float = 0.0) -> Gray:
    """`truth.picture`, each made once."""
    return _made(ref_H_cur.tobytes(), size, seed, noise, gain, offset)


@cache
def _made(ref_H_cur: bytes, size: tuple[int, int], *arguments: Any) -> Gray:
    gray = truth.picture(np.frombuffer(ref_H_cur).reshape(3, 3), size, *arguments)
    gray.flags.writeable = False
    return gray


@cache
def flown(name: str, frame: int) -> tuple[Gray, Homography]:
    """A frame over a river, and its true `ref_H_cur`."""
    shot = Flight(preset(name), size=LARGE, seed=2)[frame]
    return shot.image, shot.ref_H_cur


def everywhere(gray: Gray) -> BoolArray:
    return np.ones(gray.shape, bool)


def measured(reference: Gray, current: Gray, previous: Gray | None = None) -> Rmse:
    """With everything allowed and valid."""
    points = points_of(reference.tobytes(), reference.shape)
    return points.measure(current, everywhere(current), previous, None if previous is None else everywhere(previous))


@cache
def points_of(reference: bytes, shape: tuple[int, ...]) -> HomologousPoints:
    return HomologousPoints(np.frombuffer(reference, np.uint8).reshape(shape), np.ones(shape, bool))


def plain_rmse(reference: Gray, current: Gray) -> float:
    """SIFT of both whole pictures, OpenCV's matcher, OpenCV's RANSAC of 1 px, and Eq. 7 point by point."""
    sift = cv2.SIFT.create(4000)
    points_r, of_r = sift.detectAndCompute(reference, None)
    points_c, of_c = sift.detectAndCompute(current, None)
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    pairs = [(m.trainIdx, m.queryIdx) for m, second in matcher.knnMatch(of_c, of_r, k=2)
             if m.distance < 0.8 * second.distance]
    back = {(m.queryIdx, m.trainIdx) for (m,) in matcher.knnMatch(of_r, of_c, k=1)}
    pairs = [pair for pair in pairs if pair in back]
    here, there = (np.array([p.pt for p in points]) for points in (
        [points_r[i] for i, _ in pairs], [points_c[j] for _, j in pairs]))
    _, agrees = cv2.findHomography(there, here, cv2.RANSAC, 1.0, None, 5000, 0.9999)
    total, count = 0.0, 0
    for (x_r, y_r), (x_s, y_s), good in zip(here, there, agrees.ravel(), strict=True):
        if good:
            total, count = total + (x_r - x_s) ** 2 + (y_r - y_s) ** 2, count + 1
    return math.sqrt(total / count)


def expected_px(shift_px: float) -> float:
    """SIFT's own noise adds to a true shift as variances do."""
    return math.hypot(shift_px, LARGEST_NOISE_PX / 2)


def with_region(ground: Gray, other: Gray, share: float) -> Gray:
    """`ground` with `other` in the middle rows, over that share of the picture."""
    height = ground.shape[0]
    top = round(height * (1 - share) / 2)
    both = ground.copy()
    both[top : height - top] = other[top : height - top]
    return both


def stabilised(image: Gray, ref_H_cur: Homography, size: tuple[int, int]) -> tuple[Gray, BoolArray]:
    """The warped picture, and where it is valid: pixels whose four neighbours all lie in the frame."""
    white = np.full_like(image, 255)
    return warp(image, ref_H_cur, size, "linear", None), warp(white, ref_H_cur, size, "linear", None) == 255


def test_equation_7_by_hand() -> None:
    here = np.zeros((8, 2))
    assert rmse(here, here + np.array([3, 4])) == pytest.approx(5)
    there = here.copy()
    there[0], there[1] = (0, 2), (-2, 0)
    assert rmse(here, there) == pytest.approx(1)  # sqrt((4 + 4) / 8): opposite shifts do not cancel
    assert rmse(here[:7], here[:7]) is None


@pytest.mark.parametrize("size", [SIZE, LARGE])
def test_identical_pictures_are_0_px_apart(size: tuple[int, int]) -> None:
    reference = picture(size=size, noise=2)
    found = measured(reference, reference.copy(), reference.copy())
    assert (found.reference_px, found.previous_px) == (0, 0)
    assert found.checkpoints > 100


@pytest.mark.parametrize("size", [SIZE, LARGE])
@pytest.mark.parametrize(("x_px", "y_px"), [(0.2, 0), (0, -0.2), (0.6, 0.8), (-3, 0)])
def test_a_shift_is_what_is_measured(size: tuple[int, int], x_px: float, y_px: float) -> None:
    reference, shift_px = picture(size=size, noise=2), math.hypot(x_px, y_px)
    current = picture(translation(x_px, y_px), size, noise=2)
    found = measured(reference, current, reference)
    assert found.reference_px == pytest.approx(shift_px, abs=0.1, rel=0.1)
    assert found.previous_px == found.reference_px
    assert found.checkpoints > 50


def test_noise_of_the_camera_alone_stays_small() -> None:
    found = measured(picture(noise=2), picture(translation(1e-9, 0), noise=2))
    assert found.reference_px is not None
    assert 0 < found.reference_px < LARGEST_NOISE_PX


def test_brightness_and_contrast_do_not_count() -> None:
    found = measured(picture(noise=1), picture(translation(1, 0), noise=1, gain=1.15, offset=-12))
    assert found.reference_px == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("name", ["kolubara", "basento"])
@pytest.mark.parametrize("left_px", [0.0, 1.0])
def test_a_plain_search_of_the_whole_picture_agrees(name: str, left_px: float) -> None:
    (reference, _), (image, ref_H_cur) = flown(name, 0), flown(name, 25)
    current, valid = stabilised(image, translation(0.6 * left_px, 0.8 * left_px) @ ref_H_cur, LARGE)
    found = HomologousPoints(reference, everywhere(reference)).measure(current, valid)
    assert found.reference_px == pytest.approx(plain_rmse(reference, current), abs=0.08)
    assert found.reference_px == pytest.approx(left_px, abs=0.25 if left_px == 0 else 0.1)


@pytest.mark.thorough
def test_a_plain_search_agrees_on_real_video(shared_data: Path) -> None:
    capture = cv2.VideoCapture(str(shared_data / "navizence.mp4"))
    video = [cv2.cvtColor(capture.read()[1], cv2.COLOR_BGR2GRAY) for _ in range(11)]
    capture.release()
    stabilizer = make_stabilizer({})
    steady = {k: stabilizer.step(Frame(video[k], "mono8", 10**9 + k * 40_000_000)).image for k in (0, 9, 10)}
    before, now = steady[9], steady[10]
    assert before is not None
    assert now is not None
    found = measured(video[0], now, before)
    assert found.reference_px == pytest.approx(plain_rmse(video[0], now), abs=0.1)
    assert found.reference_px is not None
    assert found.previous_px is not None
    assert found.previous_px < found.reference_px < 0.5
    assert found.checkpoints > 100


@pytest.mark.parametrize(("left_px", "water_px"), [(0, 5), (1, 5), (0, 1.5)])
@pytest.mark.parametrize("share", [0.45, 0.6])
def test_water_that_moves_as_one_does_not_count(left_px: float, water_px: float, share: float) -> None:
    """Not even where it is the larger part and as well textured as its banks."""
    def seen(ground_px: float, flown_px: float) -> Gray:
        return with_region(picture(translation(ground_px, 0), LARGE), picture(translation(0, flown_px), LARGE, seed=5),
                           share)

    dry = measured(picture(size=LARGE), picture(translation(left_px, 0), LARGE), picture(size=LARGE))
    wet = measured(seen(0, 0), seen(left_px, water_px), seen(0, water_px / 2))
    assert wet.reference_px == pytest.approx(dry.reference_px, abs=0.1)
    assert wet.previous_px == pytest.approx(dry.previous_px, abs=0.1)


def test_water_that_keeps_its_texture_does_not_win_against_the_picture_before() -> None:
    """Over 70 % of the picture it is new since the reference, and unchanged since the picture before."""
    water = picture(size=LARGE, seed=5)[::-1]
    reference = with_region(picture(size=LARGE), picture(size=LARGE, seed=5), 0.7)
    found = measured(reference, with_region(picture(translation(1, 0), LARGE), water, 0.7),
                     with_region(picture(translation(0.001, 0), LARGE), water, 0.7))
    assert found.reference_px == pytest.approx(1, abs=0.1)
    assert found.previous_px == pytest.approx(1, abs=0.1)


def test_only_what_is_allowed_counts() -> None:
    """The middle lies 0.7 px away, too near the common plane to be taken for water."""
    reference, current = picture(size=LARGE), picture(translation(1e-9, 0), LARGE)
    current = with_region(current, picture(translation(0.7, 0), LARGE), 0.5)
    banks = with_region(np.ones_like(reference), np.zeros_like(reference), 0.5).astype(bool)
    all_of_it = measured(reference, current)
    only_banks = HomologousPoints(reference, banks).measure(current, everywhere(current))
    assert all_of_it.reference_px is not None
    assert all_of_it.reference_px > 0.3
    assert only_banks.reference_px is not None
    assert only_banks.reference_px < LARGEST_NOISE_PX


def numbers(found: Rmse) -> tuple[float | None, float | None, int]:
    return found.reference_px, found.previous_px, found.checkpoints


@pytest.mark.parametrize("size", [(200, 150), (640, 480), (1000, 310), (310, 1000), (1600, 97)])
def test_every_size_has_points(size: tuple[int, int]) -> None:
    found = measured(picture(size=size), picture(translation(0.5, 0), size))
    assert found.checkpoints > 50
    assert found.reference_px == pytest.approx(0.5, abs=0.05)
    assert found.ref_H_cur is not None
    assert rms_distance(found.ref_H_cur, translation(0.5, 0), size) < 0.1


@pytest.mark.parametrize("size", [SIZE, LARGE])
def test_only_what_is_valid_counts(size: tuple[int, int]) -> None:
    reference = picture(size=size)
    moved = with_region(picture(translation(1e-9, 0), size), picture(translation(0.7, 0), size), 0.4)
    valid = with_region(np.ones_like(reference), np.zeros_like(reference), 0.4).astype(bool)
    points = HomologousPoints(reference, everywhere(reference))
    found = points.measure(moved, valid, reference, everywhere(reference))
    assert found.reference_px is not None
    assert found.previous_px is not None
    assert max(found.reference_px, found.previous_px) < LARGEST_NOISE_PX
    assert found.checkpoints < points.measure(moved, everywhere(moved)).checkpoints
    assert numbers(points.measure(moved, np.zeros_like(valid))) == (None, None, 0)


def test_the_black_border_of_a_warped_picture_does_not_count() -> None:
    H = similarity(2, 1.01, 15, -10, LARGE)
    reference, image = picture(size=LARGE), picture(H, LARGE)
    current, valid = stabilised(image, H, LARGE)
    assert not valid.all()
    found = HomologousPoints(reference, everywhere(reference)).measure(current, valid, current, valid)
    assert found.reference_px is not None
    assert found.reference_px < 0.25  # interpolation adds to SIFT's noise
    assert found.previous_px == 0


@pytest.mark.parametrize("size", [SIZE, LARGE])
@pytest.mark.parametrize(("x_px", "y_px"), [(-30, 40), (0, -75)])
def test_raw_pictures_that_lie_far_away(size: tuple[int, int], x_px: float, y_px: float) -> None:
    reference, current = picture(size=size), picture(translation(x_px, y_px), size)
    found = measured(reference, current, picture(translation(x_px - 1, y_px), size))
    assert found.reference_px == pytest.approx(math.hypot(x_px, y_px), abs=0.1)
    assert found.previous_px == pytest.approx(1, abs=0.1)
    assert found.checkpoints > 50


def test_raw_pictures_that_are_turned_count_to_their_corners() -> None:
    """Tiles that stayed in place would find the middle alone, which has hardly moved."""
    H = similarity(6, 1.02, 20, -15, LARGE)
    found = measured(picture(size=LARGE), picture(H, LARGE), picture(translation(1, 0) @ H, LARGE))
    assert found.reference_px == pytest.approx(rms_distance(H, IDENTITY, LARGE), rel=0.15)
    assert found.previous_px == pytest.approx(1 / 1.02, abs=0.1)


def test_a_jump_between_two_pictures_is_measured() -> None:
    found = measured(picture(size=LARGE), picture(translation(40, 0), LARGE), picture(translation(0, 30), LARGE))
    assert found.reference_px == pytest.approx(40, abs=0.1)
    assert found.previous_px == pytest.approx(50, abs=0.1)


@pytest.mark.parametrize("size", [SIZE, LARGE])
def test_where_nothing_is_found_again_there_is_no_rmse(size: tuple[int, int]) -> None:
    for current in (random_noise(1, size), flat(size=size), np.zeros(size[::-1], np.uint8)):
        found = measured(picture(size=size), current, current)
        assert (found.reference_px, found.previous_px) == (None, None)
        assert found.checkpoints < 8


@pytest.mark.parametrize("size", [SIZE, LARGE, (64, 64)])
def test_a_reference_of_nothing_has_no_rmse(size: tuple[int, int]) -> None:
    found = measured(np.full(size[::-1], 90, np.uint8), picture(size=LARGE)[: size[1], : size[0]])
    assert numbers(found) == (None, None, 0)


def test_without_the_picture_before_there_is_only_the_reference() -> None:
    found = measured(picture(), picture(translation(1, 0)))
    assert found.reference_px is not None
    assert found.previous_px is None


def test_a_lost_picture_before_leaves_the_comparison_with_the_reference() -> None:
    found = measured(picture(size=LARGE), picture(translation(1, 0), LARGE), random_noise(1, LARGE))
    assert found.reference_px == pytest.approx(1, abs=0.1)
    assert found.previous_px is None


def pictures_in_a_row() -> list[Gray]:
    return [picture(translation(0.4 * k, -0.2 * k), LARGE, noise=2) for k in range(5)]


def test_a_result_depends_on_the_pictures_alone() -> None:
    """Not on what was measured before (every picture, or every other one), nor on the number of threads."""
    row, valid = pictures_in_a_row(), np.ones(LARGE[::-1], bool)
    one_by_one = HomologousPoints(row[0], valid)
    results = [one_by_one.measure(row[k], valid, row[k - 1], valid) for k in range(1, 5)]
    threads = cv2.getNumThreads()
    try:
        for count in (1, 4):
            cv2.setNumThreads(count)
            other = HomologousPoints(row[0], valid)
            again_4_2 = [numbers(other.measure(row[k], valid, row[k - 1], valid)) for k in (4, 2)]
            assert again_4_2 == [numbers(results[3]), numbers(results[1])]
    finally:
        cv2.setNumThreads(threads)
    assert len({result.reference_px for result in results}) == 4


def test_a_buffer_that_is_filled_anew_is_a_new_picture() -> None:
    row, valid = pictures_in_a_row(), np.ones(LARGE[::-1], bool)
    points, buffer = HomologousPoints(row[0], valid), row[1].copy()
    points.measure(buffer, valid, row[0], valid)
    buffer[:] = row[4]
    again = points.measure(buffer, valid, row[3], valid)
    assert numbers(again) == numbers(HomologousPoints(row[0], valid).measure(row[4], valid, row[3], valid))


def test_pictures_are_not_written_to() -> None:
    row, valid = pictures_in_a_row(), np.ones(LARGE[::-1], bool)
    for array in (*row, valid):
        array.flags.writeable = False  # an error, if it were
    assert HomologousPoints(row[0], valid).measure(row[2], valid, row[1], valid).reference_px is not None


def test_pictures_that_are_cut_from_larger_ones_are_welcome() -> None:
    reference, current = picture(size=LARGE), picture(translation(1, 0), LARGE)
    cut = np.s_[::-1, 40:]
    assert measured(reference[cut], current[cut]).reference_px == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("shape", [(299, 400), (300, 401)])
def test_another_size_is_refused(shape: tuple[int, int]) -> None:
    points, fits, other = HomologousPoints(picture(), everywhere(picture())), picture(), np.zeros(shape, np.uint8)
    for arguments in ((other, everywhere(other)), (fits, everywhere(other)),
                      (fits, everywhere(fits), other, everywhere(other))):
        with pytest.raises(ValueError, match=r"must be \(300, 400\)"):
            points.measure(*arguments)
    with pytest.raises(ValueError, match=r"must be \(300, 400\)"):
        HomologousPoints(fits, everywhere(other))


def test_tiles_lie_where_they_are_allowed_even_if_that_is_little() -> None:
    """A bank of a sixth of the picture has as many key points as can be had from it."""
    reference: Gray = picture(size=LARGE)
    bank: FloatArray = np.zeros(reference.shape)
    bank[:90] = 1
    found = HomologousPoints(reference, bank.astype(bool)).measure(
        picture(translation(1, 0), LARGE), everywhere(reference))
    assert found.reference_px == pytest.approx(1, abs=0.1)
    assert found.checkpoints > 50
