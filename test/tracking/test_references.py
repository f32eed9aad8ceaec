"""The reference strategies: what frames are compared with, and whether the accumulated sigma is honest."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from truth import IDENTITY, SIZE, error_px, frame, picture, projective, random_noise, similarity, translation

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply, normalized, point_jacobian, product_jacobians, rms_distance, sigma_px
from stab_ros.core.settings import Value
from stab_ros.core.types import FloatArray, Frame, Homography, Image, State, Track
from stab_ros.estimation.models import MODELS
from stab_ros.parameters.engines import make_stabilizer, reconfigure
from stab_ros.synthetic.flight import Flight, preset
from stab_ros.tracking.anchor_pose import AnchorPose
from stab_ros.tracking.settings import REFERENCES
from stab_ros.tracking.stabilizer import Stabilizer

ACCUMULATING = [name for name in REFERENCES if name != "fixed"]
PATH = [similarity(0.3 * k, 1 + 0.001 * k, 1.7 * k, -1.1 * k) for k in range(10)]
LEFT_HALF = "[[[0, 0], [199, 0], [199, 299], [0, 299]]]"
FLIGHT_SIZE = (640, 360)
every_strategy = pytest.mark.parametrize("reference", REFERENCES)
every_accumulating = pytest.mark.parametrize("reference", ACCUMULATING)


def tracked(images: list[Image], **values: bool | float | str) -> list[Track]:
    stabilizer = make_stabilizer({name.replace("__", "."): value for name, value in values.items()})
    return [stabilizer.track(frame(image, index)) for index, image in enumerate(images)]


def sigmas(tracks: list[Track]) -> FloatArray:
    return np.array([np.nan if track.sigma_px is None else track.sigma_px for track in tracks])


# --- along a path ----------------------------------------------------------------------------------------------------


@every_strategy
@pytest.mark.parametrize("method", ["direct", "klt"])
def test_a_path_is_followed_within_a_few_sigma(method: str, reference: str) -> None:
    tracks = tracked([picture(H) for H in PATH], reference=reference, method=method)
    for track, H in zip(tracks[1:], PATH[1:], strict=True):
        assert track.sigma_px is not None
        assert error_px(track, H) < 4 * track.sigma_px + 0.02
        assert (track.reset_counter, track.reference_stamp_ns) == (0, tracks[0].stamp_ns)


@pytest.mark.parametrize("reference", ["updated", "adjacent"])
def test_sigma_grows_from_frame_to_frame(reference: str) -> None:
    images = [picture(H) for H in PATH]
    growing, fixed = (sigmas(tracked(images, reference=name)) for name in (reference, "fixed"))
    assert (np.diff(growing) > 0).all()
    assert growing[1] == pytest.approx(fixed[1])
    assert growing[-1] > 5 * fixed[-1]


@every_accumulating
def test_covariance_is_that_of_sigma(reference: str) -> None:
    for track in tracked([picture(H) for H in PATH[:4]], reference=reference)[1:]:
        assert track.covariance is not None
        assert track.ref_H_cur is not None
        assert np.linalg.eigvalsh(track.covariance).min() > -1e-9 * np.trace(track.covariance)
        assert track.sigma_px == pytest.approx(sigma_px(track.ref_H_cur, track.covariance, SIZE))


@every_accumulating
@pytest.mark.parametrize(("scene", "method"), [("kolubara", "direct"), ("alpine", "direct"), ("kolubara", "klt")])
def test_sigma_is_honest_over_a_flight(scene: str, method: str, reference: str) -> None:
    shots = list(Flight(preset(scene), size=FLIGHT_SIZE, frames=12, seed=1))
    stabilizer = make_stabilizer({"reference": reference, "method": method})
    tracks = [stabilizer.track(Frame(shot.image, "mono8", shot.stamp_ns)) for shot in shots]
    errors = np.array([error_px(track, shot.ref_H_cur, FLIGHT_SIZE) for track, shot in zip(tracks, shots, strict=True)])
    ratio = errors[1:] / sigmas(tracks)[1:]
    assert ratio.max() < 4
    assert ratio.mean() > 0.1  # nor does sigma exaggerate
    assert errors[-1] < 1.0


@every_accumulating
@pytest.mark.parametrize("model", MODELS)
def test_homographies_stay_in_the_model(reference: str, model: str) -> None:
    tracks = tracked([picture(translation(0.9 * k, -0.7 * k)) for k in range(4)], reference=reference, model=model)
    H = tracks[-1].ref_H_cur
    assert H is not None
    assert rms_distance(H, translation(2.7, -2.1), SIZE) < 0.1
    if model != "projective":
        np.testing.assert_allclose(H[2], [0, 0, 1], atol=1e-12)
    if model == "rigid":
        assert np.linalg.det(H) == pytest.approx(1, abs=1e-12)
    if model == "translation":
        np.testing.assert_allclose(H[:2, :2], np.eye(2), atol=1e-12)


@pytest.mark.parametrize("reference", [pytest.param("updated", marks=pytest.mark.thorough), "adjacent"])
def test_a_turn_that_the_reference_cannot_follow(reference: str) -> None:
    """Windows that are only shifted are not found again turned by 50 degrees, but from frame to frame they are."""
    path = [similarity(5.0 * k, 1.0) for k in range(11)]
    images = [picture(H) for H in path]
    assert tracked(images, method="klt")[-1].state is State.LOST
    assert error_px(tracked(images, method="klt", reference=reference)[-1], path[-1]) < 0.3


def test_features_are_found_anew_every_so_many_frames() -> None:
    images = [picture(translation(0.5 * k, 0.3 * k)) for k in range(8)]
    sigma_px_ = sigmas(tracked(images, reference="updated", update_every=3))[1:]
    bases = np.round(sigma_px_ / sigma_px_[0])
    np.testing.assert_array_equal(bases, [1, 1, 1, 2, 2, 2, 3])


def test_the_same_frames_give_the_same_numbers() -> None:
    for reference in ACCUMULATING:
        once, again = (tracked([picture(H) for H in PATH[:4]], reference=reference) for _ in range(2))
        for a, b in zip(once, again, strict=True):
            np.testing.assert_array_equal(a.ref_H_cur, b.ref_H_cur)
            np.testing.assert_array_equal(a.covariance, b.covariance)


# --- loss, reset, settings -------------------------------------------------------------------------------------------


@every_accumulating
def test_a_lost_frame_never_becomes_the_base(reference: str) -> None:
    images: list[Image] = [picture(), picture(PATH[1]), random_noise(1), random_noise(2), picture(PATH[3])]
    tracks = tracked(images, reference=reference)
    assert [track.state for track in tracks] == [State(s) for s in ("TRACKED", "TRACKED", "LOST", "LOST", "TRACKED")]
    assert error_px(tracks[-1], PATH[3]) < 0.03
    assert (tracks[-1].reset_counter, tracks[-1].reference_stamp_ns) == (0, tracks[0].stamp_ns)
    unbroken = tracked([images[k] for k in (0, 1, 4)], reference=reference)
    assert tracks[-1].sigma_px == pytest.approx(unbroken[-1].sigma_px, rel=0.05)  # of one comparison more, not three


@every_accumulating
def test_a_buffer_may_be_used_again(reference: str) -> None:
    stabilizer, buffer = make_stabilizer({"reference": reference, "method": "klt"}), picture()
    expected = tracked([picture(H) for H in PATH[:4]], reference=reference, method="klt")
    for index, H in enumerate(PATH[:4]):
        buffer[:] = picture(H)
        np.testing.assert_array_equal(stabilizer.track(frame(buffer, index)).ref_H_cur, expected[index].ref_H_cur)
        buffer[:] = random_noise(index)


@every_accumulating
def test_reset_and_another_size_begin_anew(reference: str) -> None:
    stabilizer = make_stabilizer({"reference": reference})
    for index, H in enumerate(PATH[:4]):
        stabilizer.track(frame(picture(H), index))
    stabilizer.reset_reference()
    new = stabilizer.track(frame(picture(PATH[4]), 4))
    np.testing.assert_array_equal(new.ref_H_cur, IDENTITY)
    assert (new.reset_counter, new.reference_stamp_ns, new.sigma_px) == (1, new.stamp_ns, 0)
    back = stabilizer.track(frame(picture(PATH[5]), 5))
    assert error_px(back, normalized(np.linalg.inv(PATH[4]) @ PATH[5])) < 0.03
    other = stabilizer.track(frame(picture(size=(320, 240)), 6))
    assert (other.reset_counter, other.sigma_px) == (2, 0)


def test_settings_at_run_time() -> None:
    stabilizer = make_stabilizer({"reference": "adjacent"})
    far = [stabilizer.track(frame(picture(H), index)) for index, H in enumerate(PATH[:6])]
    reconfigure(stabilizer, {"reference": "adjacent", "method": "klt"})  # goes on from the last frame
    assert error_px(stabilizer.track(frame(picture(PATH[6]), 6)), PATH[6]) < 0.1
    reconfigure(stabilizer, {"reference": "fixed"})  # goes back to the first
    track = stabilizer.track(frame(picture(PATH[7]), 7))
    assert error_px(track, PATH[7]) < 0.02
    assert track.sigma_px is not None
    assert far[-1].sigma_px is not None
    assert track.sigma_px < far[-1].sigma_px / 2
    assert track.reference_stamp_ns == far[0].stamp_ns


# --- what is carried -------------------------------------------------------------------------------------------------


def matched_px(stabilizer: Stabilizer) -> FloatArray:
    assert stabilizer.last_match is not None
    return stabilizer.last_match[0].reference_px


@every_strategy
def test_regions_are_carried(reference: str) -> None:
    stabilizer = make_stabilizer({"reference": reference, "exclude": LEFT_HALF})
    for index in range(6):
        assert stabilizer.track(frame(picture(translation(7.0 * index, 0)), index)).tracked
    x = matched_px(stabilizer)[:, 0]
    assert len(x) > 100
    assert x.min() > 198.5
    assert x.max() < 400  # what the reference does not show may be water


@every_strategy
def test_points_are_carried(reference: str) -> None:
    named = np.array([[60.0, 50.0], [330, 60], [340, 240], [70, 230], [200, 150]])
    values: dict[str, Value] = {"reference": reference, "method": "klt", "min_inliers": 4,
                                "manual_points": str(named.tolist())}
    stabilizer = make_stabilizer(values)
    for index, H in enumerate(PATH[:6]):
        assert error_px(stabilizer.track(frame(picture(H), index)), H) < 0.5
    np.testing.assert_allclose(matched_px(stabilizer), named, atol=1e-3)


@every_accumulating
def test_a_point_that_leaves_the_picture_is_done_without(reference: str) -> None:
    named = np.array([[16.0, 150.0], [330, 60], [340, 240], [70, 230], [80, 70]])
    values: dict[str, Value] = {"reference": reference, "method": "klt", "min_inliers": 4,
                                "manual_points": str(named.tolist())}
    stabilizer = make_stabilizer(values)
    for index in range(6):
        H = translation(4.0 * index, 0)
        assert error_px(stabilizer.track(frame(picture(H), index)), H) < 0.5
    np.testing.assert_allclose(matched_px(stabilizer), named[1:], atol=1e-3)


def test_a_mask_lies_where_the_base_sees_it() -> None:
    allowed = np.zeros(SIZE[::-1], np.uint8)
    cv2.rectangle(allowed, (100, 100), (200, 180), 1, -1)
    place = AnchorPose(projective(), np.eye(8))
    carried = place.mask_in_anchor(allowed.astype(bool))
    y, x = np.nonzero(carried)
    seen = apply(projective(), np.stack([x, y], axis=1).astype(float))
    assert (seen > [99.4, 99.4]).all()
    assert (seen < [200.6, 180.6]).all()
    assert carried.sum() == pytest.approx(allowed.sum(), rel=0.05)
    everywhere = np.ones(SIZE[::-1], bool)
    assert place.mask_in_anchor(everywhere).all()


def test_points_of_no_use_are_refused_in_the_reference() -> None:
    stabilizer = make_stabilizer({"manual_points": "[[1, 1], [330, 60], [340, 240], [70, 230]]", "min_inliers": 3,
                                  "reference": "adjacent", "method": "klt"})
    with pytest.raises(InputError, match=r"points: \(1, 1\) lies too near the border"):
        stabilizer.track(frame(picture()))


# --- derivatives -----------------------------------------------------------------------------------------------------


def differences(product: FloatArray, moved: list[tuple[Homography, Homography]], step: float) -> FloatArray:
    """Columns of the change of normalized(A B) for each moved (A, B)."""
    return np.stack([(normalized(A @ B) - product).ravel()[:8] / step for A, B in moved], axis=1)


def test_product_jacobians_are_finite_differences() -> None:
    A, B, step = projective(), normalized(np.linalg.inv(similarity(3.0, 1.02, 5, 7))), 1e-7
    by_a, by_b = product_jacobians(A, B)
    steps = [step * np.eye(9)[k].reshape(3, 3) for k in range(8)]
    product = normalized(A @ B)
    np.testing.assert_allclose(by_a, differences(product, [(A + d, B) for d in steps], step), rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(by_b, differences(product, [(A, B + d) for d in steps], step), rtol=1e-3, atol=1e-4)


def test_point_jacobian_is_finite_differences() -> None:
    points = np.random.default_rng(1).uniform(0, 300, (20, 2))
    H = projective()
    moved = [(apply(H, points + d) - apply(H, points - d)) / 2e-4 for d in 1e-4 * np.eye(2)]
    np.testing.assert_allclose(point_jacobian(H, points), np.stack(moved, axis=2), atol=1e-7)
