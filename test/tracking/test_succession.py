"""A damaged first picture gives way to a later one; a good one that damaged ones follow does not."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from truth import IDENTITY, SIZE, error_px, flat, frame, picture, random_noise, similarity, translation

from stab_ros.core.types import Gray, Homography, LostReason, Track
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.tracking.stabilizer import Stabilizer

FRAMES = 16
START = {"start_s": 0.4}  # ten frames
AT_ONCE = {"start_s": 0.0}


def place(index: int) -> Homography:
    return similarity(0.05 * index, 1.0, 0.9 * index, -0.6 * index)


def strips(index: int) -> Gray:
    """A picture that was put together from the wrong pieces: most strips of a good one, each at another place."""
    good, draw = picture(place(index)), np.random.default_rng(index)
    return np.concatenate([np.roll(good[top : top + 20], draw.integers(40, 360), axis=1) for top in range(0, 300, 20)])


DAMAGED: dict[str, Callable[[int], Gray]] = {
    "noise": random_noise, "strips": strips, "another scene": lambda _: picture(seed=9),
    "upside down": lambda index: np.ascontiguousarray(picture(place(index))[::-1]),
}


def answered(images: Sequence[Gray], stabilizer: Stabilizer) -> list[Track]:
    tracks = [track for index, image in enumerate(images) for track in stabilizer.answers(frame(image, index))]
    tracks += stabilizer.finish()
    assert [track.index for track in tracks] == list(range(len(images)))
    return tracks


def pictures(**bad: Gray) -> list[Gray]:
    """A good stream with other pictures at `at_<index>`."""
    images = [picture(place(index)) for index in range(FRAMES)]
    for name, image in bad.items():
        images[int(name.removeprefix("at_"))] = image
    return images


def check_tracked_by(tracks: Sequence[Track], reference: int) -> None:
    """All of the tracks are right, relative to the frame of that number."""
    to_reference = np.linalg.inv(place(reference))
    for track in tracks:
        assert error_px(track, to_reference @ place(track.index), SIZE) < 0.05
        assert track.reference_stamp_ns == frame(picture(), reference).stamp_ns


@pytest.mark.parametrize("damage", list(DAMAGED))
def test_a_damaged_first_picture_is_given_up_within_the_start(damage: str) -> None:
    stabilizer = make_stabilizer(START)
    tracks = answered(pictures(at_0=DAMAGED[damage](0)), stabilizer)
    check_tracked_by(tracks[1:], reference=1)
    assert [track.reset_counter for track in tracks] == [0] + [1] * (FRAMES - 1)
    assert stabilizer.given_up == 1
    assert stabilizer.reference is not None
    assert stabilizer.reference.stamp_ns == frame(picture(), 1).stamp_ns


def test_two_damaged_pictures_are_given_up() -> None:
    tracks = answered(pictures(at_0=random_noise(0), at_1=picture(seed=9)), make_stabilizer(START))
    check_tracked_by(tracks[2:], reference=2)
    assert tracks[1].lost_reason is LostReason.NO_FEATURES
    assert tracks[1].reset_counter == 1


@pytest.mark.parametrize("damage", ["noise", "strips"])
def test_without_a_start_it_is_given_up_after_some_frames(damage: str) -> None:
    stabilizer = make_stabilizer(AT_ONCE)
    tracks = answered(pictures(at_0=DAMAGED[damage](0)), stabilizer)
    lost = [track.index for track in tracks if not track.tracked]
    assert lost == list(range(1, 9))
    check_tracked_by(tracks[9:], reference=1)
    assert stabilizer.given_up == 1


@pytest.mark.parametrize("values", [START, AT_ONCE])
@pytest.mark.parametrize("damage", ["strips", "another scene"])
def test_damaged_pictures_after_a_good_reference_cost_themselves_alone(damage: str, values: dict[str, float]) -> None:
    bad = {f"at_{index}": DAMAGED[damage](index) for index in (1, 2, 3, 6)}
    stabilizer = make_stabilizer(values)
    tracks = answered(pictures(**bad), stabilizer)
    check_tracked_by([tracks[index] for index in range(FRAMES) if index not in (1, 2, 3, 6)], reference=0)
    assert stabilizer.given_up == 0


def test_the_same_wrong_picture_some_times_does_not_replace_the_reference() -> None:
    """As a decoder that repeats a frame: those agree among each other, but more frames agree with the reference."""
    wrong = {f"at_{index}": picture(seed=9) for index in range(1, 5)}
    for values in (START, AT_ONCE):
        tracks = answered(pictures(**wrong), make_stabilizer(values))
        check_tracked_by([tracks[0], *tracks[5:]], reference=0)


def test_a_flat_picture_is_no_rival() -> None:
    tracks = answered(pictures(at_0=random_noise(0), at_1=flat(), at_2=flat()), make_stabilizer(START))
    check_tracked_by(tracks[3:], reference=3)


def test_a_pause_gives_the_reference_up_if_that_is_clear() -> None:
    stabilizer, images = make_stabilizer({"start_s": 2.0}), pictures(at_0=random_noise(0))
    tracks = [track for index, image in enumerate(images[:8]) for track in stabilizer.answers(frame(image, index))]
    tracks += stabilizer.pause(ended=False)
    check_tracked_by(tracks[1:], reference=1)
    for index in range(8, FRAMES):
        tracks += stabilizer.answers(frame(images[index], index))
    tracks += stabilizer.finish()
    check_tracked_by(tracks[1:], reference=1)
    assert [track.index for track in tracks] == list(range(FRAMES))


def test_a_pause_that_comes_too_early_keeps_the_reference() -> None:
    stabilizer, images = make_stabilizer(START), pictures(at_0=random_noise(0))
    tracks = [track for index in range(3) for track in stabilizer.answers(frame(images[index], index))]
    tracks += stabilizer.pause(ended=False)
    assert [track.tracked for track in tracks] == [True, False, False]
    assert stabilizer.given_up == 0


def test_a_resumed_reference_is_never_given_up() -> None:
    first = make_stabilizer(AT_ONCE)
    for index in range(3):
        first.track(frame(picture(place(index)), index))
    assert first.static_map is not None
    assert first.reference is not None
    again = make_stabilizer(AT_ONCE)
    again.resume(first.reference, first.static_map, 4)
    for index in range(3, 14):
        assert not again.track(frame(picture(translation(index, 0), seed=9), index)).tracked
    assert again.track(frame(picture(place(2)), 14)).tracked
    assert again.reset_counter == 4


# --- one bad picture within the start --------------------------------------------------------------------------------


@pytest.mark.parametrize("at", [1, 4])
@pytest.mark.parametrize("damage", ["noise", "upside down"])
def test_a_glitch_within_the_start_costs_itself_alone(damage: str, at: int) -> None:
    tracks = answered(pictures(**{f"at_{at}": DAMAGED[damage](at)}), make_stabilizer(START))
    assert [track.index for track in tracks if not track.tracked] == [at]
    check_tracked_by([track for track in tracks if track.index != at], reference=0)


def test_a_jump_within_the_start_is_followed() -> None:
    far = [IDENTITY if index < 4 else similarity(12.0, 1.0, 60.0, 20.0) @ translation(index, 0) for index in range(12)]
    for track in answered([picture(H) for H in far], make_stabilizer(START)):
        assert error_px(track, far[track.index], SIZE) < 0.1
