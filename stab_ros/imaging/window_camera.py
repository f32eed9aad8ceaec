"""The camera that would take what an output window shows."""

from __future__ import annotations

import numpy as np

from stab_ros.imaging.camera import Camera
from stab_ros.imaging.window import Window


def window_camera(camera: Camera, window: Window, corrected: bool) -> Camera:
    """The camera of the reference view, cut and scaled as the window is.

    Args:
        camera: that took the reference.
        window: the part of the reference that is shown, and its scale.
        corrected: whether the lens distortion has been removed, so that a pinhole camera remains.

    Returns:
        K maps rays to pixels of the output image, with its centre of the top left pixel at (0, 0).
    """
    D, model = (np.zeros(5), "plumb_bob") if corrected else (camera.D, camera.model)
    return Camera(window.window_H_cur(camera.K), D, model, window.size(camera.size))
