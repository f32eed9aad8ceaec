"""What happens when the stream breaks: state and error before, during and after each fault, and a plot of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from effort import Effort
from scenes import SEED
from tables import Section, Table, number
from tqdm import tqdm

from stab_ros.core.geometry import rms_distance
from stab_ros.core.settings import Value
from stab_ros.core.types import FloatArray, Frame, Gray, Track
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.camera_path import Gust, Pose
from stab_ros.synthetic.flight import Flight, Shot, preset
from stab_ros.synthetic.river import SceneSettings

SIZE = (960, 540)
PLOT = Path(__file__).resolve().parents[1] / "docs" / "faults.png"
PRESET = "kolubara"
BEGIN_S, END_S, STREAM_S = 2.0, 3.0, 5.0
_WRONG_PX = 1.0
_SKIN = 155


@dataclass(frozen=True)
class Fault:
    """spoil: picture, seconds into the fault -> picture; None: the frame is dropped. move: of the camera, for good.

    always: the fault lasts as long as the stream. blind: nothing of the scene is to be seen while it lasts.
    """

    name: str
    spoil: Callable[[Gray, float], Gray | None] = lambda picture, _: picture
    move: Pose | None = None
    always: bool = False
    blind: bool = False


def _hand(picture: Gray, seconds: float) -> Gray:
    """A hand that comes in from the left, covers half of the picture and goes."""
    height, width = picture.shape
    reach = width / 2 * math.sin(math.pi * min(max(seconds, 0.0), 1.0)) ** 0.5
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    fingers = reach * (0.85 + 0.15 * np.cos(y / height * 9 * math.pi))
    covered = (x < fingers).astype(np.float32)
    soft = cv2.GaussianBlur(covered, (0, 0), 6)
    return np.asarray(picture * (1 - soft) + (_SKIN + 12 * np.sin(x / 17) * np.cos(y / 23)) * soft, np.uint8)


def _blur(picture: Gray, _seconds: float) -> Gray:
    """9 px along a slant, as by a gust."""
    kernel = np.zeros((9, 9), np.float32)
    cv2.line(kernel, (0, 2), (8, 6), 1.0)
    kernel += kernel[::-1, ::-1]  # a line of whole px is not quite symmetric, and would shift the picture
    return np.asarray(cv2.filter2D(picture, -1, kernel / kernel.sum()))


def _brightness(picture: Gray, seconds: float) -> Gray:
    """Steps of 20 % up and down, five a second."""
    factor = (1.2, 1.0, 0.8, 1.0, 1.2)[int(max(seconds, 0.0) * 5) % 5]
    return np.asarray(np.clip(picture * factor, 0, 255), np.uint8)


def _dropped(seed: int) -> Callable[[Gray, float], Gray | None]:
    draw = np.random.default_rng(seed)
    return lambda picture, _: None if draw.random() < 0.1 else picture


def faults(scene: SceneSettings) -> Sequence[Fault]:
    """Those that are asked for."""
    half = scene.ground_m[0] / 2
    return (
        Fault("10 % dropped", _dropped(SEED), always=True),
        Fault("1 s black", lambda picture, _: np.zeros_like(picture), blind=True),
        Fault("hand over half", _hand),
        Fault("blur 9 px", _blur),
        Fault("20 % brightness", _brightness),
        Fault("turned by 90 degrees", move=Pose(yaw_deg=90.0)),
        Fault("jump of half a frame", move=Pose(x_m=half)),
    )


@dataclass(frozen=True, eq=False)
class FaultCourse:
    """One run: seconds, error px (NaN: lost), and sigma px of every frame. reset_counter: at the end."""

    fault: Fault
    seconds: FloatArray
    error_px: FloatArray
    sigma_px: FloatArray
    reset_counter: int

    @property
    def lost(self) -> int:
        return int(np.isnan(self.error_px).sum())

    @property
    def wrong(self) -> int:
        """Frames that were published although they are off."""
        return int(np.sum(self.error_px[1:] > _WRONG_PX))

    @property
    def recovery(self) -> int:
        """Frames lost in a row at most while the scene could be seen."""
        longest = run = 0
        for seconds, error in zip(self.seconds, self.error_px, strict=True):
            seen = not self.fault.blind or not BEGIN_S <= seconds < END_S
            run = run + 1 if math.isnan(error) and seen else 0
            longest = max(longest, run)
        return longest


def fly(fault: Fault, scene: SceneSettings, size: tuple[int, int], values: Mapping[str, Value],
        seed: int = SEED) -> FaultCourse:
    """A flight with one fault, tracked with default settings but for `values`."""
    gusts = () if fault.move is None else (Gust(BEGIN_S, 1e-6, fault.move),)
    scene = replace(scene, motion=replace(scene.motion, gusts=(*scene.motion.gusts, *gusts)))
    flight = Flight(scene, size=size, frames=int(STREAM_S * scene.fps), seed=seed)
    stabilizer = make_stabilizer(values)
    shown: list[int] = []
    tracks: dict[int, Track] = {}
    for shot in tqdm(flight, fault.name, disable=None, leave=False):
        spoilt = _spoilt(fault, shot, flight)
        if spoilt is not None:
            shown.append(shot.index)
            _keep(tracks, stabilizer.answers(Frame(spoilt, "mono8", shot.stamp_ns)), shown)
    _keep(tracks, stabilizer.finish(), shown)
    seconds = np.array([index / scene.fps for index in shown])
    error_px = np.array([_error_px(tracks[index], flight, size) for index in shown])
    sigma_px = np.array([tracks[index].sigma_px or math.nan for index in shown])
    return FaultCourse(fault, seconds, error_px, sigma_px, stabilizer.reset_counter)


def _spoilt(fault: Fault, shot: Shot, flight: Flight) -> Gray | None:
    seconds = shot.index / flight.preset.fps
    if shot.index == 0 or not (fault.always or BEGIN_S <= seconds < END_S):
        return shot.image
    return fault.spoil(shot.image, seconds - BEGIN_S)


def _keep(tracks: dict[int, Track], answers: Sequence[Track], shown: Sequence[int]) -> None:
    for track in answers:
        tracks[shown[track.index]] = track


def _error_px(track: Track, flight: Flight, size: tuple[int, int]) -> float:
    index = round((track.stamp_ns - flight.start_ns) * 1e-9 * flight.preset.fps)
    return math.nan if track.ref_H_cur is None else rms_distance(track.ref_H_cur, flight.ref_H_cur(index), size)


def measure(effort: Effort) -> Section:
    """All faults with the default method; the plot goes into docs/ where the effort is full."""
    scene = preset(PRESET)
    courses = [fly(fault, scene, SIZE, {}) for fault in faults(scene)]
    if effort.plots:
        plot(courses, PLOT)
    head = ("fault", "frames", "lost", "lost in a row, visible", "wrong (> 1 px)", "worst, px", "median after, px",
            "resets")
    rows = [_row(course) for course in courses]
    data = {course.fault.name: {"lost": course.lost, "recovery_frames": course.recovery, "wrong": course.wrong,
                                "worst_px": float(np.nanmax(course.error_px)), "after_px": _after_px(course),
                                "resets": course.reset_counter} for course in courses}
    note = f"{PRESET}, {SIZE[0]}x{SIZE[1]}, default settings; the fault from second 2 to 3, moves from second 2 on."
    return Section("Faults in the stream", [Table("State and error", head, rows, note)], data)


def _row(course: FaultCourse) -> tuple[str, ...]:
    return (course.fault.name, str(len(course.seconds)), str(course.lost), str(course.recovery), str(course.wrong),
            number(float(np.nanmax(course.error_px)), 3), number(_after_px(course), 4), str(course.reset_counter))


def _after_px(course: FaultCourse) -> float:
    return float(np.nanmedian(course.error_px[course.seconds >= END_S]))


def plot(courses: Sequence[FaultCourse], path: Path) -> None:
    """Error over time, one panel a fault; lost frames stand at the top."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(len(courses), 1, sharex=True, figsize=(9, 1.35 * len(courses)), dpi=110)
    for course, panel in zip(courses, panels, strict=True):
        lost = np.isnan(course.error_px)
        panel.axvspan(0 if course.fault.always else BEGIN_S,
                      STREAM_S if course.fault.always or course.fault.move else END_S, color="#f0e0d0")
        panel.semilogy(course.seconds, course.error_px, ".", ms=3, color="#1f6fb4")
        panel.semilogy(course.seconds[lost], np.full(lost.sum(), 1.0), "x", ms=5, color="#c0392b")
        panel.set_ylim(8e-4, 2)
        panel.set_ylabel("px", fontsize=8)
        panel.set_title(course.fault.name, fontsize=9, loc="left", pad=2)
        panel.tick_params(labelsize=8)
    panels[-1].set_xlabel("s (shaded: the fault; cross: LOST; dot: error of a published homography)", fontsize=8)
    figure.tight_layout()
    figure.savefig(path)
    pyplot.close(figure)
