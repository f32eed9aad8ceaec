"""The evaluator on cameras with dirt on the lens, text in the picture and hot pixels, which are no ground."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import cv2
import numpy as np
import pytest
from truth import IDENTITY, frame, picture, translation

from stab_ros.core.types import Gray, Homography
from stab_ros.evaluation.evaluator import Arrival, Evaluator
from stab_ros.evaluation.frame_metrics import FrameMetrics, Outcome
from stab_ros.evaluation.results import TopicEvaluation
from stab_ros.evaluation.settings import EvaluatorConfig, NamedPoint
from stab_ros.evaluation.summary import topic_json
from stab_ros.evaluation.verdict import Answer, verdict_of

SIZE = (640, 480)
EVERY = EvaluatorConfig(rmse_every=3)
FRAMES = 16


def path(index: int) -> Homography:
    """A camera that goes up to 20 px to the side and back."""
    return translation(1.9 * index if index < 11 else 1.9 * (21 - index), -0.7 * index)


def specks(image: Gray) -> Gray:
    """Soft dark specks over the whole lens, as dirt out of focus."""
    random, dirt = np.random.default_rng(7), np.zeros(image.shape, np.float32)
    for x, y, radius in random.uniform((0, 0, 3), (*SIZE, 8), (20, 3)).tolist():
        cv2.circle(dirt, (int(x), int(y)), int(radius), 1.0, cv2.FILLED)
    return np.asarray(image * (1 - 0.7 * cv2.GaussianBlur(dirt, (0, 0), 1.5)), np.uint8)


def lettered(image: Gray) -> Gray:
    """What a flight controller writes into the picture."""
    image = image.copy()
    for row in range(80, SIZE[1], 90):
        for column in (60, 360):
            cv2.putText(image, f"ALT {row}.{column} m", (column, row), cv2.FONT_HERSHEY_SIMPLEX, 0.9, 255, 2)
    return image


def hot(image: Gray) -> Gray:
    """A dim scene, and one pixel in 500 that glows."""
    glows = np.random.default_rng(3).random(image.shape) < 1 / 500
    return np.where(glows, 255, image // 5 + 8).astype(np.uint8)


def clean(image: Gray) -> Gray:
    return image


def arrivals(lens: Callable[[Gray], Gray], stabilised: bool = True, told: bool = True,
             moves: bool = True) -> Iterator[Arrival]:
    """A flight seen through a lens, stabilised by the truth or not at all, with or without its homographies."""
    for index in range(FRAMES):
        H = path(index) if moves else IDENTITY
        seen = lens(picture(H, SIZE, noise=0.0 if moves else 1.0 + 0.01 * index))
        warp = H if stabilised else IDENTITY
        steady = cv2.warpPerspective(seen, warp, SIZE) if stabilised and moves else seen
        shown = frame(np.asarray(steady, np.uint8), index)
        yield Arrival(index, shown.stamp_ns, warp if told else None, False, shown)


def judged(evaluator: Evaluator, stream: Iterator[Arrival]) -> TopicEvaluation:
    rows: list[FrameMetrics] = [evaluator.step(one) for one in stream]
    reference = evaluator.reference
    assert reference is not None
    return TopicEvaluation("/steady", reference, evaluator.points, evaluator.static,
                           tuple(map(evaluator.revised, rows)), evaluator.config, 25.0,
                           evaluator.camera_fixed, evaluator.has_hot_pixels, evaluator.points_are_named)


def median_px(found: TopicEvaluation) -> float:
    summary = found.summary("displacement_reference_px")
    assert summary is not None
    return summary.median


def test_points_on_dirt_are_left_out_and_told() -> None:
    found = judged(Evaluator(EVERY), arrivals(specks))
    assert found.camera_fixed.any()
    assert not (found.static & found.camera_fixed).any()
    assert median_px(found) < 0.1
    assert verdict_of(found).answer is Answer.STILL
    tree = topic_json(found)
    count = int(found.camera_fixed.sum())
    assert tree["points_left_out"]["fixed_to_camera"] == count
    assert [one["fixed_to_camera"] for one in tree["points"]] == found.camera_fixed.tolist()
    assert tree["remarks"] == [f"{count} of {len(found.points)} verification points are moving with the camera, as "
                               "dirt on the lens or an overlay does: left out"]


@pytest.mark.parametrize("told", [True, False], ids=["homographies", "none"])
def test_text_in_a_picture_that_stands_still_is_not_followed(told: bool) -> None:
    found = judged(Evaluator(EVERY), arrivals(lettered, told=told))
    checks = [row["rmse_reference_px"] for row in found.measured if (row["rmse_reference_px"] or 0) > 0]
    assert np.median(np.array(checks[1:], float)) < 0.4, "the first check comes before the camera has moved"
    assert verdict_of(found).answer is not Answer.MOVES


@pytest.mark.parametrize("lens", [specks, lettered, hot])
def test_what_is_not_stabilised_at_all_never_stands_still(lens: Callable[[Gray], Gray]) -> None:
    found = judged(Evaluator(EVERY), arrivals(lens, stabilised=False))
    verdict = verdict_of(found)
    assert verdict.answer is not Answer.STILL
    if verdict.answer is Answer.MOVES:
        assert verdict.moves_px is not None
        assert verdict.moves_px > 3 or verdict.at_least


def test_hot_pixels_are_no_points() -> None:
    found = judged(Evaluator(EVERY), arrivals(hot))
    assert topic_json(found)["hot_pixels"] is True
    assert "hot or dead pixels" in found.remarks[-1]
    assert median_px(found) < 0.3


@pytest.mark.parametrize("lens", [clean, specks, lettered])
def test_a_camera_on_a_tripod_keeps_its_points(lens: Callable[[Gray], Gray]) -> None:
    found = judged(Evaluator(EVERY), arrivals(lens, moves=False))
    assert found.static.all()
    assert not found.camera_fixed.any()
    assert found.remarks == ()
    assert verdict_of(found).answer is Answer.STILL


def test_a_clean_lens_changes_nothing() -> None:
    found = judged(Evaluator(EVERY), arrivals(clean))
    assert not found.camera_fixed.any()
    assert found.static.all()
    assert not found.hot_pixels
    assert found.remarks == ()


def test_points_of_the_user_are_warned_about_and_kept() -> None:
    chosen = judged(Evaluator(EVERY), arrivals(specks))
    named: list[NamedPoint] = [(point.name, float(point.x_px), float(point.y_px)) for point in chosen.points]
    found = judged(Evaluator(EVERY, named), arrivals(specks))
    assert found.camera_fixed.any()
    assert "does: counted all the same" in found.remarks[0]
    assert topic_json(found)["points_left_out"]["fixed_to_camera"] == int((~found.static & found.camera_fixed).sum())
    assert all(row["points_used"] for row in found.measured)


def test_wrong_homographies_of_a_camera_at_rest_do_not_hide_the_motion() -> None:
    """The stabiliser moves a picture that stood still: all of it stands still in the raw picture."""
    still = picture(IDENTITY, SIZE, noise=0.0)

    def moved() -> Iterator[Arrival]:
        for index in range(FRAMES):
            shown = frame(cv2.warpPerspective(still, path(index), SIZE).astype(np.uint8), index)
            yield Arrival(index, shown.stamp_ns, path(index), False, shown)

    found = judged(Evaluator(EVERY), moved())
    assert found.static.any()
    verdict = verdict_of(found)
    assert verdict.answer is Answer.MOVES
    assert verdict.moves_px is not None
    assert verdict.moves_px > 5


def test_a_reference_that_was_warped_itself_is_the_same_camera() -> None:
    """A recording that begins in mid-flight."""
    late = [one for one in arrivals(specks) if one.index >= 6]
    found = judged(Evaluator(EVERY), iter(late))
    assert found.rows[0].outcome is Outcome.REFERENCE
    assert not (found.static & found.camera_fixed).any()


def test_a_check_of_one_frame_does_not_stand_for_all() -> None:
    found = judged(Evaluator(EvaluatorConfig()), arrivals(clean, stabilised=False, told=False))
    checked = found.summary("rmse_reference_px")
    assert checked is not None
    assert checked.count < 3
    verdict = verdict_of(found)
    assert (verdict.answer, verdict.moves_px) == (Answer.MOVES, median_px(found))
