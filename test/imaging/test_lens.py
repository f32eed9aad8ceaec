"""The picture that comes out: warped as OpenCV would, freed of lens distortion, and as image_proc makes it."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest
from truth import (
    IDENTITY,
    SIZE,
    error_px,
    frame,
    picture,
    projective,
    sampled,
    similarity,
    translation,
)

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray, Gray, Homography
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.lens import make_lens
from stab_ros.imaging.lens_maps import lens_maps
from stab_ros.imaging.resampling import Nodes, resample_at
from stab_ros.imaging.warp import INTERPOLATION
from stab_ros.methods import METHODS
from stab_ros.parameters.engines import make_stabilizer

INNER = np.s_[40:-40, 40:-40]


@pytest.mark.parametrize("interpolation", list(INTERPOLATION))
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_the_warp_is_opencv_s(interpolation: str, channels: int) -> None:
    stabilizer = make_stabilizer({"interpolation": interpolation})
    stabilizer.track(frame(picture()))
    grey = picture(projective())
    image = grey if channels == 1 else np.dstack([grey] * channels)
    encoding = {1: "mono8", 3: "bgr8", 4: "bgra8"}[channels]
    done = stabilizer.step(frame(image, 1, encoding))
    assert done.image is not None
    expected = cv2.warpPerspective(image, done.track.ref_H_cur, SIZE, flags=INTERPOLATION[interpolation])
    difference = np.abs(done.image.astype(int) - expected.astype(int))[INNER]
    assert np.percentile(difference, 99) <= 1


def test_beyond_the_border_is_black() -> None:
    stabilizer = make_stabilizer({})
    stabilizer.track(frame(picture()))
    done = stabilizer.step(frame(picture(translation(30, 0)), 1))
    assert done.image is not None
    assert not done.image[:, :29].any()
    assert (done.image[:, 31:] > 0).mean() > 0.99


# --- lens ------------------------------------------------------------------------------------------------------------

K = np.array([[380.0, 0, 203], [0, 381, 148], [0, 0, 1]])
LENSES = {
    "plumb_bob": Camera(K, np.array([-0.12, 0.03, 0.001, -0.0015, 0.004]), "plumb_bob", SIZE),
    "rational_polynomial": Camera(K, np.array([0.25, -0.05, 0.001, -0.001, 0.01, 0.37, 0.02, -0.01]),
                                  "rational_polynomial", SIZE),
    "equidistant": Camera(K, np.array([-0.03, 0.012, -0.004, 0.001]), "equidistant", SIZE),
}
LENS = LENSES["plumb_bob"]


def seen_by(lens: Camera, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where the lens shows the ideal pixels: the models of sensor_msgs/distortion_models.hpp written out."""
    u, v = (x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1]
    r2 = u**2 + v**2
    if lens.model == "equidistant":
        theta = np.arctan(np.sqrt(r2))
        bent = theta * (1 + sum(k * theta ** (2 * n + 2) for n, k in enumerate(lens.D)))
        scale = bent / np.maximum(np.sqrt(r2), 1e-12)
        return u * scale * K[0, 0] + K[0, 2], v * scale * K[1, 1] + K[1, 2]
    k1, k2, p1, p2, k3, k4, k5, k6 = np.pad(lens.D, (0, 8 - len(lens.D)))
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    seen_u = u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u**2)
    seen_v = v * radial + p1 * (r2 + 2 * v**2) + 2 * p2 * u * v
    return seen_u * K[0, 0] + K[0, 2], seen_v * K[1, 1] + K[1, 2]


@cache
def ideal_px(model: str, dx: float, dy: float) -> tuple[FloatArray, FloatArray]:
    """Where each pixel, off by (dx, dy), would lie without distortion: by fixed-point iteration."""
    seen_x, seen_y = np.meshgrid(np.arange(SIZE[0]) + dx, np.arange(SIZE[1]) + dy)
    x, y = seen_x, seen_y
    for _ in range(30):
        back_x, back_y = seen_by(LENSES[model], x, y)
        x, y = x + seen_x - back_x, y + seen_y - back_y
    return x, y


def distorted(ref_H_cur: Homography, noise: float = 1.0, model: str = "plumb_bob") -> Gray:
    """What the camera with the lens sees."""
    quarters = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))
    total = np.sum([sampled(ref_H_cur, *ideal_px(model, dx, dy), SIZE, 1) for dx, dy in quarters], axis=0)
    grain = np.random.default_rng([3, *ref_H_cur.tobytes()]).normal(0, noise, total.shape)
    return np.asarray(np.clip(np.round(total / 4 + grain), 0, 255), np.uint8)


@pytest.mark.parametrize("model", ["rational_polynomial", "equidistant"])
def test_every_lens_is_removed(model: str) -> None:
    H, lens = similarity(4.0, 1.02, 9.0, -7.0), LENSES[model]
    images = [distorted(IDENTITY, model=model), distorted(H, model=model)]
    blind, knowing = make_stabilizer({}), make_stabilizer({}, lens)
    tracks = [[s.track(frame(image, index)) for index, image in enumerate(images)][1] for s in (blind, knowing)]
    assert error_px(tracks[1], H) < 0.03
    assert not tracks[0].tracked or error_px(tracks[0], H) > 0.15
    warped = knowing.warp(frame(images[1], 1), tracks[1])
    assert warped is not None
    truth = picture(noise=0)
    assert np.abs(warped[INNER].astype(int) - truth[INNER].astype(int)).mean() < 0.15 * truth.std()


@pytest.mark.parametrize("lens", LENSES.values(), ids=list(LENSES))
def test_a_picture_is_straightened_as_its_model_says(lens: Camera) -> None:
    """A picture that holds its own columns, then its own rows."""
    places = np.meshgrid(*(np.arange(n, dtype=np.float32) for n in SIZE))
    expected = seen_by(lens, *(p.astype(float) for p in places))
    inside = np.logical_and.reduce([(at > 1) & (at < n - 2) for at, n in zip(expected, SIZE, strict=True)])
    for place, at in zip(places, expected, strict=True):
        np.testing.assert_allclose(lens.undistort(place)[inside], at[inside], atol=0.04)  # OpenCV 4 rounds to 1/32


@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
def test_maps_are_opencv_s_for_every_number_of_coefficients(count: int) -> None:
    D = np.array([-0.12, 0.03, 0.001, -0.0015, 0.004, 0.02, 0.01, -0.001, 0.001, 0.002, -0.001, 0.0005, 0.02, -0.03])
    R, H = np.linalg.inv(K) @ projective() @ K, projective()
    ours = lens_maps(make_lens(K, D[:count], False, SIZE), np.linalg.inv(H @ K), SIZE)
    for one, other in zip(ours, cv2.initUndistortRectifyMap(K, D[:count], R, K, SIZE, cv2.CV_32FC1), strict=True):
        seen = (ours[0] > -SIZE[0] / 2) & (ours[1] > -SIZE[1] / 2)  # well outside, ours say no more than that
        np.testing.assert_allclose(one[seen], other[seen], atol=0.002)


def test_a_fisheye_lens_shows_nothing_twice() -> None:
    """Where its angle falls again, what lies further in would appear as a ring."""
    k1, f = -0.3, 130.0
    lens = Camera(np.array([[f, 0, 200], [0, f, 150], [0, 0, 1]]), np.array([k1, 0, 0, 0]), "equidistant", SIZE)
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    angle = np.arctan(np.hypot(x - 200, y - 150) / f)
    falls = angle > np.sqrt(-1 / (3 * k1)) + 0.01
    shown = lens.undistort(np.full(SIZE[::-1], 200, np.uint8))
    assert falls.any()
    assert not shown[falls].any()
    assert shown[angle < np.sqrt(-1 / (3 * k1)) - 0.01].all()


@pytest.mark.parametrize("model", ["plumb_bob", "equidistant"])
def test_beyond_the_horizon_is_black(model: str) -> None:
    lens, H = LENSES[model], np.array([[1, 0, 0], [0, 1, 0], [0.01, 0, 1.0]])
    x = np.arange(SIZE[0])
    behind = np.linalg.inv(H)[2, 0] * x + 1 <= 0
    assert behind.any()
    shown = lens.rectify(np.full(SIZE[::-1], 200, np.uint8), H, SIZE, cv2.INTER_LINEAR)
    assert shown.any()
    assert not shown[:, behind].any()


def test_what_the_lens_does_not_show_is_black_and_holds_no_feature() -> None:
    """Strong barrel distortion: the corners of the straightened picture lie beyond what was taken."""
    lens = Camera(np.array([[260.0, 0, 200], [0, 260, 150], [0, 0, 1]]), np.array([-0.45, 0.0, 0.0, 0.0]), "plumb_bob",
                  SIZE)
    straight = lens.undistort(np.full(SIZE[::-1], 200, np.uint8))
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    r = np.hypot((x - 200) / 260, (y - 150) / 260)
    folded = r > np.sqrt(1 / (3 * 0.45))  # there r (1 - 0.45 r^2) falls again
    assert folded.any()
    assert not straight[folded & (r > 0.9)].any()
    assert not lens.visible[folded].any()
    stabilizer = make_stabilizer({}, lens)
    stabilizer.track(frame(picture()))
    stabilizer.track(frame(picture(translation(0.5, 0.25)), 1))
    assert stabilizer.last_match is not None
    column, row = stabilizer.last_match[0].reference_px.astype(int).T
    assert lens.visible[row, column].all()


@pytest.mark.parametrize("method", list(METHODS))
def test_with_the_camera_a_distorted_scene_is_tracked_to_the_truth(method: str) -> None:
    H = similarity(4.0, 1.02, 9.0, -7.0)
    images = [distorted(IDENTITY), distorted(H)]
    blind, knowing = make_stabilizer({"method": method}), make_stabilizer({"method": method}, LENS)
    tracks = [[s.track(frame(image, index)) for index, image in enumerate(images)][1] for s in (blind, knowing)]
    assert error_px(tracks[1], H) < (0.03 if method == "direct" else 0.1)
    assert not tracks[0].tracked or error_px(tracks[0], H) > 0.15


def test_the_warp_undoes_distortion_too() -> None:
    H, stabilizer = translation(6.4, -3.2), make_stabilizer({}, LENS)
    stabilizer.track(frame(distorted(IDENTITY)))
    image = distorted(H, noise=0)
    done = stabilizer.step(frame(image, 1))
    assert done.image is not None
    in_two_steps = cv2.warpPerspective(cv2.undistort(image, K, LENS.D), done.track.ref_H_cur, SIZE)
    truth = picture(noise=0)
    one, two = (np.abs(i[INNER].astype(int) - truth[INNER].astype(int)) for i in (done.image, in_two_steps))
    assert np.abs(done.image[INNER].astype(int) - in_two_steps[INNER].astype(int)).mean() < 3
    assert one.mean() < two.mean()  # interpolated once, it is sharper
    assert one.mean() < 0.15 * truth.std()


def test_the_camera_must_fit_the_frames() -> None:
    stabilizer = make_stabilizer({}, Camera(K, LENS.D, "plumb_bob", (640, 480)))
    with pytest.raises(InputError, match="camera_info is for 640x480 px, the images have 400x300"):
        stabilizer.track(frame(picture()))


def test_a_camera_without_distortion_changes_nothing() -> None:
    results = []
    for camera in (None, Camera(K, np.zeros(5), "plumb_bob", SIZE), Camera(K, np.zeros(0), "", SIZE)):
        stabilizer = make_stabilizer({}, camera)
        stabilizer.track(frame(picture()))
        results.append(stabilizer.step(frame(picture(projective()), 1)))
    for other in results[1:]:
        np.testing.assert_array_equal(results[0].track.ref_H_cur, other.track.ref_H_cur)
        np.testing.assert_array_equal(results[0].image, other.image)


@pytest.mark.parametrize(("K_", "D_", "model", "complaint"), [
    (np.zeros((3, 3)), np.zeros(5), "plumb_bob", "not calibrated"),
    (np.diag([-300.0, 300, 1]), np.zeros(5), "plumb_bob", "not calibrated"),
    (np.eye(2), np.zeros(5), "plumb_bob", "3x3"),
    (np.diag([np.nan, 300, 1]), np.zeros(5), "plumb_bob", "finite"),
    (K, np.array([np.inf, 0, 0, 0, 0]), "plumb_bob", "finite"),
    (K, np.full(4, 0.1), "omnidirectional", "omnidirectional.*plumb_bob"),
    (K, np.full(5, 0.1), "equidistant", "5 coefficients do not fit"),
    (K, np.zeros(8), "equidistant", "8 coefficients do not fit"),
    (K, np.full(7, 0.1), "plumb_bob", "7 coefficients do not fit .* plumb_bob of 0, 4, 5; rational_polynomial of 8"),
])
def test_impossible_cameras_are_refused(K_: FloatArray, D_: FloatArray, model: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint) as error:
        Camera(K_, D_, model, SIZE)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(("number", "model"), [(8, "plumb_bob"), (5, ""), (8, "inverse_brown_conrady")])
def test_zeros_are_no_distortion_whatever_their_number(number: int, model: str) -> None:
    camera = Camera(K, np.zeros(number), model, SIZE)
    assert not camera.distorts
    np.testing.assert_array_equal(camera.undistort(picture()), picture())


@pytest.mark.parametrize("camera", [None, *LENSES.values()], ids=["no camera", *LENSES])
def test_image_proc_makes_the_same_picture_of_our_camera_info(camera: Camera | None) -> None:
    model = "plumb_bob" if camera is None else camera.model
    image = picture(projective()) if camera is None else distorted(projective(), model=model)
    stabilizer = make_stabilizer({}, camera)
    stabilizer.track(frame(picture() if camera is None else distorted(IDENTITY, model=model)))
    done = stabilizer.step(frame(image, 1))
    assert done.image is not None
    assert done.track.ref_H_cur is not None
    # the contract's camera_info: H = P[:, :3] R K^-1; without a camera with K = P = I
    K_, D_ = (np.eye(3), np.zeros(5)) if camera is None else (camera.K, camera.D)
    R = np.linalg.inv(K_) @ done.track.ref_H_cur @ K_
    maps_of = cv2.fisheye.initUndistortRectifyMap if model == "equidistant" else cv2.initUndistortRectifyMap
    maps = maps_of(K_, D_, R, K_, SIZE, cv2.CV_16SC2)
    rectified = cv2.remap(image, *maps, cv2.INTER_LINEAR)
    difference = np.abs(rectified[INNER].astype(int) - done.image[INNER].astype(int))
    assert (difference <= 1).mean() >= 0.95
    assert difference.max() <= 8


OBLIQUE = np.linalg.inv(np.array([[2.2, 0.4, -300], [0.1, 3.0, -200], [0.0002, 0.004, 0.3]]))


@pytest.mark.parametrize("lens", LENSES.values(), ids=list(LENSES))
@pytest.mark.parametrize("H", [similarity(4.0, 1.02, 9.0, -7.0), similarity(130.0, 0.7, 9.0, 8.0), OBLIQUE],
                         ids=["hover", "turned", "oblique"])
def test_quick_maps_are_the_exact_ones_within_a_fiftieth_of_a_pixel(lens: Camera, H: Homography) -> None:
    whole, shares = lens.quick_maps(H, (431, 300))
    x, y = lens.maps(H, (431, 300))
    seen = (x > -2) & (x < SIZE[0] + 1) & (y > -2) & (y < SIZE[1] + 1)
    assert seen.mean() > 0.1
    assert np.abs(whole[..., 0] + shares % 32 / 32 - x)[seen].max() < 0.02
    assert np.abs(whole[..., 1] + shares // 32 / 32 - y)[seen].max() < 0.02
    outside = ((whole[..., 0] < -1) | (whole[..., 0] >= SIZE[0]) | (whole[..., 1] < -1) | (whole[..., 1] >= SIZE[1]))
    assert outside[~seen].all()


@pytest.mark.parametrize("channels", [(), (3,)])
def test_pictures_are_resampled_at_nodes_as_by_exact_maps(channels: tuple[int, ...]) -> None:
    """Also at the border, and where the last block of a row is not whole."""
    lens, H, size = LENS, translation(-7.3, 4.6), (431, 310)
    image = np.random.default_rng(4).integers(0, 65535, (SIZE[1], SIZE[0], *channels)).astype(np.uint16)
    nodes, out = lens.nodes(H, size), np.empty((size[1], size[0], *channels), np.uint16)
    resample_at(image, nodes, out)
    exact = cv2.remap(image.astype(np.float32), *lens.maps(H, size), cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    assert np.abs(out - exact).max() < (0.02 + 1 / 32) * 2 * 65535  # OpenCV 4 rounds places to 1/32 px
    assert not out[:, -20:].any()


def test_nodes_are_gentle_only_near_the_identity() -> None:
    mild = Camera(K, np.array([-0.02, 0, 0, 0]), "plumb_bob", SIZE)
    assert mild.nodes(translation(3, 2), SIZE).gentle
    assert not mild.nodes(similarity(40.0, 1.0, 0, 0), SIZE).gentle
    assert not mild.nodes(similarity(0.0, 1.3, 0, 0), SIZE).gentle
    assert not Nodes(*(np.full((4, 7), -1e6, np.float32) for _ in range(2))).gentle
