"""The pictures in which velocities are measured: images as they come, or orthophotos (Perks 2020, section 2.2.4)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stab_ros.core.gray import GreyRange, grey_range, to_gray
from stab_ros.core.types import Frame, Gray, Homography, Image
from stab_ros.georeferencing.georeferencer import Georeferenced
from stab_ros.georeferencing.placement import Motion
from stab_ros.imaging.camera import Camera
from stab_ros.velocimetry.placing import Picture
from stab_ros.velocimetry.vectors import Unit

# the orthophoto of a frame; None: it is unplaced
Orthophoto = Callable[[Georeferenced], Image | None]


@dataclass(frozen=True, eq=False)
class Stream:
    """What is known of the frames of a stream.

    Attributes:
        unit: of the plane.
        reference_size: width and height of the reference, px; None: that of the frames.
        image_H_ref: (3, 3), for images that are stabilised already: from pixels of the reference to those of the image;
            None: images are as taken.
        camera: whose lens distortion the images have; None: they have none.
        orthophoto: None: velocities are measured in the images as they come.
        level_scales: whether the scale is that of a water surface elevation; not so where it is given for the picture.
    """

    unit: Unit = "m"
    reference_size: tuple[int, int] | None = None
    image_H_ref: Homography | None = None
    camera: Camera | None = None
    orthophoto: Orthophoto | None = None
    level_scales: bool = True


class Pictures:
    """Makes them; those of more than 8 bits in the range of the first one."""

    def __init__(self, stream: Stream) -> None:
        self._stream = stream
        self._range: GreyRange | None = None

    def of(self, answer: Georeferenced, motion: Motion | None) -> Picture:
        """The picture of a placed frame. motion: known, if images are stabilised."""
        frame, stream = answer.frame, self._stream
        cur_H_image: Homography = np.eye(3)
        if stream.image_H_ref is not None and motion is not None:
            cur_H_image = np.linalg.inv(stream.image_H_ref @ motion.ref_H_cur)
        ortho = None if stream.orthophoto is None else stream.orthophoto(answer)
        if ortho is None or answer.ortho_H_image is None:
            return Picture(self._gray(frame), cur_H_image, stream.camera)
        shown = Frame(ortho, frame.warped_encoding, frame.stamp_ns)
        return Picture(self._gray(shown), cur_H_image @ np.linalg.inv(answer.ortho_H_image))

    def _gray(self, frame: Frame) -> Gray:
        if self._range is None:
            self._range = grey_range(frame)
        return to_gray(frame, self._range)
