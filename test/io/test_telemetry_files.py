"""Telemetry in the formats of drones and receivers, each small file here as one of those programs writes it."""

from __future__ import annotations

import math
from datetime import datetime, timedelta, timezone, tzinfo
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from pyproj import Transformer
from scipy.spatial.transform import Rotation

from stab_ros.core.errors import InputError
from stab_ros.io.fix_message import FIX, GBAS_FIX, SBAS_FIX
from stab_ros.io.repeated import measured
from stab_ros.io.telemetry import read_telemetry
from stab_ros.io.telemetry_mending import mended
from stab_ros.io.telemetry_record import Record, Recorded

S = 10**9
NOON_NS = int(datetime(2022, 8, 7, 12, tzinfo=timezone.utc).timestamp()) * S


def read(path: Path, text: str | bytes, zone: tzinfo = timezone.utc) -> Recorded:
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_telemetry(path, zone, lambda done, total: None)


def close(found: np.ndarray | None, wanted: ArrayLike, rtol: float = 1e-12) -> None:
    assert found is not None
    np.testing.assert_allclose(found, np.array(wanted, float), rtol)


def srt(*bodies: str, step_ms: int = 40) -> str:
    """Subtitles, one of step_ms after another."""
    return "\n".join(f"{n}\n00:00:{n * step_ms // 1000:02d},{n * step_ms % 1000:03d} --> 00:00:59,000\n{body}\n"
                     for n, body in enumerate(bodies))


# DJI ------------------------------------------------------------------------------------------------------------------
MAVIC_3 = ('<font size="28">FrameCnt: 1, DiffTime: 20ms\n2022-08-07 12:00:00.250\n[iso: 220] [shutter: 1/8000.0] '
           "[fnum: 3.2] [ct: 5115] [focal_len: 24.00] [latitude: 55.01531] [longitude: -1.67440] "
           "[rel_alt: 46.400 abs_alt: 93.401] {}</font>")
GIMBAL = "[gb_yaw: -142.5 gb_pitch: -88.7 gb_roll: 0.5] "


@pytest.mark.parametrize(("body", "place", "height_m", "above_m"), [
    (MAVIC_3.format(""), (55.01531, -1.6744), 93.401, 46.4),
    ('<font size="36">FrameCnt : 9, DiffTime : 16ms\n2020-04-02 15:19:58,720,764\n[iso : 120] [fnum : 280] '
     "[latitude : 31.452012] [longtitude : 74.398751] [altitude: 213.983002] </font>", (31.452012, 74.398751),
     213.983002, math.nan),
    ("[latitude : -20.2533] [longtitude : 149.0251] [iso : 100] [ev : 0]", (-20.2533, 149.0251), math.nan, math.nan),
    ("[latitude: 45,3735] [longitude: -121,6959] [rel_alt: 1,300 abs_alt: 132,860]", (45.3735, -121.6959), 132.86, 1.3),
    ("HOME(149.0251,-20.2532) 2017.08.05 14:11:51\nGPS(149.0251,-20.2533,16) BAROMETER:1.9\nISO:100 Shutter:60 EV:",
     (-20.2533, 149.0251), math.nan, 1.9),
    ("HOME(149.0251,-20.2532) 2017.8.5 14:11:51\nGPS(149.0251,-20.2533,16) Hb:1.9 Hs:1.8\nISO:100 TV:60",
     (-20.2533, 149.0251), math.nan, 1.9),
    ("2022.06.21 16:06:17\nGPS(36.6146,-6.1120,0.0M) BAROMETER:8.4M", (36.6146, -6.112), math.nan, 8.4),
    ("F/3.2, SS 160, ISO 100, EV 0, GPS (8.2090, 47.4692, 18), D 49.21m, H 45.60m, H.S 0.00m/s, V.S 0.00m/s ",
     (47.4692, 8.209), math.nan, 45.6),
    ("HOME(W: 121.7, N: 48.1)\nGPS(W: 121.7458, N: 48.0771, 201.5m)\nISO:100", (48.0771, -121.7458), 201.5, math.nan),
    ("GPS(E:149.0251,S:20.2533,8m)", (-20.2533, 149.0251), 8.0, math.nan),
    ("F/2.8, GPS (-121,7458, 48,0771, 17), D 221,21m, H 200,70m, H.S n/a", (48.0771, -121.7458), math.nan, 200.7)])
def test_positions_of_dji(tmp_path: Path, body: str, place: tuple[float, float], height_m: float,
                          above_m: float) -> None:
    (record,) = read(tmp_path / "a.SRT", srt(body)).records
    assert (record.latitude_deg, record.longitude_deg) == place
    np.testing.assert_equal([record.height_m, record.above_takeoff_m], [height_m, above_m])


@pytest.mark.parametrize(("body", "yaw", "pitch", "roll"), [
    (MAVIC_3.format(GIMBAL), -142.5, -88.7, 0.5),
    (MAVIC_3.format("[gb_yaw: 12.0] [gb_pitch: -90.0] [gb_roll: 0.0]"), 12.0, -90.0, 0.0),
    ("GPS (-58.85, -34.23, 15), H 85.80m, F.PRY (2.7°, -7.0°, 110.1°), G.PRY (-24.4°, 0.3°, 110.4°)",
     110.4, -24.4, 0.3)])
def test_gimbal_of_dji(tmp_path: Path, body: str, yaw: float, pitch: float, roll: float) -> None:
    (record,) = read(tmp_path / "a.srt", srt(body)).records
    aviation = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True).as_matrix()
    ned = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
    expected = Rotation.from_matrix(ned @ aviation @ np.diag([1.0, -1, -1])).as_quat()
    assert record.gimbal is not None
    assert abs(record.gimbal @ expected) == pytest.approx(1, abs=1e-12)
    assert (record.body is not None) == ("F.PRY" in body)


def test_times_of_subtitles(tmp_path: Path) -> None:
    brisbane = timezone(timedelta(hours=10))
    first, second = read(tmp_path / "a.srt", srt(MAVIC_3.format(""), MAVIC_3.format("")), brisbane).records
    assert (first.since_start_ns, second.since_start_ns) == (0, 40_000_000)
    assert first.utc_ns == NOON_NS + S // 4 - 36_000 * S
    (dated,) = read(tmp_path / "b.srt", "1\n2022.08.07 12:00:00,393,525\n[latitude : 1.5] [longtitude : 2.5]\n").records
    assert (dated.since_start_ns, dated.utc_ns) == (None, NOON_NS + 393_525_000)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_encodings_and_ends_of_lines(tmp_path: Path, encoding: str, end: str) -> None:
    text = srt("GPS (-58.85, -34.23, 15), H 85.80m, G.PRY (-24.4°, 0.3°, 110.4°)").replace("\n", end)
    (record,) = read(tmp_path / "a.srt", text.encode(encoding)).records
    assert (record.latitude_deg, record.longitude_deg, record.gimbal is None) == (-34.23, -58.85, False)


def test_broken_blocks_are_left_out_and_said(tmp_path: Path) -> None:
    sound = MAVIC_3.format("")
    text = srt(sound, sound[:-80], "GPS(N/A,N/A,9) BAROMETER:1.0", "", sound) + "7\n00:00:01,000 --> 00:00:02,000\n" + (
        sound[: sound.index("[latitude") + 14])
    recorded = read(tmp_path / "a.srt", text)
    assert [record.since_start_ns for record in recorded.records] == [0, 160_000_000]
    assert recorded.warnings == ["4 of 6 blocks are left out, holding no time with a position or an attitude"]


def test_blocks_without_a_number_are_told_apart(tmp_path: Path) -> None:
    text = "".join(line for line in srt(*[MAVIC_3.format("")] * 3).splitlines(keepends=True)
                   if not line.strip().isdecimal())
    assert [record.since_start_ns for record in read(tmp_path / "a.srt", text).records] == [0, 40_000_000, 80_000_000]


# RTKLIB ---------------------------------------------------------------------------------------------------------------
COLUMNS = "  Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)  sdeu(m)  sdun(m) age(s)  ratio\n"
DEGREES = "%  GPST                  latitude(deg) longitude(deg)  height(m) " + COLUMNS
ROW = "2026/01/14 21:17:29.000   32.064101442   34.800189222    94.8836   2   4   0.0880   0.1341   0.3388"
ECEF = ("% (x/y/z-ecef=WGS84,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)\n"
        "%  GPST                      x-ecef(m)      y-ecef(m)      z-ecef(m)   Q  ns   sdx(m)   sdy(m)   sdz(m)"
        "  sdxy(m)  sdyz(m)  sdzx(m) age(s)  ratio\n")


def test_a_solution_of_rtklib(tmp_path: Path) -> None:
    header = "% program   : rnx2rtkp ver.2.4.3\n% obs start : 2026/01/14 21:17:29.0 GPST\n%\n"
    recorded = read(tmp_path / "a.pos", header + DEGREES + ROW + "  -0.0500   0.0200   0.0100   0.00    1.6\n")
    (record,) = recorded.records
    assert (record.latitude_deg, record.longitude_deg, record.height_m) == (32.064101442, 34.800189222, 94.8836)
    assert record.utc_ns == int(datetime(2026, 1, 14, 21, 17, 11, tzinfo=timezone.utc).timestamp()) * S
    assert (record.since_start_ns, record.status) == (None, GBAS_FIX)
    close(record.covariance_m2, [
        [0.1341**2, -(0.05**2), 0.02**2], [-(0.05**2), 0.088**2, 0.01**2], [0.02**2, 0.01**2, 0.3388**2]])
    assert recorded.notes == ["its times are GPS time, 18 leap seconds ahead of UTC", "solutions: 1 float"]


def test_a_covariance_that_rounding_made_none_is_mended(tmp_path: Path) -> None:
    """Two axes that move as one: 0.0045 twice, and 0.0046 for their covariance."""
    row = ROW.replace("0.0880   0.1341   0.3388", "0.0045 0.0045 0.0100 0.0046 0.0000 0.0000")
    (record,) = read(tmp_path / "a.pos", DEGREES + row + "\n").records
    assert record.covariance_m2 is not None
    assert np.linalg.eigvalsh(record.covariance_m2)[0] == pytest.approx(1e-8)
    close(np.diag(record.covariance_m2), [0.0045**2, 0.0045**2, 0.01**2], 0.03)


@pytest.mark.parametrize(("system", "hour"), [("GPST", -18 / 3600), ("UTC ", 0), ("JST ", -9)])
def test_time_systems_of_rtklib(tmp_path: Path, system: str, hour: float) -> None:
    (record,) = read(tmp_path / "a.pos", DEGREES.replace("GPST", system) + ROW + "\n").records
    shown = datetime(2026, 1, 14, 21, 17, 29, tzinfo=timezone.utc) + timedelta(hours=hour)
    assert record.utc_ns == round(shown.timestamp()) * S


def test_week_and_second_of_week(tmp_path: Path) -> None:
    rows = "2401 604799.875 1.5 2.5 3.5 1 9\n2402      0.125 1.5 2.5 3.5 5 9\n"
    first, second = read(tmp_path / "a.pos", DEGREES + rows).records
    assert first.utc_ns is not None
    assert second.utc_ns == first.utc_ns + S // 4
    assert first.utc_ns == int(datetime(2026, 1, 17, 23, 59, 41, tzinfo=timezone.utc).timestamp()) * S + 875_000_000
    assert (first.status, second.status) == (GBAS_FIX, FIX)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.floats(-89, 89), st.floats(-179, 179), st.floats(-100, 9000))
def test_ecef_is_turned_into_degrees(tmp_path_factory: pytest.TempPathFactory, latitude: float, longitude: float,
                                     height: float) -> None:
    x, y, z = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True).transform(longitude, latitude, height)
    path = tmp_path_factory.getbasetemp() / "ecef.pos"
    row = f"2026/01/14 21:17:29.000 {x:.6f} {y:.6f} {z:.6f} 6 9 0.01 0.02 0.03 0.004 -0.005 0.006 0 0\n"
    (record,) = read(path, ECEF + row).records
    assert record.latitude_deg == pytest.approx(latitude, abs=1e-10)
    assert record.height_m == pytest.approx(height, abs=1e-5)
    up = Rotation.from_euler("ZY", [longitude, -latitude], degrees=True).apply([1, 0, 0])
    C = np.array([[1e-4, 1.6e-5, 3.6e-5], [1.6e-5, 4e-4, -2.5e-5], [3.6e-5, -2.5e-5, 9e-4]])
    assert record.covariance_m2 is not None
    assert record.covariance_m2[2, 2] == pytest.approx(up @ C @ up, rel=1e-6)
    np.testing.assert_allclose(np.linalg.eigvalsh(record.covariance_m2), np.linalg.eigvalsh(C), rtol=1e-9)
    assert record.status == SBAS_FIX


def test_degrees_minutes_and_seconds_between_commas(tmp_path: Path) -> None:
    header = "%  UTC,  latitude(d'\"), longitude(d'\"),height(m),Q,ns,sdn(m),sde(m),sdu(m),sdne(m),sdeu(m),sdue(m)\n"
    (record,) = read(tmp_path / "a.pos", header + "2020/08/25 12:03:00.0, -0 30 36.0,  8 15 0.0, 100.5,1, 9, 0.01,"
                     "0.02,0.03,0,0,0\n").records
    assert (record.latitude_deg, record.longitude_deg, record.height_m) == (-0.51, 8.25, 100.5)
    close(record.covariance_m2, np.diag([4e-4, 1e-4, 9e-4]))


def test_broken_lines_of_rtklib_are_left_out_and_said(tmp_path: Path) -> None:
    bad = ["garbage", "2026/01/14 21:17:30.000 32.06", "2026/13/14 21:17:30 1 2 3 1 9",
           ROW.replace("  2   4", "  0   4"), "2026/01/14 21:17:30.000 nan nan nan 1 9"]
    recorded = read(tmp_path / "a.pos", DEGREES + "\n".join([*bad, ROW]) + "\n")
    assert len(recorded.records) == 1
    assert recorded.warnings == ["5 lines hold no position and are left out, the first is line 2"]


@pytest.mark.parametrize(("text", "says"), [
    (ROW, "has no line of % that names its columns"), ("", "has no line of %"),
    ("%  GPST   e-baseline(m)  n-baseline(m)  u-baseline(m) Q ns\n", "holds distances from a base station; RTKLIB"),
    ("% (lat/lon/height=Tokyo/ellipsoidal,Q=1:fix)\n" + DEGREES + ROW, "in the Tokyo datum, they must be in WGS84"),
    (DEGREES.replace("height(m)", "h"), "its line of % names no column height"),
    (DEGREES.replace("GPST", "BDT "), "its times are in 'BDT', they must be in GPST, UTC or JST"),
    (DEGREES, "holds no position and no attitude, it must be solutions of RTKLIB")])
def test_no_solution_is_refused(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path / "a.pos", text)
    assert str(caught.value).startswith(f"{tmp_path / 'a.pos'}: ")
    assert says in str(caught.value)


def test_heights_above_the_geoid_are_said(tmp_path: Path) -> None:
    text = "% (lat/lon/height=WGS84/geodetic,Q=1:fix)\n" + DEGREES + ROW
    assert read(tmp_path / "a.pos", text).warnings == [
        "its heights are above the geoid, a NavSatFix has them above the ellipsoid"]


# tables ---------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("header", "cell", "since_ns", "utc_ns"), [
    ("time", "0.04", 40_000_000, None), ("t_s", "12.5", 12 * S + S // 2, None), ("time (ms)", "40", 40_000_000, None),
    ("timestamp", "1659873600.000000001", None, NOON_NS + 1), ("unix_time", "1659873600250", None, NOON_NS + S // 4),
    ("stamp_ns", str(NOON_NS + 7), None, NOON_NS + 7), ("time", "1659873600000001", None, NOON_NS + 1000),
    ("Datetime", "2022-08-07T12:00:00.000000009Z", None, NOON_NS + 9),
    ("datetime", "2022-08-07 22:00:00+10:00", None, NOON_NS), ("utc", "2022/08/07 12:00:00", None, NOON_NS),
    ("time", "7.8.2022", None, None), ("time", "1e400", None, None), ("time", "nan", None, None)])
def test_times_of_a_table(tmp_path: Path, header: str, cell: str, since_ns: int | None, utc_ns: int | None) -> None:
    text = f"{header},lat,lon\n{cell},1.5,2.5\n0.0,1.5,2.5\n"
    recorded = read(tmp_path / "a.csv", text)
    if (since_ns, utc_ns) == (None, None):
        assert len(recorded.records) == 1
        assert recorded.warnings == ["1 line holds no moment and is left out, the first is line 2"]
    else:
        assert (recorded.records[0].since_start_ns, recorded.records[0].utc_ns) == (since_ns, utc_ns)


@pytest.mark.parametrize("header", ["datetime(utc)", "utc", "time_utc"])
def test_dates_in_utc_by_the_name_of_their_column(tmp_path: Path, header: str) -> None:
    brisbane = timezone(timedelta(hours=10))
    recorded = read(tmp_path / "a.csv", f"{header},lat,lon\n2022-08-07 12:00:00,1.5,2.5\n", brisbane)
    assert (recorded.records[0].utc_ns, recorded.zoneless) == (NOON_NS, False)


def test_times_of_day_go_on_after_midnight(tmp_path: Path) -> None:
    recorded = read(tmp_path / "a.csv", "time,lat,lon\n23:59:59.5,1,2\n00:00:00.25,1,2\n")
    assert [record.since_start_ns for record in recorded.records] == [0, 750_000_000]
    assert recorded.notes == ["its times of day have no date, they count from the first row"]
    dated = read(tmp_path / "b.csv", "date,time,lat,lon\n2022-08-07,23:59:59.5,1,2\n2022-08-08,00:00:00,1,2\n")
    assert [record.utc_ns for record in dated.records] == [NOON_NS + 43_199 * S + S // 2, NOON_NS + 43_200 * S]


def test_columns_with_units_as_airdata_writes_them(tmp_path: Path) -> None:
    header = ("time(millisecond),datetime(utc),latitude,longitude,height_above_takeoff(feet),height_sonar(feet),"
              "altitude_above_seaLevel(feet),compass_heading(degrees), pitch(degrees), roll(degrees),"
              "gimbal_heading(degrees),gimbal_pitch(degrees),gimbal_roll(degrees)")
    row = "200,2022-08-07 12:00:00,55.1,-1.5,100,0,300,90,1,2,180,-90,0"
    (record,) = read(tmp_path / "a.csv", f"{header}\n{row}\n").records
    assert (record.since_start_ns, record.utc_ns) == (200_000_000, NOON_NS)
    assert (record.above_takeoff_m, record.height_m) == pytest.approx((30.48, 91.44))
    assert record.gimbal is not None
    assert record.body is not None
    np.testing.assert_allclose(Rotation.from_quat(record.gimbal).apply([0, 0, 1]), [0, -1, 0], atol=1e-12)


def test_a_table_of_datcon(tmp_path: Path) -> None:
    """The log of the drone itself, which has no position at first."""
    header = ("Clock:Tick#,Clock:offsetTime,IMU_ATTI(0):roll[degrees],IMU_ATTI(0):pitch[degrees],"
              "IMU_ATTI(0):yaw[degrees],GPS(0):Long[degrees],GPS(0):Lat[degrees],GPS(0):heightMSL[meters],"
              "General:relativeHeight[meters],GPS:dateTimeStamp")
    before, after = read(tmp_path / "a.csv", f"{header}\n1,-0.5,0,0,90,,,,,\n"
                         "2,33.25,0,0,90,-1.6700001,55.0100001,93.4,46.2,2022-08-07T12:00:00Z\n").records
    assert (before.since_start_ns, before.utc_ns, before.placed) == (-S // 2, None, False)
    assert (after.since_start_ns, after.utc_ns) == (33 * S + S // 4, NOON_NS)
    assert (after.latitude_deg, after.longitude_deg, after.height_m) == (55.0100001, -1.6700001, 93.4)
    assert after.above_takeoff_m == 46.2
    assert after.body is not None
    np.testing.assert_allclose(Rotation.from_quat(after.body).apply([1, 0, 0]), [1, 0, 0], atol=1e-12)


def test_a_table_with_decimal_commas_radians_sigmas_and_quaternion(tmp_path: Path) -> None:
    text = ("Time [s];Latitude [rad];Longitude [rad];Height [m];sde;sdn;sdu_mm;qx;qy;qz;qw\n"
            "0,5;0,9;-0,03;46,25;0,01;0,02;30;0;0;0,6;0,8\n")
    (record,) = read(tmp_path / "a.csv", text.encode("utf-16")).records
    assert record.latitude_deg == pytest.approx(math.degrees(0.9), abs=1e-12)
    assert (record.since_start_ns, record.height_m) == (S // 2, 46.25)
    close(record.covariance_m2, np.diag([1e-4, 4e-4, 9e-4]))
    close(record.body, [0, 0, 0.6, 0.8])


@pytest.mark.parametrize("name", ["gimbalPitch", "Gimbal Pitch", "gimbal_pitch", "GIMBAL-PITCH", "gb_pitch_deg"])
def test_names_of_columns_as_programs_write_them(tmp_path: Path, name: str) -> None:
    (record,) = read(tmp_path / "a.csv", f"time,{name},gimbalYaw(degrees)\n1,-90,0\n").records
    assert record.gimbal is not None
    np.testing.assert_allclose(Rotation.from_quat(record.gimbal).apply([1, 0, 0]), [0, 0, -1], atol=1e-12)


@pytest.mark.parametrize(("text", "says"), [
    ("time,lat,lon,height(furlong)\n1,2,3,4\n", "its column 'height(furlong)' has an unknown unit, it must be one"),
    ("time (h),lat,lon\n1,2,3\n", "its column 'time (h)' has an unknown unit, it must be one of s,"),
    ("", "has no column of time"), ("lat,lon\n1,2\n", "has no column of time, its first line is 'lat, lon'"),
    ("time,x,y\n1,2,3\n", "has no column of latitude and longitude"),
    ("time,lat,lon\n", "holds no position and no attitude, it must be a table"),
    ("time,lat,lon\n1,x,y\n", "holds no position and no attitude")])
def test_no_table_is_refused(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path / "a.csv", text)
    assert says in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_missing_and_unknown_files_are_refused(tmp_path: Path) -> None:
    for path, says in ((tmp_path / "no.srt", "no such file"), (tmp_path, "is no telemetry by its name")):
        with pytest.raises(InputError, match=f"{says}, it must be a DJI .srt, an RTKLIB .pos or a .csv"):
            read_telemetry(path, timezone.utc, lambda done, total: None)


# mending --------------------------------------------------------------------------------------------------------------
def records(*places: tuple[float, float]) -> Recorded:
    return Recorded(True, False, [Record(n, None, *place) for n, place in enumerate(places)])


def places(recorded: Recorded) -> list[tuple[float, float]]:
    return [(record.latitude_deg, record.longitude_deg) for record in recorded.records if record.placed]


def test_latitude_and_longitude_that_are_swapped_are_put_right_and_said() -> None:
    fixed = mended(records((149.0251234, -20.2532), (149.0251233, -20.2533)), swap=False)
    assert places(fixed) == [(-20.2532, 149.0251234), (-20.2533, 149.0251233)]
    assert "are taken as longitudes" in fixed.warnings[0]
    asked = mended(records((-1.5000001, 55.1000001)), swap=True)
    assert (places(asked), asked.warnings) == ([(55.1000001, -1.5000001)], [])


def test_zero_positions_before_the_fix_are_left_out_and_said() -> None:
    fixed = mended(records((0, 0), (0, 0), (55.0000001, -1.0000002)), swap=False)
    assert places(fixed) == [(55.0000001, -1.0000002)]
    assert fixed.warnings == ["2 of 3 positions are left out, the first: its latitude and longitude are zero, as "
                              "before the first fix"]


def test_one_latitude_beyond_the_pole_is_left_out() -> None:
    fixed = mended(records((55.0000001, 91.5), (155.0, 91.5), (55.0000002, 91.5)), swap=False)
    assert len(places(fixed)) == 2
    assert "must lie within 90 degrees" in fixed.warnings[0]


def test_radians_are_put_right_and_said() -> None:
    west = math.radians(-1.5)
    fixed = mended(records((math.radians(55.1), west), (math.radians(55.1001), west)), swap=False)
    np.testing.assert_allclose(places(fixed), [(55.1, -1.5), (55.1001, -1.5)], rtol=1e-12)
    assert "taken as radians" in fixed.warnings[0]


@pytest.mark.parametrize(("latitudes", "says"), [
    ((55.1234, 55.1235), ["its positions have 4 decimals, they are told in steps of 11.1 m"]),
    ((55.12345, 55.12346), ["its positions have 5 decimals, they are told in steps of 1.11 m"]),
    ((55.123456, 55.123457), [])])
def test_coarse_positions_are_said(latitudes: tuple[float, ...], says: list[str]) -> None:
    assert mended(records(*((latitude, 7.6543) for latitude in latitudes)), swap=False).warnings == says


# repeated values ------------------------------------------------------------------------------------------------------
def test_each_fix_is_taken_once() -> None:
    assert measured([n // 3 for n in range(30)]) == list(range(0, 30, 3))
    assert measured(list(range(9))) == list(range(9))
    assert measured([7] * 9) == list(range(9))
    assert measured([]) == []


def test_a_drone_that_stands_still_goes_on_to_be_there() -> None:
    """Else interpolation lets it glide to where it is next, all the time that it stood."""
    values = [*(n // 3 for n in range(30)), *[10] * 60, *(11 + n // 3 for n in range(30))]
    assert measured(values) == list(range(0, 120, 3))


def test_two_and_a_half_frames_a_fix() -> None:
    values = [int(n / 2.5) for n in range(1000)]
    assert measured(values) == [n for n in range(1000) if n == 0 or values[n] != values[n - 1]]
