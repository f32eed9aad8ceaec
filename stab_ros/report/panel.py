"""A figure of the report: an image with caption and alternative text."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from stab_ros.core.gray import grey_range, to_gray
from stab_ros.core.types import Frame, Gray, Image

WIDTH_IN, _DPI = 5.2, 150  # 11 pt text stays legible on a phone
REFERENCE_COLOR, PREVIOUS_COLOR, LOST_COLOR = "#1f5f99", "#e08214", "#c0392b"
_STREAM_COLORS = ("#1f6fb2", "#b2601a", "#3b8a4d", "#8a4d9e")  # the stabilised one first, as in the tables
_FONT_PT = 11
_JPEG_QUALITY = 75
_FEW_DECADES = 2.0
_LONGEST_NAME = 44  # characters that fit beside a line of a legend


@dataclass(frozen=True)
class Panel:
    """A figure. uri: the image as a data URI; None if there is nothing to draw, and the caption gives the reason."""

    title: str
    caption: str
    alt: str = ""
    uri: str | None = None


@dataclass(frozen=True)
class Section:
    """Figures under one heading. name: the anchor."""

    name: str
    title: str
    panels: Sequence[Panel]


def new_axes(height_in: float = 3.8) -> tuple[Figure, Axes]:
    """Axes on a new figure of the standard width, without global state."""
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=_DPI, layout="constrained")
    axes = figure.add_subplot()
    axes.tick_params(labelsize=_FONT_PT - 1)
    axes.grid(True, color="#d8d8d8", linewidth=0.6)
    axes.set_axisbelow(True)
    return figure, axes


def label(axes: Axes, x: str, y: str) -> None:
    """Labels the axes; the texts include units."""
    axes.set_xlabel(x, fontsize=_FONT_PT)
    axes.set_ylabel(y, fontsize=_FONT_PT)


def logarithmic(axes: Axes, which: Literal["x", "y"], low: float, high: float) -> None:
    """Sets a logarithmic scale from `low` to `high`, with plain numbers, several within a decade."""
    axes.set(**{f"{which}scale": "log", f"{which}lim": (low, high)})
    axis = axes.xaxis if which == "x" else axes.yaxis
    decades = math.log10(high / low)
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < _FEW_DECADES else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def legend(axes: Axes, columns: int = 1) -> None:
    """Draws the legend below the axes."""
    handles, names = axes.get_legend_handles_labels()
    if not handles:
        return
    axes.legend(handles, list(map(shortened, names)), fontsize=_FONT_PT - 1, loc="upper center", frameon=False,
                bbox_to_anchor=(0.5, -0.17), ncols=columns, handlelength=1.6, labelspacing=0.3)


def shortened(name: str) -> str:
    """The end of a long topic name, the part that differs from others."""
    return name if len(name) <= _LONGEST_NAME else "…" + name[1 - _LONGEST_NAME:]


def show_picture(axes: Axes, image: Image, extent_px: tuple[float, float, float, float] | None = None) -> None:
    """Shows an image with pixels as axes. extent_px: left, right, bottom and top, if it is a part of a larger one."""
    height, width = image.shape[:2]
    extent = extent_px or (-0.5, width - 0.5, height - 0.5, -0.5)
    axes.imshow(image, cmap="gray", vmin=0, vmax=255, extent=extent, interpolation="antialiased")
    axes.grid(False)
    label(axes, "x, px", "y, px")


def picture_height_in(width: float, height: float) -> float:
    """Height of a panel with an image of this size and its labels."""
    return min(8.0, (WIDTH_IN - 0.8) * height / width + 0.7)


def gray_of(frame: Frame) -> Gray:
    """The frame in gray, (h, w) uint8."""
    return to_gray(frame, grey_range(frame))


def stream_color(index: int) -> str:
    """The colour of a stream; that of the stabilised one is the same with and without the raw one."""
    return _STREAM_COLORS[index % len(_STREAM_COLORS)]


def drawn(figure: Figure, title: str, caption: str, alt: str, photo: bool = False) -> Panel:
    """The panel of a finished figure; a `photo` is stored as JPEG, at a tenth of the size of PNG."""
    kind, options = ("jpeg", {"quality": _JPEG_QUALITY}) if photo else ("png", {})
    with io.BytesIO() as file:
        figure.savefig(file, format=kind, pil_kwargs=options)
        return Panel(title, caption, alt, data_uri(f"image/{kind}", file.getvalue()))


def data_uri(mime: str, content: bytes) -> str:
    """Content embedded in the page, as a data URI."""
    return f"data:{mime};base64,{base64.b64encode(content).decode('ascii')}"
