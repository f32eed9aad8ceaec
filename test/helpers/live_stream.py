"""A synthetic stabilised stream, as a tracker would publish it."""

from __future__ import annotations

from typing import Any

import numpy as np
from live_graph import Graph, image_message
from sensor_msgs.msg import CameraInfo, Image

from stab_ros.core.types import Gray


def still(ground: Gray, number: int, shift_px: int = 0) -> Gray:
    """An image of a perfect tracker: the same ground, independent noise, and a shift to the right if asked for."""
    height, width = ground.shape
    noise = np.random.default_rng(number).normal(0.0, 1.0, (height - 16, width - 16))
    return np.clip(ground[8:-8, 8 - shift_px : width - 8 - shift_px] + noise, 0, 255).astype(np.uint8)


class StabilizedStream:
    """Publishes frame after frame, 40 ms apart."""

    def __init__(self, graph: Graph, ground: Gray, homographies: bool = True) -> None:
        self.ground = ground
        self.number = 0
        self._images = graph.speak(Image, "/cam/image_stabilized")
        self._homographies = graph.speak(CameraInfo, "/cam/homography") if homographies else None

    def send(self, count: int = 1, shift_px: int = 0, lost: bool = False, shown: Gray | None = None) -> int:
        """The number of the last frame."""
        for _ in range(count):
            image = image_message(still(self.ground, self.number, shift_px) if shown is None else shown,
                                  10**9 + self.number * 40_000_000)
            if self._homographies is not None:
                self._homographies.publish(homography_message(image, lost))
            if not lost:
                self._images.publish(image)
            self.number += 1
        return self.number - 1


def homography_message(image: Any, lost: bool = False) -> CameraInfo:
    """The identity, or LOST."""
    one = np.zeros((3, 4)) if lost else np.eye(3, 4)
    return CameraInfo(header=image.header, k=one[:, :3].ravel(), r=one[:, :3].ravel(), p=one.ravel())


def name_of(number: int) -> str:
    return f"frame {number} ({1 + 0.04 * number:.3f} s)"
