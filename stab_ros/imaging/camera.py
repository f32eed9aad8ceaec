"""The camera model of sensor_msgs/CameraInfo, and the removal of lens distortion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from stab_ros.core.downscale import Downscaling
from stab_ros.core.errors import InputError
from stab_ros.core.text import counted
from stab_ros.core.types import BoolArray, FloatArray, Homography, Image
from stab_ros.imaging.lens import Lens, make_lens
from stab_ros.imaging.lens_maps import MOST_PX, QuickTables, RemapTables, lens_maps, quick_lens_maps
from stab_ros.imaging.lens_points import seen_rays, undistorted_rays
from stab_ros.imaging.resampling import NODE_PX, Nodes

# valid numbers of distortion coefficients of each model (sensor_msgs/distortion_models.hpp)
COEFFICIENTS = {"plumb_bob": (0, 4, 5), "rational_polynomial": (8, 12, 14), "equidistant": (4,)}
_MARGIN_PX = 16  # margin of features to pixels without image content, beyond their own size


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera, as sensor_msgs/CameraInfo describes it.

    Attributes:
        K: (3, 3) float64, the intrinsic matrix, px.
        D: (n,) float64, the distortion coefficients of `model`; all zero or empty: no distortion.
        model: plumb_bob, rational_polynomial or equidistant (Kannala & Brandt), as in sensor_msgs/distortion_models.
        size: width and height of the image, px.

    Raises:
        InputError: K or D is not finite, a focal length is not positive, or D does not fit the model.
    """

    K: FloatArray
    D: FloatArray
    model: str
    size: tuple[int, int]

    def __post_init__(self) -> None:
        if self.K.shape != (3, 3) or not (np.isfinite(self.K).all() and np.isfinite(self.D).all()):
            raise InputError("camera_info: K must be 3x3 and K and D finite")
        if self.K[0, 0] <= 0 or self.K[1, 1] <= 0 or tuple(self.K[2]) != (0.0, 0.0, 1.0):
            raise InputError("camera_info: K is not calibrated, it must have positive focal lengths "
                             "and a last row 0 0 1")
        fits = len(self.D) in (0, *COEFFICIENTS.get(self.model, ()))
        if not fits and (np.any(self.D) or self.model == "equidistant"):  # drivers send zeros of any number
            known = "; ".join(f"{model} of {', '.join(map(str, numbers))}" for model, numbers in COEFFICIENTS.items())
            raise InputError(f"camera_info: {counted(len(self.D), 'coefficient does', 'coefficients do')} not fit "
                             f"distortion_model {self.model!r}, it must be {known}")

    @property
    def fisheye(self) -> bool:
        """Whether the lens follows the equidistant model."""
        return self.model == "equidistant" and len(self.D) > 0

    @property
    def distorts(self) -> bool:
        """Whether the image differs from that of a pinhole camera; a fisheye does even without coefficients."""
        return self.fisheye or bool(np.any(self.D))

    def undistort(self, image: Image) -> Image:
        """Removes the lens distortion.

        Args:
            image: (h, w) or (h, w, channels), as taken.

        Returns:
            The image of a pinhole camera with the same K and size; 0 where the lens shows nothing.
        """
        return _resampled(image, self._undistorting, cv2.INTER_LINEAR) if self.distorts else image

    def rectify(self, image: Image, ref_H_cur: Homography, size: tuple[int, int], interpolation: int) -> Image:
        """Removes the lens distortion and applies a homography, with one interpolation for both.

        Args:
            image: (h, w) or (h, w, channels), as taken.
            ref_H_cur: (3, 3), maps undistorted pixels of the frame to those of the result.
            size: width and height of the result, px.
            interpolation: a flag of OpenCV, as `cv2.INTER_LINEAR`.

        Returns:
            The image in the place of the reference, 0 beyond the border; channels and dtype of `image`.
        """
        return _resampled(image, self.maps(ref_H_cur, size), interpolation)

    def rectify_at(self, image: Image, ref_H_cur: Homography, size: tuple[int, int], places: RemapTables,
                   interpolation: int) -> Image:
        """As `rectify`, of any places of that result in place of all its pixels.

        Args:
            image: (h, w) or (h, w, channels), as taken.
            ref_H_cur: as for `rectify`.
            size: as for `rectify`.
            places: x and y, (rows, columns) float32, px of the result of `rectify`.
            interpolation: as for `rectify`.

        Returns:
            (rows, columns) or (rows, columns, channels).
        """
        x_px, y_px = (_resampled(map_px, places, cv2.INTER_LINEAR) for map_px in self.maps(ref_H_cur, size))
        return _resampled(image, (x_px, y_px), interpolation)

    def downscaled(self, downscaling: Downscaling) -> Camera:
        """Scales the intrinsics to a downscaled image.

        Args:
            downscaling: how the image is downscaled.

        Returns:
            The camera that would take the downscaled image.
        """
        width, height = (n >> downscaling.level for n in self.size)
        return Camera(downscaling.scale @ self.K, self.D, self.model, (width, height))

    def pixels(self, rays: FloatArray) -> FloatArray:
        """Where rays are seen.

        Args:
            rays: (N, 2), x / z and y / z in the camera's axes.

        Returns:
            (N, 2), px of the image as taken; NaN beyond what the lens model covers.
        """
        if not self.distorts:
            return np.asarray(rays @ self.K[:2, :2].T + self.K[:2, 2])
        covered = np.sum(rays**2, axis=1) < self._lens.reach2
        seen = seen_rays(np.where(covered[:, None], rays, 0), self.D, self.fisheye)
        return np.asarray(np.where(covered[:, None], seen @ self.K[:2, :2].T + self.K[:2, 2], np.nan))

    def rays(self, pixels: FloatArray) -> FloatArray:
        """The rays that are seen at pixels: the inverse of `pixels`.

        Args:
            pixels: (N, 2), px of the image as taken.

        Returns:
            (N, 2), x / z and y / z in the camera's axes; NaN where the lens shows nothing.
        """
        seen = (pixels - self.K[:2, 2]) @ np.linalg.inv(self.K[:2, :2]).T
        return undistorted_rays(seen, self.D, self.fisheye, self._lens) if self.distorts else seen

    @cached_property
    def visible(self) -> BoolArray:
        """(h, w) bool: where the undistorted image shows something, with a margin to its border."""
        shown = self.undistort(np.full((self.size[1], self.size[0]), 255, np.uint8)) == 255
        if shown.all():
            return np.asarray(shown)
        kernel = np.ones((2 * _MARGIN_PX + 1, 2 * _MARGIN_PX + 1), np.uint8)
        return np.asarray(cv2.erode(shown.astype(np.uint8), kernel, borderValue=1) > 0)

    @cached_property
    def _undistorting(self) -> RemapTables:
        return self.maps(np.eye(3), self.size)

    @cached_property
    def _lens(self) -> Lens:
        return make_lens(self.K, self.D, self.fisheye, self.size)

    def maps(self, ref_H_cur: Homography, size: tuple[int, int]) -> RemapTables:
        """Positions in the distorted image of the pixels of the result of `rectify`.

        Args:
            ref_H_cur: as for `rectify`; scaled so that its inverse gives the depth, positive in front of the camera.
            size: as for `rectify`.

        Returns:
            x and y, (h, w) float32, for cv2.remap; far outside the image where the lens shows nothing.
        """
        # OpenCV's maps are faster, but do not check the range in which the lens model is valid.
        ray_M_pixel = np.linalg.inv(ref_H_cur @ self.K)
        if self.fisheye or not self._lens.holds(ray_M_pixel, size):
            return lens_maps(self._lens, ray_M_pixel, size)
        rotation = np.linalg.inv(self.K) @ ref_H_cur @ self.K
        x, y = cv2.initUndistortRectifyMap(self.K, self.D, rotation, self.K, size, cv2.CV_32FC1)
        return np.asarray(x), np.asarray(y)

    def nodes(self, ref_H_cur: Homography, size: tuple[int, int], row_step: int = 1) -> Nodes:
        """`maps` at every 32nd pixel of each row, for `resample_at`.

        Args:
            ref_H_cur: as for `maps`.
            size: as for `maps`.
            row_step: rows from one of nodes to the next; above 1 to look at them, as `Nodes.gentle` does.

        Returns:
            The nodes.
        """
        ray_M_node = np.linalg.inv(ref_H_cur @ self.K) @ np.diag([NODE_PX, row_step, 1])
        return Nodes(*lens_maps(self._lens, ray_M_node, (Nodes.columns(size[0]), -(-size[1] // row_step))))

    def quick_maps(self, ref_H_cur: Homography, size: tuple[int, int]) -> RemapTables | QuickTables:
        """As `maps`, in a fraction of the time and within 0.02 px along each axis; not for the nearest neighbour.

        Args:
            ref_H_cur: as for `maps`.
            size: as for `maps`.

        Returns:
            Two tables for cv2.remap; those of `maps` for pictures of more than 32000 px a side.
        """
        if max(self.size) > MOST_PX:
            return self.maps(ref_H_cur, size)
        return quick_lens_maps(self._lens, np.linalg.inv(ref_H_cur @ self.K), size)


def _resampled(image: Image, maps: RemapTables, interpolation: int) -> Image:
    return np.asarray(cv2.remap(image, maps[0], maps[1], interpolation, borderMode=cv2.BORDER_CONSTANT))
