"""Conversion of decoded images to the 8-bit gray images that the methods use."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import cv2
import numpy as np

from stab_ros.core.types import FloatArray, Frame, Gray, Image

_TO_GRAY = {
    "bgr8": cv2.COLOR_BGR2GRAY,
    "bgr16": cv2.COLOR_BGR2GRAY,
    "rgb8": cv2.COLOR_RGB2GRAY,
    "bgra8": cv2.COLOR_BGRA2GRAY,
    "rgba8": cv2.COLOR_RGBA2GRAY,
}
_WITHOUT_COLOUR = {"bgr16": "mono16"}  # mono8 for all others
_LOW, _HIGH = 0.1, 99.9  # percentiles of the values
_MOST_LOW, _MOST_HIGH = 2.0, 98.0  # of what most of them lie between
# what lies further off than so many times that span is not the scene (stuck pixels); its share of the range instead
_FAR, _MARGIN = 3.0, 0.5
_LEAST_VARIED = 0.2  # of the values: with fewer, constant areas count as well
_HIGH_LEVEL = 0.9 * 255.0  # the grey level of the high one: later frames may be brighter
_ROOM = 0.25  # of the range, below the low one: later frames may be darker
_FLAT = 20.0  # sigma of noise: a scene of a smaller range; noise alone has 8
_MOST_NOISE = 4.0  # grey levels in a flat scene: no texture to `is_textured`, and steps of one level are lost in it
_LEAST_NOISE = 0.5  # steps of whole values
_SEGMENT_PX = 64
_NOISE_PERCENTILE = 10.0  # of the segments of rows: the others hold texture


@dataclass(frozen=True)
class GreyRange:
    """The values of an image of more than 8 bits that its gray image shows; no meaning for 8 bits.

    Attributes:
        low: the value that becomes 0, as do all below it.
        gain: grey levels for each step of the value above it, up to 255.
    """

    low: float = 0.0
    gain: float = 1.0

    def to_8_bit(self, image: Image) -> Image:
        """Maps values to grey levels.

        Args:
            image: (h, w) or (h, w, channels), uint16 or float32; values that are not finite are no data.

        Returns:
            The same shape, uint8; 0 where there are no data.
        """
        if image.dtype == np.uint16:
            above = cv2.subtract(image, (self.low,) * 4) if self.low else image
            return np.asarray(cv2.convertScaleAbs(above, alpha=self.gain))
        levels = np.where(np.isfinite(image), (image - np.float32(self.low)) * np.float32(self.gain), 0)
        return np.asarray(np.rint(np.clip(levels, 0, 255)), np.uint8)


AS_IT_IS = GreyRange()


def grey_range(frame: Frame) -> GreyRange:
    """The range of values in a frame: measured, because a sensor of 16 bits rarely uses its full range.

    That of the reference is used for all later frames, so that brightness remains comparable: brighter ones saturate.
    Zeros and what is not finite are left out, as they often stand for no data, and so are bars, borders, overlays and
    stuck pixels, which may have any values. The noise of a scene without contrast stays small, so that it is not taken
    for texture.
    """
    if frame.image.dtype == np.uint8 or not frame.image.size:
        return AS_IT_IS
    known = _values_of_the_scene(frame)
    if not known.size:
        return AS_IT_IS
    first, last = _bounds(known)
    low = first - _ROOM * (last - first)
    if frame.image.dtype == np.uint16:
        low = float(np.floor(low))
    low = max(0.0, low) if first >= 0 else low
    return GreyRange(low, _gain(last - low, _noise(frame)))


def _values_of_the_scene(frame: Frame) -> Image:
    """(n,) values of pixels that have some and lie in no constant area; of all with a value where most is constant."""
    sample, left, right, above, below = _with_neighbours(frame, 4)
    constant = ((sample == left) & (sample == right)) | ((sample == above) & (sample == below))
    known = np.isfinite(sample) & (sample != 0)
    varied = known & ~constant
    return np.asarray(sample[varied if varied.sum() >= _LEAST_VARIED * known.sum() else known])


def _with_neighbours(frame: Frame, step: int) -> list[Image]:
    """(rows, columns) of every so many pixels, and of those to the left, to the right, above and below of them."""
    found = [_levels(frame, step, step, y, x) for y, x in ((1, 1), (1, 0), (1, 2), (0, 1), (2, 1))]
    rows, columns = min(len(one) for one in found), min(one.shape[1] for one in found)
    return [one[:rows, :columns] for one in found]


def _bounds(values: FloatArray | Image) -> tuple[float, float]:
    """The lowest and the highest value that the scene has, without those that lie far from most."""
    first, low, high, last = (float(one) for one in np.percentile(values, (_LOW, _MOST_LOW, _MOST_HIGH, _HIGH)))
    span = high - low
    if span == 0:
        return first, last
    return (low - _MARGIN * span if low - first > _FAR * span else first,
            high + _MARGIN * span if last - high > _FAR * span else last)


def _gain(span: float, noise: float) -> float:
    """Grey levels per step. span, noise: in steps."""
    by_span = _HIGH_LEVEL / span if span > 0 else 1.0
    return min(by_span, _MOST_NOISE / noise) if span < _FLAT * noise else by_span


def _noise(frame: Frame) -> float:
    """One sigma of the pixels' noise, in steps, where the image is smoothest; 0: unknown.

    From second differences along rows, as Immerkaer (1996) does it in two dimensions.
    """
    values = _levels(frame, 8, 1).astype(np.float64)
    levels = np.where(np.isfinite(values), values, np.nan)
    bent: FloatArray = (levels[:, :-2] - 2 * levels[:, 1:-1] + levels[:, 2:]) / np.sqrt(6)
    whole = bent.shape[1] // _SEGMENT_PX * _SEGMENT_PX
    sigma = np.sqrt(np.mean(bent[:, :whole].reshape(-1, _SEGMENT_PX) ** 2, axis=1))
    seen = sigma[np.isfinite(sigma) & (sigma > 0)]  # not constant, as bars are
    measured = float(np.percentile(seen, _NOISE_PERCENTILE)) if seen.size else 0.0
    return max(_LEAST_NOISE, measured) if frame.image.dtype == np.uint16 else measured


def _levels(frame: Frame, step_y: int, step_x: int, y: int = 0, x: int = 0) -> Image:
    """The gray values of every so many rows and columns from (y, x) on, (rows, columns) in the dtype of the frame."""
    image = np.ascontiguousarray(frame.image[y::step_y, x::step_x])
    if not image.size:
        return np.zeros(image.shape[:2], image.dtype)
    return np.asarray(cv2.cvtColor(image, _TO_GRAY[frame.encoding])) if frame.encoding in _TO_GRAY else image


def to_gray(frame: Frame, shown: GreyRange = AS_IT_IS) -> Gray:
    """The frame as gray (h, w) uint8; mono8 images are not copied. shown: from `grey_range`, for more than 8 bits."""
    gray = frame.image
    if frame.encoding in _TO_GRAY:
        gray = np.asarray(cv2.cvtColor(gray, _TO_GRAY[frame.encoding]))
    return gray if gray.dtype == np.uint8 else shown.to_8_bit(gray)


def without_colour(frame: Frame) -> Frame:
    """The frame as mono8 or mono16 if it has colour, which needs a third of the memory; otherwise the frame itself."""
    if frame.encoding not in _TO_GRAY:
        return frame
    gray = np.asarray(cv2.cvtColor(frame.image, _TO_GRAY[frame.encoding]))
    return dataclasses.replace(frame, image=gray, encoding=_WITHOUT_COLOUR.get(frame.encoding, "mono8"))
