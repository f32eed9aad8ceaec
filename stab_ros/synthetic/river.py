"""River scenes and camera paths as data, after the case studies of Ljubicic et al. (2021, table 1).

Lengths are in m on the ground. Positions are shares of the nominal image, from (0, 0) at its top left to (1, 1) at its
bottom right corner, so that a scene does not depend on the image size: fewer pixels are coarser pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

from stab_ros.core.errors import InputError
from stab_ros.synthetic.camera_path import Gust, Motion, Pose

Share = tuple[float, float]


@dataclass(frozen=True)
class Stream:
    """A stream that flows from left to right.

    Attributes:
        centre: mean y of the centre line, as a share of the image height.
        width: as a share of the image height.
        bend: amplitude of the centre line over one image width, as a share of the image height.
        speed_m_s: in mid-stream; 0 at the banks.
        rigid: whether all water moves along x at that speed with a constant texture as strong as the ground's, so that
            only its motion distinguishes it from ground.
    """

    centre: float
    width: float
    bend: float
    speed_m_s: float
    rigid: bool = False


@dataclass(frozen=True)
class Island:
    """Elliptic dry ground in the stream; centre and half axes as shares of the image width and height."""

    centre: Share
    half_axes: Share


@dataclass(frozen=True)
class ControlPoint:
    """A square ground control point with black and white quadrants."""

    place: Share
    size_m: float


@dataclass(frozen=True)
class SceneSettings:
    """A river scene with the camera's motion.

    Attributes:
        name: of the scene.
        size: width and height of the nominal image, px.
        gsd_m: ground sampling distance at that size.
        fps: frames per second.
        duration_s: of the original video.
        stream: the water.
        motion: of the camera.
        islands: in the stream.
        control_points: on the ground.
        focal_share: focal length divided by the image width.
        noise_levels: standard deviation of the noise, grey levels.
        brightness: amplitude of the gain variation.
        tracers_per_m2: density of tracer particles on the water.
    """

    name: str
    size: tuple[int, int]
    gsd_m: float
    fps: float
    duration_s: float
    stream: Stream
    motion: Motion
    islands: tuple[Island, ...] = ()
    control_points: tuple[ControlPoint, ...] = ()
    focal_share: float = 0.67
    noise_levels: float = 2.0
    brightness: float = 0.02
    tracers_per_m2: float = 0.15

    @property
    def ground_m(self) -> tuple[float, float]:
        """Width and height of the ground in the nominal image."""
        return self.size[0] * self.gsd_m, self.size[1] * self.gsd_m

    @property
    def height_m(self) -> float:
        """Flying height: focal length times ground sampling distance."""
        return self.focal_share * self.ground_m[0]


KOLUBARA = SceneSettings(
    name="kolubara", size=(4096, 2160), gsd_m=0.010, fps=23.0, duration_s=31.4,
    stream=Stream(centre=0.52, width=0.50, bend=0.05, speed_m_s=0.12),
    motion=Motion(
        sway=Pose(x_m=0.06, y_m=0.06, height_m=0.08, yaw_deg=0.2, pitch_deg=0.12, roll_deg=0.12), sway_hz=0.11
    ),
    control_points=(
        ControlPoint((0.13, 0.14), 0.65), ControlPoint((0.88, 0.13), 0.65), ControlPoint((0.50, 0.15), 0.20),
        ControlPoint((0.12, 0.90), 0.20), ControlPoint((0.50, 0.91), 0.20), ControlPoint((0.87, 0.88), 0.20),
    ),
)
ALPINE = SceneSettings(
    name="alpine", size=(3840, 2160), gsd_m=0.021, fps=5.0, duration_s=30.4,
    stream=Stream(centre=0.50, width=0.62, bend=0.10, speed_m_s=2.0),
    motion=Motion(
        sway=Pose(x_m=0.08, y_m=0.08, height_m=0.10, yaw_deg=0.15, pitch_deg=0.12, roll_deg=0.12), sway_hz=0.15,
        drift_per_s=Pose(x_m=0.03, y_m=-0.012, height_m=0.004, yaw_deg=-0.02),
    ),
    islands=(Island((0.40, 0.47), (0.11, 0.10)), Island((0.66, 0.56), (0.08, 0.07))),
    control_points=tuple(
        ControlPoint(place, 0.66)
        for place in ((0.10, 0.08), (0.36, 0.07), (0.62, 0.07), (0.90, 0.10),
                      (0.08, 0.93), (0.37, 0.94), (0.63, 0.93), (0.92, 0.92))
    ),
    tracers_per_m2=0.05,
)
BASENTO = SceneSettings(
    name="basento", size=(1920, 1080), gsd_m=0.005, fps=23.98, duration_s=38.3,
    stream=Stream(centre=0.62, width=0.62, bend=0.08, speed_m_s=0.4),
    motion=Motion(
        sway=Pose(x_m=0.10, y_m=0.08, height_m=0.10, yaw_deg=0.8, pitch_deg=0.5, roll_deg=0.5), sway_hz=0.25,
        gusts=(
            Gust(1.0, 1.2, Pose(x_m=0.6, y_m=0.35, height_m=-0.25, yaw_deg=4.0)),
            Gust(8.0, 2.0, Pose(x_m=-0.9, y_m=0.5, height_m=0.5, yaw_deg=-9.0, roll_deg=1.0)),
            Gust(18.0, 1.5, Pose(x_m=0.8, y_m=-2.2, height_m=0.1, yaw_deg=6.0, pitch_deg=1.0)),
            Gust(28.0, 2.5, Pose(x_m=-1.0, y_m=1.6, height_m=-0.4, yaw_deg=-5.0)),
        ),
    ),
    brightness=0.05,
    tracers_per_m2=1.5,
)
SCENES = {p.name: p for p in (KOLUBARA, ALPINE, BASENTO)}


def preset(name: str) -> SceneSettings:
    """The scene of this name.

    Raises:
        InputError: there is none.
    """
    if name not in SCENES:
        raise InputError(f"preset {name!r} is unknown, it must be one of {', '.join(SCENES)}")
    return SCENES[name]
