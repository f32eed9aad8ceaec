"""The section of a live discharge, from parameters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

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


def test_misuse(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="section_file"):
        placed_section({})
    with pytest.raises(InputError, match=r"missing\.csv"):
        placed_section({"section_file": str(tmp_path / "missing.csv")})
    with pytest.raises(ConfigError, match="4 numbers"):
        placed_section({**written(tmp_path, "chainage,Z", "0,1", "1,0", "2,1"), "section_line": "1, 2"})
