"""The section of a live discharge, from parameters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS, Transformer

from stab_ros.core.errors import ConfigError, InputError
from stab_ros.core.settings import Value
from stab_ros.georeferencing.local_frame import LocalFrame
from stab_ros.jobs.placed_section import placed_section


def written(tmp_path: Path, header: str, *rows: str) -> dict[str, Value]:
    path = tmp_path / "section.csv"
    path.write_text("\n".join([header, *rows]))
    return {"section_file": str(path)}


def test_by_chainage_with_depths_along_a_line(tmp_path: Path) -> None:
    given = written(tmp_path, "chainage,depth", "0,0", "5,2", "10,0")
    with pytest.raises(ConfigError, match="section_line"):
        placed_section(given)
    given["section_line"] = "1, 2, 1, 12"
    with pytest.raises(ConfigError, match="wse_m: is not given"):
        placed_section(given)
    section, _ = placed_section({**given, "wse_m": 54.5})
    np.testing.assert_allclose(section.bed_m, [54.5, 52.5, 54.5])
    np.testing.assert_allclose(section.position_m, [[1, 2], [1, 7], [1, 12]])


def test_heights_that_are_not_told(tmp_path: Path) -> None:
    given = written(tmp_path, "X,Y,h", "0,0,54", "0,5,52", "0,10,54")
    with pytest.raises(ConfigError, match="heights"):
        placed_section(given)
    section, _ = placed_section({**given, "heights": "elevation"})
    np.testing.assert_allclose(section.bed_m, [54, 52, 54])


def test_in_a_reference_system(tmp_path: Path) -> None:
    origin = LocalFrame(46.95, 7.45, 550.0)
    here = LocalFrame(46.9501, 7.4501, 550.0)
    east, north, _ = origin.from_geodetic(np.array([[here.latitude_deg, here.longitude_deg, here.height_m]]))[0]
    rows = [f"{here.longitude_deg + 1e-5 * k:.9f},{here.latitude_deg:.9f},{54 - k % 2}" for k in range(3)]
    given = {**written(tmp_path, "X,Y,Z", *rows), "crs": "EPSG:4326"}
    with pytest.raises(ConfigError, match="origin"):
        placed_section(given)
    section, _ = placed_section({**given, "origin": "46.95, 7.45, 550"})
    np.testing.assert_allclose(section.position_m[0], [east, north], atol=0.01)


def test_what_is_for_distances_alone_is_refused_beside_places(tmp_path: Path) -> None:
    given = written(tmp_path, "X,Y,Z", "0,0,54", "0,5,52", "0,10,54")
    for one in ({"section_line": "1, 2, 1, 12"}, {"section_start_m": 5.0}):
        with pytest.raises(ConfigError, match="has places of its own"):
            placed_section({**given, **one})


@pytest.mark.parametrize(("header", "unit_m", "says"), [
    ("X,Y,Z", 1200 / 3937, ""), ("X (m),Y (m),Z", 1.0, ""), ("X (US ft),Y (US ft),Z (m)", 1200 / 3937, "made metres"),
    ("X (ft),Y (ft),Z (m)", 1200 / 3937, "the feet of the section are taken for those of EPSG:2225, of 0.304800610 m")])
def test_in_a_reference_system_in_feet(tmp_path: Path, header: str, unit_m: float, says: str) -> None:
    """The places by pyproj alone."""
    north_m = np.array([0.0, 5, 10])
    plane = CRS.from_proj4("+proj=aeqd +lat_0=39 +lon_0=-121.5 +datum=WGS84 +units=m")
    east_ft, north_ft = Transformer.from_crs(plane, CRS("EPSG:2225"), always_xy=True).transform(0 * north_m, north_m)
    places = np.column_stack([east_ft, north_ft]) * (1200 / 3937) / unit_m
    rows = [f"{x!r},{y!r},{z}" for (x, y), z in zip(places.tolist(), (54, 52, 54), strict=True)]
    section, said = placed_section({**written(tmp_path, header, *rows), "crs": "EPSG:2225", "origin": "39, -121.5, 0"})
    np.testing.assert_allclose(section.position_m, np.column_stack([0 * north_m, north_m]), atol=1e-3)
    assert says in " ".join(said)
    assert bool(says) == bool(said)


def test_lengths_are_no_degrees(tmp_path: Path) -> None:
    given = written(tmp_path, "X (ft),Y (ft),Z (ft)", "0,0,54", "0,5,52", "0,10,54")
    with pytest.raises(InputError, match="coordinates must not be lengths"):
        placed_section({**given, "crs": "EPSG:4326", "origin": "39, -121.5, 0"})


def test_misuse(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="section_file"):
        placed_section({})
    with pytest.raises(InputError, match=r"missing\.csv"):
        placed_section({"section_file": str(tmp_path / "missing.csv")})
    with pytest.raises(ConfigError, match="4 numbers"):
        placed_section({**written(tmp_path, "chainage,Z", "0,1", "1,0", "2,1"), "section_line": "1, 2"})
