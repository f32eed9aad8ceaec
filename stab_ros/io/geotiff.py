"""GeoTIFF (OGC 19-008r4): an orthophoto with its place in a reference system, for GIS."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import tifffile

from stab_ros.core.errors import WorkError
from stab_ros.core.types import FloatArray, Image
from stab_ros.georeferencing.ortho_grid import OrthoGrid
from stab_ros.io.outputs import partial_of

_TRANSFORMATION, _KEYS, _TEXTS, _NODATA = 34264, 34735, 34737, 42113  # TIFF tags; the last is GDAL's
_SHORT, _DOUBLE, _ASCII = 3, 12, 2  # types of TIFF
_MODEL_TYPE, _RASTER_TYPE, _CITATION, _PROJECTED, _UNITS = 1024, 1025, 1026, 3072, 3076  # geokeys
_IS_PROJECTED, _USER_DEFINED, _PIXEL_IS_AREA, _METRE = 1, 32767, 1, 9001
_LOCAL = "local east, north in metres"
_TILE = (256, 256)
_TO_RGB = {"bgr8": [2, 1, 0], "bgra8": [2, 1, 0, 3]}


def write_geotiff(path: Path, image: Image, encoding: str, grid: OrthoGrid, crs_A_map: FloatArray,
                  epsg: int | None) -> None:
    """Writes an orthophoto; `path` appears when it is complete.

    Args:
        path: *.tif.
        image: (rows, columns) or (rows, columns, channels), on the grid; 0 where nothing is seen.
        encoding: of the image, as of `Frame`.
        grid: its places in the map.
        crs_A_map: (2, 3), affine, from east and north of the map to easting and northing of the reference system.
        epsg: code of the projected reference system; None: local coordinates.

    Raises:
        WorkError: it cannot be written.
    """
    partial = partial_of(path)
    channels = _TO_RGB.get(encoding)
    pixels = image if channels is None else image[..., channels]
    photometric: Any = "rgb" if image.ndim == 3 else "minisblack"
    alpha: Any = ["unassalpha"] if image.ndim == 3 and image.shape[2] == 4 else None
    try:
        tifffile.imwrite(partial, np.ascontiguousarray(pixels), photometric=photometric, extrasamples=alpha, tile=_TILE,
                         compression="zlib", metadata=None, extratags=_tags(grid, crs_A_map, epsg))
        partial.replace(path)
    except OSError as error:
        raise WorkError(f"{path}: cannot be written ({error.strerror}); the unfinished file is {partial}") from error


def _tags(grid: OrthoGrid, crs_A_map: FloatArray, epsg: int | None) -> list[tuple[int, int, int, Any, bool]]:
    """Tags as tifffile takes them: code, type, count, value, whether for the first page only."""
    r = grid.resolution_m
    map_A_raster = np.array([[r, 0, grid.west_m], [0, -r, grid.north_m], [0, 0, 1]])  # from the pixels' corners
    A = crs_A_map @ map_A_raster
    transformation = np.eye(4)
    transformation[:2, [0, 1, 3]] = A
    transformation[2, 2] = 0
    text = "" if epsg is not None else _LOCAL + "|"
    keys = [(_MODEL_TYPE, 0, 1, _IS_PROJECTED if epsg is not None else _USER_DEFINED),
            (_RASTER_TYPE, 0, 1, _PIXEL_IS_AREA)]
    keys += [(_PROJECTED, 0, 1, epsg)] if epsg is not None else [(_CITATION, _TEXTS, len(text), 0)]
    keys += [(_UNITS, 0, 1, _METRE)]
    directory = [1, 1, 1, len(keys), *(number for key in keys for number in key)]
    tags: list[tuple[int, int, int, Any, bool]] = [
        (_TRANSFORMATION, _DOUBLE, 16, tuple(transformation.ravel().tolist()), True),
        (_KEYS, _SHORT, len(directory), tuple(directory), True), (_NODATA, _ASCII, 0, "0", True)]
    return [*tags, (_TEXTS, _ASCII, 0, text, True)] if text else tags
