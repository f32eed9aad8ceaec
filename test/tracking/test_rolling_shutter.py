"""Rows that swing: corrected where they do, nothing changed where they do not."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import pytest
from flights import fly
from truth import SIZE, frame, picture, sampled, similarity, translation

from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray, Gray, Homography, Track
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.flight import Flight, preset
from stab_ros.tracking.stabilizer import Stabilizer

FRAMES = 32
Wave = Callable[[FloatArray], FloatArray]


def wave(size_px: float, number: int, cycles: float = 3.0) -> Wave:
    """Displacement (n, 2) of rows (n,) in one frame, mostly along x; another phase in each frame."""
    def at(rows_px: FloatArray) -> FloatArray:
        turn = 2 * np.pi * (rows_px / SIZE[1] * cycles + 0.37 * number)
        return size_px * np.stack([np.sin(turn), 0.4 * np.sin(0.8 * turn + 1)], axis=-1)

    return at


def place(number: int) -> Homography:
    return similarity(0.3 * np.sin(number / 5), 1.0, 2.5 * np.sin(number / 6), 1.5 * np.cos(number / 7) - 1.5)


@functools.cache
def swung(number: int, size_px: float) -> Gray:
    """The texture, looked at row by row: exact, without resampling a picture."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]].astype(float)
    total = np.zeros(SIZE[::-1])
    for dx, dy in ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)):
        moved = wave(size_px, number)(y[:, 0])[:, None]
        total += sampled(place(number), x + dx + moved[..., 0], y + dy + moved[..., 1], SIZE, 1)
    grain = np.random.default_rng([5, number]).normal(0, 1, total.shape)
    return np.asarray(np.clip(np.round(total / 4 + grain), 0, 255), np.uint8)


def tracked(stabilizer: Stabilizer, size_px: float) -> list[Track]:
    answers = [track for n in range(FRAMES) for track in stabilizer.answers(frame(swung(n, size_px), n))]
    return [*answers, *stabilizer.finish()]


def left_px(track: Track, size_px: float, with_rows: bool = True) -> float:
    """RMS over the frame of where a track places it in the reference, whose rows swing as well."""
    y, x = np.mgrid[8 : SIZE[1] - 8 : 4, 8 : SIZE[0] - 8 : 20].astype(float)
    at_px = np.stack([x.ravel(), y.ravel()], axis=1)
    straight = apply(place(track.index), at_px + wave(size_px, track.index)(at_px[:, 1]))
    start = np.linalg.inv(place(0))
    straight, truth = apply(start, straight), apply(start, straight)
    for _ in range(30):
        truth = straight - wave(size_px, 0)(truth[:, 1])
    assert track.ref_H_cur is not None
    rows = track.rows if with_rows else None
    made = apply(track.ref_H_cur, at_px if rows is None else at_px + rows.at(at_px[:, 1]))
    return float(np.sqrt(((made - truth) ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("settings", [{}, {"method": "klt"}, {"reference": "keyframe"}, {"reference": "updated"}])
@pytest.mark.parametrize("size_px", [0.25, 0.5, 1.0])
def test_rows_that_swing_are_corrected(settings: dict[str, str], size_px: float) -> None:
    stabilizer = make_stabilizer(settings)
    tracks = tracked(stabilizer, size_px)[1:]
    assert all(track.tracked for track in tracks)
    left = [left_px(track, size_px) for track in tracks]
    assert np.median(left) < 0.04 + 0.1 * size_px
    assert max(left) < 0.1 + 0.3 * size_px
    swing = stabilizer.swing
    assert swing is not None
    assert swing.frames > 0.8 * len(tracks)
    assert size_px < swing.most_px < 2.6 * size_px
    assert stabilizer.relief is None


def test_sigma_says_what_the_homography_alone_leaves() -> None:
    for track in tracked(make_stabilizer({}), 0.5)[1:]:
        if track.rows is not None:
            assert track.sigma_px is not None
            assert track.sigma_px == pytest.approx(track.rows.rms_px, rel=0.1)
            assert track.sigma_px == pytest.approx(left_px(track, 0.5, with_rows=False), rel=0.35)


@pytest.mark.thorough
def test_what_is_not_looked_for_stays() -> None:
    stabilizer = make_stabilizer({"rolling_shutter": "off"})
    tracks = tracked(stabilizer, 0.5)[1:]
    assert all(track.rows is None for track in tracks)
    assert np.median([left_px(track, 0.5) for track in tracks if track.tracked]) > 0.3  # the others are too uncertain
    assert stabilizer.swing is None


@pytest.mark.thorough
def test_the_image_is_straight() -> None:
    """Against the reference, which shows its own rows as they are."""
    found_levels, last = [], FRAMES - 2
    for mode in ("auto", "off"):
        stabilizer = make_stabilizer({"rolling_shutter": mode})
        track = next(track for track in tracked(stabilizer, 0.7) if track.index == last)
        image = stabilizer.warp(frame(swung(last, 0.7), last), track)
        assert image is not None
        off = (image.astype(float) - swung(0, 0.7))[10:-10, 10:-10]
        found_levels.append(float(np.sqrt(np.mean(off**2))))
    assert found_levels[0] < 5.0
    assert found_levels[1] > 7.0


@pytest.mark.thorough
def test_rows_are_noticed_in_mid_flight() -> None:
    """Without a start-up; the first frames are still."""
    stabilizer = make_stabilizer({"start_s": 0.0})
    tracks = [stabilizer.track(frame(swung(n, 0.0 if n < 8 else 0.3), n)) for n in range(FRAMES)]
    assert all(track.rows is None for track in tracks[:9])
    assert all(track.rows is not None for track in tracks[20:])


@pytest.mark.parametrize("name", ["kolubara", "alpine", "basento"])
@pytest.mark.parametrize("start_s", [0.0, 1.0])
def test_a_river_without_swing_is_answered_as_if_it_were_not_looked_for(name: str, start_s: float) -> None:
    answers = []
    for mode in ("auto", "off"):
        stabilizer = make_stabilizer({"rolling_shutter": mode, "start_s": start_s})
        answers.append(fly(stabilizer, Flight(preset(name), (480, 270), 40)).tracks)
        assert stabilizer.swing is None
    for number, track in answers[0].items():
        same = answers[1][number]
        assert track.rows is None
        assert (track.inliers, track.rmse_px, track.sigma_px) == (same.inliers, same.rmse_px, same.sigma_px)
        np.testing.assert_array_equal(track.ref_H_cur, same.ref_H_cur)


@pytest.mark.parametrize("height", [0.06, 0.2])
@pytest.mark.parametrize("start_s", [0.0, 1.0])
def test_a_bank_along_the_rows_above_the_plane_is_no_rolling_shutter(height: float, start_s: float) -> None:
    stabilizer, tracks = make_stabilizer({"start_s": start_s}), []
    for number in range(50):
        far = 6 * np.sin(number / 4)
        low, high = (picture(translation(far * scale, 0.0)) for scale in (1.0, 1.0 + height))
        image = np.where(np.arange(SIZE[1])[:, None] < SIZE[1] // 3, high, low)
        tracks += stabilizer.answers(frame(image, number))
    tracks += stabilizer.finish()
    assert all(track.rows is None for track in tracks)
    assert stabilizer.swing is None
