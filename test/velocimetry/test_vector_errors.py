"""What vectors share: the columns against draws of the errors that they stand for."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from stab_ros.core.covariance import factor
from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray, Homography
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.places import places_of
from stab_ros.velocimetry.speeds import joined
from stab_ros.velocimetry.tracks import Tracks
from stab_ros.velocimetry.vector_errors import vectors_of

GRAY = np.zeros((100, 200), np.uint8)
H_START = np.array([[0.02, 0.001, 5], [0.0, -0.021, 9], [1e-5, 2e-4, 1]])
H_END = np.array([[0.021, 0.0, 5.1], [0.001, -0.02, 9.2], [2e-5, 1e-4, 1]])
COVARIANCE = np.diag([1e-5, 2e-5, 1e-3, 1e-5, 1e-5, 2e-3, 1e-8, 1e-8]) ** 2
SHARED = 1e-3 * np.outer(np.r_[H_START.ravel()[:6], 0, 0], [1.0])  # a scale that is wrong by a thousandth
START_PX = np.array([[20.0, 20], [150, 30], [100, 80]])
END_PX = START_PX + np.array([12.0, 5])


def tracks(H_start: Homography = H_START, H_end: Homography = H_END) -> Tracks:
    first, last = (PlacedFrame(stamp, GRAY, H, COVARIANCE, SHARED)
                   for stamp, H in ((0, H_start), (500_000_000, H_end)))
    made = Tracks.begun(first, START_PX, places_of(first, START_PX))
    made.seen(last, np.arange(3), END_PX, places_of(last, END_PX))
    return made


def velocity(H_start: Homography, H_end: Homography) -> FloatArray:
    return (apply(H_end, END_PX) - apply(H_start, START_PX)) / 0.5


def test_errors_of_both_homographies_are_shared() -> None:
    vectors = vectors_of(tracks(), np.ones(3, bool), 0, 0.0, "m")
    np.testing.assert_allclose(vectors.velocity_m_s, velocity(H_START, H_END))
    rng, root = np.random.default_rng(1), factor(COVARIANCE)
    draws = [velocity(*(H + np.r_[root @ rng.standard_normal(8), 0].reshape(3, 3) for H in (H_START, H_END))).ravel()
             for _ in range(20000)]
    S = vectors.shared[:, :, :16].reshape(6, 16)
    np.testing.assert_allclose(S @ S.T, np.cov(np.array(draws).T), rtol=0.05, atol=0.03 * np.max(S @ S.T))


def test_columns_and_stamps_tell_the_covariance_between_intervals() -> None:
    """The frame that ends an interval and begins the next is one error in both (docs/velocimetry.md)."""
    H_last = H_END + np.array([[0, 0, 0.1], [0, 0, 0.2], [0, 0, 0]])
    placed = [PlacedFrame(stamp, GRAY, H, COVARIANCE, SHARED)
              for stamp, H in ((0, H_START), (500_000_000, H_END), (900_000_000, H_last))]
    both = []
    for first, last in pairwise(placed):
        made = Tracks.begun(first, START_PX, places_of(first, START_PX))
        made.seen(last, np.arange(3), END_PX, places_of(last, END_PX))
        both.append(vectors_of(made, np.ones(3, bool), 0, 0.0, "m"))
    vectors = joined(both)
    by_frame = np.zeros((6, 2, 3, 8))
    for k, frame in enumerate(placed):
        starts = vectors.start_ns == frame.stamp_ns
        by_frame[starts, :, k] += vectors.shared[starts, :, 0:8]
        ends = vectors.end_ns == frame.stamp_ns
        by_frame[ends, :, k] += vectors.shared[ends, :, 8:16]
    S = by_frame.reshape(12, 24)
    rng, root, draws = np.random.default_rng(1), factor(COVARIANCE), []
    for _ in range(20000):
        a, b, c = (H + np.r_[root @ rng.standard_normal(8), 0].reshape(3, 3) for H in (H_START, H_END, H_last))
        draws.append(np.r_[velocity(a, b).ravel(), velocity(b, c).ravel() * 0.5 / 0.4])
    np.testing.assert_allclose(S @ S.T, np.cov(np.array(draws).T), rtol=0.05, atol=0.03 * np.max(S @ S.T))
    mean, as_one = S.mean(axis=0), vectors.shared[:, :, :16].reshape(12, 16).mean(axis=0)
    assert np.hypot.reduce(as_one) > np.hypot.reduce(mean)  # as docs/velocimetry.md says


def test_a_wrong_scale_is_a_wrong_scale_of_all_vectors() -> None:
    vectors = vectors_of(tracks(), np.ones(3, bool), 0, 0.0, "m")
    wrong = np.zeros((3, 3))
    wrong.ravel()[:8] = SHARED[:, 0]
    expected = velocity(H_START + wrong, H_END + wrong) - velocity(H_START, H_END)
    np.testing.assert_allclose(vectors.shared[:, :, 17], expected, rtol=1e-6)


def test_a_wrong_stamp_is_a_wrong_speed() -> None:
    vectors = vectors_of(tracks(), np.ones(3, bool), 0, 0.005, "m")
    np.testing.assert_allclose(vectors.shared[:, :, 16], -vectors.velocity_m_s * np.sqrt(2) * 0.005 / 0.5)


def test_vectors_may_end_before_the_interval() -> None:
    made = tracks()
    later = PlacedFrame(900_000_000, GRAY, H_END, 4 * COVARIANCE, SHARED)
    made.seen(later, np.array([1]), END_PX[1:2] + 3, places_of(later, END_PX[1:2] + 3))
    vectors = vectors_of(made, made.end_frame > 0, 7, 0.0, "m")
    assert list(vectors.end_ns) == [500_000_000, 900_000_000, 500_000_000]
    assert list(vectors.track_id) == [7, 8, 9]
