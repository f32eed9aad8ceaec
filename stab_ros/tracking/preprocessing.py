"""From a frame as it comes to the gray image that is registered."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from stab_ros.core.errors import InputError
from stab_ros.core.gray import GreyRange, grey_range, to_gray
from stab_ros.core.region import Area
from stab_ros.core.types import BoolArray, Frame, Gray
from stab_ros.imaging.camera import Camera
from stab_ros.tracking.reference import Reference, is_textured


@dataclass(frozen=True, eq=False)
class Preprocessing:
    """Makes frames gray and, with a camera, removes their lens distortion."""

    camera: Camera | None = None

    def check_size(self, frame: Frame) -> None:
        """Raises InputError where the camera is for images of another size."""
        if self.camera is not None and self.camera.size != frame.size:
            raise InputError(f"camera_info is for {self.camera.size[0]}x{self.camera.size[1]} px, "
                             f"the images have {frame.size[0]}x{frame.size[1]}")

    def gray(self, frame: Frame, shown: GreyRange) -> Gray:
        """The frame as (h, w) uint8, undistorted. shown: see `gray.grey_range`."""
        gray = to_gray(frame, shown)
        return gray if self.camera is None else self.camera.undistort(gray)

    def reference(self, frame: Frame) -> Reference | None:
        """A copy of the frame as the reference; None where it has too little texture."""
        shown = grey_range(frame)
        gray = self.gray(frame, shown)
        if not is_textured(gray):
            return None
        own = dataclasses.replace(frame, image=frame.image.copy())  # the caller may use its buffer again
        return Reference(own, gray.copy(), shown)

    def allowed(self, area: Area, size: tuple[int, int]) -> BoolArray:
        """(h, w) bool: where `area` and the undistorted image leave room for features. size: width, height, px."""
        allowed = area.allowed(size)
        return allowed if self.camera is None else allowed & self.camera.visible
