"""GeoTIFFs, read back by GDAL (rasterio)."""

from pathlib import Path

import numpy as np
import pytest
import rasterio

from stab_ros.core.types import Image
from stab_ros.georeferencing.ortho_grid import OrthoGrid
from stab_ros.io.geotiff import write_geotiff

GRID = OrthoGrid(-12.5, 30.0, 0.025, 401, 300)
TO_UTM = np.array([[0.9996, 0.0123, 571234.5678], [-0.0123, 0.9996, 6123456.7891]])


def _image(dtype: type[np.uint8 | np.uint16], *channels: int) -> Image:
    return np.random.default_rng(0).integers(0, np.iinfo(dtype).max, (300, 401, *channels)).astype(dtype)


@pytest.mark.parametrize(("encoding", "image", "bands"), [
    ("mono8", _image(np.uint8), [0]), ("mono16", _image(np.uint16), [0]), ("bgr8", _image(np.uint8, 3), [2, 1, 0]),
    ("rgb8", _image(np.uint8, 3), [0, 1, 2]), ("bgra8", _image(np.uint8, 4), [2, 1, 0, 3])])
def test_gdal_reads_the_same_pixels_at_the_same_places(tmp_path: Path, encoding: str, image: Image,
                                                       bands: list[int]) -> None:
    path = tmp_path / "ortho.tif"
    write_geotiff(path, image, encoding, GRID, TO_UTM, 32630)
    with rasterio.open(path) as found:
        assert found.crs.to_epsg() == 32630
        assert found.nodata == 0
        assert found.tags()["AREA_OR_POINT"] == "Area"
        wanted = image[None] if image.ndim == 2 else np.moveaxis(image[..., bands], -1, 0)
        assert (found.read() == wanted).all()
        for row, column in ((0, 0), (299, 400), (17, 231)):
            place = TO_UTM @ GRID.map_H_ortho @ [column, row, 1]
            assert np.abs(np.array(found.xy(row, column)) - place).max() < 1e-8  # of the pixel's centre


def test_local_coordinates_have_no_reference_system_on_earth(tmp_path: Path) -> None:
    path = tmp_path / "ortho.tif"
    write_geotiff(path, _image(np.uint8), "mono8", GRID, np.eye(2, 3), None)
    with rasterio.open(path) as found:
        assert found.crs is None or found.crs.to_epsg() is None
        assert found.xy(0, 0) == pytest.approx((-12.4875, 29.9875), abs=1e-12)
    assert [file.name for file in tmp_path.iterdir()] == ["ortho.tif"]
