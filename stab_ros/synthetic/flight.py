"""A synthetic drone flight over a river: images and the exact homography of each.

    for shot in Flight(preset("kolubara"), size=(1920, 1080), frames=40, seed=1):
        shot.image, shot.ref_H_cur

The same arguments give the same bytes, and a longer flight begins with the frames of a shorter one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply, normalized
from stab_ros.core.types import BoolArray, FloatArray, Gray, Homography, Image
from stab_ros.imaging import pose as map_poses
from stab_ros.imaging.view import View
from stab_ros.synthetic.camera_path import PinholeCamera, Pose, inverse, product
from stab_ros.synthetic.map_frame import camera_of, map_points, map_pose
from stab_ros.synthetic.render import Surface, add_tracers, colored, quantised, render_gray, water_mask
from stab_ros.synthetic.river import SCENES, SceneSettings, preset
from stab_ros.synthetic.terrain import Extent, GroundTexture, Layout, centre_line, make_ground, place_m
from stab_ros.synthetic.textures import natural_texture

__all__ = ["SCENES", "Flight", "SceneSettings", "Shot", "preset"]

FIRST_STAMP_NS = 1_000_000_000  # as for videos without stamps
_TEXEL_PX = math.sqrt(0.2)  # finer than the two samples per pixel and axis, in an irrational ratio to them
_MARGIN_TEXELS = 16
_RIPPLE_LIFE_S = 1.6
_TRACER_LEVEL = 110.0
_RIGID_CONTRAST = 2.5  # ripples as strong as gravel


@dataclass(frozen=True, eq=False)
class Shot:
    """One frame of a flight.

    Attributes:
        index: number of the frame, from 0.
        stamp_ns: time stamp.
        image: (h, w) or (h, w, 3) bgr uint8.
        ref_H_cur: exact homography to the pixels of frame 0.
        pose: of the camera.
        water: (h, w) bool, water in frame 0 (the same array in every shot).
    """

    index: int
    stamp_ns: int
    image: Image
    ref_H_cur: Homography
    pose: Pose
    water: BoolArray


class Flight:
    """A sequence of frames over the river of a scene, iterable and indexable.

    Args:
        preset: scene and camera path.
        size: width and height of the images, px; None for those of the scene.
        frames: number of frames.
        seed: of all random numbers.
        still: (h, w) uint8 image of the ground in place of the procedural one.
        color: whether the images are bgr instead of gray.
        start_ns: stamp of frame 0.

    Raises:
        InputError: a size below 64 px, no frames, or a still that is not (h, w) uint8.
    """

    def __init__(self, preset: SceneSettings, size: tuple[int, int] | None = None, frames: int = 60, seed: int = 1,
                 still: Gray | None = None, color: bool = False, start_ns: int = FIRST_STAMP_NS) -> None:
        self.preset, self.frames, self.seed, self.color, self.start_ns = preset, frames, seed, color, start_ns
        self.size = preset.size if size is None else size
        if min(self.size) < 64:
            raise InputError(f"a flight of {self.size[0]}x{self.size[1]} px, it must be at least 64x64")
        if frames < 1:
            raise InputError(f"a flight of {frames} frames, it must have at least 1")
        if still is not None and (still.ndim != 2 or still.dtype != np.uint8):
            raise InputError(f"a still of {still.shape} {still.dtype}, it must be (h, w) uint8")
        self.gsd_m = preset.ground_m[0] / self.size[0]
        self.camera = PinholeCamera(self.size, preset.focal_share * self.size[0])
        self.ground: GroundTexture = make_ground(preset, self._extent(), seed, still)
        self._waves = natural_texture([seed, 30], 0.9, 40.0, stretch=0.6)
        self._flow = self.ground.flow / np.float32(self.ground.extent.texel_m)
        self._tracers = self._scatter_tracers()

    def __len__(self) -> int:
        return self.frames

    def __iter__(self) -> Iterator[Shot]:
        return (self[index] for index in range(self.frames))

    def __getitem__(self, index: int) -> Shot:
        if not 0 <= index < self.frames:
            raise IndexError(f"frame {index} of a flight of {self.frames}")
        image, ref_H_cur = self._image(index), self.ref_H_cur(index)
        return Shot(index, self.stamp_ns(index), image, ref_H_cur, self.pose(index), self.water)

    def stamp_ns(self, index: int) -> int:
        """Time stamp of frame `index`."""
        return self.start_ns + round(index * 1e9 / self.preset.fps)

    def ref_H_cur(self, index: int) -> Homography:
        """Ground truth homography (3, 3) from pixels of frame `index` to pixels of frame 0."""
        if index == 0:
            return np.eye(3)
        return normalized(product(self.image_H_plane(0), inverse(self.image_H_plane(index))))

    def image_H_plane(self, index: int) -> Homography:
        """Homography (3, 3) from ground coordinates, m, to pixels of frame `index`."""
        return self.camera.image_H_plane(self.pose(index))

    def pose(self, index: int) -> Pose:
        """Pose of the camera in frame `index`."""
        return self._pose_at(index / self.preset.fps)

    def map_pose_at(self, time_s: float) -> map_poses.Pose:
        """Exact pose of the camera in the map (`map_frame`) at seconds since frame 0."""
        return map_pose(self._pose_at(time_s))

    def view(self, index: int) -> View:
        """Camera and exact pose of frame `index` in the map; ground and water are its plane z = 0."""
        return View(camera_of(self.camera), map_pose(self.pose(index)))

    @cached_property
    def water(self) -> BoolArray:
        """Mask (h, w) bool of the water in frame 0."""
        return np.asarray(water_mask(self.size, self._texel_H_image(0), self.ground.water))

    @cached_property
    def control_points_px(self) -> FloatArray:
        """Centres (n, 2) of the ground control points in frame 0, px."""
        return apply(self.image_H_plane(0), self._control_points_m)

    @property
    def control_points_map_m(self) -> FloatArray:
        """Centres (n, 3) of the ground control points in the map."""
        return map_points(self._control_points_m)

    @property
    def _control_points_m(self) -> FloatArray:
        return np.array([place_m(self.preset, p.place) for p in self.preset.control_points]).reshape(-1, 2)

    def _pose_at(self, time_s: float) -> Pose:
        return Pose(height_m=self.preset.height_m) + self.preset.motion.at(time_s, self.seed)

    def _extent(self) -> Extent:
        """The ground visible during the scene's duration, so that shorter flights have the same ground."""
        width, height = self.size
        corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1.0]])
        last_s = max(self.preset.duration_s, self.frames / self.preset.fps)
        seen = np.concatenate([
            apply(inverse(self.camera.image_H_plane(self._pose_at(t))), corners)
            for t in np.arange(0, last_s + 0.25, 0.25)
        ])
        texel_m = self.gsd_m * _TEXEL_PX
        low = (np.floor(seen.min(axis=0) / texel_m) - _MARGIN_TEXELS) * texel_m
        columns, rows = np.ceil((seen.max(axis=0) - low) / texel_m).astype(int) + _MARGIN_TEXELS
        return Extent(float(low[0]), float(low[1]), texel_m, (int(rows), int(columns)))

    def _texel_H_image(self, index: int) -> Homography:
        extent = self.ground.extent
        k = 1 / extent.texel_m
        texel_H_plane = np.array([[k, 0, -extent.x_m * k], [0, k, -extent.y_m * k], [0, 0, 1.0]])
        return product(texel_H_plane, inverse(self.image_H_plane(index)))

    def _image(self, index: int) -> Image:
        ground, texel_H_image = self.ground, self._texel_H_image(index)
        image = render_gray(self.size, texel_H_image, ground.brightness, ground.water, self._surface(index))
        add_tracers(image, self._tracers_in(index))
        if self.color:
            image = colored(image, texel_H_image, ground.tint)
        return self._exposed(index, image)

    def _exposed(self, index: int, image: Image) -> Image:
        """The image with varying brightness and contrast, noise, and rounding to grey levels."""
        time_s, share = index / self.preset.fps, self.preset.brightness
        gain = 1 + share * math.sin(2 * math.pi * 0.13 * time_s + self.seed)
        offset = 100 * share * math.sin(2 * math.pi * 0.31 * time_s + 2 * self.seed)
        noise = np.random.default_rng([self.seed, 50, index]).standard_normal(image.size, dtype=np.float32)
        noise *= np.float32(self.preset.noise_levels)
        levels = quantised(image.ravel(), noise, np.float32(gain), np.float32(offset))
        return np.asarray(levels).reshape(image.shape)

    def _surface(self, index: int) -> Surface:
        width, height = self.size
        glint = np.array([0.62 * width, 0.45 * height, 0.3 * width])
        contrast = _RIGID_CONTRAST if self.preset.stream.rigid else 1.0
        return Surface(self._flow, self._waves, self._ripple_lives(index), glint, contrast)

    def _ripple_lives(self, index: int) -> FloatArray:
        """Two overlapping generations of ripples (2, 4): age from mid-life, s, weight, texture offset x and y."""
        if self.preset.stream.rigid:
            return np.array([[index / self.preset.fps, 1.0, 0, 0], [0.0, 0, 0, 0]])
        lives = []
        for k in range(2):
            turn = index / self.preset.fps / _RIPPLE_LIFE_S + k / 2
            part = turn - math.floor(turn)
            offset = np.random.default_rng([self.seed, 40, k, math.floor(turn)]).uniform(0, 4096, 2)
            lives.append([(part - 0.5) * _RIPPLE_LIFE_S, math.sin(math.pi * part), *offset])
        return np.array(lives)

    def _scatter_tracers(self) -> FloatArray:
        """Tracer particles (n, 4): initial x, m, position across the stream in (-1, 1), radius, m, brightness."""
        extent, layout = self.ground.extent, Layout.of(self.preset)
        length = extent.shape[1] * extent.texel_m
        n = int(self.preset.tracers_per_m2 * length * 2 * layout.half_width_m)
        rng = np.random.default_rng([self.seed, 41])
        return np.stack([rng.uniform(0, length, n), rng.uniform(-0.93, 0.93, n),
                         rng.uniform(0.001, 0.003, n) * layout.unit_m, rng.uniform(0.4, 1.0, n)], axis=1)

    def _tracers_in(self, index: int) -> FloatArray:
        """Tracer particles (n, 4) in frame `index`: x, y and sigma, px, and brightness, which is 0 over land."""
        extent, layout = self.ground.extent, Layout.of(self.preset)
        start, across, radius, bright = self._tracers.T
        length = extent.shape[1] * extent.texel_m
        profile = np.ones_like(across) if layout.rigid else 1 - across**2
        travelled = layout.speed_m_s * profile * index / self.preset.fps
        x = extent.x_m + (start + travelled) % length
        y = np.array([centre_line(layout, at) for at in x]) + across * layout.half_width_m
        column = np.clip(np.round((x - extent.x_m) / extent.texel_m), 0, extent.shape[1] - 1).astype(int)
        row = np.clip(np.round((y - extent.y_m) / extent.texel_m), 0, extent.shape[0] - 1).astype(int)
        wet = self.ground.water[row, column] / 255.0
        places = apply(self.image_H_plane(index), np.stack([x, y], axis=1))
        sigma = np.maximum(radius / self.gsd_m / 2, 0.7)
        return np.column_stack([places, sigma, _TRACER_LEVEL * bright * wet])
