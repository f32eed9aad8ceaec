"""Poses in the map of rendered flights, and sensors on board: their geometry by other libraries, their statistics."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from pyproj import Transformer
from scipy.spatial.transform import Rotation

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply
from stab_ros.imaging.pose import Pose
from stab_ros.synthetic.flight import Flight, preset
from stab_ros.synthetic.geodetic import Origin
from stab_ros.synthetic.sensors import (
    CONSUMER,
    EXACT,
    MARGIN_S,
    NADIR_BODY_R_OPTICAL,
    PPK,
    SensorModel,
    measured,
)


def hovering(_time_s: float) -> Pose:
    return Pose.of_angles(np.array([3.0, -2.0, 46.0]), 0.4, 1.2, 0.1)


def turning(time_s: float) -> Pose:
    return Pose.of_angles(np.array([1.4 * time_s, 0.1, 46.0]), 0.2 * time_s, 1.2, 0.1 * math.sin(time_s))


def test_a_flight_in_the_map_shows_its_control_points_where_its_own_truth_does() -> None:
    flight = Flight(preset("alpine"), (480, 270), frames=9)
    view = flight.view(8)
    rotation, _ = cv2.Rodrigues(view.pose.cam_R_map)
    offset = -view.pose.cam_R_map @ view.pose.position_m
    seen, _ = cv2.projectPoints(flight.control_points_map_m, rotation, offset, view.camera.K, None)
    expected = apply(np.linalg.inv(flight.ref_H_cur(8)), flight.control_points_px)
    np.testing.assert_allclose(seen[:, 0], expected, atol=1e-8)
    np.testing.assert_allclose(apply(view.image_H_map(0.0), flight.control_points_map_m[:, :2]), expected, atol=1e-8)


def test_the_top_of_a_nominal_image_is_north() -> None:
    flight = Flight(preset("kolubara"), (480, 270), frames=1)
    (_, top), (_, bottom) = flight.view(0).to_plane(np.array([[240.0, 0], [240, 269]]), 0.0)
    assert top > bottom


def test_exact_sensors_tell_the_pose() -> None:
    samples = measured(turning, 2.0, EXACT, seed=1)
    poses = [turning((stamp - 1_000_000_000) / 1e9) for stamp in samples.position_stamp_ns]
    np.testing.assert_allclose(samples.position_m, [pose.position_m for pose in poses], atol=1e-7)
    for stamp, q in zip(samples.attitude_stamp_ns, samples.map_q_body, strict=True):
        forward = Rotation.from_quat(q).apply([1.0, 0, 0])  # of a gimbal: along the view
        np.testing.assert_allclose(forward, turning((stamp - 1_000_000_000) / 1e9).cam_R_map[2], atol=1e-7)


def test_samples_enclose_the_flight_at_their_rates() -> None:
    samples = measured(hovering, 3.0, SensorModel(position_rate_hz=5.0, attitude_rate_hz=100.0), seed=1)
    for stamps, rate_hz in ((samples.position_stamp_ns, 5.0), (samples.attitude_stamp_ns, 100.0)):
        np.testing.assert_array_equal(np.diff(stamps), round(1e9 / rate_hz))
        assert stamps[0] == 1_000_000_000 - MARGIN_S * 1e9
        assert stamps[-1] >= 4_000_000_000 + MARGIN_S * 1e9


def test_stamps_are_late_by_the_delay() -> None:
    prompt, late = (measured(turning, 2.0, replace(EXACT, delay_s=delay_s), seed=1) for delay_s in (0.0, 0.15))
    np.testing.assert_array_equal(late.position_stamp_ns - prompt.position_stamp_ns, 150_000_000)
    np.testing.assert_array_equal(late.attitude_stamp_ns - prompt.attitude_stamp_ns, 150_000_000)
    np.testing.assert_array_equal(late.position_m, prompt.position_m)


def test_the_lever_arm_turns_with_the_body() -> None:
    """The antenna is 0.2 m above a drone's body that flies to the north, and 0.1 m behind."""
    def northwards(_time_s: float) -> Pose:
        return Pose.of_angles(np.zeros(3), math.pi / 2, math.pi / 2, 0.0)

    model = replace(EXACT, lever_arm_m=(-0.1, 0.0, 0.2), body_R_optical=NADIR_BODY_R_OPTICAL)
    samples = measured(northwards, 1.0, model, seed=1)
    np.testing.assert_allclose(samples.position_m, np.tile([0, -0.1, 0.2], (len(samples.position_m), 1)), atol=1e-12)
    np.testing.assert_allclose(Rotation.from_quat(samples.map_q_body[0]).apply([1.0, 0, 0]), [0, 1, 0], atol=1e-12)


def test_noise_has_its_covariance() -> None:
    samples = measured(hovering, 100.0, replace(PPK, position_rate_hz=40.0, attitude_rate_hz=40.0), seed=3)
    noise = samples.position_m - hovering(0).position_m
    np.testing.assert_allclose(np.cov(noise.T), samples.position_covariance_m2, atol=0.1 * 0.02**2)
    truth = measured(hovering, 0.0, EXACT, seed=3).map_q_body[0]
    turns = (Rotation.from_quat(truth).inv() * Rotation.from_quat(samples.map_q_body)).as_rotvec()
    np.testing.assert_allclose(np.cov(turns.T), samples.attitude_covariance_rad2, atol=0.1 * math.radians(0.05) ** 2)


def test_drift_is_correlated_over_its_time() -> None:
    model = replace(EXACT, drift_sigma_m=(0.5, 0.5, 1.0), drift_time_s=2.0, attitude_rate_hz=0.1)
    drift = measured(hovering, 3000.0, model, seed=4).position_m - hovering(0).position_m
    np.testing.assert_allclose(drift.std(axis=0), model.drift_sigma_m, rtol=0.1)
    apart = 20  # samples at 10 Hz: the drift time
    correlation = (drift[:-apart] * drift[apart:]).mean(axis=0) / drift.var(axis=0)
    np.testing.assert_allclose(correlation, math.exp(-1), atol=0.1)


def test_a_bias_is_a_rotation_of_the_body() -> None:
    bias = (0.01, -0.02, 0.03)
    biased, exact = (measured(turning, 1.0, replace(EXACT, attitude_bias_rad=b), seed=1) for b in (bias, (0.0,) * 3))
    turns = (Rotation.from_quat(exact.map_q_body).inv() * Rotation.from_quat(biased.map_q_body)).as_rotvec()
    np.testing.assert_allclose(turns, np.tile(bias, (len(turns), 1)), atol=1e-9)


def test_the_same_seed_gives_the_same_samples_and_another_one_others() -> None:
    first, again, other = (measured(turning, 1.0, CONSUMER, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.position_m, again.position_m)
    np.testing.assert_array_equal(first.map_q_body, again.map_q_body)
    assert not np.allclose(first.position_m, other.position_m)


def test_geodetic_places_are_those_of_proj() -> None:
    origin = Origin(55.3, -2.04, 151.0)
    points = np.array([[0.0, 0, 0], [180, -40, 46], [-2000, 3000, 500]])
    topocentric = Transformer.from_pipeline(
        "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 +lat_0=55.3 +lon_0=-2.04 +h_0=151 "
        "+step +inv +proj=cart +ellps=WGS84 +step +proj=unitconvert +xy_in=rad +xy_out=deg")
    longitude, latitude, height = topocentric.transform(*points.T)
    found = origin.to_geodetic(points)
    np.testing.assert_allclose(found[:, :2], np.column_stack([latitude, longitude]), atol=1e-11)
    np.testing.assert_allclose(found[:, 2], height, atol=1e-6)
    np.testing.assert_allclose(origin.to_map(found), points, atol=1e-6)


def test_a_sensor_that_cannot_be_is_refused() -> None:
    with pytest.raises(InputError):
        SensorModel(position_rate_hz=0.0)
    with pytest.raises(InputError):
        SensorModel(drift_time_s=-1.0)
    with pytest.raises(InputError):
        SensorModel(attitude_sigma_rad=(-1.0, 0.0, 0.0))
