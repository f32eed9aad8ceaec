"""The search for lies, on short flights of every kind: no frame is far off in silence."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from lies.draw import FAULTS, TEXTURES, draw
from lies.judge import GRAVE, LOST, judge, said_of
from lies.render import render

from stab_ros.core.geometry import rms_distance
from stab_ros.core.types import Frame
from stab_ros.parameters.engines import make_stabilizer

FRAMES, SIZES = 34, ((320, 240), (480, 270))
FLIGHTS = {  # kind and seed; those that once were far off, where there were any
    "none": 1000, "osd": 127, "hot_pixels": 1002, "fixed_pattern": 1003, "dirt": 1004, "bars": 1005, "soft_bars": 2006,
    "vignette": 3007, "flakes": 3008, "garbage_first": 4009, "garbage_early": 1010, "frozen_previous": 45,
    "frozen_reference": 29, "late_overlay": 24, "fixed_camera": 1014, "jello": 1015, "legs": 4016, "repeated": 1017,
    "gusts": 1018, "cut": 3019,
}
MISLEADING = {  # seed and number of frames
    300139: FRAMES,  # the banks have less texture than the water, and noise takes most of it
    400096: 60,  # a cut within the start: hardly any feature is seen both before and after, but for water
    410052: 60,  # dirt on the lens, and the camera sways by a pixel within the start
    410066: 60,  # text in the picture, and a cut within the start: what is seen before and after is the text
    420029: 60,  # a damaged picture within the start, after which the water was found again, and the ground was not
    420008: 60,  # snow and low contrast: no features keep together, but for water in the first frames
    430007: 60,  # a codec scatters the features of the banks, those of the water keep together
    430095: 60,  # rows that swing: no feature keeps together from frame to frame, those of the water less than others
    430020: 60,  # three planes, each of which can be the ground
    440106: 60,  # the codec scatters a bank while water that hardly flows keeps together
    430038: 60,  # dirt on the lens before a camera that sways, through which the scene is seen
    450052: 60,  # gusts blow the bank and the water beside it out of a small picture
    480070: 60,  # banks of less texture than the glitter on the water, a cut within the start
    480084: 60,  # crowns of less texture than the glitter on the water, and the drone's legs
    480095: 60,  # a camera that sways by half a pixel over banks with few features
    490014: 60,  # few features, and glitter that keeps for a second
}


def test_every_fault_has_a_flight() -> None:
    assert {*FAULTS} <= {*FLIGHTS}


@pytest.mark.parametrize(("kind", "seed"), FLIGHTS.items())
def test_no_flight_is_far_off_in_silence(kind: str, seed: int) -> None:
    recipe = draw(seed, FRAMES, kind, SIZES)
    verdicts = judge(render(recipe), {})
    assert [verdict for verdict in verdicts if verdict.said == GRAVE] == [], recipe


@pytest.mark.thorough
@pytest.mark.parametrize(("seed", "frames"), MISLEADING.items())
def test_no_misleading_flight_is_far_off_in_silence(seed: int, frames: int) -> None:
    verdicts = judge(render(draw(seed, frames)), {})
    assert [verdict for verdict in verdicts if verdict.said == GRAVE] == []


@pytest.mark.thorough
def test_a_group_of_features_that_makes_no_plane_is_left() -> None:
    """There were features that agreed in a few frames and, all together, determined no homography in any."""
    flight = render(draw(200015))
    stabilizer = make_stabilizer({"threads": 1})
    for number, shown in enumerate(flight.pictures[:36]):
        stabilizer.answers(Frame(shown, "mono8", flight.stamp_ns(number)))
    assert not stabilizer.buffering


@pytest.mark.parametrize("texture", [texture for texture in TEXTURES if texture != "photo"])
def test_the_truth_is_that_of_the_pictures(texture: str) -> None:
    recipe = replace(draw(7, 12, texture, SIZES), fault="none", motion="drift", water="none", encoding="raw", noise=0.0,
                     blur_px=1.0, exposure=0.0, weather="clear", jello_px=0.0)
    flight = render(recipe)
    first, last = (picture.astype(np.float32) for picture in (flight.pictures[0], flight.pictures[-1]))
    guess = np.linalg.inv(flight.true_H(11, 0)).astype(np.float32)
    enough = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-7)
    _, cur_H_ref = cv2.findTransformECC(first, last, guess, cv2.MOTION_HOMOGRAPHY, enough, None, 5)
    ref_H_cur = np.linalg.inv(cur_H_ref.astype(float))
    error_px = rms_distance(ref_H_cur / ref_H_cur[2, 2], flight.true_H(11, 0), recipe.size)
    assert error_px < 0.05  # which is ECC's own, as it interpolates linearly


def test_a_seed_is_a_flight() -> None:
    one, other = (render(draw(5, 12, "late_overlay", SIZES)) for _ in range(2))
    assert one.recipe == other.recipe
    np.testing.assert_array_equal(one.pictures, other.pictures)


def test_what_is_off_is_found() -> None:
    flight = render(replace(draw(3, 30, "none", SIZES), texture="crowns", water="none", encoding="raw", motion="hover"))
    moved = flight.world_H_cur.copy()
    moved[12:, 0, 2] += 3.0
    verdicts = judge(replace(flight, world_H_cur=moved), {})
    assert {verdict.frame for verdict in verdicts if verdict.said == GRAVE} == set(range(12, 30))


@pytest.mark.thorough
def test_what_is_lost_and_can_be_seen_is_found() -> None:
    flight = render(replace(draw(3, 12, "none", SIZES), texture="crowns", water="none", encoding="raw", motion="hover"))
    verdicts = judge(flight, {"min_inliers": 10_000})
    assert {verdict.frame for verdict in verdicts if verdict.said == LOST} == set(range(1, 12))


@pytest.mark.parametrize(("error_px", "sigma_px", "word"), [
    (0.5, 0.2, ""), (0.5, 0.1, "sigma"), (0.015, 0.001, ""), (2.0, 0.1, "grave"), (2.0, 1.0, "far")])
def test_words(error_px: float, sigma_px: float, word: str) -> None:
    assert said_of(error_px, sigma_px) == word
