"""Makes docs/images/stabilised.jpg: the mean of the sample flight's frames, as recorded and stabilised.

python docs/make_picture.py
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from stab_ros.core.types import Frame, Image
from stab_ros.io.engine import make_stabilizer
from stab_ros.io.source import open_source

_HERE = Path(__file__).parent
_SAMPLE = _HERE.parent / "bags" / "sample.mcap"
_PICTURE = _HERE / "images" / "stabilised.jpg"
_CROP = np.s_[40:360, 240:720]  # bank and water
_GAP_PX = 8


def _mean(images: Sequence[Image]) -> Image:
    total = np.zeros(images[0].shape, np.float64)
    for image in images:
        total += image
    return np.asarray((total / len(images)).round(), np.uint8)


def _titled(image: Image, title: str) -> Image:
    crop = image[_CROP].copy()
    for colour, width in (((0, 0, 0), 5), ((255, 255, 255), 2)):
        cv2.putText(crop, title, (12, 28), cv2.FONT_HERSHEY_SIMPLEX, 0.7, colour, width, cv2.LINE_AA)
    return crop


def main() -> None:
    """Stabilises the sample and lays the two means side by side."""
    with open_source(_SAMPLE) as source:
        decoded = (item.decoded for item in source.frames())
        frames = [frame for frame in decoded if isinstance(frame, Frame)]
    stabilizer = make_stabilizer({})
    steady = [step.image for step in map(stabilizer.step, frames) if step.image is not None]
    before = _titled(_mean([frame.image for frame in frames]), f"mean of {len(frames)} frames as recorded")
    after = _titled(_mean(steady), f"mean of {len(steady)} frames stabilised")
    gap = np.full((before.shape[0], _GAP_PX, 3), 255, np.uint8)
    cv2.imwrite(str(_PICTURE), np.hstack([before, gap, after]), [cv2.IMWRITE_JPEG_QUALITY, 88])


if __name__ == "__main__":
    main()
