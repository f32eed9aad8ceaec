"""The velocities as arrows over the first picture, to which all others are stabilised."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from stab_ros.core.errors import WorkError
from stab_ros.core.types import FloatArray, Image
from stab_ros.demo.flow import Flow
from stab_ros.demo.replay import STABILIZED
from stab_ros.demo.water import SECTION_FROM_M, SECTION_TO_M
from stab_ros.io.bag import open_bag
from stab_ros.io.cdr import IMAGE
from stab_ros.io.image_message import read_image
from stab_ros.velocimetry.arrow_picture import speed_colours
from stab_ros.velocimetry.grid import on_grid

_CELL_M = 1.2  # an arrow each: the median of its vectors
_LENGTH_S = 0.9  # of an arrow: the way of the water in this time
_FASTEST_M_S = 1.5  # end of the scale
_TICKS_M_S = (0.0, 0.5, 1.0, 1.5)
_SCALE_PX = (300, 12)  # of its bar
_BAND_PX = 64
_FINE = 4  # fractional bits of coordinates, as OpenCV takes them
_WHITE = (255, 255, 255)


def draw_flow(path: Path, recorded: Path, flow: Flow) -> None:
    """Writes the picture.

    Raises:
        WorkError: it cannot be written, or the bag holds no stabilised picture.
    """
    image = _reference(recorded)
    _draw_section(image, flow)
    grid = on_grid(flow.water, _CELL_M)
    tips_m = grid.centre_m + _LENGTH_S * grid.median_m_s
    tails, tips = (flow.known.pixels(places) for places in (grid.centre_m, tips_m))
    colours = _colours(np.hypot(grid.median_m_s[:, 0], grid.median_m_s[:, 1]))
    for tail, tip, colour in zip(tails, tips, colours, strict=True):
        cv2.arrowedLine(image, _fine(tail), _fine(tip), colour, 2, cv2.LINE_AA, _FINE, 0.35)
    if not cv2.imwrite(str(path), np.vstack([image, _legend(image.shape[1], flow)])):
        raise WorkError(f"{path}: cannot be written")


def _reference(recorded: Path) -> Image:
    """The first stabilised picture, which is the reference itself, darker."""
    with open_bag(recorded) as bag:
        first = next(iter(bag.messages({STABILIZED} & set(bag.topics))), None)
    if first is None:
        raise WorkError(f"{recorded}: holds no picture of {STABILIZED} to draw velocities on")
    return np.asarray(read_image(first.data, IMAGE).image * 0.65, np.uint8)


def _draw_section(image: Image, flow: Flow) -> None:
    start, end = flow.known.pixels(np.stack([SECTION_FROM_M, SECTION_TO_M]))
    cv2.line(image, _fine(start), _fine(end), _WHITE, 1, cv2.LINE_AA, _FINE)
    _write(image, "section", (round(end[0]) + 8, round(end[1]) + 12))


def _legend(width: int, flow: Flow) -> Image:
    """A band with the scale of speed and the figures."""
    band = np.full((_BAND_PX, width, 3), 32, np.uint8)
    (length, height), (left, top) = _SCALE_PX, (16, 14)
    shades = _colours(np.linspace(0, _FASTEST_M_S, length))
    band[top:top + height, left:left + length] = np.array(shades)[None]
    for tick in _TICKS_M_S:
        _write(band, f"{tick:g}", (left + round(tick / _FASTEST_M_S * length) - 8, top + height + 20))
    _write(band, "m/s", (left + length + 24, top + height + 20))
    (speed, true), found = flow.medians_m_s, flow.discharge
    _write(band, f"median {speed:.3f} m/s (truth {true:.3f})", (left + length + 90, 24))
    _write(band, f"discharge {found.q_m3_s:.1f} m3/s, 95 % {found.low_m3_s:.1f} to {found.high_m3_s:.1f} "
           f"(truth {flow.true_m3_s:.1f})", (left + length + 90, 48))
    return band


def _colours(speed_m_s: FloatArray) -> list[tuple[float, float, float]]:
    """Blue, green and red of speeds (n,), 0 to 255."""
    return [(blue, green, red) for red, green, blue in (255 * speed_colours(speed_m_s, _FASTEST_M_S)).tolist()]


def _write(image: Image, text: str, place: tuple[int, int]) -> None:
    cv2.putText(image, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, _WHITE, 1, cv2.LINE_AA)


def _fine(point: FloatArray) -> tuple[int, int]:
    x, y = np.round(point * 2**_FINE).astype(int).tolist()
    return x, y
