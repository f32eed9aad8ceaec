"""What every method promises with every model, over pictures whose homographies are known."""

from __future__ import annotations

from collections.abc import Callable

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

from stab_ros.core.geometry import rms_distance
from stab_ros.core.types import Frame, Homography, Image, State, Track
from stab_ros.estimation.models import MODELS
from stab_ros.methods import METHODS
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.tracking.stabilizer import Stabilizer

TOLERANCE_PX = {"direct": 0.02}
OTHERS_TOLERANCE_PX = 0.1
NEED_ROOM = {"fast_freak", "akaze", "sar_sift"}  # their descriptors reach so far that small pictures hold too few
STRETCHED = np.array([[1.012, 0.004, 1.1], [-0.006, 0.992, 2.0], [0, 0, 1.0]])
MOTIONS = {
    "shift": translation(3.37, -2.61), "whole pixels": translation(-5, 4), "half a pixel": translation(0.5, 0.5),
    "rotation": similarity(2.5, 1.0, 1.5, 0.7), "zoom": similarity(0.0, 1.03), "stretch": STRETCHED,
    "projective": projective(),
}
MAKEABLE = {  # which motions a model contains
    "translation": ("shift", "whole pixels", "half a pixel"),
    "rigid": ("shift", "whole pixels", "half a pixel", "rotation"),
    "similarity": ("shift", "whole pixels", "half a pixel", "rotation", "zoom"),
    "affine": ("shift", "whole pixels", "half a pixel", "rotation", "zoom", "stretch"),
    "projective": tuple(MOTIONS),
}
OTHER_SIZE = (320, 240)
every_method = pytest.mark.parametrize("method", list(METHODS))
every_model = pytest.mark.parametrize("model", MODELS)


def tolerance_px(method: str) -> float:
    return TOLERANCE_PX.get(method, OTHERS_TOLERANCE_PX)


def tracked(method: str, images: list[Image], model: str = "projective", encoding: str = "mono8") -> list[Track]:
    """The tracks of a short stream."""
    stabilizer = make_stabilizer({"method": method, "model": model})
    return [stabilizer.track(frame(image, index, encoding)) for index, image in enumerate(images)]


def homography(track: Track) -> Homography:
    assert track.ref_H_cur is not None
    return track.ref_H_cur


@every_method
@every_model
def test_a_standing_camera_gives_the_identity(method: str, model: str) -> None:
    first, second = tracked(method, [picture(), picture()], model)
    np.testing.assert_array_equal(homography(first), IDENTITY)
    assert error_px(second, IDENTITY) < 1e-3


@every_method
@pytest.mark.parametrize(("model", "motion"), [(m, motion) for m, motions in MAKEABLE.items() for motion in motions])
def test_a_known_motion_is_found(method: str, model: str, motion: str) -> None:
    track = tracked(method, [picture(), picture(MOTIONS[motion])], model)[1]
    assert error_px(track, MOTIONS[motion]) < tolerance_px(method)


@every_method
@every_model
def test_a_track_is_whole(method: str, model: str) -> None:
    for index, track in enumerate(tracked(method, [picture(), picture(translation(1.2, 0.4))], model)):
        H, covariance, sigma_px = track.ref_H_cur, track.covariance, track.sigma_px
        assert (track.state, track.index, track.reset_counter) == (State.TRACKED, index, 0)
        assert (track.stamp_ns, track.reference_stamp_ns) == (10**9 + index * 40_000_000, 10**9)
        assert 0 < track.inliers <= track.matches
        assert H is not None
        assert covariance is not None
        assert H[2, 2] == 1
        np.testing.assert_allclose(covariance, covariance.T, rtol=1e-9, atol=1e-18)
        assert np.linalg.eigvalsh(covariance).min() > -1e-9 * max(np.trace(covariance), 1e-12)
        assert sigma_px is not None
        assert track.rmse_px is not None
        assert (sigma_px > 0) == (track.rmse_px > 0) == (index > 0)


@every_method
def test_the_homography_stays_in_the_model(method: str) -> None:
    H = homography(tracked(method, [picture(), picture(similarity(0.1, 1.0005, 2, 1))], "translation")[1])
    np.testing.assert_allclose(H[:2, :2], np.eye(2), atol=1e-12)
    H = homography(tracked(method, [picture(), picture(similarity(1.5, 1.01, 2, 1))], "similarity")[1])
    np.testing.assert_allclose([H[0, 0], H[0, 1]], [H[1, 1], -H[1, 0]], atol=1e-12)


@every_method
@pytest.mark.parametrize("way_px", [12.0, 25.0])
@pytest.mark.parametrize("degrees", [20.0, 140.0, 260.0])
def test_a_jump_is_followed(method: str, way_px: float, degrees: float) -> None:
    x, y = way_px * np.cos(np.radians(degrees)), way_px * np.sin(np.radians(degrees))
    jump = similarity(1.0, 1.01, x, y)
    assert error_px(tracked(method, [picture(), picture(jump)])[1], jump) < tolerance_px(method)


@every_method
@pytest.mark.parametrize(("gain", "offset"), [(0.85, 0.0), (1.1, -10.0), (0.7, 45.0), (1.0, 25.0)])
def test_brightness_and_contrast_change(method: str, gain: float, offset: float) -> None:
    brighter = picture(MOTIONS["shift"], gain=gain, offset=offset)
    assert error_px(tracked(method, [picture(), brighter])[1], MOTIONS["shift"]) < tolerance_px(method)


@every_method
def test_a_slow_drift_is_followed_far(method: str) -> None:
    path = [similarity(0.4 * k, 1 + 0.002 * k, 3.1 * k, -1.7 * k) for k in range(12)]
    tracks = tracked(method, [picture(H) for H in path])
    assert max(error_px(track, H) for track, H in zip(tracks, path, strict=True)) < tolerance_px(method)


@every_method
@pytest.mark.parametrize(("level", "noise"), [(0, 0.0), (90, 4.0), (255, 2.0)])
def test_a_flat_picture_never_becomes_the_reference(method: str, level: int, noise: float) -> None:
    tracks = tracked(method, [flat(level, noise), flat(level, noise), picture(), picture(translation(1, 2))])
    assert [track.state for track in tracks] == [State.LOST, State.LOST, State.TRACKED, State.TRACKED]
    np.testing.assert_array_equal(homography(tracks[2]), IDENTITY)
    assert tracks[3].reference_stamp_ns == tracks[2].stamp_ns
    assert [track.reset_counter for track in tracks] == [0, 0, 0, 0]


@every_method
@every_model
def test_a_flat_picture_is_lost(method: str, model: str) -> None:
    lost = tracked(method, [picture(), flat()], model)[1]
    assert lost.state is State.LOST
    assert lost.inliers == 0
    assert (lost.ref_H_cur, lost.covariance, lost.rmse_px, lost.sigma_px) == (None, None, None, None)


@every_method
@pytest.mark.parametrize("model", ["translation", "projective"])  # most and least easily agreed on
def test_random_noise_is_lost(method: str, model: str) -> None:
    images: list[Image] = [picture(), *(random_noise(k) for k in range(3))]
    assert all(track.state is State.LOST for track in tracked(method, images, model)[1:])


@every_method
def test_noise_is_not_found_again_in_noise(method: str) -> None:
    tracks = tracked(method, [random_noise(k) for k in range(8)])
    assert all(track.state is State.LOST for track in tracks[1:])


@every_method
def test_another_scene_is_lost(method: str) -> None:
    assert tracked(method, [picture(), picture(seed=2)])[1].state is State.LOST


@every_method
def test_another_size_becomes_a_new_reference(method: str) -> None:
    H = translation(1.3, 0.8)
    tracks = tracked(method, [picture(), picture(size=OTHER_SIZE), picture(H, size=OTHER_SIZE), picture()])
    assert [track.reset_counter for track in tracks] == [0, 1, 1, 2]
    assert [track.reference_stamp_ns for track in tracks] == [tracks[k].stamp_ns for k in (0, 1, 1, 3)]
    assert error_px(tracks[2], H, OTHER_SIZE) < tolerance_px(method)


@every_method
def test_a_flat_picture_of_another_size_changes_nothing(method: str) -> None:
    H = translation(1.3, 0.8)
    tracks = tracked(method, [picture(), flat(size=OTHER_SIZE), picture(H)])
    assert [track.state for track in tracks] == [State.TRACKED, State.LOST, State.TRACKED]
    assert tracks[2].reset_counter == 0
    assert error_px(tracks[2], H) < tolerance_px(method)


@every_method
@pytest.mark.parametrize("shape", [(0, 0), (1, 1), (1, 4000), (4000, 1), (7, 5), (63, 400)])
def test_pictures_too_small_are_lost(method: str, shape: tuple[int, int]) -> None:
    tiny = np.random.default_rng(1).integers(0, 256, shape, dtype=np.uint8)
    assert [track.state for track in tracked(method, [tiny, tiny])] == [State.LOST, State.LOST]


@every_method
@pytest.mark.parametrize("size", [(64, 64), (65, 131), (640, 64)])
def test_small_pictures_are_tracked(method: str, size: tuple[int, int]) -> None:
    track = tracked(method, [picture(size=size), picture(translation(0.6, 0.3), size=size)], "translation")[1]
    if track.tracked or method not in NEED_ROOM:
        assert error_px(track, translation(0.6, 0.3), size) < 5 * tolerance_px(method)


@every_method
def test_input_is_not_modified_and_may_be_read_only(method: str) -> None:
    images = [picture(), picture(projective()), flat()]
    copies = [image.copy() for image in images]
    for image in images:
        image.flags.writeable = False
    stabilizer = make_stabilizer({"method": method, "on_lost": "hold"})
    for index, image in enumerate(images):
        stabilizer.step(frame(image, index))
    for image, copy in zip(images, copies, strict=True):
        np.testing.assert_array_equal(image, copy)


@every_method
def test_a_buffer_may_be_used_again(method: str) -> None:
    stabilizer, buffer = make_stabilizer({"method": method}), picture()
    stabilizer.track(frame(buffer))
    buffer[:] = picture(MOTIONS["shift"])
    assert error_px(stabilizer.track(frame(buffer, 1)), MOTIONS["shift"]) < tolerance_px(method)
    assert stabilizer.reference is not None
    np.testing.assert_array_equal(stabilizer.reference.image, picture())


@every_method
def test_a_part_of_a_larger_array_is_as_good(method: str) -> None:
    images = [picture(), picture(projective())]
    padded = [np.pad(image, ((3, 4), (5, 7)))[3:-4, 5:-7] for image in images]
    whole, part = tracked(method, images)[1], tracked(method, padded)[1]
    np.testing.assert_array_equal(homography(whole), homography(part))


@every_method
def test_the_same_frames_give_the_same_numbers(method: str) -> None:
    images = [picture(), picture(projective()), random_noise(1), picture(translation(2, 1)), picture(translation(3, 1))]
    once, again = tracked(method, images), tracked(method, images)
    for a, b in zip(once, again, strict=True):
        assert (a.state, a.matches, a.inliers, a.rmse_px, a.sigma_px) == (b.state, b.matches, b.inliers, b.rmse_px,
                                                                          b.sigma_px)
        if a.tracked:
            np.testing.assert_array_equal(homography(a), homography(b))


@every_method
def test_two_streams_do_not_know_of_each_other(method: str) -> None:
    here: list[Frame] = [frame(picture(translation(k, -k)), k) for k in range(3)]
    there: list[Frame] = [frame(picture(translation(-2 * k, k), seed=2), k) for k in range(3)]
    alone: Stabilizer = make_stabilizer({"method": method})
    expected = [homography(alone.track(f)) for f in here]
    one, other = (make_stabilizer({"method": method}) for _ in range(2))
    for f, g, H in zip(here, there, expected, strict=True):
        track = one.track(f)
        other.track(g)
        np.testing.assert_array_equal(homography(track), H)


def as_16_bit(full_scale: int) -> Callable[[Image], Image]:
    return lambda image: np.asarray(np.round(image / 255 * full_scale), np.uint16)


def coloured(channels: int) -> Callable[[Image], Image]:
    tint = np.array([0.9, 1.0, 0.8, 0.0])[:channels]
    return lambda image: np.asarray(image[..., None] * tint + [0, 0, 0, 255][:channels], np.uint8)


ENCODINGS = {
    "mono16 full": ("mono16", as_16_bit(65535)), "mono16 of 12 bit": ("mono16", as_16_bit(4095)),
    "mono16 of 10 bit": ("mono16", as_16_bit(1023)), "bgr8": ("bgr8", coloured(3)), "rgb8": ("rgb8", coloured(3)),
    "bgra8": ("bgra8", coloured(4)), "rgba8": ("rgba8", coloured(4)),
}


@every_method
@pytest.mark.parametrize("kind", list(ENCODINGS))
def test_every_encoding_is_tracked(method: str, kind: str) -> None:
    encoding, convert = ENCODINGS[kind]
    images = [convert(picture()), convert(picture(MOTIONS["shift"]))]
    stabilizer = make_stabilizer({"method": method})
    stabilizer.track(frame(images[0], 0, encoding))
    done = stabilizer.step(frame(images[1], 1, encoding))
    assert error_px(done.track, MOTIONS["shift"]) < tolerance_px(method)
    assert done.image is not None
    assert (done.image.shape, done.image.dtype) == (images[1].shape, images[1].dtype)


@every_method
def test_a_stream_that_changes_from_grey_to_colour_keeps_its_reference(method: str) -> None:
    stabilizer, colour = make_stabilizer({"method": method}), coloured(3)
    first = stabilizer.track(frame(picture()))
    track = stabilizer.track(frame(colour(picture(MOTIONS["shift"])), 1, "bgr8"))
    assert (track.reset_counter, track.reference_stamp_ns) == (0, first.stamp_ns)
    assert error_px(track, MOTIONS["shift"]) < tolerance_px(method)


@every_method
def test_16_bit_of_another_size_and_exposure(method: str) -> None:
    dark, bright = as_16_bit(1000), as_16_bit(60000)
    H = translation(1.3, 0.8)
    images = [dark(picture()), bright(picture(size=OTHER_SIZE)), bright(picture(H, size=OTHER_SIZE))]
    tracks = tracked(method, images, encoding="mono16")
    assert [track.reset_counter for track in tracks] == [0, 1, 1]
    assert error_px(tracks[2], H, OTHER_SIZE) < tolerance_px(method)


@every_method
def test_the_stabilised_picture_lies_on_the_reference(method: str) -> None:
    stabilizer = make_stabilizer({"method": method})
    stabilizer.track(frame(picture(noise=0)))
    done = stabilizer.step(frame(picture(projective(), noise=0), 1))
    assert done.image is not None
    inner = np.s_[30:-30, 30:-30]
    difference = np.abs(done.image[inner].astype(int) - picture(noise=0)[inner].astype(int))
    unstabilised = np.abs(picture(projective(), noise=0)[inner].astype(int) - picture(noise=0)[inner].astype(int))
    assert np.median(difference) <= 3
    assert difference.mean() < 0.2 * unstabilised.mean()


@every_method
def test_covariance_tells_far_from_near(method: str) -> None:
    tracks = tracked(method, [picture(noise=1.0), picture(MOTIONS["shift"], noise=12.0)])
    calm = tracked(method, [picture(noise=1.0), picture(MOTIONS["shift"], noise=1.0)])
    assert tracks[1].sigma_px is not None
    assert calm[1].sigma_px is not None
    assert tracks[1].sigma_px > calm[1].sigma_px
    assert rms_distance(homography(tracks[1]), MOTIONS["shift"], SIZE) < 3 * tolerance_px(method)
