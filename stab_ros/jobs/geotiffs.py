"""GeoTIFFs of a recording: the first and the last placed frame of each interval."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray
from stab_ros.georeferencing.georeferencer import Georeferenced, Georeferencer
from stab_ros.georeferencing.local_frame import LOCAL, projected_code
from stab_ros.georeferencing.ortho_grid import OrthoGrid
from stab_ros.io.geotiff import write_geotiff

# from the middle of the grid: the affine map (2, 3) from the map to the reference system, and its EPSG code
ToCrs = Callable[[FloatArray], tuple[FloatArray, int | None]]


def _to_crs_of(engine: Georeferencer, crs: str) -> ToCrs:
    """From the map of an engine to a reference system, an EPSG code or local.

    Raises:
        InputError: on the first use, where the origin of the map is not known, or the system is not a projected one.
    """
    if crs == LOCAL:
        return lambda _middle_m: (np.eye(2, 3), None)

    def to_crs(middle_m: FloatArray) -> tuple[FloatArray, int | None]:
        if engine.local_frame is None:
            raise InputError(f"crs {crs}: where the map is on the Earth is not known, give its origin")
        return engine.local_frame.affine_to_crs(crs, np.append(middle_m, engine.wse_m)), projected_code(crs)

    return to_crs


class GeoTiffs:
    """Writes `ortho_<stamp>.tif` into a folder. An interval begins with the first placed frame after the one before.

    Attributes:
        crs: the reference system of the files, an EPSG code or local.
        written: number of files so far.
    """

    def __init__(self, folder: Path, interval_s: float | None, engine: Georeferencer, crs: str) -> None:
        """Makes the folder.

        Args:
            folder: of the files.
            interval_s: None: the whole recording is one interval.
            engine: makes the orthophotos.
            crs: of the files.

        Raises:
            InputError: the folder cannot be made.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder}: cannot be made ({error.strerror}), --geotiff must name a folder") from error
        self.crs = crs
        self._folder, self._make_image, self._to_crs = folder, engine.orthophoto, _to_crs_of(engine, crs)
        self._interval_ns = None if interval_s is None else round(interval_s * 1e9)
        self._begin_ns: int | None = None
        self._last: Georeferenced | None = None  # of the interval, not written yet
        self.written = 0

    def take(self, answer: Georeferenced) -> None:
        """Takes the next frame.

        Raises:
            WorkError: a file cannot be written.
        """
        if answer.placement is None:
            return
        stamp_ns = answer.frame.stamp_ns
        if self._begin_ns is None or (self._interval_ns is not None
                                      and stamp_ns - self._begin_ns >= self._interval_ns):
            self.finish()
            self._begin_ns = stamp_ns
            self._write(answer)
        else:
            self._last = answer

    def finish(self) -> None:
        """Writes the last frame of the last interval."""
        if self._last is not None:
            self._write(self._last)
            self._last = None

    def _write(self, answer: Georeferenced) -> None:
        image, grid = self._make_image(answer), answer.grid
        if image is None or grid is None:
            return
        crs_A_map, epsg = self._to_crs(_middle_m(grid))
        path = self._folder / f"ortho_{answer.frame.stamp_ns}.tif"
        write_geotiff(path, image, answer.frame.warped_encoding, grid, crs_A_map, epsg)
        self.written += 1


def _middle_m(grid: OrthoGrid) -> FloatArray:
    r = grid.resolution_m / 2
    return np.array([grid.west_m + grid.columns * r, grid.north_m - grid.rows * r])
