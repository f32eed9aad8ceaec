"""Pictures of a textured plane z = 0, exact to the interpolation of an oversampled texture."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from stab_ros.core.types import Gray, Homography
from stab_ros.imaging.view import View

_OVERSAMPLED = 2
_STEP_M, _SIDE_M = 0.025, 120.0


def _texture() -> Gray:
    n = round(_SIDE_M / _STEP_M)
    rng = np.random.default_rng(5)
    image = np.full((n, n), 128, np.float32)
    for step, weight in ((6, 28), (16, 28), (60, 20)):
        coarse = rng.standard_normal((n // step, n // step)).astype(np.float32)
        image += weight * cv2.resize(coarse, (n, n), interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.clip(image, 0, 255), np.uint8)


@dataclass(frozen=True, eq=False)
class GroundPictures:
    """Gravel, 120 m square about the origin of the map."""

    texture: Gray = field(default_factory=_texture)

    @property
    def map_H_texture(self) -> Homography:
        """(3, 3), from its pixels to east and north, m."""
        half = _SIDE_M / 2
        return np.array([[_STEP_M, 0, -half], [0, -_STEP_M, half], [0, 0, 1]])

    def seen_by(self, view: View) -> Gray:
        """The picture (h, w) that a camera takes; its lens distorts it."""
        width, height = view.camera.size
        wide = (width * _OVERSAMPLED, height * _OVERSAMPLED)
        s = 1 / _OVERSAMPLED
        pixel_H_wide = np.array([[s, 0, s / 2 - 0.5], [0, s, s / 2 - 0.5], [0, 0, 1]])
        texture_H_image = np.linalg.inv(self.map_H_texture) @ np.linalg.inv(view.image_H_map(0.0))
        if not view.camera.distorts:
            image = cv2.warpPerspective(self.texture, texture_H_image @ pixel_H_wide, wide,
                                        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
        else:
            image = self._through_lens(view, wide, pixel_H_wide, texture_H_image)
        return np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA))

    def _through_lens(self, view: View, wide: tuple[int, int], pixel_H_wide: Homography, H: Homography) -> Gray:
        """The lens is computed at every 16th pixel, and cubic between them."""
        x, y = (np.arange(0, n + 32, 16) - 16.0 for n in wide)
        grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) @ pixel_H_wide[:2, :2].T + pixel_H_wide[:2, 2]
        K = view.camera.K
        straight = (view.camera.rays(grid) @ K[:2, :2].T + K[:2, 2]).astype(np.float32).reshape(len(y), len(x), 2)
        at_x, at_y = np.meshgrid(*((np.arange(n, dtype=np.float32) + 16) / 16 for n in wide))
        pixels = cv2.remap(straight, at_x, at_y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        places = pixels @ H[:, :2].T + H[:, 2]
        maps = (places[..., :2] / places[..., 2:]).astype(np.float32)
        return np.asarray(cv2.remap(self.texture, maps, None, cv2.INTER_LINEAR))
