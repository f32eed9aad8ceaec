"""The engine of georeferencing: a frame in, its place on the water plane and its orthophoto out.

Node and command call the same `Georeferencer`. Its answers depend on what was added to it and on the stamps, never on a
clock: a frame that needs sensors waits until they have told of a time after it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.geometry import apply, grid, inside, normalized
from stab_ros.core.gray import GreyRange, grey_range, to_gray
from stab_ros.core.text import counted
from stab_ros.core.types import FloatArray, Frame, Homography, Image
from stab_ros.georeferencing.camera_twist import Moment, Twist, twist_between
from stab_ros.georeferencing.control_points import ControlPoints
from stab_ros.georeferencing.horizon import gsd_m, in_front, sampled_pixels, shown_well
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.georeferencing.orientation import Answer, Orientation, Unplaced, Watching
from stab_ros.georeferencing.ortho_grid import MOST_PIXELS, OrthoGrid
from stab_ros.georeferencing.orthophoto import Orthophotos
from stab_ros.georeferencing.placement import NO_PICTURE, Motion, Placement, Sighting
from stab_ros.georeferencing.samples import AttitudeSample, PositionSample
from stab_ros.georeferencing.sensors import Sensors
from stab_ros.georeferencing.settings import GeoreferenceConfig
from stab_ros.georeferencing.water_level import WaterLevels
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.warp import Allocate


@dataclass(frozen=True, eq=False)
class Georeferenced:
    """The answer for one frame.

    Attributes:
        frame: as it was added.
        wse_m: water surface elevation that was taken, in the map.
        answer: where the frame lies, or why that is not known.
        grid: of the orthophotos, the same for all frames; None: none is placed yet.
        ortho_H_image: (3, 3), h22 = 1, from undistorted pixels of the image to pixels of the grid; None: unplaced.
        before: the frame before it; None: there is none, or it is unplaced.
    """

    frame: Frame
    wse_m: float
    answer: Answer
    grid: OrthoGrid | None = None
    ortho_H_image: Homography | None = None
    before: Moment | None = None

    @property
    def placement(self) -> Placement | None:
        """Where the frame lies; None: unplaced."""
        return self.answer if isinstance(self.answer, Placement) else None

    @property
    def reason(self) -> str:
        """Why the frame is unplaced; "" if it is not."""
        return self.answer.reason if isinstance(self.answer, Unplaced) else ""

    @property
    def twist(self) -> Twist | None:
        """How the camera has moved since the frame before; None: see `twist_between`. It is computed anew."""
        if self.placement is None or self.before is None:
            return None
        return twist_between(self.before, Moment(self.frame.stamp_ns, self.placement))


class Georeferencer:
    """Places the frames of a stream on the water plane.

    Add what comes in the order in which it comes, and take the `answers` to the frames that are known by then; `finish`
    gives those of the frames that still wait. `frame` does it in one call.
    """

    def __init__(self, config: GeoreferenceConfig, camera: Camera, orientation: Orientation, sensors: Sensors,
                 image_H_ref: Homography | None = None, gcps: ControlPoints | None = None,
                 local_frame: LocalFrame | None = None, doubts: tuple[str, ...] = ()) -> None:
        """Prepares for a stream.

        Args:
            config: the settings.
            camera: that took the images.
            orientation: the way to know where frames lie.
            sensors: those that `orientation` takes.
            image_H_ref: (3, 3), for images that are stabilised already: from pixels of the reference to those of the
                image; their lens distortion is removed already. None: images are as taken.
            gcps: the control points of `orientation`, to be shown; None: there are none.
            local_frame: where the map is on the Earth; None: the first fix tells, if any comes.
            doubts: what is doubtful of the whole stream: one line each.
        """
        self._config, self._camera, self._orientation, self._sensors = config, camera, orientation, sensors
        self._image_H_ref, self.gcps, self.doubts = image_H_ref, gcps, doubts
        self._local_frame = local_frame
        self._shown = camera  # the one that took the images as they come
        if image_H_ref is not None:
            self._shown = Camera(image_H_ref @ camera.K, np.zeros(0), "plumb_bob", camera.size)
        self._levels = WaterLevels(config.wse_m)
        self._waiting: deque[tuple[Frame, Motion | None]] = deque()
        self._grid: OrthoGrid | None = None
        self._orthophotos: tuple[Camera, Orthophotos] | None = None
        self._range: GreyRange | None = None  # of the first frame
        self._before: Moment | None = None  # the last frame, where it is placed

    @property
    def grid(self) -> OrthoGrid | None:
        """The grid of all orthophotos; None until the first frame is placed, if `extent` does not tell it."""
        return self._grid

    @property
    def camera(self) -> Camera:
        """That took the images, as it was given."""
        return self._camera

    @property
    def waiting(self) -> int:
        """Number of frames that wait for sensors."""
        return len(self._waiting)

    @property
    def time_offset_s(self) -> float:
        """Seconds that are added to the stamps of positions and attitudes."""
        return self._sensors.time_offset_s

    @property
    def wse_m(self) -> float:
        """Water surface elevation of the settings, m."""
        return self._config.wse_m

    @property
    def local_frame(self) -> LocalFrame | None:
        """Where the map is on the Earth; None: not known yet."""
        return self._local_frame

    def add_fix(self, stamp_ns: int, lat_lon_height: FloatArray, covariance_m2: FloatArray | None) -> None:
        """Takes a position of the antenna. The first one fixes the origin of the map, at height 0, where none is given.

        Args:
            stamp_ns: on the clock of the sensor.
            lat_lon_height: (3,), latitude and longitude, degrees, and height, m.
            covariance_m2: (3, 3) of east, north and up; None: unknown.

        Raises:
            InputError: not finite, no place on the Earth, or too far from the origin.
        """
        raised = lat_lon_height + np.array([0, 0, self._config.fix_height_offset_m])
        local_frame = self._local_frame or LocalFrame(float(raised[0]), float(raised[1]), 0.0)
        position_m = local_frame.from_geodetic(raised[None])[0]
        self._local_frame = local_frame
        self.add_position(PositionSample(stamp_ns, position_m, covariance_m2))

    def add_position(self, sample: PositionSample) -> None:
        """Takes a position of the antenna in the map, on the clock of the sensor."""
        self._sensors.add_position(sample)

    def add_attitude(self, sample: AttitudeSample) -> None:
        """Takes an attitude of the body in the map, on the clock of the sensor."""
        self._sensors.add_attitude(sample)

    def set_water_level(self, stamp_ns: int, wse_m: float) -> None:
        """The water surface elevation in the map, from this stamp on.

        Raises:
            InputError: not finite.
        """
        self._levels.add(stamp_ns, wse_m)

    def add_frame(self, frame: Frame, motion: Motion | None = None) -> None:
        """Takes the next frame.

        Args:
            frame: as taken, or stabilised if `image_H_ref` was given.
            motion: how it lies to the reference; None: lost, or not stabilised.

        Raises:
            InputError: the frame does not fit the camera.
        """
        if self._image_H_ref is None and frame.size != self._camera.size:
            width, height = self._camera.size
            raise InputError(f"the camera takes images of {width}x{height}, not {frame.size[0]}x{frame.size[1]}; give "
                             "the calibration of this size")
        if self._image_H_ref is not None and self._shown.size != frame.size:
            self._shown = Camera(self._image_H_ref @ self._camera.K, np.zeros(0), "plumb_bob", frame.size)
        self._waiting.append((frame, motion))

    def answers(self) -> list[Georeferenced]:
        """The answers that are known by now, in the order of the frames."""
        found = []
        while self._waiting and self._is_ready():
            found.append(self._answer(*self._waiting.popleft()))
        if found:
            self._sensors.forget_before(found[-1].frame.stamp_ns)
        return found

    def finish(self) -> list[Georeferenced]:
        """The answers to all frames that still wait: no sensor will tell more."""
        found = [self._answer(*waiting) for waiting in self._waiting]
        self._waiting.clear()
        return found

    def last_look(self) -> tuple[str, ...]:
        """What is doubtful of a whole recording and was not said with a frame, one line each; after its last frame."""
        return self._orientation.last_look() if isinstance(self._orientation, Watching) else ()

    def frame(self, frame: Frame, motion: Motion | None = None) -> Georeferenced:
        """Places a frame at once, by what the sensors have told so far; frames that wait must be taken first.

        Raises:
            InputError: as `add_frame`, or frames wait.
        """
        if self._waiting:
            raise InputError(f"{counted(len(self._waiting), 'frame')} left to wait for sensors, take the answers first")
        self.add_frame(frame, motion)
        return self.finish()[0]

    def orthophoto(self, georeferenced: Georeferenced, allocate: Allocate = np.empty) -> Image | None:
        """The orthophoto of a frame.

        Args:
            georeferenced: the answer to it.
            allocate: makes the array of the result from shape and dtype.

        Returns:
            The frame on the grid, north up, in its `warped_encoding`; None: it is unplaced.
        """
        if georeferenced.grid is None or georeferenced.ortho_H_image is None:
            return None
        frame = georeferenced.frame
        if self._orthophotos is None or self._orthophotos[0] is not self._shown:
            self._orthophotos = (self._shown, Orthophotos(self._shown, self._config.interpolation))
        image = self._orthophotos[1].make(frame.image, georeferenced.ortho_H_image, georeferenced.grid.size, allocate)
        return image if frame.warped_encoding == frame.encoding else self._range_of(frame).to_8_bit(image)

    def _is_ready(self) -> bool:
        if not self._orientation.needs_sensors or len(self._waiting) > self._config.sensor_wait_frames:
            return True
        return self._sensors.cover(self._waiting[0][0].stamp_ns)

    def _answer(self, frame: Frame, motion: Motion | None) -> Georeferenced:
        answer = replace(self._answered(frame, motion), before=self._before)
        self._before = None if answer.placement is None else Moment(frame.stamp_ns, answer.placement)
        return answer

    def _answered(self, frame: Frame, motion: Motion | None) -> Georeferenced:
        wse_m = self._levels.at(frame.stamp_ns)
        answer = self._placed(frame, motion, wse_m)
        if isinstance(answer, Unplaced):
            return Georeferenced(frame, wse_m, answer, self._grid)
        map_H_image = answer.map_H_image if self._image_H_ref is None else (
            answer.map_H_image @ np.linalg.inv(_ref_H_cur(motion)) @ np.linalg.inv(self._image_H_ref))
        grid = self._grid_of(map_H_image)
        if grid is None:
            return Georeferenced(frame, wse_m, Unplaced("the frame shows nothing of the water plane"))
        doubts = grid_doubts(self._config, grid, map_H_image, self._shown)
        answer = replace(answer, warnings=(*answer.warnings, *doubts)) if doubts else answer
        return Georeferenced(frame, wse_m, answer, grid, normalized(grid.ortho_H_map @ map_H_image))

    def _placed(self, frame: Frame, motion: Motion | None, wse_m: float) -> Answer:
        if motion is None and (self._orientation.needs_motion or self._image_H_ref is not None):
            return Unplaced("the frame is lost, there is no homography of it")
        greys = self._range_of(frame)  # of the first frame, even if nobody looks at it yet
        gray = to_gray(frame, greys) if self._orientation.needs_picture else NO_PICTURE
        sigma_m = self._config.wse_sigma_m
        if motion is None:
            return self._orientation.place(Sighting(frame.stamp_ns, gray, wse_m=wse_m, wse_sigma_m=sigma_m,
                                                    size=frame.size))
        return self._orientation.place(Sighting(frame.stamp_ns, gray, motion.ref_H_cur, motion.covariance, wse_m,
                                                sigma_m, motion.reset_counter, frame.size))

    def _range_of(self, frame: Frame) -> GreyRange:
        if self._range is None:
            self._range = grey_range(frame)
        return self._range

    def _grid_of(self, map_H_image: Homography) -> OrthoGrid | None:
        """The grid, which the first placed frame fixes."""
        if self._grid is None:
            self._grid = make_grid(self._config, map_H_image, self._shown)
        return self._grid


def _ref_H_cur(motion: Motion | None) -> Homography:
    return np.eye(3) if motion is None else motion.ref_H_cur


def make_grid(config: GeoreferenceConfig, map_H_image: Homography, camera: Camera) -> OrthoGrid | None:
    """The grid of the settings, or that of what a frame shows; None: it shows nothing of the water plane.

    Args:
        config: the settings.
        map_H_image: (3, 3), from undistorted pixels of the frame to east and north, m.
        camera: that took it.
    """
    pixels = shown_well(map_H_image, sampled_pixels(camera))
    if not len(pixels):
        return None
    resolution_m = config.resolution_m or float(np.median(gsd_m(map_H_image, pixels)))
    if config.borders_m is not None:
        west, south, east, north = config.borders_m
        return OrthoGrid.covering(np.array([[west, south], [east, north]]), resolution_m)
    outline = apply(map_H_image, pixels)
    margin = config.margin_m * np.array([[-1.0, -1.0], [1.0, 1.0]])
    return OrthoGrid.covering(np.concatenate([outline.min(axis=0)[None], outline.max(axis=0)[None]]) + margin,
                              resolution_m)


def grid_doubts(config: GeoreferenceConfig, ortho: OrthoGrid, map_H_image: Homography, camera: Camera
                ) -> tuple[str, ...]:
    """What the settings ask of the grid and do not get, one line each.

    Args:
        config: the settings.
        ortho: the grid of the orthophotos.
        map_H_image: (3, 3), from undistorted pixels of a frame to east and north, m.
        camera: that took it.
    """
    said = []
    if config.resolution_m and ortho.resolution_m > config.resolution_m:
        said.append(f"resolution_m {config.resolution_m:g} would take more than {MOST_PIXELS} pixels, the orthophoto "
                    f"has {ortho.resolution_m:.4g} m")
    if config.borders_m is not None and not _shows(ortho, map_H_image, camera):
        said.append("the frame shows nothing of extent")
    return tuple(said)


def _shows(ortho: OrthoGrid, map_H_image: Homography, camera: Camera) -> bool:
    """Whether places of the grid lie in the picture, or pixels in the grid, whichever is the smaller."""
    pixels = apply(np.linalg.inv(map_H_image) @ ortho.map_H_ortho, grid(ortho.size))
    if (inside(pixels, camera.size) & in_front(map_H_image, pixels)).any():
        return True
    seen = shown_well(map_H_image, sampled_pixels(camera))
    return bool(inside(apply(ortho.ortho_H_map @ map_H_image, seen), ortho.size).any())
