"""The engine over a stream: reference, gate, prediction, loss and return, settings at run time."""

from __future__ import annotations

from contextlib import suppress

import cv2
import numpy as np
import pytest
from truth import (
    IDENTITY,
    SIZE,
    error_px,
    flat,
    frame,
    picture,
    projective,
    random_noise,
    similarity,
    translation,
)

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply
from stab_ros.core.types import Correspondences, Fit, Frame, Gray, Image, LostReason, State
from stab_ros.methods import METHODS
from stab_ros.parameters.engines import make_stabilizer, reconfigure
from stab_ros.tracking.motion import CameraMotion
from stab_ros.tracking.stabilizer import Stabilizer

TOLERANCE_PX = 0.02
MOVED = translation(3.37, -2.61)
SECOND_NS = 10**9
BESIDE = "[[[500, 10], [600, 10], [600, 90]]]"
LEFT_HALF = "[[[0, 0], [199, 0], [199, 299], [0, 299]]]"


def started(image: Image | None = None, **values: bool | float | str) -> Stabilizer:
    """An engine that has taken the picture (the unmoved one) as its reference."""
    stabilizer = make_stabilizer({name.replace("__", "."): value for name, value in values.items()})
    assert stabilizer.track(frame(picture() if image is None else image)).tracked
    return stabilizer


def matched(stabilizer: Stabilizer) -> tuple[Correspondences, Fit]:
    """What the last frame was accepted by."""
    assert stabilizer.last_match is not None
    pairs, fit = stabilizer.last_match
    assert fit is not None
    return pairs, fit


# --- reference, loss and return --------------------------------------------------------------------------------------


def test_before_the_first_frame_there_is_nothing() -> None:
    stabilizer = make_stabilizer({})
    assert stabilizer.reference is None
    assert stabilizer.last_match is None
    assert stabilizer.reset_counter == 0


@pytest.mark.parametrize("method", list(METHODS))
def test_after_a_loss_the_same_reference_holds(method: str) -> None:
    stabilizer = started(method=method)
    assert error_px(stabilizer.track(frame(picture(MOVED), 1)), MOVED) < 0.1
    for index in range(2, 8):
        assert stabilizer.track(frame(random_noise(index), index)).state is State.LOST
    elsewhere = similarity(2.0, 1.01, -19, 12)  # the camera went on while nothing was seen
    track = stabilizer.track(frame(picture(elsewhere), 8))
    assert error_px(track, elsewhere) < 0.1
    assert (track.reset_counter, track.reference_stamp_ns, track.index) == (0, SECOND_NS, 8)


def test_reset_takes_the_next_textured_frame() -> None:
    stabilizer = started()
    stabilizer.reset_reference()
    assert stabilizer.reference is None
    assert stabilizer.track(frame(flat(), 1)).state is State.LOST
    new = stabilizer.track(frame(picture(MOVED), 2))
    np.testing.assert_array_equal(new.ref_H_cur, IDENTITY)
    assert (new.reset_counter, new.reference_stamp_ns) == (1, new.stamp_ns)
    back = stabilizer.track(frame(picture(), 3))
    assert back.reset_counter == 1
    assert error_px(back, np.linalg.inv(MOVED)) < TOLERANCE_PX


def test_reference_is_the_frame_itself() -> None:
    first = frame(picture())
    stabilizer = make_stabilizer({})
    stabilizer.track(first)
    assert stabilizer.reference is not None
    np.testing.assert_array_equal(stabilizer.reference.image, first.image)
    assert (stabilizer.reference.stamp_ns, stabilizer.reference.frame_id) == (first.stamp_ns, "camera")


@pytest.mark.parametrize("method", list(METHODS))
def test_a_region_with_nothing_in_it_is_not_said_to_be_tracked(method: str) -> None:
    half_flat = picture()
    half_flat[:, :200] = 90
    stabilizer = make_stabilizer({"method": method, "roi": LEFT_HALF.replace("199", "150")})
    with suppress(InputError):  # a refusal is as right as a lost frame
        assert stabilizer.track(frame(half_flat)).state is State.LOST


# --- on_lost ---------------------------------------------------------------------------------------------------------


def test_a_lost_frame_is_dropped_held_or_passed() -> None:
    lost = random_noise(1)
    images = {}
    for on_lost in ("drop", "hold", "pass"):
        stabilizer = started(on_lost=on_lost)
        H = stabilizer.track(frame(picture(MOVED), 1)).ref_H_cur
        done = stabilizer.step(frame(lost, 2))
        assert done.track.state is State.LOST
        images[on_lost] = done.image
    assert images["drop"] is None
    np.testing.assert_array_equal(images["pass"], lost)
    assert images["hold"] is not None
    assert H is not None
    np.testing.assert_allclose(images["hold"].astype(int), cv2.warpPerspective(lost, H, SIZE), atol=9)


def test_hold_without_any_reference_gives_nothing() -> None:
    for on_lost, expected in (("drop", False), ("hold", False), ("pass", True)):
        done = make_stabilizer({"on_lost": on_lost}).step(frame(flat()))
        assert (done.image is not None) == expected


# --- gate ------------------------------------------------------------------------------------------------------------


def half_seen() -> Gray:
    """The moved picture, of which only the upper third is not hidden by noise."""
    image = picture(MOVED)
    image[100:] = random_noise(9)[100:]
    return image


def test_the_gate_wants_inliers() -> None:
    track = started().track(frame(half_seen(), 1))
    assert error_px(track, MOVED) < 0.1
    assert started(min_inliers=track.inliers - 1).track(frame(half_seen(), 1)).tracked
    assert not started(min_inliers=track.inliers + 1).track(frame(half_seen(), 1)).tracked
    # a third of the picture agrees, and there nearly all features do: the share does not count
    assert started(min_inlier_share=1.0).track(frame(half_seen(), 1)).tracked


def test_the_gate_wants_certainty() -> None:
    sigma_px = started().track(frame(half_seen(), 1)).sigma_px
    assert sigma_px is not None
    relative = 1000 * sigma_px / max(SIZE)
    assert started(max_sigma=1.1 * relative).track(frame(half_seen(), 1)).tracked
    assert not started(max_sigma=0.9 * relative).track(frame(half_seen(), 1)).tracked


def test_a_mirrored_picture_is_lost() -> None:
    assert not started().track(frame(np.ascontiguousarray(picture()[:, ::-1]), 1)).tracked


def test_a_lost_frame_teaches_nothing() -> None:
    calm, disturbed = started(), started()
    for index in range(1, 6):
        assert not disturbed.track(frame(random_noise(index), index)).tracked
    a, b = (s.track(frame(picture(MOVED), 6)) for s in (calm, disturbed))
    assert a.tracked
    assert (a.inliers, a.sigma_px, a.rmse_px) == (b.inliers, b.sigma_px, b.rmse_px)


def test_what_moves_against_the_ground_loses_its_say() -> None:
    stabilizer, moving = started(), np.s_[100:200, 100:300]
    for index in range(1, 8):
        image = picture(translation(0.4 * index, 0))
        image[moving] = picture(translation(0.4 * index - 0.35 * index, 0.2 * index))[moving]
        track = stabilizer.track(frame(image, index))
        assert error_px(track, translation(0.4 * index, 0)) < 0.05
    pairs, fit = matched(stabilizer)
    x, y = apply(np.linalg.inv(fit.ref_H_cur), pairs.reference_px).T
    hidden = (x > 110) & (x < 290) & (y > 110) & (y < 190)
    ground = (x < 85) | (x > 315)
    assert not fit.inlier[hidden].any()
    assert ground.sum() > 100
    assert fit.inlier[ground].mean() > 0.9


# --- prediction ------------------------------------------------------------------------------------------------------


def test_prediction_is_constant_velocity_in_stamps() -> None:
    step = similarity(0.5, 1.0, 2.0, -1.0)
    motion = CameraMotion(SIZE, IDENTITY, 0).then(step, 40)
    np.testing.assert_allclose(apply(motion.predict(80), CORNERS), apply(step @ step, CORNERS), atol=0.05)
    half = apply(motion.predict(60), CORNERS) - apply(step, CORNERS)
    np.testing.assert_allclose(2 * half, apply(motion.predict(80), CORNERS) - apply(step, CORNERS), atol=0.02)
    assert motion.predict(80)[2, 2] == 1


@pytest.mark.parametrize("stamp_ns", [40, 39, 0, -(10**9), 40 + 121, 10**18])
def test_stamps_that_tell_no_velocity_predict_the_last_place(stamp_ns: int) -> None:
    motion = CameraMotion(SIZE, IDENTITY, 0).then(MOVED, 40)
    np.testing.assert_array_equal(motion.predict(stamp_ns), MOVED)


def test_prediction_after_duplicate_or_backward_stamps_or_a_loss() -> None:
    for before_ns in (40, 50):
        np.testing.assert_array_equal(CameraMotion(SIZE, IDENTITY, before_ns).then(MOVED, 40).predict(60), MOVED)
    np.testing.assert_array_equal(CameraMotion(SIZE, IDENTITY, 0).then(MOVED, 40).standing().predict(80), MOVED)
    np.testing.assert_array_equal(CameraMotion(SIZE, MOVED, 0).predict(40), MOVED)


CORNERS = np.array([[0, 0], [399, 0], [0, 299], [399, 299.0]])
IRREGULAR_MS = {
    "even": [0, 40, 80, 120, 160, 200], "gaps": [0, 40, 400, 440, 5000, 5040], "duplicate": [0, 40, 40, 40, 80, 80],
    "backward": [0, 40, 20, 60, 10, 50], "restarted": [0, 40, 80, 0, 40, 80], "zero": [0, 0, 0, 0, 0, 0],
    "far future": [0, 40, 80, 2**62 // 10**6, 120, 160],
}


@pytest.mark.parametrize("kind", list(IRREGULAR_MS))
@pytest.mark.parametrize("method", ["direct", "klt", "akaze"])  # with a guess, with pictures of its own, and without
def test_stamps_of_any_kind_do_no_harm(method: str, kind: str) -> None:
    stabilizer = make_stabilizer({"method": method})
    for index, at_ms in enumerate(IRREGULAR_MS[kind]):
        H = translation(2.3 * index, -1.1 * index)
        track = stabilizer.track(Frame(picture(H), "mono8", at_ms * 10**6))
        assert error_px(track, H) < 0.1
        assert (track.stamp_ns, track.reference_stamp_ns) == (at_ms * 10**6, 0)


# --- settings at run time --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", list(METHODS))
def test_new_settings_keep_the_reference(method: str) -> None:
    stabilizer = started()
    stabilizer.track(frame(picture(translation(1, 1)), 1))
    reconfigure(stabilizer, {"method": method, "model": "similarity", "exclude": LEFT_HALF, "on_lost": "pass"})
    turned = similarity(1.0, 1.0, 4, 2)
    track = stabilizer.track(frame(picture(turned), 2))
    assert (track.reset_counter, track.reference_stamp_ns, track.index) == (0, SECOND_NS, 2)
    assert error_px(track, turned) < 0.1
    assert matched(stabilizer)[0].reference_px[:, 0].min() > 199
    assert track.ref_H_cur is not None
    np.testing.assert_allclose(track.ref_H_cur[2], [0, 0, 1], atol=1e-12)
    assert stabilizer.step(frame(random_noise(1), 3)).image is not None


@pytest.mark.parametrize("values", [
    {"roi": BESIDE}, {"method": "klt", "exclude": BESIDE}, {"roi": LEFT_HALF, "exclude": LEFT_HALF},
    {"model": "rubber"}, {"roi": "[[[1, 2]]]"}, {"direct.radius": 99, "on_lost": "hold"}, {"roi": "/nowhere.png"},
])
def test_wrong_settings_change_nothing(values: dict[str, str]) -> None:
    touched, untouched = started(), started()
    with pytest.raises(InputError):
        reconfigure(touched, {"on_lost": "pass", **values})
    for index, image in enumerate([picture(MOVED), random_noise(1), picture(projective())], start=1):
        a, b = (s.step(frame(image, index)) for s in (touched, untouched))
        assert (a.track.state, a.track.inliers, a.track.sigma_px) == (b.track.state, b.track.inliers, b.track.sigma_px)
        assert (a.image is None) == (b.image is None)
        if a.track.tracked:
            np.testing.assert_array_equal(a.track.ref_H_cur, b.track.ref_H_cur)


def test_settings_before_the_first_frame_count_from_it() -> None:
    stabilizer = make_stabilizer({})
    reconfigure(stabilizer, {"roi": BESIDE})
    with pytest.raises(InputError, match="outside the reference"):
        stabilizer.track(frame(picture()))
    reconfigure(stabilizer, {})
    track = stabilizer.track(frame(picture(), 1))
    assert (track.state, track.index) == (State.TRACKED, 1)


def test_a_start_up_that_fails_begins_anew() -> None:
    stabilizer: Stabilizer = make_stabilizer({"start_s": 0.1})
    for k in range(3):
        stabilizer.answers(frame(picture(translation(0.1 * k, 0)), k))
    failed = [stabilizer.fail(k, frame(picture(), k).stamp_ns) for k in (1, 2)]
    assert [track.lost_reason for track in failed] == [LostReason.INTERNAL] * 2
    assert not stabilizer.buffering
    later = [track for k in range(3, 9) for track in stabilizer.answers(frame(picture(translation(0.1 * k, 0)), k))]
    later += stabilizer.finish()
    assert [track.index for track in later] == list(range(3, 9))
    assert {track.reset_counter for track in later} == {1}
    assert all(track.tracked for track in later)
