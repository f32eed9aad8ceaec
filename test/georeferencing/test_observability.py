"""What control points do not tell is refused or warned of, not returned as a number."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from control_scene import SIZE, Scene, moved

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.camera_fit import fit_camera, fit_pose
from stab_ros.georeferencing.camera_problem import KnownPosition, Unknowns
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.levels import on_own_level
from stab_ros.georeferencing.plane_fit import fit_plane
from stab_ros.georeferencing.point_noise import PointNoise

NADIR = Scene(pitch_rad=math.pi / 2, relief_m=0)


def at(scene: Scene, px: FloatArray, heights: FloatArray, noise_px: float = 0.3) -> ControlPoints:
    """Control points at these pixels and heights."""
    map_m = np.column_stack([on_own_level(scene.view, px, np.column_stack([px, heights])), heights])
    noise = np.random.default_rng(0).normal(0, noise_px, px.shape)
    return ControlPoints(tuple(f"G{i + 1}" for i in range(len(px))), px + noise, map_m)


@pytest.mark.parametrize(("noise_px", "off_nadir_rad"), [(0.0, 0.0), (0.3, 0.0), (0.3, 0.03), (1.0, 0.03)])
def test_focal_length_and_height_above_one_plane_at_nadir_are_refused(noise_px: float, off_nadir_rad: float) -> None:
    scene = replace(NADIR, pitch_rad=math.pi / 2 - off_nadir_rad)
    with pytest.raises(InputError, match="do not tell the focal length from the distance"):
        fit_camera(scene.points(8, noise_px, np.random.default_rng(0)), SIZE)


def test_they_are_told_by_a_known_position_or_a_known_camera() -> None:
    points = NADIR.points(8, 0.3, np.random.default_rng(1))
    position = NADIR.view.pose.position_m
    fit = fit_camera(points, SIZE, known=KnownPosition(position))
    assert fit.view.camera.K[0, 0] == pytest.approx(NADIR.view.camera.K[0, 0], rel=0.01)
    assert fit_pose(points, NADIR.view.camera).view.pose.position_m == pytest.approx(position, abs=0.1)


def test_an_oblique_plane_tells_the_focal_length() -> None:
    scene = replace(NADIR, pitch_rad=0.7)
    fit = fit_camera(scene.points(9, 0.3, np.random.default_rng(2)), SIZE)
    assert fit.view.camera.K[0, 0] == pytest.approx(scene.view.camera.K[0, 0], rel=0.03)


@pytest.mark.parametrize("known", [False, True])
def test_points_on_a_line_are_refused(known: bool) -> None:
    scene = Scene(relief_m=0)
    px = np.column_stack([np.linspace(200, 1700, 8), np.linspace(300, 900, 8)])
    points = at(scene, px, np.zeros(8))
    with pytest.raises(InputError, match="on a line"):
        fit_pose(points, scene.view.camera) if known else fit_camera(points, SIZE)


def test_three_points_that_fit_several_cameras_are_refused_and_a_view_nearby_chooses() -> None:
    scene = replace(NADIR, pitch_rad=1.4)
    px = np.array([[400.0, 300], [1500, 350], [900, 900]])
    points = at(scene, px, np.zeros(3), 0)
    with pytest.raises(InputError, match="mirror solutions"):
        fit_pose(points, scene.view.camera)
    fit = fit_pose(points, scene.view.camera, near=scene.view)
    assert fit.view.pose.position_m == pytest.approx(scene.view.pose.position_m, abs=1e-4)
    assert any("nothing checks the fit" in line for line in fit.warnings)


@pytest.mark.parametrize(("count", "unknowns"), [(2, Unknowns(focals=0)), (5, Unknowns())])
def test_too_few_points_are_refused_in_one_line(count: int, unknowns: Unknowns) -> None:
    points = Scene().points(count, 0.3, np.random.default_rng(3))
    with pytest.raises(InputError, match=f"{count} control points, there must be at least"):
        fit_camera(points, SIZE, unknowns)


def test_points_in_a_corner_are_warned_of() -> None:
    scene = Scene(relief_m=3)
    rng = np.random.default_rng(4)
    points = at(scene, rng.uniform([1500, 700], [1900, 1060], (8, 2)), rng.uniform(0, 3, 8))
    fit = fit_pose(points, scene.view.camera)
    assert any("one part of the picture" in line for line in fit.warnings)
    spread = fit_pose(scene.points(8, 0.3, rng), scene.view.camera)
    assert spread.warnings == ()


def test_a_point_that_nothing_checks_is_named() -> None:
    px = np.array([[200.0, 200], [1700, 200], [200, 900], [1700, 900], [960, 300], [960, 800], [500, 500]])
    heights = np.array([0, 0, 0, 0, 0, 0, 9.0])
    fit = fit_camera(at(NADIR, px, heights), SIZE)
    assert any("an error of G7 would not show" in line for line in fit.warnings)


def test_k1_that_the_points_do_not_tell_is_refused() -> None:
    scene = Scene(relief_m=6)
    rng = np.random.default_rng(5)
    points = at(scene, rng.uniform([860, 440], [1060, 640], (10, 2)), rng.uniform(0, 6, 10))
    with pytest.raises(InputError, match="do not tell"):
        fit_camera(points, SIZE, Unknowns(focals=0, k1=True), camera=scene.view.camera)


def test_residuals_of_few_points_that_hide_a_wrong_one_are_warned_of() -> None:
    scene = Scene()
    points = moved(scene.points(5, 0.3, np.random.default_rng(6)), "G2", 0.4, 0.3)
    fit = fit_pose(points, scene.view.camera)
    assert fit.wrong == ("G2",) or any("too few points" in line for line in fit.warnings)


def test_noise_that_the_residuals_contradict_is_said() -> None:
    scene = Scene()
    fit = fit_pose(scene.points(9, 3.0, np.random.default_rng(7)), scene.view.camera, noise=PointNoise(0.3))
    assert any("contradict the noise that was given" in line for line in fit.warnings)


def test_places_of_a_projected_system_and_any_scale_are_fitted_as_well_as_small_ones() -> None:
    scene = Scene(relief_m=6)
    points = scene.points(9, 0.3, np.random.default_rng(8))
    near, offset = fit_camera(points, SIZE), np.array([2.6e6, 8.1e6, 1500.0])
    far = fit_camera(ControlPoints(points.names, points.image_px, points.map_m + offset), SIZE)
    assert far.rmse_px == pytest.approx(near.rmse_px, rel=1e-3)
    assert far.view.pose.position_m - offset == pytest.approx(near.view.pose.position_m, abs=1e-3)
    small = fit_camera(ControlPoints(points.names, points.image_px, points.map_m / 1000), SIZE)
    assert small.view.pose.position_m * 1000 == pytest.approx(near.view.pose.position_m, abs=1e-3)


def test_points_that_do_not_belong_to_the_picture_are_refused() -> None:
    rng = np.random.default_rng(9)
    points = Scene(relief_m=6).points(9, 0.3, rng)
    scattered = ControlPoints(points.names, rng.uniform(0, 1000, (9, 2)), points.map_m)
    one = ControlPoints(points.names, np.repeat(points.image_px[:1], 9, 0), np.repeat(points.map_m[:1], 9, 0))
    for wrong in (scattered, one):
        for fit in (lambda p: fit_camera(p, SIZE), lambda p: fit_pose(p, Scene().view.camera), fit_plane):
            with pytest.raises(InputError):
                fit(wrong)


def test_a_plane_seen_as_in_a_mirror_is_refused() -> None:
    points = Scene(relief_m=0).points(7, 0.3, np.random.default_rng(10))
    with pytest.raises(InputError, match="swapped"):
        fit_plane(ControlPoints(points.names, points.image_px, points.map_m[:, [1, 0, 2]]))


def test_points_off_the_plane_are_said() -> None:
    points = Scene(relief_m=0).points(7, 0.3, np.random.default_rng(11))
    assert any("off the plane" in line for line in fit_plane(points, -0.8).warnings)
    assert fit_plane(points, 0.0).warnings == ()
