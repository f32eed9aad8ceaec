"""The evaluator against exact truth: known residuals, brightness, what moves on its own, gaps, a new reference."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from truth import IDENTITY, flat, frame, picture, similarity, translation

from stab_ros.core.errors import InputError
from stab_ros.core.region import Area, Region
from stab_ros.core.types import Frame, Gray, Homography
from stab_ros.evaluation.evaluator import Arrival, Evaluator
from stab_ros.evaluation.frame_metrics import FrameMetrics, Outcome
from stab_ros.evaluation.settings import EvaluatorConfig

SIZE = (640, 480)
EVERY = EvaluatorConfig(rmse_every=1)
DIRECTIONS = (0.0, 0.8, 2.4, 4.0)


def arrival(index: int, image: Gray | None, ref_H_cur: Homography | None = None, lost: bool = False) -> Arrival:
    shown = None if image is None else frame(image, index)
    return Arrival(index, frame(flat(), index).stamp_ns, ref_H_cur, lost, shown)


def measured(evaluator: Evaluator, *images: Gray) -> list[FrameMetrics]:
    return [evaluator.step(arrival(index, image)) for index, image in enumerate(images)]


def displaced(distance_px: float, angle: float, noise: float, seed: int = 1) -> Gray:
    """What remains of motion when a stabiliser leaves the picture displaced so far."""
    x, y = distance_px * np.cos(angle), distance_px * np.sin(angle)
    return picture(translation(-x, -y), SIZE, seed, noise)


@pytest.mark.parametrize(("noise", "relative", "absolute_px"), [(0.0, 0.15, 0.05), (2.0, 0.20, 0.1)])
@pytest.mark.parametrize("distance_px", [0.05, 0.2, 0.5, 1.0, 2.0, 4.0])
def test_a_known_residual_is_recovered(distance_px: float, noise: float, relative: float, absolute_px: float) -> None:
    evaluator = Evaluator(EVERY)
    images = [picture(IDENTITY, SIZE, 1, noise), *(displaced(distance_px, angle, noise) for angle in DIRECTIONS)]
    for found, angle in zip(measured(evaluator, *images)[1:], DIRECTIONS, strict=True):
        tolerance_px = max(relative * distance_px, absolute_px)
        assert found["displacement_reference_px"] == pytest.approx(distance_px, abs=tolerance_px)
        true_px = distance_px * np.array([np.cos(angle), np.sin(angle)])
        assert (found["shift_u_px"], found["shift_v_px"]) == pytest.approx(true_px, abs=0.05)
        assert found.field is not None
        for region in found.field.regions:
            assert (region.u_px, region.v_px) == pytest.approx(true_px, abs=0.05 if noise == 0 else 0.1)
            assert region.magnitude_px == pytest.approx(distance_px, abs=0.05 if noise == 0 else 0.15)


def test_rmsd_is_that_of_the_equation() -> None:
    before, after = picture(IDENTITY, SIZE), displaced(0.7, 1.0, 1.0)
    evaluator = Evaluator(EvaluatorConfig(points=5))
    _, found = measured(evaluator, before, after)
    expected = []
    for point in evaluator.points:
        total = 0
        for i in range(-15, 16):
            for j in range(-15, 16):
                place = point.y_px + i, point.x_px + j
                total += (int(before[place]) - int(after[place])) ** 2
        expected.append((total / 31**2) ** 0.5)
    assert found.points["rmsd_reference"] == pytest.approx(expected, rel=1e-5)
    assert found["rmsd_reference"] == pytest.approx(np.mean(expected), rel=1e-5)


def test_previous_is_the_frame_before() -> None:
    images = [picture(IDENTITY, SIZE), displaced(1.0, 0, 1), displaced(1.0, 0, 1.0001), displaced(2.0, 0, 1)]
    found = measured(Evaluator(EVERY), *images)
    assert [one["displacement_previous_px"] for one in found[1:]] == pytest.approx([1, 0, 1], abs=0.15)
    assert [one["displacement_reference_px"] for one in found[1:]] == pytest.approx([1, 1, 2], abs=0.3)
    assert [one["rmse_previous_px"] for one in found[1:]] == pytest.approx([1, 0, 1], abs=0.15)
    assert [one["rmse_reference_px"] for one in found[1:]] == pytest.approx([1, 1, 2], abs=0.15)


@pytest.mark.parametrize(("gain", "offset"), [(1.05, 0.0), (0.95, 0.0), (1.0, 8.0)])
def test_a_change_of_brightness_is_told_and_not_taken_for_motion(gain: float, offset: float) -> None:
    evaluator = Evaluator(EvaluatorConfig())
    _, found = measured(evaluator, picture(IDENTITY, SIZE), picture(IDENTITY, SIZE, gain=gain, offset=offset))
    assert found["brightness_change"] == pytest.approx(gain + offset / 128 - 1, abs=0.01)
    assert (found["rmsd_reference"] or 0) > 5, "Eq. 2 stays what it is"
    assert (found["displacement_reference_px"] or 0) < 0.1


def test_only_the_overlap_counts() -> None:
    """What the camera has left is black; windows that reach into it are left out."""
    H = translation(60.3, 41.6) @ similarity(3.0, 1.0, size=SIZE)
    warped = cv2.warpPerspective(picture(H, SIZE), H, SIZE)
    for known in (H, None):
        evaluator = Evaluator(EvaluatorConfig(points=20, rmse_every=1))
        evaluator.step(arrival(0, picture(IDENTITY, SIZE), IDENTITY))
        found = evaluator.step(arrival(1, warped, known))
        assert 0 < (found["points_used"] or 0) < len(evaluator.points)
        assert (found["displacement_reference_px"] or 9) < 0.3
        assert found.field is not None
        lengths = [region.magnitude_px for region in found.field.regions if region.vectors]
        assert lengths
        assert max(lengths) < 0.1


@pytest.mark.thorough
def test_water_does_not_count_as_unrest() -> None:
    """A third of the picture flows at 1.5 px a frame under a camera that stands still."""
    still, images = picture(IDENTITY, SIZE, noise=0), []
    for index in range(12):
        flowing = picture(translation(-1.5 * index, 0), SIZE, seed=2, noise=0)
        grain = np.random.default_rng(index).normal(0, 1, still.shape)
        both = np.where(np.arange(SIZE[1])[:, None] < 320, still, flowing)
        images.append(np.asarray(np.clip(np.round(both + grain), 0, 255), np.uint8))
    evaluator = Evaluator(EVERY)
    found = measured(evaluator, *images)
    wet = np.array([point.y_px > 320 for point in evaluator.points])
    assert wet.any()
    assert not evaluator.static[wet].any()
    assert evaluator.static[~wet].all()
    assert max(one["displacement_reference_px"] or 0 for one in found[1:]) < 0.15
    assert max(one["rmse_reference_px"] or 0 for one in found[1:]) < 0.2


def test_frames_that_were_lost_or_have_no_picture_are_not_measured() -> None:
    evaluator = Evaluator(EvaluatorConfig())
    image = picture(IDENTITY, SIZE)
    arrivals = [arrival(0, image), arrival(1, None, lost=True), arrival(2, displaced(1, 0, 1)), arrival(3, None)]
    found = [evaluator.step(one) for one in arrivals]
    assert [one.outcome for one in found] == [Outcome.REFERENCE, Outcome.LOST, Outcome.MEASURED, Outcome.NO_IMAGE]
    assert found[2]["rmsd_previous"] is None, "a lost frame lies between"
    assert found[2]["rmsd_reference"] is not None


def test_checks_come_after_the_reference_and_then_every_so_often() -> None:
    evaluator = Evaluator(EvaluatorConfig(rmse_every=3))
    found = measured(evaluator, *[picture(IDENTITY, SIZE, noise=1 + i / 100) for i in range(8)])
    assert [one.frame for one in found if one.field is not None] == [1, 3, 6]
    assert [one.frame for one in found if one["checkpoints"] is not None] == [1, 3, 6]


def test_skipping_a_check_changes_nothing_else() -> None:
    images = [picture(IDENTITY, SIZE), displaced(0.5, 1, 1)]
    whole, less = Evaluator(EVERY), Evaluator(EVERY)
    measured(whole, images[0])
    measured(less, images[0])
    assert less.check_is_due
    a, b = whole.step(arrival(1, images[1])), less.step(arrival(1, images[1]), check=False)
    assert b.field is None
    assert b.values == {name: value for name, value in a.values.items() if name in b.values}


def test_repeated_pictures_are_counted() -> None:
    image, other = picture(IDENTITY, SIZE), displaced(0.2, 0, 1)
    found = measured(Evaluator(EvaluatorConfig()), image, image, image, other, other)
    assert [one["identical_frames"] for one in found[1:]] == [1, 2, 0, 1]


def test_a_given_reference_is_measured_against_and_replaced_by_a_newer_one() -> None:
    evaluator = Evaluator(EvaluatorConfig())
    evaluator.use_reference(frame(picture(IDENTITY, SIZE), 0))
    late = evaluator.step(arrival(5, displaced(1.0, 0, 1)))
    assert late["displacement_reference_px"] == pytest.approx(1, abs=0.15)
    evaluator.use_reference(frame(displaced(3.0, 0, 1), 6))
    assert evaluator.step(arrival(6, displaced(3.0, 0, 1))).outcome is Outcome.REFERENCE
    still = evaluator.step(arrival(7, displaced(3.0, 0, 1.1)))
    assert still["displacement_reference_px"] == pytest.approx(0, abs=0.1)


def test_another_size_begins_anew() -> None:
    images = [picture(), picture(noise=1.1), picture(IDENTITY, SIZE), picture(IDENTITY, SIZE, noise=2)]
    found = measured(Evaluator(EvaluatorConfig()), *images)
    assert [one.outcome.value for one in found] == ["REFERENCE", "MEASURED", "REFERENCE", "MEASURED"]


def test_metres_need_a_scale() -> None:
    images = [picture(IDENTITY, SIZE), displaced(0.5, 0, 1)]
    plain = measured(Evaluator(EvaluatorConfig()), *images)[1]
    assert plain["velocity_error_m_s"] is plain["position_error_m"] is None
    by_stamp = measured(Evaluator(EvaluatorConfig(gsd_m=0.01)), *images)[1]
    given = measured(Evaluator(EvaluatorConfig(gsd_m=0.01, fps=24.0)), *images)[1]
    unrest_px = plain["displacement_previous_px"] or 0
    assert by_stamp["velocity_error_m_s"] == pytest.approx(unrest_px * 0.01 * 25)
    assert given["velocity_error_m_s"] == pytest.approx(unrest_px * 0.01 * 24)
    assert given["position_error_m"] == pytest.approx((plain["displacement_reference_px"] or 0) * 0.01)


def test_points_and_areas_of_the_user() -> None:
    gray = picture(IDENTITY, SIZE)
    evaluator = Evaluator(EvaluatorConfig(), [("left", 100.0, 200.4), ("right", 500.0, 200.0)])
    measured(evaluator, gray)
    places = [(point.name, point.x_px, point.y_px) for point in evaluator.points]
    assert places == [("left", 100, 200), ("right", 500, 200)]
    with pytest.raises(InputError, match="outside"):
        measured(Evaluator(EvaluatorConfig(), [("outside", 2.0, 200.0)]), gray)
    water = Region("exclude", (np.array([[0.0, 0], [640, 0], [640, 240], [0, 240]]),))
    dry = Evaluator(EvaluatorConfig(), area=Area(exclude=water))
    measured(dry, gray)
    assert dry.points
    assert min(point.y_px for point in dry.points) > 240 + 15


def test_a_picture_without_texture_has_no_points_and_no_displacement() -> None:
    evaluator = Evaluator(EVERY)
    _, found = measured(evaluator, flat(size=SIZE), flat(level=91, size=SIZE))
    assert evaluator.points == ()
    assert found["points_used"] == 0
    assert found["displacement_reference_px"] is found["rmse_reference_px"] is None


def test_the_same_stream_gives_the_same_numbers() -> None:
    images = [picture(IDENTITY, SIZE), displaced(0.5, 1, 1), displaced(0.3, 2, 1)]
    first, second = measured(Evaluator(EVERY), *images), measured(Evaluator(EVERY), *images)
    assert [one.values for one in first] == [one.values for one in second]


@pytest.mark.parametrize("encoding", ["bgr8", "mono16"])
def test_colour_and_depth_are_measured_as_gray(encoding: str) -> None:
    def shown(image: Gray, index: int) -> Frame:
        one = frame(image, index)
        decoded = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if encoding == "bgr8" else image.astype(np.uint16) * 16
        return replace(one, image=decoded, encoding=encoding)

    evaluator = Evaluator(EvaluatorConfig())
    for index, image in enumerate([picture(IDENTITY, SIZE), displaced(1.0, 0.5, 1)]):
        one = shown(image, index)
        found = evaluator.step(Arrival(index, one.stamp_ns, None, False, one))
    assert found["displacement_reference_px"] == pytest.approx(1.0, abs=0.15)
