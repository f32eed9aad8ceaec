"""The fit of a camera to control points, against exact truth, OpenCV and central differences."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from control_scene import SIZE, Scene, moved

from stab_ros.core.geometry import apply, jacobian
from stab_ros.georeferencing.camera_fit import CameraFit, fit_camera, fit_pose
from stab_ros.georeferencing.camera_problem import CameraProblem, KnownPosition, Unknowns
from stab_ros.georeferencing.plane_fit import fit_plane
from stab_ros.georeferencing.point_noise import PointNoise
from stab_ros.imaging.view import View

ALL = Unknowns(focals=2, k1=True)


def difference(fit: CameraFit, truth: View) -> float:
    """Largest distance, px, at which the fitted camera sees places of the truth."""
    x, y = np.meshgrid(np.linspace(100, 1800, 5), np.linspace(100, 1000, 4))
    places = truth.to_plane(np.column_stack([x.ravel(), y.ravel()]), 1.0)
    places = np.column_stack([places, np.full(len(places), 1.0)])
    return float(np.abs(fit.view.project(places) - truth.project(places)).max())


@pytest.mark.parametrize("unknowns", [Unknowns(), ALL, Unknowns(position=False), Unknowns(focals=0, k1=True)])
def test_derivatives_are_those_of_differences(unknowns: Unknowns) -> None:
    scene, rng = Scene(k1=-0.1), np.random.default_rng(0)
    problem = CameraProblem(scene.points(8, 0.0, rng), scene.view, unknowns)
    x, step = rng.normal(0, 0.02, problem.parameters), 1e-6
    ends = [(problem.predicted_px(x + d), problem.predicted_px(x - d)) for d in step * np.eye(len(x))]
    by_differences = np.stack([(more - less) / (2 * step) for more, less in ends], axis=2)
    assert np.allclose(problem.jacobian(x), by_differences, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("pitch_rad", [0.5, 1.0, 1.5])
@pytest.mark.parametrize("unknowns", [Unknowns(), Unknowns(focals=2), Unknowns(k1=True)])
def test_exact_points_give_the_exact_camera_from_nothing(unknowns: Unknowns, pitch_rad: float) -> None:
    scene = Scene(k1=-0.1 if unknowns.k1 else 0, pitch_rad=pitch_rad, relief_m=8)
    fit = fit_camera(scene.points(9, 0.0, np.random.default_rng(1)), SIZE, unknowns)
    assert fit.wrong == ()
    assert difference(fit, scene.view) < 1e-4
    assert fit.view.pose.position_m == pytest.approx(scene.view.pose.position_m, abs=1e-4)
    assert fit.rmse_px < 1e-6


def test_pose_of_a_known_camera_is_that_of_opencv() -> None:
    scene = Scene(k1=-0.1)
    points, camera = scene.points(7, 0.3, np.random.default_rng(2)), scene.view.camera
    fit = fit_pose(points, camera)
    _, turn, shift = cv2.solvePnP(points.map_m, points.image_px, camera.K, camera.D, flags=cv2.SOLVEPNP_SQPNP)
    turn, shift = cv2.solvePnPRefineLM(points.map_m, points.image_px, camera.K, camera.D, turn, shift)
    R = cv2.Rodrigues(turn)[0]
    assert np.allclose(fit.view.pose.cam_R_map, R, atol=1e-5)
    assert np.allclose(fit.view.pose.position_m, -R.T @ shift.ravel(), atol=1e-3)


def test_sigmas_that_few_residuals_tell_cover_as_many_errors_as_known_ones() -> None:
    """Drawn from the linear model of a fit. Without Student's quantile 3 sigma would hold 96 % of errors."""
    rng, scene = np.random.default_rng(5), Scene()
    solution = fit_pose(scene.points(5, 0.3, rng), scene.view.camera, near=scene.view).solution
    noise = rng.standard_normal((20000, len(solution.design)))
    off = noise @ np.linalg.pinv(solution.design).T
    rss = np.sum((noise - off @ solution.design.T) ** 2, axis=1)
    sigma = np.sqrt(rss[:, None] / solution.rss * np.diag(solution.covariance))
    assert solution.redundancy == 4
    assert np.mean(np.abs(off) < 3 * sigma) == pytest.approx(0.9973, abs=0.0007)


def test_a_known_position_is_kept_or_weighted() -> None:
    scene = Scene()
    points, truth = scene.points(8, 0.3, np.random.default_rng(3)), scene.view.pose.position_m
    fixed = fit_camera(points, SIZE, known=KnownPosition(truth))
    assert fixed.view.pose.position_m == pytest.approx(truth, abs=1e-12)
    assert np.all(fixed.pose_covariance[:3] == 0)
    free, weighted = fit_camera(points, SIZE), fit_camera(points, SIZE, known=KnownPosition(truth, 0.02))
    assert weighted.sigmas["up_m"] < min(0.0201, free.sigmas["up_m"])


@pytest.mark.parametrize("count", [7, 8, 12])
def test_one_point_that_was_moved_by_half_a_metre_is_named(count: int) -> None:
    scene = Scene(relief_m=6)
    points = scene.points(count, 0.3, np.random.default_rng(count))
    fit = fit_camera(moved(points, "G4", 0.4, -0.3), SIZE)
    assert fit.wrong == ("G4",)
    assert difference(fit, scene.view) < 2
    assert np.linalg.norm(fit.residuals_m[3]) == pytest.approx(0.5, abs=0.2)


def test_two_points_whose_names_were_swapped_are_named() -> None:
    points = Scene().points(12, 0.3, np.random.default_rng(4))
    order = [0, 2, 1, *range(3, 12)]
    swapped = type(points)(points.names, points.image_px, points.map_m[order])
    assert set(fit_pose(swapped, Scene().view.camera).wrong) == {"G2", "G3"}


@pytest.mark.thorough
def test_homography_of_the_fit_is_that_of_the_view_and_its_covariance_that_of_new_draws() -> None:
    scene = Scene(relief_m=6)
    exact = scene.points(10, 0.0, np.random.default_rng(5))
    noise = PointNoise(0.3)
    fit = fit_camera(exact, SIZE, noise=noise)
    H, covariance = fit.map_H_image(1.0)
    px = np.array([[300.0, 900], [1500, 700]])
    assert np.allclose(apply(H, px), scene.view.to_plane(px, 1.0), atol=1e-4)
    rng, drawn = np.random.default_rng(6), []
    for _ in range(60):
        noisy = type(exact)(exact.names, exact.image_px + rng.normal(0, 0.3, (10, 2)), exact.map_m)
        drawn.append(apply(fit_camera(noisy, SIZE, noise=noise, near=fit.view).map_H_image(1.0)[0], px).ravel())
    J = jacobian(H, px).reshape(4, 8)
    predicted = np.sqrt(np.diag(J @ covariance @ J.T))
    assert np.std(drawn, axis=0) / predicted == pytest.approx(1, abs=0.35)


def test_plane_of_four_points_is_exact_and_of_more_names_the_wrong_one() -> None:
    scene = Scene(relief_m=0)
    points = scene.points(8, 0.2, np.random.default_rng(7))
    fit = fit_plane(moved(points, "G3", 0.3, 0.4), 0.0)
    assert fit.wrong == ("G3",)
    px = np.array([[960.0, 540]])
    assert np.allclose(apply(fit.map_H_image, px), scene.view.to_plane(px, 0.0), atol=0.02)
    four = scene.points(8, 0.0, np.random.default_rng(9)).where(np.arange(8) < 4)
    assert np.allclose(apply(fit_plane(four).map_H_image, px), scene.view.to_plane(px, 0.0), atol=1e-6)
