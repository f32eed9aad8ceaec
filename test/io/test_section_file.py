"""Cross-sections as people write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stab_ros.core.errors import InputError
from stab_ros.io.section_file import read_section

PLACES = {
    "KLT-IV": "X,Y,Z\n1.5,2.5,3.5\n4,5,6\n",
    "semicolons, decimal commas, a mark": "\ufeffEasting;Northing;Elevation (m)\n1,5;2,5;3,5\n4;5;6\n",
    "tabs, other order": "Z [m]\tname\tY [m]\tX [m]\n3.5\ta\t2.5\t1.5\n6\tb\t5\t4\n",
    "quotes and comments": '# survey\n"x_m", "y_m", "bed_elevation_m"\n1.5, 2.5, 3.5\n\n4, 5, 6\n',
}
CHAINED = {
    "chainage": "Chainage,Depth\n0,0\n3.048,1.524\n",
    "feet": "Station (ft);Depth_ft\n0;0\n10;5,0\n",
    "feet, mixed": "distance [feet],water depth m\n0,0\n10,1.524\n",
    "US survey feet": "Station (US ft);depth US-ft\n0;0\n9.99998;4.99999\n",
    "a datum": "chainage (m),depth (m NAVD88)\n0,0\n3.048,1.524\n",
    "centimetres": "d,depth (cm)\n0,0\n3.048,152.4\n",
}


def section(tmp_path: Path, text: str, encoding: str = "utf-8") -> Path:
    path = tmp_path / "section.csv"
    path.write_text(text, encoding=encoding)
    return path


@pytest.mark.parametrize("form", PLACES)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_places(tmp_path: Path, form: str, encoding: str) -> None:
    text = PLACES[form].removeprefix("\ufeff" if encoding == "utf-16" else "")  # which that encoding adds itself
    table = read_section(section(tmp_path, text, encoding))
    assert table.position_m is not None
    assert table.position_m.tolist() == [[1.5, 2.5], [4, 5]]
    assert table.height_m.tolist() == [3.5, 6]
    assert (table.heights, table.chainage_m, table.remarks) == ("elevation", None, ())


@pytest.mark.parametrize("form", CHAINED)
def test_chainages(tmp_path: Path, form: str) -> None:
    table = read_section(section(tmp_path, CHAINED[form]))
    assert table.chainage_m == pytest.approx(np.array([0, 3.048]))
    assert table.height_m == pytest.approx(np.array([0, 1.524]))
    assert (table.heights, table.position_m) == ("depth", None)
    assert any("feet" in remark for remark in table.remarks) == ("feet" in form)


@pytest.mark.parametrize(("unit", "unit_m"), [
    ("", None), (" (m)", 1.0), (" (ft)", 0.3048), (" (ftUS)", 1200 / 3937), (" [us survey feet]", 1200 / 3937),
    ("_ft", 0.3048), (" us_ft", 1200 / 3937)])
def test_the_unit_of_places_is_kept_for_their_reference_system(tmp_path: Path, unit: str, unit_m: float | None) -> None:
    table = read_section(section(tmp_path, f"X{unit},Y{unit},Z (m)\n1000,2000,3\n"))
    assert table.position_m is not None
    assert table.position_m == pytest.approx(np.array([[1000, 2000]]) * (unit_m or 1))
    assert (table.unit_m, table.height_m.tolist()) == (unit_m, [3])


def test_points_that_are_repeated_count_once_and_this_is_said(tmp_path: Path) -> None:
    """The first of each stays where it is; points in one place at two heights are a wall."""
    table = read_section(section(tmp_path, "chainage,Z\n4,1\n4,1\n0,3\n2,5\n4,1.0\n2,6\n0,3\n"))
    assert table.chainage_m is not None
    found = list(zip(table.chainage_m.tolist(), table.height_m.tolist(), strict=True))
    assert found == [(4, 1), (0, 3), (2, 5), (2, 6)]
    assert [one.split(": ")[1] for one in table.remarks] == ["3 rows repeat a point, which counts once"]


@pytest.mark.parametrize("text", ["0,1\n1,2\n", "X,Y,Z/Depth\n0,0,1\n", "d,h\n0,1\n", "1,2,3\n2,3,4\n"])
def test_what_does_not_tell_elevation_from_depth(tmp_path: Path, text: str) -> None:
    assert read_section(section(tmp_path, text)).heights == "unknown"


@pytest.mark.parametrize(("text", "says"), [
    ("", "is empty"), ("X,Y,Z\n", "holds no point"), ("a,b\n1,2\n", "no columns of a cross-section"),
    ("X,Y,Z\n1,2\n", "is no number"), ("X,Y,Z\n1,2,nan\n", "is no number"), ("X,Y,Z\n1,5,2,5,3,5\n", "semicolons"),
    ("lat,lon,Z\n1,2,3\n", "latitudes"), ("chainage (yd),Z\n1,2\n", "unit that is not known"),
    ("X (ft),Y,Z\n1,2,3\n", r"X \(ft\) and Y must be in one unit"),
    ("X,Y (ft),Z\n1,2,3\n", r"X and Y \(ft\) must be in one unit"),
    ("X (m),Y,Z\n1,2,3\n", "both or neither"), ("X (ft),Y (m),Z (m)\n1,2,3\n", "in one unit"),
    ("X (ft),Y (ft),Z\n1,2,3\n", r"the column Z must name its unit, as X \(ft\) does"),
    ("station (ft),depth\n1,2\n", "the column depth must name its unit"), ("X (N),Y,Z\n1,2,3\n", "two axes"),
    ("distance,depth (ft)\n1,2\n", "the column distance must name its unit"),
    ("X,Y,Z,depth\n1,2,3,4\n", "Z and depth are two columns"), ("1,2,3,4\n", "4 columns without a header"),
])
def test_no_sections(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        read_section(section(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_section(tmp_path / "none.csv")
