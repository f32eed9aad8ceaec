"""Windows sampled through affine maps against images and homographies that are known exactly."""

from __future__ import annotations

import numpy as np
from truth import picture, similarity, translation

from stab_ros.core.geometry import apply
from stab_ros.methods._affine_windows import AffineMaps, sample


def test_areas_are_exact_where_the_picture_is_a_parabola() -> None:
    y, x = np.mgrid[:60, :80].astype(np.float32)
    H = similarity(7.0, 1.1, 2.3, -1.4, (80, 60))
    maps = AffineMaps.linearized(H, np.array([[40.5, 30.5], [37.0, 28.0]]))
    areas = sample(0.05 * x * x + 0.3 * x * y - 0.02 * y * y + x - 2 * y, maps, 9)
    v, u = np.mgrid[:9, :9] - 4.0
    for area, centre in zip(areas, [[40.5, 30.5], [37.0, 28.0]], strict=True):
        places = apply(H, np.stack([u.ravel(), v.ravel()], axis=1) + centre)  # H is affine, its map is exact
        px, py = places.T
        expected = 0.05 * px * px + 0.3 * px * py - 0.02 * py * py + px - 2 * py
        np.testing.assert_allclose(area.ravel(), expected, rtol=2e-5, atol=2e-3)


def test_areas_touch_the_homography() -> None:
    H = np.array([[1.01, 0.02, 3.0], [-0.01, 0.98, -2.0], [2e-5, -3e-5, 1.0]])
    centres = np.array([[100.0, 50.0], [300.0, 250.0]])
    maps, tiny = AffineMaps.linearized(H, centres), 1e-3
    for axis in (0, 1):
        step = tiny * np.eye(2)[axis]
        slope = (apply(H, centres + step) - apply(H, centres - step)) / (2 * tiny)
        np.testing.assert_allclose(maps.linear[:, :, axis], slope, atol=1e-8)


def test_areas_beyond_the_picture_are_told_and_never_read_it() -> None:
    centres = np.array([[10.0, 10.0], [9.9, 10.0], [np.nan, 5.0], [1e300, 0.0], [np.inf, -np.inf]])
    maps = AffineMaps.identity(centres)
    assert maps.inside(picture(), 21).tolist() == [True, False, False, False, False]
    assert np.isfinite(sample(picture(), maps, 21)).all()


def test_a_shift_is_a_shift() -> None:
    maps = AffineMaps.identity(np.array([[50.0, 60.0]])).displaced(np.array([[1.5, -2.0]]), np.zeros((1, 2, 2)))
    np.testing.assert_array_equal(maps.centres, apply(translation(1.5, -2.0), np.array([[50.0, 60.0]])))
