"""What velocimetry tells of an interval, as messages; the same bytes live and offline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stab_ros.io.cdr import Header
from stab_ros.io.georeference_messages import MAP_FRAME
from stab_ros.io.image_message import image_cdr
from stab_ros.io.marker_message import arrows_cdr
from stab_ros.io.velocity_grid_message import velocity_grid_cdr
from stab_ros.io.velocity_message import velocity_cdr
from stab_ros.velocimetry.arrow_picture import arrow_picture, speed_colours
from stab_ros.velocimetry.grid import VelocityGrid, on_grid
from stab_ros.velocimetry.grid_side import side_for
from stab_ros.velocimetry.velocimeter import Measured

_LONGEST = 1.5  # arrow of the fastest water, in cells of the grid
_WIDTH = 0.1  # of arrows, in cells


@dataclass(frozen=True, eq=False)
class IntervalMessages:
    """CDR bytes: `velocity`, `velocity_grid` and `~/markers`."""

    velocity: bytes
    grid: bytes
    markers: bytes


def velocity_header(measured: Measured) -> Header:
    """At the time of the last frame: in the map; in the camera's frame where lengths are in pixels."""
    frame_id = MAP_FRAME if measured.vectors.unit == "m" else measured.frame.frame_id
    return Header(measured.stamp_ns, frame_id)


def image_velocity_cdr(measured: Measured) -> bytes:
    """Image: arrows on the picture of the last frame."""
    return image_cdr(arrow_picture(measured.placed, measured.vectors), "bgr8",
                     Header(measured.placed.stamp_ns, measured.frame.frame_id))


class VelocityMessages:
    """Makes the messages of the intervals of a stream, in order: on one grid, its arrows on one scale."""

    def __init__(self, cell_m: float) -> None:
        """cell_m: side of the cells of the grid; 0: what suits the first vectors."""
        self._cell_m = cell_m
        self._longest_m_s = 0.0  # so far

    def grid_of(self, measured: Measured) -> VelocityGrid:
        """The velocities of the next interval on the grid."""
        if not self._cell_m and len(measured.vectors):
            self._cell_m = side_for(measured.vectors)
        return on_grid(measured.vectors, self._cell_m or 1.0)

    def of(self, measured: Measured) -> IntervalMessages:
        """The messages of the next interval."""
        grid, header = self.grid_of(measured), velocity_header(measured)
        return IntervalMessages(velocity_cdr(measured.vectors, measured.wse_m, header, measured.scale_wse_m),
                                velocity_grid_cdr(grid, measured.wse_m, header), self._arrows(grid, measured, header))

    def _arrows(self, grid: VelocityGrid, measured: Measured, header: Header) -> bytes:
        """An arrow from the middle of each cell, coloured from blue (0) to red (the fastest so far)."""
        speed_m_s = np.hypot(*grid.median_m_s.T)
        self._longest_m_s = max(self._longest_m_s, float(speed_m_s.max(initial=0)))
        scale = _LONGEST * grid.side_m / self._longest_m_s if self._longest_m_s else 0.0
        z = np.full(len(grid.count), measured.wse_m)
        starts = np.column_stack([grid.centre_m, z])
        ends = np.column_stack([grid.centre_m + scale * grid.median_m_s, z])
        colours = speed_colours(speed_m_s, self._longest_m_s)
        return arrows_cdr(starts, ends, colours, _WIDTH * grid.side_m, header)
