"""Keyframes carry on beyond the first view, close the loop on the way back, and say how uncertain they are."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from flights import SIZE, fly, moved
from truth import frame, picture, translation

from stab_ros.core.errors import ConfigError
from stab_ros.core.geometry import rms_distance
from stab_ros.core.settings import Value
from stab_ros.imaging.window import Window
from stab_ros.parameters.engines import make_stabilizer, reconfigure
from stab_ros.synthetic.camera_path import Gust, Pose
from stab_ros.synthetic.flight import Flight, preset

KEYFRAME = {"reference": "keyframe"}
AWAY_S, REST_S = 4.0, 0.3


def traverse(name: str, widths: float, seed: int = 1) -> Flight:
    """So many frame widths along the river, and back."""
    scene = preset(name)
    away = Pose(x_m=widths * scene.ground_m[0])
    there, back = Gust(1.2, AWAY_S, away), Gust(1.2 + AWAY_S + REST_S, AWAY_S, away * -1.0)
    scene = replace(moved(scene, there, back), fps=16.0)
    scene = replace(scene, motion=replace(scene.motion, drift_per_s=Pose()))
    return Flight(scene, SIZE, int(16 * (1.6 + 2 * AWAY_S + REST_S)), seed)


@pytest.mark.parametrize("name", ["kolubara", pytest.param("alpine", marks=pytest.mark.thorough)])
def test_a_traverse_of_three_widths_comes_back_to_the_truth(name: str) -> None:
    flight, stabilizer = traverse(name, 3.0), make_stabilizer(KEYFRAME)
    flown = fly(stabilizer, flight)
    assert not flown.lost
    assert abs(flight.ref_H_cur(int(16 * (1.2 + AWAY_S)) + 2)[0, 2]) > 2.7 * SIZE[0]
    assert np.max(flown.error_px) < 1.5  # keyframes were made in time: it was 5.9 px over alpine where they were not
    assert np.max(flown.error_px[-5:]) < 0.1  # the loop is closed
    assert np.max(flown.sigma_px[-5:]) < 0.1
    assert np.mean(flown.error_px[1:] <= 2 * flown.sigma_px[1:]) > 0.9
    assert stabilizer.keyframes > 4
    steps = np.abs(np.diff(flown.error_px))
    assert np.all(steps < 2 * np.maximum(flown.sigma_px[1:], flown.sigma_px[:-1]) + 0.1)  # no jump that sigma denies


@pytest.mark.thorough
def test_a_fixed_reference_is_lost_there() -> None:
    flown = fly(make_stabilizer({}), traverse("kolubara", 2.0))
    assert len(flown.lost) > 20
    assert np.nanmax(flown.error_px) < 1.0


@pytest.mark.thorough
def test_keyframes_are_bounded() -> None:
    stabilizer = make_stabilizer({**KEYFRAME, "max_keyframes": 3})
    flown = fly(stabilizer, traverse("kolubara", 3.0))
    assert stabilizer.keyframes == 3
    assert not flown.lost
    assert np.max(flown.error_px[-5:]) < 0.1  # the reference is never forgotten


def test_within_the_first_view_keyframes_change_nothing() -> None:
    flight = Flight(preset("kolubara"), SIZE, 40)
    fixed, keyed = (fly(make_stabilizer(values), flight) for values in ({}, KEYFRAME))
    for number in range(40):
        np.testing.assert_array_equal(fixed.tracks[number].ref_H_cur, keyed.tracks[number].ref_H_cur)


def test_a_lost_frame_is_found_by_another_keyframe() -> None:
    """Black on the way back, until the view of the current keyframe has long been left."""
    flight, stabilizer = traverse("kolubara", 2.0), make_stabilizer(KEYFRAME)
    begin, end = int(16 * (1.2 + AWAY_S + REST_S)) + 20, int(16 * (1.2 + AWAY_S + REST_S)) + 44
    flown = fly(stabilizer, flight, lambda number, image: image * 0 if begin <= number < end else image)
    assert flown.lost == list(range(begin, end))
    assert np.max(flown.error_px[-5:]) < 0.1


@pytest.mark.thorough
def test_settings_may_change_on_the_way() -> None:
    """The reference is still known: the loop is closed on the way back."""
    flight, stabilizer = traverse("kolubara", 1.0), make_stabilizer({"reference": "adjacent"})
    middle = int(16 * (1.2 + AWAY_S))
    changes: dict[int, dict[str, Value]] = {middle: {**KEYFRAME}, middle + 4: {**KEYFRAME, "direct.patches": 900}}
    for shot in flight:
        if shot.index in changes:
            reconfigure(stabilizer, changes[shot.index])
        last = stabilizer.answers(frame(shot.image, shot.index))
    assert last[-1].ref_H_cur is not None
    assert rms_distance(last[-1].ref_H_cur, flight.ref_H_cur(len(flight) - 1), SIZE) < 0.1
    assert last[-1].sigma_px is not None
    assert last[-1].sigma_px < 0.1


# --- what image_stabilized shows -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("text", "window"), [("10, -20, 200, 100", (10, -20, 200, 100)),
                                              ("[-400,0,1200,300]", (-400, 0, 1200, 300))])
def test_a_window_is_that_part_of_the_view(text: str, window: tuple[int, int, int, int]) -> None:
    x, y, width, height = window
    whole, part = make_stabilizer({}), make_stabilizer({"output_roi": text})
    images = [picture(), picture(translation(3.0, 2.0))]
    shown = [[one.step(frame(image, number)) for number, image in enumerate(images)][1] for one in (whole, part)]
    assert shown[0].image is not None
    assert shown[1].image is not None
    assert shown[1].image.shape == (height, width)
    assert part.window.offset == (x, y)
    np.testing.assert_array_equal(shown[0].track.ref_H_cur, shown[1].track.ref_H_cur)
    canvas = cv2.copyMakeBorder(shown[0].image, 500, 500, 500, 1500, cv2.BORDER_CONSTANT)
    expected = canvas[y + 500 : y + 500 + height, x + 500 : x + 500 + width]
    inside = (expected > 0) & (shown[1].image > 0)
    assert inside.mean() > 0.2
    assert np.percentile(np.abs(expected.astype(int) - shown[1].image)[inside], 99) <= 1


@pytest.mark.parametrize("text", ["1, 2, 3", "a, b, c, d", "0, 0, 0, 9", "0, 0, 20000, 9", "0, 0, 16000, 16000", "[]"])
def test_a_window_that_cannot_be_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="output_roi") as error:
        Window.of(text)
    assert len(str(error.value).splitlines()) == 1
    with pytest.raises(ConfigError, match="output_roi"):
        make_stabilizer({"output_roi": text})
