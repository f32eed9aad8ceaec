"""The scale of a nadir view: from the height above the water, a ground sampling distance, or a known distance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stab_ros.core.errors import ConfigError
from stab_ros.core.types import Homography
from stab_ros.georeferencing.settings import GeoreferenceConfig, numbers_of
from stab_ros.georeferencing.unit_checks import is_feet
from stab_ros.imaging.camera import Camera

_DISAGREE = 0.05  # relative difference of two scales that is warned of


@dataclass(frozen=True)
class Scale:
    """gsd_m: m per px. sigma: relative. what: where it is from, for messages."""

    gsd_m: float
    sigma: float
    what: str


def known_scales(config: GeoreferenceConfig, focal_px: float | None, above_plane_m: float = 0.0) -> list[Scale]:
    """The scales that the settings tell, the one to use first.

    Args:
        config: the settings.
        focal_px: the focal length; None: unknown, then the height tells nothing.
        above_plane_m: what the plane lies above the water.
    """
    found = []
    if config.known_distance:
        x1, y1, x2, y2, length_m = numbers_of("known_distance", config.known_distance, 5)
        length_px = math.hypot(x2 - x1, y2 - y1)
        if not (length_px > 0 and length_m > 0):
            raise ConfigError(f"known_distance: {config.known_distance[:80]!r} must name two different points and a "
                              "distance above 0")
        sigma = math.hypot(math.sqrt(2) * config.gcp_sigma_px / length_px, config.gcp_sigma_m / length_m)
        found.append(Scale(length_m / length_px, sigma, "known_distance"))
    if config.gsd_m:
        found.append(Scale(config.gsd_m, 0.0, "gsd_m"))
    if config.height_m and focal_px is not None:
        height_m = config.height_m - above_plane_m
        if not height_m > 0:
            raise ConfigError(f"height_m: the camera is {config.height_m:g} m above the water and so not above the "
                              f"ground, which is {above_plane_m:g} m above it")
        found.append(Scale(height_m / focal_px, config.height_sigma_m / height_m, "height_m"))
    return found


def contradiction(used: Scale, other: Scale) -> str:
    """Why two scales are not of one scene: one line; "" where they agree."""
    ratio = used.gsd_m / other.gsd_m
    if abs(math.log(ratio)) < max(_DISAGREE, 3 * math.hypot(used.sigma, other.sigma)):
        return ""
    said = (f"{used.what} tells {used.gsd_m:.4g} m per pixel, {other.what} {other.gsd_m:.4g} m per pixel, "
            f"{max(ratio, 1 / ratio):.3g} times as much or little")
    if is_feet(ratio):
        return f"{said}: one of them is in feet, it must be in metres"
    return f"{said}: one of them is wrong"


def nadir_H(camera: Camera, gsd_m: float, yaw_rad: float) -> Homography:
    """Homography (3, 3), h22 = 1, from undistorted pixels of a nadir view to east and north, m.

    Args:
        camera: that took it; the origin of the map lies at its principal point.
        gsd_m: m per px along x; along y it differs by the aspect of the pixels.
        yaw_rad: direction of the top of the image.
    """
    K, (c, s) = camera.K, (math.cos(yaw_rad), math.sin(yaw_rad))
    ray_H_image = np.linalg.inv(K)
    H = np.array([[s, -c, 0], [-c, -s, 0], [0, 0, 1 / (gsd_m * K[0, 0])]]) @ ray_H_image
    return np.asarray(H / H[2, 2])
