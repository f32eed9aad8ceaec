"""Synthetic flights, rendered once into memory, with the truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from tqdm import tqdm

from stab_ros.core.types import BoolArray, FloatArray, Frame, Homography
from stab_ros.synthetic.flight import Flight, preset

HD, UHD = (1920, 1080), (4096, 2160)
SEED = 1


@dataclass(frozen=True, eq=False)
class Scene:
    """frames: mono8, the first is the reference. truth: the `ref_H_cur` of each. water: (h, w), in the reference.

    control_points_px: (n, 2), in the reference.
    """

    frames: tuple[Frame, ...]
    truth: tuple[Homography, ...]
    water: BoolArray
    control_points_px: FloatArray

    @property
    def size(self) -> tuple[int, int]:
        return self.frames[0].size

    def back_and_forth(self, count: int) -> Iterator[tuple[Frame, Homography]]:
        """`count` frames 0 1 2 ... n-2 n-1 n-2 ... 1 0 1 ..., so that the camera never jumps; stamps go on."""
        turn = len(self.frames) - 1
        step_ns = self.frames[1].stamp_ns - self.frames[0].stamp_ns
        for number in range(count):
            index = turn - abs(turn - number % (2 * turn))
            stamp_ns = self.frames[0].stamp_ns + number * step_ns
            yield replace(self.frames[index], stamp_ns=stamp_ns), self.truth[index]


def render(name: str, size: tuple[int, int], count: int) -> Scene:
    """The first `count` frames of a preset's flight; a progress bar on a terminal."""
    flight = Flight(preset(name), size=size, frames=count, seed=SEED)
    shots = list(tqdm(flight, f"render {name} {size[0]}x{size[1]}", disable=None, leave=False))
    frames = tuple(Frame(shot.image, "mono8", shot.stamp_ns) for shot in shots)
    return Scene(frames, tuple(shot.ref_H_cur for shot in shots), flight.water, flight.control_points_px)
