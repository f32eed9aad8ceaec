"""Flights for surveys as data: path of the camera in the map, lens, boards and water level.

The river of a reach flows to the east along north = 0. `nadir` hovers 46 m over it, `oblique` looks from a bank, 20
degrees below the horizon, with the horizon in view, and `strip` is the flight of Perks (2020, section 3.2): 180 m along
the river at 5 km/h, 46 m high, for 125 s, with boards for control at both ends only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.imaging.camera import Camera
from stab_ros.imaging.pose import Pose
from stab_ros.synthetic import camera_path
from stab_ros.synthetic.camera_path import Gust, Motion
from stab_ros.synthetic.map_frame import MAP_R_WORLD
from stab_ros.synthetic.reach import Board, ReachSettings

Vector = tuple[float, float, float]

# barrel distortion of about 8 % at the corners, as of a wide lens whose video is not corrected
RATIONAL = ("rational_polynomial", (0.12, -0.05, 4e-4, -3e-4, 0.004, 0.21, -0.02, 0.002))
EQUIDISTANT = ("equidistant", (0.02, -0.004, 0.001, -0.0002))
NO_LENS: tuple[str, tuple[float, ...]] = ("plumb_bob", (0.0,) * 5)
_STILL = Motion(camera_path.Pose(), 0.1)


@dataclass(frozen=True)
class MapPath:
    """Path of a camera in the map.

    Attributes:
        position_m: at frame 0 without motion.
        yaw_deg: of the view, as `imaging.pose` defines it.
        pitch_deg: of the view.
        roll_deg: of the view.
        velocity_m_s: east, north and up.
        motion: deviations: x_m to the east, y_m to the south, height_m up; then turns about the camera's z (yaw_deg),
            x (pitch_deg) and y (roll_deg) axes.
    """

    position_m: Vector
    yaw_deg: float
    pitch_deg: float
    roll_deg: float = 0.0
    velocity_m_s: Vector = (0.0, 0.0, 0.0)
    motion: Motion = _STILL

    def at(self, time_s: float, seed: int) -> Pose:
        """Pose at seconds since frame 0; `seed` selects the phases of the motion."""
        nominal = Pose.of_angles(np.array(self.position_m) + time_s * np.array(self.velocity_m_s),
                                 *(math.radians(a) for a in (self.yaw_deg, self.pitch_deg, self.roll_deg)))
        off = self.motion.at(time_s, seed)
        moved = MAP_R_WORLD @ np.array([off.x_m, off.y_m, -off.height_m])
        return Pose(nominal.position_m + moved, camera_path.rotation(off) @ nominal.cam_R_map)


@dataclass(frozen=True)
class SurveyScene:
    """A reach with boards and a flight over it.

    Attributes:
        name: of the scene.
        path: of the camera.
        boards: on the ground.
        size: width and height of the images, px.
        fps: frames per second.
        duration_s: of the flight.
        focal_share: focal length divided by the image width.
        lens: distortion model and coefficients, as sensor_msgs/CameraInfo.
        wse_m: water surface elevation.
        reach: shape of the ground.
        noise_levels: standard deviation of the noise, grey levels.
    """

    name: str
    path: MapPath
    boards: tuple[Board, ...]
    size: tuple[int, int] = (1920, 1080)
    fps: float = 10.0
    duration_s: float = 10.0
    focal_share: float = 0.67
    lens: tuple[str, tuple[float, ...]] = NO_LENS
    wse_m: float = 0.0
    reach: ReachSettings = field(default_factory=ReachSettings)
    noise_levels: float = 1.5

    def camera(self, size: tuple[int, int]) -> Camera:
        """The camera with images of this size; its principal point is off the centre."""
        focal, (model, D) = self.focal_share * size[0], self.lens
        centre = (0.5 * (size[0] - 1) + 0.004 * size[0], 0.5 * (size[1] - 1) - 0.003 * size[0])
        return Camera(np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1.0]]), np.array(D), model, size)


def _pair(name: str, east: float, inland: float, control: bool = True,
          reach: ReachSettings | None = None) -> tuple[Board, Board]:
    """Two boards, `inland` m from the nominal shores, one on each bank; that in the south stands on a stand."""
    shape = reach or ReachSettings()
    north, south = (shape.middle_m(east), shape.middle_m(east + 3))
    return (Board(name + "n", east, north + shape.half_width_m + inland, control=control),
            Board(name + "s", east + 3, south - shape.half_width_m - inland, 0.8, 1.4, control))


_SWAY = camera_path.Pose(x_m=0.15, y_m=0.15, height_m=0.12, yaw_deg=0.5, pitch_deg=0.4, roll_deg=0.4)
_NADIR = SurveyScene(
    "nadir", MapPath((0.0, 0.0, 46.0), 90.0, 88.5, motion=Motion(_SWAY, 0.15)),
    (*_pair("g", -24, 3.0), *_pair("h", -6, 4.0), *_pair("i", 9, 3.0), *_pair("k", 25, 2.6),
     *_pair("c", -15, 3.5, False), *_pair("d", 1, 3.5, False), *_pair("e", 17, 3.2, False)),
    reach=ReachSettings(half_width_m=11.0, bend_m=3.0),
)
_OBLIQUE = SurveyScene(
    "oblique", MapPath((0.0, -32.0, 16.0), 82.0, 20.0, 0.6, motion=Motion(_SWAY * 0.6, 0.2)),
    (Board("g1", -7, -17.5, 0.6), Board("g2", 1, -15.5, 0.6, 0.8), Board("g3", 8, -15, 0.6),
     Board("g4", -13, 16.5, 1.2), Board("g5", -3, 16, 1.2, 1.5), Board("g6", 8, 17.5, 1.2),
     Board("g7", 19, 18, 1.2, 1.0), Board("g8", 26, 20, 1.2),
     Board("c1", -3, -15.5, 0.6, control=False), Board("c2", 4.5, -15, 0.6, 1.2, False),
     Board("c3", -8, 16.5, 1.2, 0.7, False), Board("c4", 3, 18, 1.2, control=False),
     Board("c5", 14, 17.5, 1.2, control=False)),
    lens=RATIONAL,
)
_GUSTS = tuple(
    Gust(start, length, camera_path.Pose(x_m=x, y_m=y, height_m=z, yaw_deg=yaw, pitch_deg=pitch, roll_deg=roll))
    for start, length, x, y, z, yaw, pitch, roll in (
        (9.0, 1.5, 0.8, 0.6, -0.3, 3.0, 1.2, -0.8), (21.0, 2.0, -0.9, -1.1, 0.4, -5.0, -1.5, 1.5),
        (33.5, 1.2, 0.4, 0.9, 0.2, 2.5, 1.0, -1.2), (47.0, 2.5, -0.6, -0.3, -0.5, 3.5, -1.4, 0.9),
        (62.0, 1.6, 1.1, 0.7, 0.3, -4.5, 1.6, 0.7), (78.0, 2.2, -1.0, -1.2, 0.2, 4.0, -0.9, -1.6),
        (91.0, 1.4, 0.7, 0.8, -0.4, -3.0, 0.8, 1.1), (108.0, 2.0, -0.5, -0.4, 0.1, -0.5, -0.8, -0.6),
    ))
_STRIP_REACH = ReachSettings(half_width_m=9.0, bend_m=2.5, trees=300)
_STRIP = SurveyScene(
    "strip",
    MapPath((0.0, 0.0, 46.0), 90.0, 90.0, velocity_m_s=(180 / 125, 0.0, 0.0), motion=Motion(_SWAY, 0.13, gusts=_GUSTS)),
    (*_pair("g", -22, 3, True, _STRIP_REACH), *_pair("h", -11, 5.5, True, _STRIP_REACH),
     *_pair("i", 2, 3, True, _STRIP_REACH), *_pair("u", 173, 5.5, True, _STRIP_REACH),
     *_pair("v", 184, 3, True, _STRIP_REACH), *_pair("w", 197, 5.5, True, _STRIP_REACH),
     *(board for k, east in enumerate(range(14, 170, 12)) for board in _pair(f"c{k}", east, 4, False, _STRIP_REACH))),
    size=(1360, 765), duration_s=125.0, reach=_STRIP_REACH,
)
SURVEYS = {scene.name: scene for scene in (_NADIR, _OBLIQUE, _STRIP)}


def survey(name: str) -> SurveyScene:
    """The scene of this name.

    Raises:
        InputError: there is none.
    """
    if name not in SURVEYS:
        raise InputError(f"survey {name!r} is unknown, it must be one of {', '.join(SURVEYS)}")
    return SURVEYS[name]
