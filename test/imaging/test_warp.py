"""The warp against exact bilinear interpolation in double precision, and against OpenCV's."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stab_ros.core.geometry import apply, shift
from stab_ros.core.row_shifts import RowShifts
from stab_ros.core.threads import use_threads
from stab_ros.core.types import FloatArray, Homography, Image
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.resampling import is_gentle
from stab_ros.imaging.warp import INTERPOLATION, warp
from stab_ros.imaging.window import Window

# OpenCV before 5 rounds places to 1/32 px: on noise of all grey levels that is up to four of them
OPENCV_OFF = 1 if int(cv2.__version__.split(".")[0]) >= 5 else 9
KINDS: dict[str, tuple[tuple[int, ...], Any]] = {
    "mono8": ((), np.uint8), "bgr8": ((3,), np.uint8), "bgra8": ((4,), np.uint8), "mono16": ((), np.uint16),
}


def noise(size: tuple[int, int], kind: str = "mono8", seed: int = 0) -> Image:
    channels, dtype = KINDS[kind]
    return np.random.default_rng(seed).integers(0, np.iinfo(dtype).max + 1, (size[1], size[0], *channels), dtype)


def turned(size: tuple[int, int], deg: float, x_px: float = 0.0, y_px: float = 0.0, scale: float = 1.0,
           tilt: float = 0.0) -> Homography:
    """About the middle. tilt: of the depth, per px."""
    a, centre = np.deg2rad(deg), shift(size[0] / 2, size[1] / 2)
    about = np.array([[scale * np.cos(a), -scale * np.sin(a), x_px], [scale * np.sin(a), scale * np.cos(a), y_px],
                      [tilt, -tilt / 2, 1.0]])
    H = centre @ about @ np.linalg.inv(centre)
    return np.asarray(H / H[2, 2])


def exactly(image: Image, ref_H_cur: Homography, size: tuple[int, int]) -> FloatArray:
    """Bilinear, of zeros beyond the border."""
    x, y = np.meshgrid(np.arange(size[0], dtype=float), np.arange(size[1], dtype=float))
    at = apply(np.linalg.inv(ref_H_cur), np.stack([x.ravel(), y.ravel()], axis=1)).reshape(*x.shape, 2)
    at = np.clip(at, -2, np.array(image.shape[1::-1]) + 1.0)
    wide = np.pad(image.astype(float), [(2, 3), (2, 3), *[(0, 0)] * (image.ndim - 2)])
    column, row = (np.floor(at[..., k]).astype(int) for k in range(2))
    fx, fy = (np.expand_dims(at[..., k] - np.floor(at[..., k]), tuple(range(2, image.ndim))) for k in range(2))
    first, second, third, fourth = (wide[row + i + 2, column + j + 2] for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)))
    return np.asarray((first * (1 - fx) + second * fx) * (1 - fy) + (third * (1 - fx) + fourth * fx) * fy)


@pytest.mark.parametrize("kind", list(KINDS))
@pytest.mark.parametrize(("deg", "x_px", "y_px", "scale", "tilt"), [
    (0.0, 0.0, 0.0, 1.0, 0.0), (0.0, 3.25, -7.75, 1.0, 0.0), (0.3, -4.6, 2.2, 1.001, 1e-7),
    (-1.1, 20.3, 11.1, 0.99, 2e-6), (2.2, -30.9, -3.0, 1.02, 1e-6), (0.4, 2.0, 3.0, 1.0, 1e-4),
    (0.0, 250.5, -120.5, 1.0, 0.0), (8.0, 5.0, 5.0, 1.1, 1e-5), (90.0, 0.0, 0.0, 1.0, 0.0),
    (180.0, 1.5, 0.5, 0.7, 1e-4),
])
def test_every_pixel_is_interpolated(kind: str, deg: float, x_px: float, y_px: float, scale: float,
                                     tilt: float) -> None:
    size = (331, 203)
    image, H = noise(size, kind), turned(size, deg, x_px, y_px, scale, tilt)
    made = warp(image, H, size, "linear", None)
    off = np.abs(made - exactly(image, H, size)) / (257 if kind == "mono16" else 1)  # grey levels of 8 bit
    assert off.max() <= (1 if is_gentle(H, size) else OPENCV_OFF)
    if is_gentle(H, size):
        assert (off > 0.6).mean() < 0.02
    assert (made.shape, made.dtype) == (image.shape, image.dtype)


@given(st.integers(1, 200), st.integers(1, 90), st.floats(-3.5, 3.5), st.floats(-60, 60), st.floats(-60, 60),
       st.floats(0.95, 1.05), st.floats(-3e-5, 3e-5))
def test_any_size_and_any_near_view(width: int, height: int, deg: float, x_px: float, y_px: float, scale: float,
                                    tilt: float) -> None:
    image, H = noise((150, 70)), turned((150, 70), deg, x_px, y_px, scale, tilt)
    made = warp(image, H, (width, height), "linear", None)
    gentle = is_gentle(H, (width, height))
    assert np.abs(made - exactly(image, H, (width, height))).max() <= (1 if gentle else 1.5 * OPENCV_OFF)
    beside = np.abs(made - cv2.warpPerspective(image, H, (width, height)).astype(int))
    assert np.percentile(beside, 99) <= OPENCV_OFF


@pytest.mark.parametrize("interpolation", list(INTERPOLATION))
@pytest.mark.parametrize("deg", [0.2, 40.0])
def test_other_interpolations_are_those_of_opencv(interpolation: str, deg: float) -> None:
    size = (300, 200)
    image, H = cv2.GaussianBlur(noise(size), (0, 0), 1.5), turned(size, deg, 2.5, 1.25)
    expected = cv2.warpPerspective(image, H, size, flags=INTERPOLATION[interpolation])
    off = np.abs(warp(image, H, size, interpolation, None).astype(int) - expected)
    assert off.max() <= OPENCV_OFF


@pytest.mark.parametrize("kind", list(KINDS))
def test_the_same_with_any_number_of_threads(kind: str) -> None:
    size = (640, 480)
    image, H = noise(size, kind), turned(size, 0.7, 12.3, -4.5, 1.003, 1e-6)
    made = []
    for threads in (1, 2, 3):
        use_threads(threads)
        made.append(warp(image, H, size, "linear", None))
    use_threads(0)
    np.testing.assert_array_equal(made[0], made[1])
    np.testing.assert_array_equal(made[0], made[2])


def test_a_picture_that_must_not_be_written_to_and_one_that_is_cut_out_of_another() -> None:
    whole = noise((400, 300))
    part = whole[20:220, 30:330]
    fixed = part.copy()
    fixed.flags.writeable = False
    H = turned((300, 200), 0.4, 1.5, 2.5)
    np.testing.assert_allclose(warp(fixed, H, (300, 200), "linear", None).astype(int),
                               warp(part, H, (300, 200), "linear", None), atol=OPENCV_OFF)
    np.testing.assert_array_equal(fixed, part)


@pytest.mark.parametrize("scale", [0.9, 0.5, 0.4, 0.25, 0.13])
@pytest.mark.parametrize("roi", ["", "50, -30, 400, 260"])
@pytest.mark.parametrize("kind", ["mono8", "bgr8"])
def test_a_smaller_picture_shows_the_same_places(scale: float, roi: str, kind: str) -> None:
    """A slope of grey levels tells where each pixel lies: offset + (u, v) / scale."""
    size, H, window = (640, 400), shift(3.4, -2.7), Window.of(roi, scale)
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    slope = np.round(20 + x / 4 + y / 8).astype(np.uint8)
    image = slope if kind == "mono8" else cv2.merge([slope] * 3)
    made = warp(image, H, size, "linear", None, window)
    assert made.shape[1::-1] == window.size(size)
    u, v = np.meshgrid(np.arange(made.shape[1]), np.arange(made.shape[0]))
    x_px, y_px = (place / scale + begin for place, begin in zip((u, v), window.offset, strict=True))
    expected = 20 + (x_px - 3.4) / 4 + (y_px + 2.7) / 8
    margin = 2 / scale + 4
    seen = (x_px > margin) & (x_px < size[0] - margin) & (y_px > margin) & (y_px < size[1] - margin)
    assert seen.mean() > 0.4
    assert np.abs(made.reshape(*made.shape[:2], -1)[..., 0] - expected)[seen].max() < 1.2


def test_a_much_smaller_picture_is_an_average_and_not_a_sample() -> None:
    image = noise((640, 400))
    made = warp(image, np.eye(3), (640, 400), "linear", None, Window(scale=0.25))
    assert made[2:-2, 2:-2].std() < 0.45 * image.std()


def test_a_smaller_picture_through_a_lens() -> None:
    size = (640, 480)
    K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    camera = Camera(K, np.array([-0.25, 0.08, 0, 0, 0]), "plumb_bob", size)
    image, H = cv2.GaussianBlur(noise(size), (0, 0), 6), turned(size, 0.5, 4.0, 3.0)
    image = cv2.normalize(image, np.empty_like(image), 0, 255, cv2.NORM_MINMAX)
    whole = warp(image, H, size, "linear", camera)
    made = warp(image, H, size, "linear", camera, Window(scale=0.5))
    average = cv2.resize(whole, (320, 240), interpolation=cv2.INTER_AREA).astype(float)
    off, slopes = made - average, np.gradient(average)
    inner = (slice(8, -8), slice(8, -8))
    assert np.abs(off[inner]).mean() < 2  # one of them is interpolated in the small picture
    shift_px = np.linalg.lstsq(np.stack([slope[inner].ravel() for slope in slopes], axis=1), off[inner].ravel())[0]
    assert np.abs(shift_px).max() < 0.01


def curve(height: int, most_px: float, seed: int = 0) -> RowShifts:
    return RowShifts(np.random.default_rng(seed).uniform(-most_px, most_px, (12, 2)), height)


@pytest.mark.parametrize("kind", list(KINDS))
@pytest.mark.parametrize(("deg", "tilt"), [(0.0, 0.0), (1.5, 2e-5), (90.0, 0.0)])
def test_rows_are_put_back_as_when_each_row_is_looked_up(kind: str, deg: float, tilt: float) -> None:
    """Place by place: the row that shows it is found by bisection, then interpolated in double precision."""
    size = (171, 103)
    H, rows = turned(size, deg, 3.4, -2.6, 1.01, tilt), curve(size[1], 2.0)
    image = np.asarray(cv2.GaussianBlur(noise(size, kind), (0, 0), 2))
    made = warp(image, H, size, "linear", None, rows=rows)
    x, y = np.meshgrid(np.arange(size[0], dtype=float), np.arange(size[1], dtype=float))
    belongs = apply(np.linalg.inv(H), np.stack([x.ravel(), y.ravel()], axis=1))
    low, high = belongs[:, 1] - 9, belongs[:, 1] + 9
    for _ in range(60):
        middle = (low + high) / 2
        short = middle + rows.at(middle)[:, 1] < belongs[:, 1]
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    at_px = belongs - rows.at(low)
    inner = ((at_px > 1) & (at_px < np.array(size) - 2)).all(axis=1).reshape(size[::-1])
    assert inner.mean() > 0.3
    expected = np.stack([_bilinear(plane, at_px) for plane in cv2.split(image)], axis=-1).reshape(made.shape)
    assert (np.abs(made - expected)[inner] / (257 if kind == "mono16" else 1)).max() <= OPENCV_OFF
    assert (made.shape, made.dtype) == (image.shape, image.dtype)


def _bilinear(plane: Image, at_px: FloatArray) -> FloatArray:
    at = np.clip(at_px, 0, np.array(plane.shape[::-1]) - 1.001)
    column, row = np.floor(at).astype(int).T
    fx, fy = (at - np.floor(at)).T
    upper = plane[row, column] * (1 - fx) + plane[row, column + 1] * fx
    return np.asarray(upper * (1 - fy) + (plane[row + 1, column] * (1 - fx) + plane[row + 1, column + 1] * fx) * fy)


@pytest.mark.parametrize("scale", [1.0, 0.6, 0.25])
@pytest.mark.parametrize("lens", [False, True])
@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_rows_that_all_move_alike_are_a_shift(scale: float, lens: bool, interpolation: str) -> None:
    """With a lens, an output window and a smaller picture."""
    size, window = (640, 480), Window.of("20, -10, 560, 420", scale)
    K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    camera = Camera(K, np.array([-0.25, 0.08, 0, 0, 0]), "plumb_bob", size) if lens else None
    image, H = cv2.GaussianBlur(noise(size, "bgr8"), (0, 0), 4), turned(size, 0.5, 4.0, 3.0)
    alike = RowShifts(np.tile([1.75, -2.25], (9, 1)), size[1])
    made = warp(image, H, size, interpolation, camera, window, rows=alike)
    expected = warp(image, H @ shift(1.75, -2.25), size, interpolation, camera, window)
    assert made.shape == expected.shape
    assert np.abs(made.astype(int) - expected).max() <= 2


def test_rows_the_same_with_any_number_of_threads() -> None:
    size = (640, 480)
    image, H, rows, made = noise(size), turned(size, 0.7, 12.3, -4.5), curve(480, 2.0), []
    for threads in (1, 3):
        use_threads(threads)
        made.append(warp(image, H, size, "linear", None, rows=rows))
    use_threads(0)
    np.testing.assert_array_equal(made[0], made[1])
