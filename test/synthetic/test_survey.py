"""Rendered surveys: pixels and places by other libraries, boards where the truth says, relief met by the rays."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from board_picks import picked

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply
from stab_ros.core.types import FloatArray
from stab_ros.synthetic.camera_path import Motion, Pose
from stab_ros.synthetic.reach import Board, ReachSettings
from stab_ros.synthetic.survey_flight import SurveyFlight
from stab_ros.synthetic.survey_scenes import EQUIDISTANT, NO_LENS, RATIONAL, MapPath, SurveyScene, survey

LENSES = {"none": NO_LENS, "rational": RATIONAL, "equidistant": EQUIDISTANT}


@cache
def flown(name: str, lens: str, size: tuple[int, int], frames: int = 2) -> SurveyFlight:
    scene = replace(survey(name), lens=LENSES[lens], noise_levels=0.5)
    return SurveyFlight(scene, size, frames, seed=1)


def seen_by_opencv(flight: SurveyFlight, index: int, points_m: FloatArray) -> FloatArray:
    view = flight.view(index)
    rotation, _ = cv2.Rodrigues(view.pose.cam_R_map)
    offset = -view.pose.cam_R_map @ view.pose.position_m
    if flight.camera.fisheye:
        pixels, _ = cv2.fisheye.projectPoints(points_m[:, None], rotation, offset, flight.camera.K, flight.camera.D)
    else:
        pixels, _ = cv2.projectPoints(points_m, rotation, offset, flight.camera.K, flight.camera.D)
    return np.asarray(pixels).reshape(-1, 2)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("name", ["nadir", "oblique"])
def test_every_pixel_lies_where_opencv_projects_its_ground(name: str, lens: str) -> None:
    flight = flown(name, lens, (240, 135))
    ground = flight.ground_m(1)
    rows, columns = np.nonzero(np.isfinite(ground).all(axis=2))
    expected = np.column_stack([columns, rows])
    assert len(rows) > 25_000
    np.testing.assert_allclose(seen_by_opencv(flight, 1, ground[rows, columns]), expected, atol=1e-4)


@pytest.mark.parametrize("name", ["nadir", "oblique"])
def test_ground_is_on_the_relief_and_water_on_its_plane(name: str) -> None:
    flight = flown(name, "rational", (480, 270))
    ground, wet = flight.ground_m(0), flight.water(0)
    np.testing.assert_allclose(ground[wet][:, 2], flight.wse_m, atol=1e-9)
    east, north, up = ground[np.isfinite(ground[..., 2]) & ~wet].T
    np.testing.assert_allclose(up, flight.reach.ground_height_m(east, north), atol=1e-5)
    assert up.min() > flight.wse_m - 1e-6
    assert np.ptp(up) > 1.0


def test_nothing_stands_between_the_camera_and_the_ground_it_shows() -> None:
    """Against dense steps along the rays, over trees and boulders."""
    flight = flown("oblique", "none", (480, 270))
    ground, position = flight.ground_m(0), flight.view(0).pose.position_m
    shown = ground[np.isfinite(ground).all(axis=2)]
    shown = shown[np.linalg.norm(shown - position, axis=1) < 300]
    for place in np.random.default_rng(0).choice(shown, 400, replace=False):
        steps = np.linspace(0, 1, 6000)[:-1, None]
        points = position + steps * (place - position)
        assert (points[:, 2] > flight.reach.ground_height_m(points[:, 0], points[:, 1]) - 2e-3).all()


@pytest.mark.parametrize(("name", "lens", "size"), [
    ("nadir", "equidistant", (1920, 1080)), ("strip", "none", (1360, 765))])
def test_boards_are_seen_where_the_truth_says(name: str, lens: str, size: tuple[int, int]) -> None:
    shot = flown(name, lens, size)[1]
    px = shot.board_px[np.isfinite(shot.board_px).all(axis=1)]
    inside = px[((px > 13) & (px < np.array(size) - 14)).all(axis=1)]
    assert len(inside) >= 6
    assert np.abs([picked(shot.image, at + 0.3) - at for at in inside]).max() < 0.035


def test_boards_are_projected_as_opencv_does_and_hidden_ones_are_said() -> None:
    flight = flown("nadir", "rational", (480, 270))
    px = flight.board_px(1)
    seen = np.isfinite(px).all(axis=1)
    assert seen.sum() >= 6
    np.testing.assert_allclose(px[seen], seen_by_opencv(flight, 1, flight.board_m[seen]), atol=1e-6)


def test_a_bank_hides_what_lies_behind_it() -> None:
    scene = replace(survey("oblique"), boards=(Board("near", 0.0, -16.0), Board("behind", 0.0, 60.0)), path=MapPath(
        (0.0, -22.0, 2.5), 90.0, 3.0))
    scene = replace(scene, reach=ReachSettings(bank_m=4.0, trees=0, boulders=0))
    flight = SurveyFlight(scene, (160, 90), 1)
    high = SurveyFlight(replace(scene, path=MapPath((0.0, -22.0, 40.0), 90.0, 30.0)), (160, 90), 1)
    assert np.isnan(flight.board_px(0)[1]).all()
    assert np.isfinite(high.board_px(0)[1]).all()


def test_boards_are_off_the_plane_of_the_water() -> None:
    for name in ("nadir", "oblique", "strip"):
        heights = flown(name, "none", (128, 72)).board_m[:, 2]
        assert heights.min() > 0.1
        assert np.ptp(heights) > 1.0


def test_the_horizon_is_in_view_and_shows_no_ground() -> None:
    flight = flown("oblique", "none", (480, 270))
    view, ground = flight.view(0), flight.ground_m(0)
    directions = np.concatenate([flight.rays, np.ones((*flight.rays.shape[:2], 1))], axis=2) @ view.pose.cam_R_map
    above = directions[..., 2] > 0.02
    assert above.sum() > 2000
    assert np.isnan(ground[above]).all()
    assert np.isfinite(ground[directions[..., 2] < -0.05]).all()


def flat(size: tuple[int, int], path: MapPath, focal_share: float = 0.67) -> SurveyFlight:
    scene = SurveyScene("flat", path, (), focal_share=focal_share, noise_levels=0.0,
                        reach=ReachSettings(dry=True))
    return SurveyFlight(scene, size, 2, seed=3)


def ortho(flight: SurveyFlight, index: int, east_m: FloatArray, north_m: FloatArray) -> FloatArray:
    """The image on the plane z = 0, by cv2.remap with a Lanczos kernel."""
    east, north = np.meshgrid(east_m, north_m)
    points = np.column_stack([east.ravel(), north.ravel(), np.zeros(east.size)])
    x, y = seen_by_opencv(flight, index, points).T.reshape(2, *east.shape).astype(np.float32)
    return np.asarray(cv2.remap(flight.image(index), x, y, cv2.INTER_LANCZOS4)).astype(float)


def misfit(expected: FloatArray, found: FloatArray) -> FloatArray:
    """By how many cells `found` lies to the right of and below `expected`, with contrast and brightness free."""
    blurred, other = (cv2.GaussianBlur(image, (0, 0), 4.0) for image in (expected, found))
    inner = np.s_[20:-20, 20:-20]
    gy, gx = (np.gradient(blurred, axis=axis)[inner].ravel() for axis in (0, 1))
    level = blurred[inner].ravel()
    design = np.stack([-gx, -gy, level, np.ones_like(level)], axis=1)
    return np.asarray(np.linalg.lstsq(design, other[inner].ravel(), rcond=None)[0][:2])


@pytest.mark.parametrize(("pitch", "distance"), [(90.0, 0.0), (45.0, 25.0), (20.0, 40.0)])
def test_orthophotos_of_rendered_frames_are_unbiased(pitch: float, distance: float) -> None:
    """Against a picture of the same ground from straight above with two and a half times the resolution or more."""
    height = max(distance * math.tan(math.radians(pitch)), 1.0) if pitch < 90 else 20.0
    fine = flat((800, 800), MapPath((0.0, 0.0, 20.0), 90.0, 90.0), 2.0)
    seen = flat((960, 540), MapPath((0.03, -distance, height), 90.0, pitch))
    cell_m = 0.02
    east, north = np.arange(-4, 4, cell_m), np.arange(4, -4, -cell_m)
    shift = misfit(ortho(fine, 0, east, north), ortho(seen, 0, east, north))
    gsd_m = seen.view(0).gsd_m(seen.view(0).project(np.zeros((1, 3))), 0.0)[0]
    assert np.abs(shift * cell_m / gsd_m).max() < 0.006


def test_a_homography_of_the_water_joins_frames() -> None:
    flight = flown("nadir", "none", (480, 270))
    places = np.array([[3.0, 2.0], [-10.0, -5.0], [0.0, 0.0]])
    first, second = (apply(flight.image_H_map(index), places) for index in (0, 1))
    np.testing.assert_allclose(apply(flight.ref_H_cur(1), second), first, atol=1e-8)
    np.testing.assert_allclose(second, seen_by_opencv(flight, 1, np.column_stack([places, np.full(3, flight.wse_m)])),
                               atol=1e-8)


def test_the_water_level_moves_the_shore_and_not_the_banks() -> None:
    low, high = (SurveyFlight(replace(survey("nadir"), wse_m=wse_m), (320, 180), 1) for wse_m in (-0.2, 0.3))
    np.testing.assert_array_equal(low.board_m, high.board_m)
    assert high.water(0).sum() > 1.02 * low.water(0).sum()


def test_the_strip_flies_the_reach_of_the_paper() -> None:
    flight = SurveyFlight(survey("strip"), (128, 72))
    start, end = flight.map_pose_at(0).position_m, flight.map_pose_at(flight.duration_s).position_m
    assert flight.duration_s == 125
    np.testing.assert_allclose(end - start, [180, 0, 0], atol=1.0)
    np.testing.assert_allclose([start[2], end[2]], 46, atol=0.6)


@pytest.mark.parametrize("name", ["strip", "level_strip"])
def test_control_points_of_the_strip_are_seen_at_its_ends_only_and_checkpoints_all_along(name: str) -> None:
    flight = SurveyFlight(survey(name), (1360, 765))
    for index in range(0, len(flight), 50):
        seen = np.isfinite(flight.board_px(index)).all(axis=1)
        assert (seen & ~flight.is_control).sum() >= 2
        controls = (seen & flight.is_control).sum()
        assert controls >= 4 if index in (0, 1250) else controls == 0 or index < 300 or index > 930


def test_the_same_arguments_give_the_same_frames_in_any_order() -> None:
    first, again = (SurveyFlight(survey("nadir"), (160, 90), 3, seed=4, color=True) for _ in range(2))
    later = again[2].image
    np.testing.assert_array_equal(first[0].image, again[0].image)
    np.testing.assert_array_equal(first[2].image, later)
    assert later.shape == (90, 160, 3)


def test_a_path_moves_as_it_says() -> None:
    path = MapPath((1.0, 2.0, 30.0), 90.0, 90.0, velocity_m_s=(2.0, 0.0, 0.0), motion=Motion(
        Pose(), 0.1, drift_per_s=Pose(y_m=0.5, height_m=0.25)))
    np.testing.assert_allclose(path.at(4.0, 1).position_m, [9.0, 0.0, 31.0], atol=1e-12)


def test_surveys_that_cannot_be_are_refused() -> None:
    with pytest.raises(InputError, match="must be one of nadir, oblique, strip, level_strip"):
        survey("lake")
    with pytest.raises(InputError, match="64x64"):
        SurveyFlight(survey("nadir"), (32, 32))
    with pytest.raises(InputError, match="bed of the river"):
        SurveyFlight(replace(survey("nadir"), boards=(Board("wet", 0.0, 0.0),)), (64, 64))
    with pytest.raises(InputError, match="names must differ"):
        SurveyFlight(replace(survey("nadir"), boards=(Board("a", 0.0, 16.0), Board("a", 5.0, 16.0))), (64, 64))
    with pytest.raises(IndexError):
        _ = SurveyFlight(survey("nadir"), (64, 64), 2)[2]
