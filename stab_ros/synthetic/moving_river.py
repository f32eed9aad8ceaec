"""A flight over a river whose water moves by a given velocity field: images, exact homographies, exact velocities.

    flight = RiverFlight(preset("kolubara"), size=(1024, 540), frames=40, seed=1)
    for shot in flight:
        shot.image, shot.stamp_ns, shot.ref_H_cur, shot.map_H_image
    flight.velocity_m_s(points_m, shot.stamp_ns)               # of the water surface, in the map
    flight.drifted_m(points_m, shot.stamp_ns, later_ns)        # where it carries them

Camera, ground and control points are those of `Flight`. All that drifts is drawn where the velocity field has carried
it from its birth: particles, foam, and texture as patches that are also strained as the water around them. So no part
of the water moves otherwise, unless it is asked for (`SurfaceSettings`): wind waves, standing waves, the sun's
reflection, the bed. The same arguments give the same bytes on one machine, in any order of the frames.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from stab_ros.core.geometry import apply, normalized
from stab_ros.core.types import BoolArray, FloatArray, Homography, Image
from stab_ros.synthetic.advection import advected, gradients, strain_rates
from stab_ros.synthetic.camera_path import Pose, inverse, product, rotation
from stab_ros.synthetic.cross_section import Bed
from stab_ros.synthetic.drifters import COHORTS, Drifters, Drifting, Region
from stab_ros.synthetic.flight import FIRST_STAMP_NS, Flight, Shot
from stab_ros.synthetic.map_frame import MAP_R_WORLD
from stab_ros.synthetic.render import FloatImage, add_tracers, colored
from stab_ros.synthetic.river import SceneSettings
from stab_ros.synthetic.river_flows import bed_of, flow_of
from stab_ros.synthetic.river_kernels import Patches, Water, draw_patches, render_river, shore_distances_m
from stab_ros.synthetic.surface import SurfaceSettings, mirror_direction, standing_waves, wind_waves
from stab_ros.synthetic.terrain import COARSE, Layout
from stab_ros.synthetic.textures import natural_texture
from stab_ros.synthetic.velocity_fields import VelocityField

_COVER = 4.0  # patches over each place
_RADIUS_TEXELS = 18.0  # of a patch; the finest wavelength is 0.37 of its radius
_CUT = 0.15  # highest frequency of the texture, 1/texel
_LEAST_POWER = 0.05
_SHARES = (0.7, 0.7)  # of the finer and the coarser texture; the sum of the squares is about 1
_MOST_STRAIN = 3.5  # a patch that the flow has drawn out so much has faded
_THINNEST_SIGMA_PX = 0.8  # smaller particles would be aliased
_GLINT_RAD = 0.16
_GRID, _TIMES = 48, 8  # samples of the field
_LONGEST_LIFE_S, _SHORTEST_LIFE_S, _SHARE_OF_VIEW = 40.0, 1.5, 0.4  # of patches
_STEP_TURN, _STEP_S = 0.2, (0.02, 0.25)  # share of a turn or stretch by 1 in a step of integration, and its limits


@dataclass(frozen=True, eq=False)
class RiverShot(Shot):
    """One frame of a flight over a moving river.

    Attributes:
        map_H_image: exact homography from pixels of the frame to east and north on the water plane, m.
    """

    map_H_image: Homography


class RiverFlight(Flight):
    """A sequence of frames over a moving river, iterable and indexable.

    Args:
        scene: ground, channel and camera path; its stream's speed and `rigid` do not matter if there is a `field`.
        field: velocity of the water; None: that of `flow_of`.
        surface: what the water looks like.
        size: width and height of the images, px; None for those of the scene.
        frames: number of frames.
        seed: of all random numbers.
        color: whether the images are bgr instead of gray.
        bed: below the water, seen with `surface.bed`; None: that of `bed_of`.
        start_ns: stamp of frame 0.

    Raises:
        InputError: a size below 64 px, or no frames.
    """

    def __init__(self, scene: SceneSettings, field: VelocityField | None = None,
                 surface: SurfaceSettings | None = None, size: tuple[int, int] | None = None, frames: int = 60,
                 seed: int = 1, color: bool = False, bed: Bed | None = None, start_ns: int = FIRST_STAMP_NS) -> None:
        super().__init__(scene, size, frames, seed, color=color, start_ns=start_ns)
        self.field = flow_of(scene) if field is None else field
        self.surface = SurfaceSettings() if surface is None else surface
        self.bed = bed_of(scene) if bed is None else bed
        self._layout = Layout.of(scene)
        self._shore = natural_texture([seed, 10], 1.8, 200.0)  # as `make_ground`
        self._texture = natural_texture([seed, 31], 0.9, 40.0, stretch=0.7, cut=_CUT)
        self._sparkles = natural_texture([seed, 32], 0.5, 12.0)
        self._region = self._seen_region()
        self._layers = [self._patches_of(k) for k in range(len(self.surface.texture_px))]
        self._particles = self._scattered()
        self._waves = wind_waves(self.surface, self.gsd_m, self._current_m_s(), seed)
        self._trains = standing_waves(self.surface, self.gsd_m, self._region, seed)
        self._clarity = self._bed_clarity()

    def __iter__(self) -> Iterator[RiverShot]:
        return (self[index] for index in range(self.frames))

    def __getitem__(self, index: int) -> RiverShot:
        shot = super().__getitem__(index)
        return RiverShot(shot.index, shot.stamp_ns, shot.image, shot.ref_H_cur, shot.pose, shot.water,
                         self.map_H_image(index))

    def map_H_image(self, index: int) -> Homography:
        """Exact homography (3, 3) from pixels of frame `index` to east and north on the water plane, m."""
        return normalized(product(MAP_R_WORLD * (1, 1, -1), inverse(self.image_H_plane(index))))

    def velocity_m_s(self, points_m: FloatArray, stamp_ns: int) -> FloatArray:
        """True velocity (N, 2) of the water surface at points (N, 2) of the map; meaningless on dry ground."""
        return self.field.velocity_m_s(points_m, self._time_s(stamp_ns))

    def drifted_m(self, points_m: FloatArray, start_ns: int, end_ns: int) -> FloatArray:
        """Where the water carries points (N, 2) of the map from one stamp to another: (N, 2)."""
        return advected(self.field, points_m, self._time_s(start_ns), self._time_s(end_ns))

    def mean_velocity_m_s(self, points_m: FloatArray, start_ns: int, end_ns: int) -> FloatArray:
        """True velocity (N, 2) of vectors that begin at points (N, 2): way by time, as a tracker measures it."""
        return (self.drifted_m(points_m, start_ns, end_ns) - points_m) / ((end_ns - start_ns) * 1e-9)

    def shore_distance_m(self, points_m: FloatArray) -> FloatArray:
        """Distance (N,) of points (N, 2) of the map to the nearest visible shore, positive in the water."""
        return np.asarray(shore_distances_m(self._layout, self._shore, np.ascontiguousarray(points_m * (1.0, -1.0))))

    def particles_m(self, stamp_ns: int) -> FloatArray:
        """Floating particles (N, 4) at an instant: east, north, brightness and number, which stays with a particle."""
        found = self._particles.at(self._time_s(stamp_ns))
        return np.column_stack([found.place_m, self._brightness(found) * self._wetness(found.place_m), found.number])

    def _time_s(self, stamp_ns: int) -> float:
        return (stamp_ns - self.start_ns) * 1e-9

    def _seen_region(self) -> Region:
        """What is seen in any frame."""
        e = self.ground.extent
        high_x, high_y = e.x_m + e.shape[1] * e.texel_m, e.y_m + e.shape[0] * e.texel_m
        return Region((e.x_m, -high_y), (high_x, -e.y_m))

    def _reach_m(self, life_s: float) -> tuple[FloatArray, FloatArray]:
        """How far west and south (2,), and east and north (2,), of what is seen its water can come from in a life."""
        margin = np.full(2, self._fastest_m_s() * life_s)
        around = self._region.widened(margin, margin).grid(2 * _GRID)
        found = np.array([self.field.velocity_m_s(around, t) for t in self._times_s()]).reshape(-1, 2) * life_s
        return np.maximum(found.max(axis=0), 0), np.maximum(-found.min(axis=0), 0)

    def _fastest_m_s(self) -> float:
        grid = self._region.grid(_GRID)
        return max(float(np.hypot(*self.field.velocity_m_s(grid, t).T).max()) for t in self._times_s())

    def _times_s(self) -> FloatArray:
        return np.linspace(0, self.frames / self.preset.fps, _TIMES)

    def _may_be_seen(self, points_m: FloatArray, time_s: float) -> BoolArray:
        """Whether points (N, 2) are wet, or the field moves them, so that they may come to be seen as water."""
        wet = self.shore_distance_m(points_m) > -4 * max(self.surface.texture_px) * self.gsd_m
        return np.asarray(wet | self.field.velocity_m_s(points_m, time_s).any(axis=1))

    def _current_m_s(self) -> FloatArray:
        """Mean velocity (2,) of the water at frame 0."""
        points = self._region.grid(_GRID)
        wet = self.shore_distance_m(points) > 0
        return self.field.velocity_m_s(points[wet], 0.0).mean(axis=0) if wet.any() else np.zeros(2)

    def _patches_of(self, layer: int) -> list[Drifters]:
        """Populations of patches with different lives, each where the strain of the water asks for it."""
        radius_m = self.surface.texture_px[layer] * self.gsd_m
        lives = self._lives_s()
        return [self._drifters(_COVER / (math.pi * radius_m**2), life, [45 + layer, k], radius_m / 2,
                               partial(self._live_as, k, lives)) for k, life in enumerate(lives)]

    def _lives_s(self) -> FloatArray:
        """Each half as long as the one before."""
        longest = self.surface.texture_life_s
        if longest is None:
            width_m = self._region.high_m[0] - self._region.low_m[0]
            longest = min(_LONGEST_LIFE_S, _SHARE_OF_VIEW * width_m / max(self._fastest_m_s(), 1e-9))
        return np.asarray(longest / 2.0 ** np.arange(max(math.ceil(math.log2(longest / _SHORTEST_LIFE_S)), 0) + 1))

    def _live_as(self, k: int, lives_s: FloatArray, points_m: FloatArray, time_s: float) -> BoolArray:
        """Whether life `k` is the longest in which the water at points (N, 2) is strained little enough."""
        strain = strain_rates(gradients(self.field, points_m, time_s, self.gsd_m))
        longest = np.searchsorted(-lives_s, -1 / np.maximum(strain, 1e-9))
        return np.asarray(np.minimum(longest, len(lives_s) - 1) == k)

    def _scattered(self) -> Drifters:
        per_m2 = self.surface.particles_per_m2
        return self._drifters(self.preset.tracers_per_m2 if per_m2 is None else per_m2,
                              self.surface.particle_life_s, [44], self.gsd_m)

    def _drifters(self, per_m2: float, life_s: float, key: list[int], arm_m: float,
                  also: Callable[[FloatArray, float], BoolArray] | None = None) -> Drifters:
        low, high = self._reach_m(life_s)

        def born_at(points_m: FloatArray, time_s: float) -> BoolArray:
            seen = self._may_be_seen(points_m, time_s)
            return seen if also is None else seen & also(points_m, time_s)

        return Drifters(self.field, self._region.widened(low + 2 * arm_m, high + 2 * arm_m), per_m2, life_s,
                        [self.seed, *key], arm_m, min(self._step_s(), life_s / COHORTS), born_at)

    def _step_s(self) -> float:
        """Step of the integration, short by the gradients of the field, which are few where they are steep."""
        found = [gradients(self.field, self._region.grid(_GRID), t, self.gsd_m) for t in self._times_s()]
        steep = float(np.quantile(np.linalg.norm(found, axis=(2, 3)), 0.998))
        return min(max(_STEP_TURN / max(steep, 1e-9), _STEP_S[0]), _STEP_S[1])

    def _bed_clarity(self) -> FloatImage:
        """Share of the bed that is seen, for every eighth texel of the ground."""
        extent = self.ground.extent
        rows, columns = self.ground.flow.shape[:2]
        pitch = COARSE * extent.texel_m
        x, y = np.meshgrid(extent.x_m + pitch * np.arange(columns), extent.y_m + pitch * np.arange(rows))
        depths = self.bed.depths_m(np.column_stack([x.ravel(), -y.ravel()])).reshape(rows, columns)
        return np.asarray(self.surface.bed * np.exp(-depths / self.surface.clear_m), np.float32)

    def _image(self, index: int) -> Image:
        texel_H_image = self._texel_H_image(index)
        image = render_river(texel_H_image, self.map_H_image(index), self.ground.brightness, self.ground.water,
                             self._water_at(index))
        add_tracers(image, self._blobs_in(index))
        if self.color:
            image = colored(image, texel_H_image, self.ground.tint)
        return self._exposed(index, image)

    def _water_at(self, index: int) -> Water:
        time_s = self._time_s(self.stamp_ns(index))
        return Water(self._drifting_in(index, time_s), self._clarity, self._waves, self._trains, time_s,
                     self._glint_in(self.pose(index)), self._sparkles)

    def _drifting_in(self, index: int, time_s: float) -> FloatImage:
        """Grey levels (h, w) of texture and foam."""
        shape = self.size[1], self.size[0]
        levels = np.zeros(shape, np.float32)
        for k, (populations, share) in enumerate(zip(self._layers, _SHARES, strict=True)):
            total, power, foam = (np.zeros(shape, np.float32) for _ in range(3))
            radius_m = self.surface.texture_px[k] * self.gsd_m
            for drifters in populations:
                draw_patches(self._texture, self._patches_in(index, drifters.at(time_s), radius_m), total, power, foam)
            levels += np.float32(self.surface.texture * share) * total / np.sqrt(power + np.float32(_LEAST_POWER))
            if k == len(self._layers) - 1:
                levels += np.float32(self.surface.foam) * foam
        return levels

    def _patches_in(self, index: int, found: Drifting, radius_m: float) -> Patches:
        image_H_map = self._image_H_map(index)
        place_px = apply(image_H_map, found.place_m)
        image_A_patch = radius_m * _jacobians(image_H_map, found.place_m) @ found.deformation
        reach = np.hypot(image_A_patch[:, :, 0], image_A_patch[:, :, 1])
        weight = found.weight * _unstrained(found.deformation)
        seen = (weight > 0) & self._in_view(place_px, reach) & (self.shore_distance_m(found.place_m) > -4 * radius_m)
        return Patches(place_px[seen], np.linalg.inv(image_A_patch[seen]), reach[seen], weight[seen],
                       found.traits[seen, :2] * 1024, _RADIUS_TEXELS)

    def _blobs_in(self, index: int) -> FloatArray:
        """Particles (n, 4) as `add_tracers` takes them: x, y and sigma, px, and brightness."""
        found = self._particles.at(self._time_s(self.stamp_ns(index)))
        place_px = apply(self._image_H_map(index), found.place_m)
        smallest, largest = self.surface.particle_px
        # the share of particles wider than d falls as 1 / d
        diameter = 1 / (1 / smallest - found.traits[:, 0] * (1 / smallest - 1 / largest))
        bright = self._brightness(found) * self._wetness(found.place_m)
        seen = (bright > 0) & self._in_view(place_px, np.repeat(2 * diameter[:, None], 2, axis=1))
        sigma = np.maximum(diameter / 4, _THINNEST_SIGMA_PX)
        return np.column_stack([place_px, sigma, bright])[seen]

    def _brightness(self, found: Drifting) -> FloatArray:
        return self.surface.particle_level * found.weight * (0.4 + 0.6 * found.traits[:, 1])

    def _wetness(self, points_m: FloatArray) -> FloatArray:
        """Share (N,) of full water at points (N, 2), 0 beyond the ground's texture."""
        extent = self.ground.extent
        cells = np.round((points_m * (1, -1) - (extent.x_m, extent.y_m)) / extent.texel_m).astype(int)
        inside = np.all((cells >= 0) & (cells < extent.shape[::-1]), axis=1)
        column, row = np.where(inside[:, None], cells, 0).T
        return np.where(inside, self.ground.water[row, column] / 255, 0)

    def _in_view(self, place_px: FloatArray, reach_px: FloatArray) -> BoolArray:
        return np.asarray(((place_px > -reach_px) & (place_px < self.size + reach_px)).all(axis=1))

    def _image_H_map(self, index: int) -> Homography:
        return product(self.image_H_plane(index), MAP_R_WORLD * (1, 1, -1))

    def _glint_in(self, pose: Pose) -> FloatArray:
        """Centre x, y and radius of the sun's reflection, px, and its strength."""
        x, y, z = rotation(pose) @ MAP_R_WORLD @ mirror_direction(self.surface)
        focal = self.camera.focal_px
        return np.array([focal * x / z + self.camera.K[0, 2], focal * y / z + self.camera.K[1, 2],
                         focal * math.tan(_GLINT_RAD), self.surface.glint])


def _jacobians(H: Homography, points: FloatArray) -> FloatArray:
    """Derivatives (N, 2, 2) of the points (N, 2) mapped by H."""
    w = points @ H[2, :2] + H[2, 2]
    return np.asarray((H[:2, :2] - apply(H, points)[:, :, None] * H[2, :2]) / w[:, None, None])


def _unstrained(deformation: FloatArray) -> FloatArray:
    """1 where water (N, 2, 2) is little strained, 0 from a stretch of `_MOST_STRAIN` on: (N,)."""
    square = np.sum(deformation**2, axis=(1, 2))
    area = np.linalg.det(deformation)
    stretch = np.sqrt((square + np.sqrt(np.maximum(square**2 - 4 * area**2, 0))) / 2)
    return np.asarray(np.clip((_MOST_STRAIN - stretch) / (_MOST_STRAIN - 2), 0, 1))
