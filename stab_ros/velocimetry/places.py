"""From pixels of a frame as taken to places on the water plane, and back: lens and homography in one step."""

from __future__ import annotations

import numpy as np

from stab_ros.core.geometry import apply, jacobian, point_jacobian
from stab_ros.core.types import BoolArray, FloatArray
from stab_ros.velocimetry.placed_frame import PlacedFrame


def undistorted(frame: PlacedFrame, pixels: FloatArray) -> FloatArray:
    """Undistorted pixels (N, 2) of pixels (N, 2) as taken; NaN where the lens shows nothing."""
    camera = frame.camera
    if camera is None or not camera.distorts:
        return pixels
    return np.asarray(camera.rays(pixels) @ camera.K[:2, :2].T + camera.K[:2, 2])


def places_of(frame: PlacedFrame, pixels: FloatArray) -> FloatArray:
    """Places (N, 2) on the plane of pixels (N, 2) as taken; NaN where they do not show the plane."""
    flat = undistorted(frame, pixels)
    return np.asarray(np.where(_in_front(frame, flat)[:, None], apply(frame.plane_H_image, flat), np.nan))


def pixels_of(frame: PlacedFrame, places: FloatArray) -> FloatArray:
    """Pixels (N, 2) as taken of places (N, 2) on the plane; NaN where the frame cannot show them."""
    flat = apply(np.linalg.inv(frame.plane_H_image), places)
    flat = np.where(_in_front(frame, flat)[:, None], flat, np.nan)
    camera = frame.camera
    if camera is None or not camera.distorts:
        return flat
    rays = (flat - camera.K[:2, 2]) @ np.linalg.inv(camera.K[:2, :2]).T
    return camera.pixels(rays)


def place_derivatives(frame: PlacedFrame, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives of places by pixels as taken, (N, 2, 2), and by h00 .. h21 of `plane_H_image`, (N, 2, 8).

    pixels: (N, 2), as taken.
    """
    flat = undistorted(frame, pixels)
    by_flat = point_jacobian(frame.plane_H_image, flat)
    return by_flat @ _lens_derivative(frame, pixels), jacobian(frame.plane_H_image, flat)


def _lens_derivative(frame: PlacedFrame, pixels: FloatArray) -> FloatArray:
    """Derivative (N, 2, 2) of undistorted pixels by pixels as taken, by central differences."""
    if frame.camera is None or not frame.camera.distorts:
        return np.tile(np.eye(2), (len(pixels), 1, 1))
    steps = 0.5 * np.eye(2)
    return np.stack([undistorted(frame, pixels + step) - undistorted(frame, pixels - step) for step in steps], axis=2)


def _in_front(frame: PlacedFrame, flat: FloatArray) -> BoolArray:
    """(N,) bool: which undistorted pixels (N, 2) lie on the side of the horizon where the plane is.

    Where the horizon crosses the image, the orientation tells (`georeferencing.horizon`).
    """
    H = frame.plane_H_image
    height, width = frame.gray.shape
    corners = np.array([[0, 0], [width, 0], [0, height], [width, height]]) @ H[2, :2] + H[2, 2]
    above = np.sign(corners[0]) if np.ptp(np.sign(corners)) == 0 else -np.sign(np.linalg.det(H))
    return np.asarray((flat @ H[2, :2] + H[2, 2]) * above > 0)
