"""Tables of control points as people write them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stab_ros.core.errors import InputError
from stab_ros.io.gcp_file import read_gcps

PX = np.array([[10.5, 20], [1800, 900.25], [400, 500]])
PLACES = np.array([[1.25, 2.5, 0.5], [30.0, -40, 1], [7, 8, 9.75]])
FORMS = {
    "ours": "name,x,y,X,Y,Z\nA,10.5,20,1.25,2.5,.5\nB,1800,900.25,30,-40,1\nC,400,500,7,8,9.75\n",
    "semicolons and decimal commas": "name;x;y;X;Y;Z\nA;10,5;20;1,25;2,5;0,5\nB;1800;900,25;30;-40;1\n"
                                     "C;400;500;7;8;9,75\n",
    "tabs, other order": "X\tY\tZ\tID\tu\tv\n1.25\t2.5\t.5\tA\t10.5\t20\n30\t-40\t1\tB\t1800\t900.25\n"
                         "7\t8\t9.75\tC\t400\t500",
    "no header": "A,10.5,20,1.25,2.5,.5\nB,1800,900.25,30,-40,1\nC,400,500,7,8,9.75",
    "comments, quotes, spaces": '# survey\n\n"name", "x", "y", "easting", "northing", "elevation"\n'
                                '"A", 10.5, 20, 1.25, 2.5, .5\nB, 1800, 900.25, 30, -40, 1\n\n'
                                "C, 400, 500, 7, 8, 9.75\n",
    "more columns": "name,code,x,y,X,Y,Z,sd\nA,gcp,10.5,20,1.25,2.5,.5,0\nB,gcp,1800,900.25,30,-40,1,0\n"
                    "C,gcp,400,500,7,8,9.75,0\n",
}
KLT_IV = ('"X [meters]","Y [meters]","Z [meters]","X [px]","Y [px]"\n1.25,2.5,.5,11.5,21\n30,-40,1,1801,901.25\n'
          "7,8,9.75,401,501\n")
KLT_IV_FRAMES = ('"flight.mp4","1","","",""\n"Frame","1","","",""\n1.25,2.5,.5,11.5,21\n30,-40,1,1801,901.25\n'
                 '7,8,9.75,401,501\n"","","","",""\n"Frame","00026","","",""\n1.25,2.5,.5,99,99\n')


def written(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.write_text(text, encoding=encoding)
    return path


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_forms_are_one(form: str, encoding: str, tmp_path: Path) -> None:
    table = read_gcps(written(tmp_path / "g.csv", FORMS[form], encoding))
    assert table.names == ("A", "B", "C")
    assert np.array_equal(table.image_px, PX)
    assert np.array_equal(table.places, PLACES)
    assert not table.geographic


@pytest.mark.parametrize("text", [KLT_IV, KLT_IV_FRAMES])
def test_tables_of_klt_iv_have_no_names_and_count_pixels_from_one(text: str, tmp_path: Path) -> None:
    table = read_gcps(written(tmp_path / "g.csv", text))
    assert table.names == ("G1", "G2", "G3")
    assert np.array_equal(table.image_px, PX)
    assert np.array_equal(table.places, PLACES)
    assert any("counted from 1" in remark for remark in table.remarks)


@pytest.mark.parametrize(("head", "metres"), [
    ("X (ft),Y (ft),Z (ft)", (0.3048, 0.3048, 0.3048)), ("X [mm],Y [mm],Z [mm]", (0.001, 0.001, 0.001)),
    ("X [km],Y [km],Z [km]", (1000, 1000, 1000)), ("X,Y,Z [ft]", (1, 1, 0.3048)), ("X,Y,Z_ft", (1, 1, 0.3048)),
    ("Easting [US ft],Northing [US ft],Z [m]", (1200 / 3937, 1200 / 3937, 1)), ("E_ft,N_ft,h ft", (0.3048,) * 3),
    ("X (m),Y (m),Z [m a.s.l.]", (1, 1, 1)), ("x [Feet],y [Feet],elevation (masl)", (0.3048, 0.3048, 1)),
])
def test_units_of_the_header_become_metres_and_are_said(head: str, metres: tuple[float, ...], tmp_path: Path) -> None:
    table = read_gcps(written(tmp_path / "g.csv", f"name,u [px],v_px,{head}\nA,1,2,100,-200,3\n"))
    np.testing.assert_allclose(table.places, [np.array([100, -200, 3]) * metres], rtol=1e-15)
    assert np.array_equal(table.image_px, [[1, 2]])
    assert any("made metres" in remark for remark in table.remarks) == (set(metres) != {1})
    assert table.unit_m == (None if "X,Y" in head else metres[0])


@pytest.mark.parametrize("unit", ["ft US", "ft-us", "feet US survey", "foot_US", "U.S. survey feet", "US_FT", "ftUS",
                                  "survey ft", "US ft, NAVD88"])
def test_feet_with_us_or_survey_are_us_survey_feet(unit: str, tmp_path: Path) -> None:
    table = read_gcps(written(tmp_path / "g.csv", f'u,v,"X ({unit})","Y [{unit}]","Z ({unit})"\n1,2,1e6,-2e6,3\n'))
    np.testing.assert_allclose(table.places, [np.array([1e6, -2e6, 3]) * 1200 / 3937], rtol=1e-15)


@pytest.mark.parametrize("unit", ["ft us", "US ft", "us_survey_feet", "foot_US", "FT-US"])
def test_us_survey_feet_need_no_brackets(unit: str, tmp_path: Path) -> None:
    table = read_gcps(written(tmp_path / "g.csv", f"u,v,X {unit},Y_{unit},Z {unit}\n1,2,1e6,-2e6,3\n"))
    np.testing.assert_allclose(table.places, [np.array([1e6, -2e6, 3]) * 1200 / 3937], rtol=1e-15)


@pytest.mark.parametrize("head", [
    "Elevation (NAVD88)", "Elevation (MSL)", "height (AMSL)", "height [a.s.l.]", "Z (ellipsoidal)", "z (EGM96)",
    "Z (orthometric)", "z (up)", "Z (m, EGM2008)", "Z (NAVD 88 m)", "up (local)"])
def test_a_datum_beside_heights_is_no_unit(head: str, tmp_path: Path) -> None:
    table = read_gcps(written(tmp_path / "g.csv", f'name,u,v,X,Y,"{head}"\nA,1,2,3,4,5\n'))
    assert np.array_equal(table.places, [[3, 4, 5]])
    assert table.remarks == ()


@pytest.mark.parametrize("head", [
    "Easting (UTM 33N),Northing (UTM 33 N)", "X (east),Y (north)", "x (E),y (N)", "y (north),x (east)",
    "X (local),Y (local)", "x (WGS 84 / UTM zone 33N),y (WGS 84 / UTM zone 33N)", "X (EPSG:25833),Y (EPSG:25833)",
    "X (NAD83(2011)),Y (NAD83)", "x (ETRS89),y (ETRS89)"])
def test_axes_and_systems_beside_places_are_no_units(head: str, tmp_path: Path) -> None:
    table = read_gcps(written(tmp_path / "g.csv", f"name,x (col),y (row),{head}\nA,1,2,3,4\n"))
    swapped = head.startswith("y")
    assert np.array_equal(table.places[:, :2], [[4, 3] if swapped else [3, 4]])
    assert np.array_equal(table.image_px, [[1, 2]])
    assert table.unit_m is None


def test_an_axis_beside_a_name_tells_what_the_column_holds(tmp_path: Path) -> None:
    table = read_gcps(written(tmp_path / "g.csv", "x (row),y (col),X (north),Y (east)\n1,2,3,4\n"))
    assert np.array_equal(table.image_px, [[2, 1]])
    assert np.array_equal(table.places[:, :2], [[4, 3]])
    table = read_gcps(written(tmp_path / "g.csv", "x [image],Y (image),Lat (N),Lon (°E)\n1,2,3,4\n"))
    assert np.array_equal(table.image_px, [[1, 2]])
    assert table.geographic
    assert np.array_equal(table.places[:, :2], [[4, 3]])
    table = read_gcps(written(tmp_path / "g.csv", "u,v,lat (WGS84),lon (WGS84 deg),Z (NAVD88 US ft)\n1,2,3,4,3937\n"))
    np.testing.assert_allclose(table.places, [[4, 3, 1200]], rtol=1e-15)


def test_decimal_commas_within_quotes(tmp_path: Path) -> None:
    text = 'name,x,y,X,Y,Z\nA,"10,5",20,"1,25","2,5","0,5"\nB,1800,"900,25",30,-40,1\nC,400,500,7,8,"9,75"\n'
    table = read_gcps(written(tmp_path / "g.csv", text))
    assert np.array_equal(table.image_px, PX)
    assert np.array_equal(table.places, PLACES)
    with pytest.raises(InputError, match="'1,250' is no number"):  # it may be a thousand
        read_gcps(written(tmp_path / "g.csv", 'name,x,y,X,Y,Z\nA,10,20,"1,250",2,0\n'))
    with pytest.raises(InputError, match="'1,250' may be a thousand or, as '0,5', have a decimal comma"):
        read_gcps(written(tmp_path / "g.csv", 'name,x,y,X,Y,Z\nA,10,20,"1,250",2,"0,5"\n'))


def test_commas_beside_the_numbers_tell_nothing_of_them(tmp_path: Path) -> None:
    head = 'name,remark,x,y,X,Y,Z\n"12,5","3,25",10,20,'
    table = read_gcps(written(tmp_path / "g.csv", head + "1.25,2,0\n"))
    assert table.names == ("12,5",)
    assert np.array_equal(table.places, [[1.25, 2, 0]])
    with pytest.raises(InputError, match="'1,234' is no number"):
        read_gcps(written(tmp_path / "g.csv", head + '"1,234",2,0\n'))
    table = read_gcps(written(tmp_path / "g.csv", 'A,"10,5",20,"1234,567","0,250","-2,5"\n'))  # no header
    assert np.array_equal(table.image_px, [[10.5, 20]])
    assert np.array_equal(table.places, [[1234.567, 0.25, -2.5]])


def test_columns_that_may_hold_the_heights_are_named(tmp_path: Path) -> None:
    table = read_gcps(written(tmp_path / "g.csv", "name,x,y,X,Y,Hoehe\nA,1,2,3,4,5\n"))
    assert np.isnan(table.places[0, 2])
    assert table.remarks == ("there is no column of heights, as Z or height; not read: Hoehe",)


def test_latitude_and_longitude(tmp_path: Path) -> None:
    table = read_gcps(written(tmp_path / "g.csv", "name,x,y,lat,lon\nA,1,2,46.1,7.2\nB,3,4,46.2,7.3\n"))
    assert table.geographic
    assert np.array_equal(table.places[:, :2], [[7.2, 46.1], [7.3, 46.2]])
    assert np.isnan(table.places[:, 2]).all()


def test_geojson(tmp_path: Path) -> None:
    features = [{"type": "Feature", "properties": {"name": name, "x": x, "y": y},
                 "geometry": {"type": "Point", "coordinates": place}}
                for name, x, y, place in (("A", 1, 2.5, [7.2, 46.1, 500]), ("", 3, 4, [7.3, 46.2]))]
    document = {"type": "FeatureCollection", "features": features}
    table = read_gcps(written(tmp_path / "g.geojson", json.dumps(document)))
    assert table.names == ("A", "G2")
    assert table.geographic
    assert np.array_equal(table.places[0], [7.2, 46.1, 500])
    assert np.isnan(table.places[1, 2])
    swiss = {**document, "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::2056"}}}
    table = read_gcps(written(tmp_path / "g.geojson", json.dumps(swiss)))
    assert (table.crs, table.geographic) == ("EPSG:2056", False)


@pytest.mark.parametrize(("text", "says"), [
    ("", "is empty"),
    ("name,x,y,X,Y,Z\n", "holds no point"),
    ("name,x,y,X,Y,Z\nA,1,2,3,4,five\n", "line 2: 'five' is no number"),
    ("name,x,y,X,Y,Z\nA,1,2,3,4\n", "line 2: '' is no number"),
    ("name,x,y,X,Y,Z\nA,1,2,3,4,nan\n", "line 2: 'nan' is no number"),
    ("name,x,y,X,Y,Z\n\nA,1,5,2,3,4,5,6,7,5\n", "line 3 has 10 cells for 6 columns; with decimal commas"),
    ("name,x,y,X,Y,Z\nA,1,2,3,4,5\nA,2,3,4,5,6\n", "has A twice"),
    ("name,X,Y,Z\nA,1,2,3\n", "no columns of pixels"),
    ("name,x,y\nA,1,2\n", "no columns of places"),
    ("x,y,east,X,Y,Z\n1,2,3,4,5,6\n", "the columns east and X mean the same"),
    ("name,x,y,X [furlong],Y,Z\nA,1,2,3,4,5\n", r"the column 'X \[furlong\]' is in a unit that is not known, .* ft"),
    ("name,x [%],y [%],X,Y,Z\nA,1,2,3,4,5\n", r"the column 'x \[%\]' is in a unit that is not known, it must be px"),
    ("name,x,y,lat (rad),lon (rad)\nA,1,2,3,4\n", r"'lat \(rad\)' is in a unit that is not known, .* degrees"),
    ("name,x,y,X (ft),Y,Z\nA,1,2,3,4,5\n", r"the columns X \(ft\) and Y must be in one unit"),
    ("name,x,y,X (m),Y,Z\nA,1,2,3,4,5\n", r"X \(m\) and Y must be in one unit, which both or neither must name"),
    ("name,x,y,X (ft),Y (ft),Z\nA,1,2,3,4,5\n", r"the column Z must name its unit, as X \(ft\) does"),
    ("u,v,X [mm],Y [mm],Z (NAVD88)\n1,2,3,4,5\n", r"the column Z \(NAVD88\) must name its unit, as X \[mm\] does"),
    ("name,x,y,lat (N),lon (W)\nA,1,2,3,4\n", r"'lon \(W\)' must hold numbers that grow to the east"),
    ("u,v,X (west),Y (south)\n1,2,3,4\n", r"'X \(west\)' must hold numbers that grow to the east"),
    ("u,v,Easting (N),Northing (E)\n1,2,3,4\n", r"'Easting \(N\)' must hold numbers that grow to the east"),
    ("u,v,X (1000 ft),Y (1000 ft)\n1,2,3,4\n", r"'X \(1000 ft\)' is in a unit that is not known"),
    ("u,v,X (NAVD88 furlong),Y\n1,2,3,4\n", r"is in a unit that is not known"),
    ("u,v,lat (WGS84 rad),lon (WGS84 rad)\n1,2,3,4\n", r"is in a unit that is not known, .* degrees"),
    (f"u,v,X (nad{'1' * 80}mm),Y\n1,2,3,4\n", "is in a unit that is not known"),
    ("1,2,3,4\n", "4 columns without a header|no columns of pixels"),
    ("{", "is no GeoJSON"),
    ('{"type": "FeatureCollection", "features": [{"type": "Feature"}]}', "feature 1 is no control point"),
])
def test_what_is_no_table_is_said_in_one_line(text: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=says) as error:
        read_gcps(written(tmp_path / "g.csv", text))
    assert len(str(error.value).splitlines()) == 1


def test_a_missing_file_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_gcps(tmp_path / "none.csv")
