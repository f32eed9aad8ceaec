"""The offset of clocks from exact flights whose sensors lag, with their noise; and when it cannot be told."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from reach import CAMERA, Reach, along_reach

from stab_ros.georeferencing.placement import Sighting
from stab_ros.georeferencing.time_offset import TimeOffset, Unobservable, estimate_time_offset
from stab_ros.imaging.pose import Pose
from stab_ros.synthetic.sensors import CONSUMER, PPK, SensorModel

LATE = replace(PPK, delay_s=0.15)


def estimated(pose_at: Callable[[float], Pose], model: SensorModel, seed: int = 1,
              duration_s: float = 30) -> TimeOffset | Unobservable:
    flight = Reach(pose_at, duration_s=duration_s, sensors=model, seed=seed)
    return estimate_time_offset(CAMERA, flight.track, flight.sightings, 0.0)


@pytest.mark.parametrize(("model", "speed", "seed"), [(LATE, 0.0, 1), (LATE, 5 / 3.6, 2), (CONSUMER, 0.0, 3)])
def test_gusts_tell_the_offset_within_10_ms(model: SensorModel, speed: float, seed: int) -> None:
    """Stamps that are late by 0.15 s; the consumer's attitude is wrong by up to 1 degree, its position by a metre."""
    found = estimated(along_reach(1.5, speed), model, seed)
    assert isinstance(found, TimeOffset)
    assert found.offset_s == pytest.approx(-0.15, abs=0.01)
    assert abs(found.offset_s + 0.15) < 4 * found.sigma_s
    assert found.sigma_s < 0.005
    assert found.explained > 0.95


def test_sigma_is_what_offsets_scatter_by() -> None:
    found = [estimated(along_reach(0.5, 0.0), LATE, seed, 20) for seed in range(1, 6)]
    ratios = [(one.offset_s + 0.15) / one.sigma_s for one in found if isinstance(one, TimeOffset)]
    assert len(ratios) == 5
    assert 0.4 < math.sqrt(np.mean(np.square(ratios))) < 2


@pytest.mark.parametrize("speed", [0.0, 5 / 3.6])
def test_a_still_or_even_flight_tells_none(speed: float) -> None:
    def even(t: float) -> Pose:
        return Pose.of_angles(np.array([0, speed * t, 46.0]), math.pi / 2, math.pi / 2, 0.0)

    found = estimated(even, LATE)
    assert isinstance(found, Unobservable)
    assert "too still to tell the time offset" in found.reason


def test_an_even_sway_tells_it_but_for_its_period() -> None:
    def swaying(t: float) -> Pose:
        pitch = math.pi / 2 + 0.05 * math.sin(2 * math.pi * t / 0.8)
        return Pose.of_angles(np.array([0, 0, 46.0]), math.pi / 2, pitch, 0)

    found = estimated(swaying, LATE)
    assert isinstance(found, Unobservable)
    assert "sways too evenly" in found.reason


def test_an_offset_beyond_the_search_is_said() -> None:
    found = estimated(along_reach(), replace(PPK, delay_s=1.0))
    assert isinstance(found, Unobservable)


def test_nothing_to_compare_is_said() -> None:
    flight = Reach(along_reach(), duration_s=5)
    lost = [Sighting(one.stamp_ns, one.gray) for one in flight.sightings]
    for sightings, track in ((lost, flight.track), (flight.sightings, replace(flight.track, attitudes=[]))):
        found = estimate_time_offset(CAMERA, track, sightings, 0.0)
        assert isinstance(found, Unobservable)
        assert "too few frames" in found.reason


def test_wrong_homographies_do_not_pull() -> None:
    flight = Reach(along_reach(), duration_s=30, sensors=LATE)
    sightings = list(flight.sightings)
    for k in range(0, len(sightings), 25):
        H = sightings[k].ref_H_cur
        assert H is not None
        sightings[k] = replace(sightings[k], ref_H_cur=H @ np.array([[1.0, 0, 60], [0, 1, -30], [0, 0, 1]]))
    found = estimate_time_offset(CAMERA, flight.track, sightings, 0.0)
    assert isinstance(found, TimeOffset)
    assert found.offset_s == pytest.approx(-0.15, abs=0.01)


@pytest.mark.parametrize("plane_m", [-49.0, 46 - 46 / 0.3048, 46 - 46 / 0.05, 30.0])
def test_a_wrong_height_hides_no_offset(plane_m: float) -> None:
    """A flight at 46 m: an undulation left out, feet for metres, a level of 0 m on a high river; a height too low."""
    flight = Reach(along_reach(1.5, 3.0), duration_s=20, sensors=LATE)
    found = estimate_time_offset(CAMERA, flight.track, flight.sightings, plane_m)
    assert isinstance(found, TimeOffset)
    assert found.offset_s == pytest.approx(-0.15, abs=0.01)


@pytest.mark.parametrize(("gust_deg", "plane_m"), [(0.3, 46 - 46 / 0.3048), (0.3, 45.0), (1.5, 60.0)])
def test_a_height_that_is_too_wrong_is_said(gust_deg: float, plane_m: float) -> None:
    """In a calm flight, feet for metres; just above the ground, and below it."""
    flight = Reach(along_reach(gust_deg, 3.0), duration_s=20, sensors=LATE)
    found = estimate_time_offset(CAMERA, flight.track, flight.sightings, plane_m)
    assert isinstance(found, Unobservable)
