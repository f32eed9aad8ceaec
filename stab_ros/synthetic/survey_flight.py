"""A synthetic flight for a survey: images of a reach with relief, through a lens, with exact poses and places.

    flight = SurveyFlight(survey("oblique"), frames=20, seed=1)
    for shot in flight:
        shot.image, shot.view, shot.board_px     # pixels of the boards flight.board_names, at flight.board_m
    flight.ground_m(3)                           # where each pixel of frame 3 lies in the map
    measured(flight.map_pose_at, flight.duration_s, PPK, seed=1)

The same arguments give the same bytes on one machine. Frames are rendered when they are asked for.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import RectBivariateSpline

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import normalized
from stab_ros.core.types import BoolArray, Float32Array, FloatArray, Homography, Image
from stab_ros.imaging.pose import Pose
from stab_ros.imaging.view import View
from stab_ros.synthetic.reach import PERIOD_M, make_reach
from stab_ros.synthetic.reach_kernels import Land, Sight, Water, averaged, depths, draw_board, render_rows
from stab_ros.synthetic.render import quantised
from stab_ros.synthetic.survey_scenes import SurveyScene
from stab_ros.synthetic.textures import natural_texture

FIRST_STAMP_NS = 1_000_000_000  # as for videos without stamps
_CHUNK_ROWS = 64
_KNOT_PX, _FEWEST_KNOTS, _DEGREE = 16, 100, 5  # a spline through rays so far apart is within 1e-6 px of all of them
_RIPPLE_LIFE_S = 1.6
_SKY = np.array([[226, 196], [216, 158], [206, 120]], np.float32)  # bgr, at the horizon and at the zenith
_WATER = np.array([66, 76, 62], np.float32)  # bgr
_GREY = np.array([[0.114, 0.587, 0.299]], np.float32)
_HIDDEN_M = 0.05  # ground that is nearer than a board by more hides it


@dataclass(frozen=True, eq=False)
class SurveyShot:
    """One frame.

    Attributes:
        index: number of the frame, from 0.
        stamp_ns: time stamp.
        image: (h, w) or (h, w, 3) bgr uint8, with the lens's distortion.
        view: camera and exact pose in the map.
        ref_H_cur: exact homography of the water plane, from undistorted pixels to those of frame 0.
        board_px: (N, 2), exact pixels of the boards' centres as taken; NaN where hidden or outside the image.
    """

    index: int
    stamp_ns: int
    image: Image
    view: View
    ref_H_cur: Homography
    board_px: FloatArray


class SurveyFlight:
    """A sequence of frames over a reach, iterable and indexable.

    Args:
        scene: reach, boards, camera and path.
        size: width and height of the images, px; None for those of the scene.
        frames: number of frames; None for the whole flight.
        seed: of all random numbers.
        color: whether the images are bgr instead of grey.
        start_ns: stamp of frame 0.

    Raises:
        InputError: a size below 64 px, no frames, or boards where none can lie.
    """

    def __init__(self, scene: SurveyScene, size: tuple[int, int] | None = None, frames: int | None = None,
                 seed: int = 1, color: bool = False, start_ns: int = FIRST_STAMP_NS) -> None:
        self.scene, self.seed, self.color, self.start_ns = scene, seed, color, start_ns
        self.size = scene.size if size is None else size
        self.frames = round(scene.duration_s * scene.fps) + 1 if frames is None else frames
        if min(self.size) < 64:
            raise InputError(f"a flight of {self.size[0]}x{self.size[1]} px, it must be at least 64x64")
        if self.frames < 1:
            raise InputError(f"a flight of {self.frames} frames, it must have at least 1")
        self.camera = scene.camera(self.size)
        self.reach = make_reach(scene.reach, scene.boards, seed, color)
        self.board_names = tuple(board.name for board in scene.boards)
        self.board_m = self.reach.board_m
        self.is_control: BoolArray = np.array([board.control for board in scene.boards], bool)
        self._top_m = float(self.reach.tops_m.max())
        self._land = Land(self.reach.height_m, self.reach.tops_m, self.reach.cover,
                          averaged(natural_texture([seed, 80], 0.8, 64.0)))
        self._waves = averaged(natural_texture([seed, 81], 0.9, 40.0, stretch=0.6))
        colors = np.eye(3, dtype=np.float32) if color else _GREY
        self._sky, self._water_color = colors @ _SKY, colors @ _WATER

    def __len__(self) -> int:
        return self.frames

    def __iter__(self) -> Iterator[SurveyShot]:
        return (self[index] for index in range(self.frames))

    def __getitem__(self, index: int) -> SurveyShot:
        if not 0 <= index < self.frames:
            raise IndexError(f"frame {index} of a flight of {self.frames}")
        return SurveyShot(index, self.stamp_ns(index), self.image(index), self.view(index), self.ref_H_cur(index),
                          self.board_px(index))

    @property
    def wse_m(self) -> float:
        """Water surface elevation in the map."""
        return self.scene.wse_m

    @property
    def duration_s(self) -> float:
        """From frame 0 to the last frame."""
        return (self.frames - 1) / self.scene.fps

    def stamp_ns(self, index: int) -> int:
        """Time stamp of frame `index`."""
        return self.start_ns + round(index * 1e9 / self.scene.fps)

    def map_pose_at(self, time_s: float) -> Pose:
        """Exact pose of the camera in the map at seconds since frame 0."""
        return self.scene.path.at(time_s, self.seed)

    def view(self, index: int) -> View:
        """Camera and exact pose of frame `index` in the map."""
        return View(self.camera, self.map_pose_at(index / self.scene.fps))

    def image_H_map(self, index: int) -> Homography:
        """Exact homography (3, 3), h22 free, from east and north on the water, m, to undistorted pixels."""
        return self.view(index).image_H_map(self.wse_m)

    def ref_H_cur(self, index: int) -> Homography:
        """Exact homography (3, 3) of the water plane from undistorted pixels of frame `index` to those of frame 0."""
        return normalized(self.image_H_map(0) @ np.linalg.inv(self.image_H_map(index)))

    def board_px(self, index: int) -> FloatArray:
        """Exact pixels (N, 2) of the boards' centres as taken; NaN where hidden or outside the image."""
        view = self.view(index)
        pixels = view.project(self.board_m)
        inside = np.asarray(((pixels >= 0) & (pixels <= np.array(self.size) - 1)).all(axis=1))
        seen = inside & self._clear_to(view, self.board_m)
        return np.asarray(np.where(seen[:, None], pixels, np.nan))

    def ground_m(self, index: int) -> FloatArray:
        """Exact place (h, w, 3) in the map, m, of what each pixel of frame `index` shows; NaN for the sky.

        Boards are left out: the ground below them is given.
        """
        return self._hit(self.view(index), self.rays.reshape(-1, 2))[0].reshape(*self.rays.shape[:2], 3)

    def water(self, index: int) -> BoolArray:
        """Mask (h, w) of the pixels of frame `index` that show water."""
        return self._hit(self.view(index), self.rays.reshape(-1, 2))[1].reshape(self.rays.shape[:2])

    @cached_property
    def rays(self) -> FloatArray:
        """The ray (h, w, 2) of each pixel, x / z and y / z in the camera's axes; NaN where the lens shows nothing."""
        x, y = (np.linspace(0, n - 1, min(n, max(_FEWEST_KNOTS, n // _KNOT_PX))) for n in self.size)
        columns, rows = np.meshgrid(x, y)
        at_knots = self.camera.rays(np.column_stack([columns.ravel(), rows.ravel()])).reshape(len(y), len(x), 2)
        if not np.isfinite(at_knots).all():
            return self._rays_one_by_one()
        width, height = self.size
        return np.stack([RectBivariateSpline(y, x, at_knots[..., axis], kx=_DEGREE, ky=_DEGREE)(
            np.arange(height), np.arange(width)) for axis in range(2)], axis=2)

    def _rays_one_by_one(self) -> FloatArray:
        width, height = self.size
        rays = np.empty((height, width, 2))
        for top in range(0, height, _CHUNK_ROWS):
            rows, columns = np.mgrid[top:min(top + _CHUNK_ROWS, height), :width].astype(float)
            rays[top:top + _CHUNK_ROWS] = self.camera.rays(
                np.column_stack([columns.ravel(), rows.ravel()])).reshape(*rows.shape, 2)
        return rays

    def image(self, index: int) -> Image:
        """Image of frame `index`, (h, w) or (h, w, 3) bgr uint8."""
        view, channels = self.view(index), len(self._sky)
        image = np.empty((self.size[1], self.size[0], channels), np.float32)
        sight = self._sight(view)
        render_rows(self.rays, self._land, self._water_at(index), sight, self._sky, image)
        self._draw_boards(view, sight, image)
        noise = np.random.default_rng([self.seed, 50, index]).standard_normal(image.size, dtype=np.float32)
        noise *= np.float32(self.scene.noise_levels)
        levels = np.asarray(quantised(image.ravel(), noise, np.float32(1), np.float32(0)))
        return levels.reshape(image.shape if self.color else image.shape[:2])

    def _draw_boards(self, view: View, sight: Sight, image: Float32Array) -> None:
        for board, centre in zip(self.scene.boards, self.board_m, strict=True):
            half = board.size_m / 2
            pixels = view.project(centre + half * np.array([[-1, -1, 0], [-1, 1, 0], [1, -1, 0], [1, 1, 0.0]]))
            if np.isfinite(pixels).all() and (pixels.max(axis=0) > -2).all() and (pixels.min(axis=0) < self.size).all():
                (left, top), (right, bottom) = np.floor(pixels.min(axis=0) - 1), np.ceil(pixels.max(axis=0) + 1)
                draw_board(self.rays, self._land, sight, centre, board.size_m,
                           (int(left), int(top), int(right), int(bottom)), image)

    def _clear_to(self, view: View, points_m: FloatArray) -> BoolArray:
        """Whether nothing hides points (N, 3) of the map from the camera."""
        in_camera = view.pose.to_camera(points_m)
        ahead = in_camera[:, 2] > 0
        rays = np.where(ahead[:, None], in_camera[:, :2] / np.where(ahead, in_camera[:, 2], 1)[:, None], 0.0)
        found, _ = depths(rays, self._land, self._sight(view))
        return np.asarray(ahead & (found > in_camera[:, 2] - _HIDDEN_M))

    def _hit(self, view: View, rays: FloatArray) -> tuple[FloatArray, BoolArray]:
        """What rays (n, 2) meet: (n, 3), m, and whether it is water."""
        depth, wet = depths(rays, self._land, self._sight(view))
        directions = np.column_stack([rays, np.ones(len(rays))]) @ view.pose.cam_R_map
        met = np.isfinite(depth) & np.isfinite(rays).all(axis=1)
        places = view.pose.position_m + np.where(met, depth, np.nan)[:, None] * directions
        return np.asarray(places), np.asarray(wet & met)

    def _sight(self, view: View) -> Sight:
        return Sight(view.pose.position_m, np.ascontiguousarray(view.pose.cam_R_map.T), 1 / float(self.camera.K[0, 0]),
                     self._wse_of_kernel, self._top_m)

    @property
    def _wse_of_kernel(self) -> float:
        return -100.0 if self.scene.reach.dry else self.wse_m

    def _water_at(self, index: int) -> Water:
        shape = self.scene.reach
        stream = np.array([shape.half_width_m, shape.bend_m, 2 * math.pi / PERIOD_M, shape.speed_m_s])
        return Water(self._water_color, self._waves, self._ripple_lives(index), stream)

    def _ripple_lives(self, index: int) -> FloatArray:
        """Two overlapping generations of ripples (2, 4): age from mid-life, s, weight, offset east and north, m."""
        lives = []
        for k in range(2):
            turn = index / self.scene.fps / _RIPPLE_LIFE_S + k / 2
            part = turn - math.floor(turn)
            offset = np.random.default_rng([self.seed, 82, k, math.floor(turn)]).uniform(0, 200, 2)
            lives.append([(part - 0.5) * _RIPPLE_LIFE_S, math.sin(math.pi * part), *offset])
        return np.array(lives)
