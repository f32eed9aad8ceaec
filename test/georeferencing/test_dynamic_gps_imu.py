"""`dynamic_gps_imu` on synthetic sensors: errors on the ground are those that the covariance predicts."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply, grid, jacobian
from stab_ros.core.types import FloatArray, Frame
from stab_ros.georeferencing.dynamic_gps_imu import DynamicGpsImu
from stab_ros.georeferencing.georeferencer import Georeferenced, Georeferencer
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.georeferencing.orientation import Unplaced
from stab_ros.georeferencing.orientations import make_orientation
from stab_ros.georeferencing.placement import Motion
from stab_ros.georeferencing.posed import sigma_m
from stab_ros.georeferencing.samples import AttitudeSample, PositionSample
from stab_ros.georeferencing.sensors import Sensors
from stab_ros.georeferencing.settings import GeoreferenceConfig
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import BODY_R_OPTICAL, Pose, quaternion_of
from stab_ros.imaging.view import View
from stab_ros.synthetic.sensors import EXACT, PPK, SensorModel, SensorSamples, measured

CAMERA = Camera(np.array([[1500.0, 0, 959.5], [0, 1500, 539.5], [0, 0, 1]]), np.zeros(5), "plumb_bob", (1920, 1080))
PICTURE = np.zeros((1080, 1920), np.uint8)
FRAMES, STEP_NS, FIRST_NS = 60, 100_000_000, 10**9
PIXELS = grid(CAMERA.size)
LEVER = (-0.1, 0.02, 0.3)


def _pose_at(at_s: float) -> Pose:
    """Along a reach at 5 km/h, in gusts, looking down 75 degrees."""
    sway = 0.3 * np.array([math.sin(at_s), math.cos(1.3 * at_s), math.sin(0.6 * at_s)])
    return Pose.of_angles(np.array([1.4 * at_s, 0, 46]) + sway, 1.2 + 0.02 * math.sin(at_s),
                          math.radians(75) + 0.01 * math.sin(1.7 * at_s), 0.01 * math.sin(1.1 * at_s))


CONFIG = GeoreferenceConfig(orientation="dynamic_gps_imu", lever_arm_m=",".join(map(str, LEVER)), wse_sigma_m=0.0,
                            sensor_slow_share=0.0)  # the noise of PPK here is white
ALONE = replace(CONFIG, fuse_homographies=False)


def _engine(config: GeoreferenceConfig) -> Georeferencer:
    sensors = Sensors(config.time_offset_s)
    return Georeferencer(config, CAMERA, make_orientation(config, CAMERA, True, sensors=sensors), sensors)


def _samples(model: SensorModel, seed: int = 0) -> SensorSamples:
    return measured(_pose_at, FRAMES * STEP_NS / 1e9, replace(model, lever_arm_m=LEVER), seed)


def _told(engine: Georeferencer, samples: SensorSamples, until_ns: float = math.inf,
          from_ns: float = -math.inf) -> None:
    for stamp_ns, place in zip(samples.position_stamp_ns.tolist(), samples.position_m, strict=True):
        if from_ns <= stamp_ns < until_ns:
            engine.add_position(PositionSample(stamp_ns, place, samples.position_covariance_m2))
    for stamp_ns, q in zip(samples.attitude_stamp_ns.tolist(), samples.map_q_body, strict=True):
        if from_ns <= stamp_ns < until_ns:
            engine.add_attitude(AttitudeSample(stamp_ns, q, samples.attitude_covariance_rad2))


def _frame(number: int) -> Frame:
    return Frame(PICTURE, "mono8", FIRST_NS + number * STEP_NS)


def _motion(number: int) -> Motion:
    """Exact, but for 0.02 px."""
    first, now = (View(CAMERA, _pose_at(n * STEP_NS / 1e9)).image_H_map(0.0) for n in (0, number))
    H = first @ np.linalg.inv(now)
    H /= H[2, 2]
    J = jacobian(H, PIXELS)
    C = np.linalg.inv(np.einsum("nij,nik->jk", J, J)) * 0.02**2
    return Motion(H + np.append(np.random.default_rng(number).multivariate_normal(np.zeros(8), C), 0).reshape(3, 3), C)


def _errors_m(answer: Georeferenced, number: int) -> FloatArray:
    assert answer.placement is not None, answer.reason
    truth = View(CAMERA, _pose_at(number * STEP_NS / 1e9)).to_plane(PIXELS, 0.0)
    return np.asarray(np.linalg.norm(apply(answer.placement.map_H_image, PIXELS) - truth, axis=1))


def test_exact_sensors_place_frames_between_their_samples() -> None:
    engine = _engine(CONFIG)
    _told(engine, _samples(EXACT))
    errors = [_errors_m(engine.frame(_frame(number)), number).max() for number in range(FRAMES)]
    assert max(errors) < 0.02  # of the line between positions 0.1 s apart


@pytest.mark.parametrize("fused", [False, True])
def test_errors_are_what_the_covariance_predicts(fused: bool) -> None:
    ratios, errors = [], []
    for seed in range(5):
        engine = _engine(CONFIG if fused else ALONE)
        _told(engine, _samples(PPK, seed))
        for number in range(FRAMES):
            answer = engine.frame(_frame(number), _motion(number) if fused else None)
            error = _errors_m(answer, number)
            assert answer.placement is not None
            assert answer.placement.covariance is not None
            sigma = sigma_m(answer.placement.map_H_image, answer.placement.covariance, PIXELS)
            ratios.append(np.median(error / sigma))
            errors.append(np.median(error))
    assert 0.7 < np.median(ratios) < 1.3
    assert np.median(errors) < (0.05 if fused else 0.08)


def test_fusing_homographies_is_better_than_sensors_alone() -> None:
    errors = {}
    for fused in (False, True):
        engine = _engine(CONFIG if fused else ALONE)
        _told(engine, _samples(PPK, 7))
        errors[fused] = np.median([_errors_m(engine.frame(_frame(number), _motion(number)), number)
                                   for number in range(FRAMES)])
    assert errors[True] < 0.7 * errors[False]


def test_frames_wait_for_the_samples_after_them_and_are_the_same_live_and_offline() -> None:
    samples = _samples(PPK, 1)
    offline = _engine(CONFIG)
    _told(offline, samples)
    wanted = [offline.frame(_frame(number), _motion(number)) for number in range(12)]
    live, answers, told = _engine(CONFIG), [], 0.0
    for number in range(12):
        live.add_frame(_frame(number), _motion(number))
        answers += live.answers()
        assert live.waiting > 0
        until_ns = FIRST_NS + (number - 1) * STEP_NS + 50_000_000  # sensors come 150 ms late
        _told(live, _between(samples, told, until_ns))
        told = until_ns
        answers += live.answers()
    _told(live, _between(samples, told, math.inf))
    answers += live.answers()
    assert len(answers) == 12
    for ours, theirs in zip(answers, wanted, strict=True):
        assert ours.placement is not None
        assert theirs.placement is not None
        assert np.abs(ours.placement.map_H_image - theirs.placement.map_H_image).max() < 1e-9


def _between(samples: SensorSamples, after_ns: float, until_ns: float) -> SensorSamples:
    position, attitude = ((stamps >= after_ns) & (stamps < until_ns)
                          for stamps in (samples.position_stamp_ns, samples.attitude_stamp_ns))
    return replace(
        samples, position_stamp_ns=samples.position_stamp_ns[position], position_m=samples.position_m[position],
        attitude_stamp_ns=samples.attitude_stamp_ns[attitude], map_q_body=samples.map_q_body[attitude])


@pytest.mark.parametrize(("config", "said"), [
    (replace(CONFIG, wse_m=60.0), "the water surface at 60 m is not below the camera at 4"),
    (replace(ALONE, wse_m=60.0), "the water surface at 60 m is not below the camera at 4"),
    (replace(CONFIG, ground_above_wse_m=50.0), "the ground at 50 m is not below the camera at 4"),
])
def test_water_or_ground_above_the_camera_is_said(config: GeoreferenceConfig, said: str) -> None:
    engine = _engine(config)
    _told(engine, _samples(PPK, 3))
    assert engine.frame(_frame(0), _motion(0)).reason.startswith(said)


@pytest.mark.parametrize(("off_m", "agrees"), [(0.0, True), (0.04, True), (3.0, False), (500.0, False)])
def test_control_points_that_contradict_the_sensors_are_left_out_and_that_is_said(off_m: float, agrees: bool) -> None:
    sensors, place = Sensors(0.0), _pose_at(0.0)
    by_points = (Pose(place.position_m + np.array([off_m, 0, 0]), place.cam_R_map), np.diag([1e-4] * 3 + [1e-8] * 3))
    engine = Georeferencer(CONFIG, CAMERA, DynamicGpsImu(CONFIG, CAMERA, sensors, by_points), sensors)
    _told(engine, _samples(PPK, 3))
    for number in range(5):
        answer = engine.frame(_frame(number), _motion(number))
        said = () if answer.placement is None else answer.placement.warnings
        assert any("control points and sensors contradict each other" in doubt for doubt in said) is not agrees
        assert np.median(_errors_m(answer, number)) < 0.15


def test_a_contradiction_by_the_clock_is_said_until_that_is_corrected() -> None:
    config, place = replace(CONFIG, apply_time_offset=True), _pose_at(0.0)
    sensors, by_points = Sensors(0.0), (place, np.diag([1e-6] * 3 + [1e-8] * 3))
    engine = Georeferencer(config, CAMERA, DynamicGpsImu(config, CAMERA, sensors, by_points), sensors)
    _told(engine, measured(_pose_at, 11.6, replace(PPK, lever_arm_m=LEVER, delay_s=0.4), 4))
    answers = [engine.frame(_frame(number), _motion(number)).placement for number in range(104)]
    said = [[doubt for doubt in answer.warnings if "control points and sensors contradict" in doubt]
            for answer in answers if answer is not None]
    assert [bool(doubts) for doubts in said] == [True] * 101 + [False] * 3
    for cause in ("lever_arm_m", "mount_rad", "time_offset_s", "sigmas of the sensors", "origin"):
        assert cause in said[0][0].partition("check")[2]


def test_a_late_sensor_is_a_reason_and_homographies_go_on() -> None:
    engine, samples = _engine(CONFIG), _samples(PPK, 2)
    _told(engine, samples, FIRST_NS + 10 * STEP_NS)
    alone = _engine(ALONE)
    _told(alone, samples, FIRST_NS + 10 * STEP_NS)
    answers = [engine.frame(_frame(number), _motion(number)) for number in range(40)]
    assert isinstance(alone.frame(_frame(39)).answer, Unplaced)
    assert answers[39].placement is not None
    assert any(doubt.startswith("by homographies alone: the nearest") for doubt in answers[39].placement.warnings)
    assert np.median(_errors_m(answers[39], 39)) < 0.15


def test_a_delay_of_the_sensors_is_taken_out() -> None:
    engine = _engine(replace(CONFIG, time_offset_s=-0.15))
    _told(engine, _samples(replace(EXACT, delay_s=0.15)))
    assert max(_errors_m(engine.frame(_frame(number)), number).max() for number in range(FRAMES)) < 0.02


def test_fixes_fix_the_origin_and_a_covariance_that_is_missing_is_said() -> None:
    config = replace(ALONE, position_sigma_m=2.0)
    engine, samples, place = _engine(config), _samples(EXACT), LocalFrame(55.2, -1.9, 0.0)
    there = place.to_geodetic(samples.position_m)
    for stamp_ns, lat_lon_height in zip(samples.position_stamp_ns.tolist(), there, strict=True):
        engine.add_fix(stamp_ns, lat_lon_height, None)
    for stamp_ns, q in zip(samples.attitude_stamp_ns.tolist(), samples.map_q_body, strict=True):
        engine.add_attitude(AttitudeSample(stamp_ns, q, 1e-6 * np.eye(3)))
    answer = engine.frame(_frame(30)).placement
    assert engine.local_frame == LocalFrame(float(there[0, 0]), float(there[0, 1]), 0.0)
    assert answer is not None
    assert answer.warnings == ("positions come without covariance, position_sigma_m stands for it",)
    assert 2.0 < answer.values["sigma_m"] < 4.0
    with pytest.raises(InputError, match="latitude"):
        engine.add_fix(0, np.array([300.0, 10, 5]), None)


def _long(delay_s: float, attitude_of: Callable[[FloatArray], FloatArray] = lambda q: q) -> Georeferenced:
    """The last answer of 11 s of flight."""
    engine, frames = _engine(CONFIG), 111
    samples = measured(_pose_at, 11.1, replace(PPK, lever_arm_m=LEVER, delay_s=delay_s), 4)
    _told(engine, replace(samples, map_q_body=np.array([attitude_of(q) for q in samples.map_q_body])))
    for number in range(frames):
        answer = engine.frame(_frame(number), _motion(number))
    return answer


def test_a_delay_that_is_left_is_told_with_its_sigma() -> None:
    answer = _long(0.15).placement
    assert answer is not None
    assert answer.values["time_offset_left_s"] == pytest.approx(-0.15, abs=0.02)
    assert any("the clock of the sensors is off: add -0.1" in doubt for doubt in answer.warnings)


def test_a_delay_that_is_found_is_applied_where_that_is_wanted() -> None:
    """Live, in which samples come as time goes on, it is the same to the last digit."""
    config, samples = replace(CONFIG, apply_time_offset=True), measured(
        _pose_at, 13.1, replace(PPK, lever_arm_m=LEVER, delay_s=0.15), 4)
    at_once, live, told = _engine(config), _engine(config), 0.0
    _told(at_once, samples)
    recorded = [at_once.frame(_frame(number), _motion(number)) for number in range(126)]
    streamed = []
    for number in range(126):
        stamp_ns = FIRST_NS + number * STEP_NS
        _told(live, samples, stamp_ns + 0.3e9, told)
        told = stamp_ns + 0.3e9
        live.add_frame(_frame(number), _motion(number))
        streamed += live.answers()
    before, after = ([np.sqrt(np.mean(_errors_m(recorded[number], number) ** 2)) for number in range(first, first + 24)]
                     for first in (76, 102))
    assert np.mean(before) > 0.15
    assert np.mean(after) < 0.1
    assert live.time_offset_s == at_once.time_offset_s
    assert live.time_offset_s == pytest.approx(-0.15, abs=0.02)
    assert len(streamed) == 126
    for one, other in zip(recorded, streamed, strict=True):
        assert one.placement is not None
        assert other.placement is not None
        assert (one.placement.map_H_image == other.placement.map_H_image).all()
        assert one.placement.warnings == other.placement.warnings
    assert recorded[-1].placement is not None
    assert "are added to time_offset_s after stamp 11000000000 ns, which makes it -0.1" in recorded[
        -1].placement.warnings[0]


def test_an_offset_that_a_short_recording_left_is_told_as_the_value_to_set() -> None:
    config = replace(CONFIG, apply_time_offset=True, time_offset_s=-0.1)
    engine = _engine(config)
    _told(engine, measured(_pose_at, 9.6, replace(PPK, lever_arm_m=LEVER, delay_s=0.3), 4))
    for number in range(96):
        engine.frame(_frame(number), _motion(number))
    (said,) = (doubt for doubt in engine.last_look() if "clock" in doubt)
    assert "still off by -0." in said
    assert float(said.rpartition(" ")[2]) == pytest.approx(-0.3, abs=0.02)
    assert "apply_time_offset" not in said


def test_an_attitude_in_other_axes_is_named() -> None:
    upside_down = _long(0.0, lambda q: q * [1, -1, -1, 1])  # forward, right, down in north, west, ...
    said = upside_down.reason or " ".join(upside_down.placement.warnings if upside_down.placement else ())
    assert "NED" in said or "contradict" in said


@pytest.mark.parametrize(("backwards", "seconds", "said_at_the_end"), [(False, 6, 0), (True, 6, 1), (True, 11, 0)])
def test_a_recording_is_looked_at_once_more_at_its_end(backwards: bool, seconds: int, said_at_the_end: int) -> None:
    """What is wrong with the sensors of a short one is told; what was told on the way is not repeated."""
    engine, samples = _engine(CONFIG), measured(_pose_at, seconds + 0.1, replace(PPK, lever_arm_m=LEVER), 4)
    turned = samples.map_q_body[:, [1, 0, 3, 2]] * [-1, 1, 1, -1]  # by 180 degrees about the vertical
    _told(engine, replace(samples, map_q_body=turned) if backwards else samples)
    said: set[str] = set()
    for number in range(10 * seconds + 1):
        answer = engine.frame(_frame(number), _motion(number)).placement
        said |= set() if answer is None else set(answer.warnings)
    at_the_end = [doubt for doubt in engine.last_look() if "the attitude contradicts the homographies" in doubt]
    assert len(at_the_end) == said_at_the_end
    assert any("the attitude contradicts" in doubt for doubt in said) is (backwards and seconds > 10)


def test_sensors_that_agree_are_not_doubted() -> None:
    answer = _long(0.0).placement
    assert answer is not None
    assert not answer.warnings


def test_a_long_flight_lets_its_samples_go_and_is_placed_the_same() -> None:
    """Ten minutes of sensors, a frame each 10 s: at most the last three minutes are kept."""
    sensors = Sensors(0.0)
    config = GeoreferenceConfig(orientation="dynamic_gps_imu")
    engine = Georeferencer(config, CAMERA, make_orientation(config, CAMERA, True, sensors=sensors), sensors)
    places = []
    for number in range(1201):
        pose, stamp_ns = _pose_at(number / 2), FIRST_NS + number * 500_000_000
        map_R_body = (BODY_R_OPTICAL @ pose.cam_R_map).T
        engine.add_position(PositionSample(stamp_ns, pose.position_m, 1e-4 * np.eye(3)))
        engine.add_attitude(AttitudeSample(stamp_ns, quaternion_of(map_R_body)))
        if number % 20 == 10:
            engine.add_frame(Frame(PICTURE, "mono8", stamp_ns))
        places += [answer.placement for answer in engine.answers()]
    assert len(places) == 60
    assert len(sensors.positions) < 400
    assert len(sensors.attitudes) < 400
    for number, place in enumerate(places):
        assert place is not None
        truth = View(CAMERA, _pose_at(10 * number + 5)).to_plane(PIXELS, 0.0)
        assert np.allclose(apply(place.map_H_image, PIXELS), truth, atol=1e-6)
