"""Every orientation on pictures of a plane: held-out points on the water within 0.02 m from a height of 46 m."""

import functools
import math
from collections.abc import Sequence

import numpy as np
import pytest
from ground_pictures import GroundPictures

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply, jacobian
from stab_ros.core.types import FloatArray, Frame, Gray
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.georeferencer import Georeferenced, Georeferencer
from stab_ros.georeferencing.orientation import Unplaced
from stab_ros.georeferencing.orientations import make_orientation
from stab_ros.georeferencing.placement import Motion
from stab_ros.georeferencing.sensors import Sensors
from stab_ros.georeferencing.settings import GeoreferenceConfig
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View
from stab_ros.tracking.settings import StabilizerConfig
from stab_ros.tracking.stabilizer import Stabilizer

K = np.array([[1500.0, 0, 963.2], [0, 1500, 535.1], [0, 0, 1]])
CAMERA = Camera(K, np.zeros(5), "plumb_bob", (1920, 1080))
HEIGHT_M, WITHIN_M, FRAMES = 46.0, 0.02, 5
FIRST_NS, STEP_NS = 10**9, 10**8
HELD_OUT = np.stack(np.meshgrid(np.linspace(-16, 16, 5), np.linspace(-9, 9, 5)), axis=-1).reshape(-1, 2)
GCPS_M = np.array([[-20.0, -8, 0], [18, -10, 0], [19, 10, 0], [-21, 9, 0], [0, -11, 0], [-8, 5, 0], [9, 2, 0],
                   [2, 11, 0]])


def _pose(frame: int, pitch_deg: float) -> Pose:
    """A drone that hovers in gusts; at frame 0 above a place from which it sees the origin of the map."""
    sway = np.array([0.4 * math.sin(frame), 0.3 * math.sin(1.7 * frame), 0.2 * math.sin(0.8 * frame)])
    yaw, pitch, roll = math.pi / 2 + 0.01 * math.sin(frame), math.radians(pitch_deg), 0.008 * math.sin(1.3 * frame)
    south = HEIGHT_M / math.tan(pitch)
    return Pose.of_angles(np.array([0, -south, HEIGHT_M]) + sway, yaw, pitch + 0.01 * math.sin(0.6 * frame), roll)


@functools.cache
def _ground() -> GroundPictures:
    return GroundPictures()


@functools.cache
def _pictures(pitch_deg: float) -> tuple[Gray, ...]:
    return tuple(_ground().seen_by(View(CAMERA, _pose(number, pitch_deg))) for number in range(FRAMES))


def _marked(view: View, map_m: FloatArray, noise_px: float = 0.0) -> ControlPoints:
    pixels = view.project(map_m) + np.random.default_rng(2).normal(0, noise_px or 1e-12, (len(map_m), 2))
    return ControlPoints(tuple(f"G{number}" for number in range(len(map_m))), pixels, map_m)


def _engine(config: GeoreferenceConfig, gcps: ControlPoints | None = None, calibrated: bool = True) -> Georeferencer:
    return Georeferencer(config, CAMERA, make_orientation(config, CAMERA, calibrated, gcps), Sensors(0.0))


def _frames(pictures: Sequence[Gray]) -> list[Frame]:
    return [Frame(picture, "mono8", FIRST_NS + number * STEP_NS) for number, picture in enumerate(pictures)]


def _followed(engine: Georeferencer, pictures: Sequence[Gray]) -> list[Georeferenced]:
    """Answers with the homographies of the real stabiliser."""
    stabilizer, answers = Stabilizer(StabilizerConfig(), camera=CAMERA), []
    for frame in _frames(pictures):
        track = stabilizer.track(frame)
        motion = None if track.ref_H_cur is None else Motion(track.ref_H_cur, track.covariance, track.reset_counter)
        answers.append(engine.frame(frame, motion))
    return answers


def _errors_m(answer: Georeferenced, view: View) -> FloatArray:
    """Distances of held-out points of the plane, whose true pixels are known, from where they are placed."""
    assert answer.placement is not None, answer.reason
    true_px = view.project(np.column_stack([HELD_OUT, np.zeros(len(HELD_OUT))]))
    shown = ((true_px > 0) & (true_px < np.array(CAMERA.size) - 1)).all(axis=1)
    assert shown.sum() > 15
    return np.asarray(np.linalg.norm(apply(answer.placement.map_H_image, true_px[shown]) - HELD_OUT[shown], axis=1))


def test_stationary_gcps() -> None:
    view = View(CAMERA, _pose(0, 60))
    gcps = _marked(view, GCPS_M + [0, 0, 1.5] * (np.arange(8) % 2)[:, None], 0.3)
    answer = _engine(GeoreferenceConfig(orientation="stationary_gcps", gcp_sigma_px=0.3, gcp_sigma_m=0.0), gcps).frame(
        _frames(_pictures(60))[0])
    assert _errors_m(answer, view).max() < WITHIN_M
    assert answer.placement is not None
    assert answer.placement.pose is not None
    assert np.linalg.norm(answer.placement.pose.position_m - view.pose.position_m) < 0.1
    assert 0.1 < answer.placement.values["rmse_px"] < 0.6


def test_one_control_point_off_by_half_a_metre_is_named() -> None:
    view, places = View(CAMERA, _pose(0, 60)), GCPS_M.copy()
    gcps = _marked(view, places, 0.3)
    places[3, 0] += 0.5
    gcps = ControlPoints(gcps.names, gcps.image_px, places)
    answer = _engine(GeoreferenceConfig(orientation="stationary_gcps", gcp_sigma_px=0.3), gcps).frame(
        _frames(_pictures(60))[0])
    assert answer.placement is not None
    assert answer.placement.rejected == ("G3",)
    assert _errors_m(answer, view).max() < WITHIN_M


@pytest.mark.parametrize("pitch_deg", [60, 88])
def test_dynamic_gcps(pitch_deg: float) -> None:
    gcps = _marked(View(CAMERA, _pose(0, pitch_deg)), GCPS_M)
    engine = _engine(GeoreferenceConfig(orientation="dynamic_gcps"), gcps)
    for number, frame in enumerate(_frames(_pictures(pitch_deg))):
        answer = engine.frame(frame)
        assert _errors_m(answer, View(CAMERA, _pose(number, pitch_deg))).max() < WITHIN_M
        assert answer.placement is not None
        assert not answer.placement.warnings


def test_dynamic_gcps_tells_what_frames_share() -> None:
    """Marks are wrong by half a pixel in all frames alike; between frames, places move by the tracking alone."""
    gcps = _marked(View(CAMERA, _pose(0, 60)), GCPS_M, 0.5)
    engine, place_px = _engine(GeoreferenceConfig(orientation="dynamic_gcps"), gcps), np.array([[960.0, 700]])
    answers = [engine.frame(frame) for frame in _frames(_pictures(60))]
    columns, own, off, sigma = [], [], [], []
    for number, answer in enumerate(answers):
        assert answer.placement is not None
        assert answer.placement.error is not None
        J = jacobian(answer.placement.map_H_image, place_px)[0]
        columns.append(J @ answer.placement.error.shared)
        own.append(np.diag(J @ answer.placement.error.own @ J.T))
        sigma.append(np.sqrt(np.diag(J @ answer.placement.error.covariance @ J.T)))
        true_m = View(CAMERA, _pose(number, 60)).to_plane(place_px, 0.0)
        off.append((apply(answer.placement.map_H_image, place_px) - true_m)[0])
    between = np.sqrt(own[1:] + np.sum((np.array(columns[1:]) - columns[0]) ** 2, axis=2))
    assert (between < 0.3 * np.array(sigma[1:])).all()
    assert (np.abs(np.array(off[1:]) - off[0]) < 3 * between).all()


def test_a_hidden_control_point_is_left_out_and_said() -> None:
    gcps = _marked(View(CAMERA, _pose(0, 60)), GCPS_M)
    engine = _engine(GeoreferenceConfig(orientation="dynamic_gcps"), gcps)
    pictures = [picture.copy() for picture in _pictures(60)]
    x, y = np.rint(View(CAMERA, _pose(2, 60)).project(GCPS_M[2:3]))[0].astype(int)
    pictures[2][y - 30 : y + 31, x - 30 : x + 31] = np.random.default_rng(0).integers(0, 255, (61, 61))
    answers = [engine.frame(frame) for frame in _frames(pictures)]
    hidden = [answer.placement.rejected for answer in answers if answer.placement is not None]
    assert hidden == [(), (), ("G2",), (), ()]
    assert answers[2].placement is not None
    assert answers[2].placement.warnings == ("not seen: G2",)
    assert max(_errors_m(answer, View(CAMERA, _pose(number, 60))).max() for number, answer in enumerate(answers)) < (
        WITHIN_M)


def test_too_few_seen_points_are_a_reason() -> None:
    engine = _engine(GeoreferenceConfig(orientation="dynamic_gcps"), _marked(View(CAMERA, _pose(0, 60)), GCPS_M))
    blank = [_pictures(60)[0], np.full_like(_pictures(60)[0], 90), _pictures(60)[2]]
    answers = [engine.frame(frame) for frame in _frames(blank)]
    assert answers[1].answer == Unplaced("0 of 8 control points are seen, it must be 4")
    assert _errors_m(answers[2], View(CAMERA, _pose(2, 60))).max() < WITHIN_M  # it goes on


def test_dynamic_gcps_stabilization() -> None:
    gcps = _marked(View(CAMERA, _pose(0, 60)), GCPS_M, 0.1)
    engine = _engine(GeoreferenceConfig(orientation="dynamic_gcps_stabilization", gcp_sigma_px=0.1, gcp_sigma_m=0.0),
                     gcps)
    for number, answer in enumerate(_followed(engine, _pictures(60))):
        assert _errors_m(answer, View(CAMERA, _pose(number, 60))).max() < WITHIN_M
        assert answer.placement is not None
        assert answer.placement.pose is not None
        assert answer.placement.pose_covariance is not None
        off = answer.placement.pose.position_m - _pose(number, 60).position_m
        assert (np.abs(off) < 5 * np.sqrt(np.diag(answer.placement.pose_covariance)[:3]) + 1e-6).all()


def test_water_below_the_ground_is_seen_along_the_rays() -> None:
    """The homographies follow the ground; the water lies 1 m below it."""
    gcps = _marked(View(CAMERA, _pose(0, 60)), GCPS_M)
    config = GeoreferenceConfig(orientation="dynamic_gcps_stabilization", wse_m=-1.0, ground_above_wse_m=1.0)
    engine, first = _engine(config, gcps), View(CAMERA, _pose(0, 60)).image_H_map(0.0)
    for number, frame in enumerate(_frames(_pictures(60))):
        view = View(CAMERA, _pose(number, 60))
        H = first @ np.linalg.inv(view.image_H_map(0.0))
        answer = engine.frame(frame, Motion(H / H[2, 2], 1e-18 * np.eye(8)))
        assert answer.placement is not None
        pixels = np.array([[100.0, 900], [1800, 1000], [960, 500]])
        np.testing.assert_allclose(apply(answer.placement.map_H_image, pixels), view.to_plane(pixels, -1.0), atol=1e-6)


def test_the_water_level_adds_to_the_uncertainty_of_oblique_views() -> None:
    gcps = _marked(View(CAMERA, _pose(0, 60)), GCPS_M + [0, 0, 1.5] * (np.arange(8) % 2)[:, None])
    frame, sigmas = _frames(_pictures(60))[0], []
    for wse_sigma_m in (0.0, 0.1):
        answer = _engine(GeoreferenceConfig(wse_sigma_m=wse_sigma_m), gcps).frame(frame)
        assert answer.placement is not None
        sigmas.append(answer.placement.values["sigma_m"])
    along = math.sqrt(sigmas[1] ** 2 - sigmas[0] ** 2) / 0.1  # of the ray: horizontal way for each metre down
    x, y = np.meshgrid(np.linspace(0, 1919, 33), np.linspace(0, 1079, 33))
    view = View(CAMERA, _pose(0, 60))
    away_m = np.linalg.norm(view.to_plane(np.stack([x.ravel(), y.ravel()], axis=1), 0.0) - view.pose.position_m[:2],
                            axis=1)
    assert along == pytest.approx(np.median(away_m) / HEIGHT_M, rel=0.02)


BY_HEIGHT = GeoreferenceConfig(orientation="dynamic_stabilization", height_m=HEIGHT_M, height_sigma_m=0.0)


def test_a_height_tells_no_scale_without_calibration() -> None:
    with pytest.raises(InputError, match="needs a scale"):
        _engine(BY_HEIGHT, None, False)


@pytest.mark.parametrize(("config", "calibrated"), [
    (GeoreferenceConfig(orientation="dynamic_stabilization", gsd_m=HEIGHT_M / 1500), True),
    (GeoreferenceConfig(orientation="dynamic_stabilization", known_distance=f"100,100,1600,100,{HEIGHT_M}"), False),
    (BY_HEIGHT, True)])
def test_dynamic_stabilization(config: GeoreferenceConfig, calibrated: bool) -> None:
    for number, answer in enumerate(_followed(_engine(config, None, calibrated), _pictures(90))):
        assert _errors_m(answer, View(CAMERA, _pose(number, 90))).max() < WITHIN_M
        assert answer.placement is not None
        assert (answer.placement.pose is not None) is calibrated
