"""What is fixed to the camera is not the ground: text, borders, an overlay in mid-flight; and a camera that stands."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import cv2
import numpy as np
import pytest
from flights import SIZE, Flown, fly, trap

from stab_ros.core.geometry import rms_distance
from stab_ros.core.gray import to_gray
from stab_ros.core.types import Frame, Gray
from stab_ros.demo.__main__ import SAMPLE, TRUTH
from stab_ros.io.homographies import read_homographies
from stab_ros.io.source import open_source
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.camera_path import Pose
from stab_ros.synthetic.flight import Flight, preset
from stab_ros.tracking.stabilizer import Stabilizer

FRAMES = 36


def with_text(image: Gray, rows: int) -> Gray:
    shown = image.copy()
    for row in range(rows):
        y = 24 + row * (image.shape[0] - 40) // max(rows, 2)
        cv2.putText(shown, "ALT 120 SPD 3.2 BAT 87%", (6, y), cv2.FONT_HERSHEY_SIMPLEX, 0.6, 255, 2, cv2.LINE_AA)
    return shown


def with_bars(image: Gray) -> Gray:
    shown = image.copy()
    shown[:24] = shown[-24:] = 0
    return shown


def swaying() -> Flight:
    """The camera moves by 10 to 30 px."""
    return Flight(preset("basento"), SIZE, FRAMES)


def with_specks(image: Gray, seed: int) -> Gray:
    """Soft dark specks of dirt on the lens."""
    random, specks = np.random.default_rng(seed), np.zeros(image.shape, np.float32)
    height, width = image.shape
    for _ in range(160):
        at = int(random.uniform(0, width)), int(random.uniform(0, height))
        cv2.circle(specks, at, int(random.uniform(3, 9)), 1.0, -1)
    return np.asarray(image * (1 - 0.6 * cv2.GaussianBlur(specks, (0, 0), 2.0)), np.uint8)


def share(stabilizer: Stabilizer) -> float:
    return stabilizer.sensor_fixed_share


def is_right(flown: Flown) -> bool:
    return not flown.lost and bool(np.nanmax(flown.error_px / np.maximum(3 * flown.sigma_px, 0.05)) < 1)


@pytest.mark.parametrize("rows", [1, 3])
def test_text_in_the_picture_is_not_the_ground(rows: int) -> None:
    stabilizer = make_stabilizer({})
    flown = fly(stabilizer, swaying(), lambda _, image: with_text(image, rows))
    assert is_right(flown)
    assert np.nanmedian(flown.error_px[1:]) < 0.05
    assert share(stabilizer) > 0.01 * rows
    assert stabilizer.competing_hypothesis is None
    assert stabilizer.static_map is not None
    text = with_text(np.zeros(SIZE[::-1], np.uint8), rows) > 0
    assert np.mean(stabilizer.static_map.picture()[text] > 127) < 0.1


@pytest.mark.thorough
def test_dirt_on_the_lens_is_not_the_ground() -> None:
    """Its specks, dragged along by the scene behind them, keep together only loosely and never quite rest."""
    stabilizer = make_stabilizer({})
    with open_source(SAMPLE) as source:
        frames = [picture.decoded for picture in islice(source.frames(), 30) if isinstance(picture.decoded, Frame)]
    tracks = [track for frame in frames
              for track in stabilizer.answers(replace(frame, image=with_specks(to_gray(frame), 5), encoding="mono8"))]
    for track, row in zip([*tracks, *stabilizer.finish()], read_homographies(TRUTH), strict=False):
        assert track.ref_H_cur is not None
        assert row.ref_H_cur is not None
        assert rms_distance(track.ref_H_cur, row.ref_H_cur, frames[0].size) < 0.05
    assert stabilizer.competing_hypothesis is None


@pytest.mark.thorough
def test_bars_above_and_below_are_not_the_ground() -> None:
    stabilizer = make_stabilizer({})
    assert is_right(fly(stabilizer, swaying(), lambda _, image: with_bars(image)))


@pytest.mark.thorough
def test_an_overlay_that_appears_in_flight_is_left_out_of_later_keyframes() -> None:
    scene = preset("basento")
    far = replace(scene, motion=replace(scene.motion, drift_per_s=Pose(x_m=0.6 * scene.ground_m[0])))
    stabilizer = make_stabilizer({"reference": "keyframe"})
    flown = fly(stabilizer, Flight(far, SIZE, 60), lambda k, image: with_text(image, 5) if k > 20 else image)
    assert stabilizer.keyframes > 1
    assert len(flown.lost) <= 3
    assert np.nanmax(flown.error_px / np.maximum(3 * flown.sigma_px, 0.05)) < 1
    assert share(stabilizer) > 0.02


@pytest.mark.parametrize("speed_m_s", [0.1, 1.0])
@pytest.mark.parametrize("name", ["kolubara", "alpine"])
def test_a_camera_that_stands_still_sees_ground_at_rest(name: str, speed_m_s: float) -> None:
    """As with an overlay, one plane is at rest and the other one moves; here that is the water."""
    scene = trap(name, speed_m_s)
    still = replace(scene, motion=replace(scene.motion, sway=Pose()))
    stabilizer = make_stabilizer({})
    flown = fly(stabilizer, Flight(still, SIZE, FRAMES))
    assert is_right(flown)
    assert np.nanmax(flown.error_px) < 0.1
    assert share(stabilizer) == 0.0
