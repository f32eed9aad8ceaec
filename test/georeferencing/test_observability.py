"""What control points do not tell is refused or warned of, not returned as a number."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from control_scene import SIZE, Scene

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.camera_fit import fit_camera, fit_pose
from stab_ros.georeferencing.camera_problem import KnownPosition, Unknowns
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.levels import on_own_level

NADIR = Scene(pitch_rad=math.pi / 2, relief_m=0)


def at(scene: Scene, px: FloatArray, heights: FloatArray, noise_px: float = 0.3) -> ControlPoints:
    """Control points at these pixels and heights."""
    map_m = np.column_stack([on_own_level(scene.view, px, np.column_stack([px, heights])), heights])
    noise = np.random.default_rng(0).normal(0, noise_px, px.shape)
    return ControlPoints(tuple(f"G{i + 1}" for i in range(len(px))), px + noise, map_m)


@pytest.mark.parametrize("noise_px", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("off_nadir_rad", [0.0, 0.01, 0.03])
def test_focal_length_and_height_above_one_plane_at_nadir_are_refused(noise_px: float, off_nadir_rad: float) -> None:
    scene = replace(NADIR, pitch_rad=math.pi / 2 - off_nadir_rad)
    for seed in range(3):
        with pytest.raises(InputError, match="do not tell the focal length from the distance"):
            fit_camera(scene.points(8, noise_px, np.random.default_rng(seed)), SIZE)


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
