"""Telemetry as a bag: what rosbags reads there, on which clock, and what the command says."""

from __future__ import annotations

import math
import subprocess
import sys
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

from stab_ros.cli import main
from stab_ros.core.errors import InputError
from stab_ros.io.date_time import utc_named, zone_named
from stab_ros.io.sensors import read_sensors
from stab_ros.io.telemetry_clock import TelemetryClock, Timing
from stab_ros.jobs.info import describe
from stab_ros.jobs.telemetry import Converted, Telemetry, convert_telemetry

S = 10**9
NOON_NS = int(datetime(2022, 8, 7, 12, tzinfo=timezone.utc).timestamp()) * S
FPS = 30000 / 1001
POS = ("%  UTC                   latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)\n"
       "2022/08/07 12:00:00.200   55.010000001   -1.670000001    93.4000   1  12   0.0200   0.0100   0.0300   0.0000\n"
       "2022/08/07 12:00:00.400   55.010000002   -1.670000002    93.4100   1  12   0.0200   0.0100   0.0300   0.0000\n")


def subtitles(frames: int, each: int = 3, gimbal: bool = True) -> str:
    """Of a video at 29.97 frames/s, with a new fix every `each` frames."""
    blocks = []
    for n in range(frames):
        ms = int(n / FPS * 1000)
        angles = f" [gb_yaw: {n / 10:.1f} gb_pitch: -90.0 gb_roll: 0.0]" * gimbal
        blocks.append(f"{n + 1}\n00:00:{ms // 1000:02d},{ms % 1000:03d} --> 00:00:59,000\n"
                      f"2022-08-07 12:00:{ms // 1000 + 5:02d}.{ms % 1000:03d}\n"
                      f"[latitude: {55 + 1e-6 * (n // each):.6f}] [longitude: -1.670001] "
                      f"[rel_alt: 46.100 abs_alt: 93.401]{angles}\n")
    return "\n".join(blocks)


def converted(folder: Path, name: str, text: str, **options: Any) -> tuple[Path, Converted]:
    (folder / name).write_text(text, encoding="utf-8")
    job = Telemetry((folder / name,), folder / "out.mcap", **options)
    return job.output, convert_telemetry(job, lambda done, total: None)


def by_rosbags(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Log time and message of each topic."""
    messages: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([path]) as reader:
        for connection, time_ns, data in reader.messages():
            messages.setdefault(connection.topic, []).append((time_ns, reader.deserialize(data, connection.msgtype)))
    return messages


def stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * S + int(message.header.stamp.nanosec)


def test_subtitles_of_a_video_on_the_clock_of_its_frames(tmp_path: Path) -> None:
    path, done = converted(tmp_path, "a.SRT", subtitles(90), timing=Timing(fps=FPS))
    topics = by_rosbags(path)
    frames_ns = [S + round(n * S / FPS) for n in range(90)]
    assert [stamp_ns(message) for _, message in topics["/camera/fix"]] == frames_ns[::3]
    assert [time_ns for time_ns, _ in topics["/camera/gimbal"]] == frames_ns
    fixes = [message for _, message in topics["/camera/fix"]]
    assert [(fix.latitude, fix.longitude, fix.altitude) for fix in fixes[:2]] == [
        (55.0, -1.670001, 93.401), (55.000001, -1.670001, 93.401)]
    assert (fixes[0].header.frame_id, fixes[0].status.status, fixes[0].position_covariance_type) == ("gps", 0, 0)
    q = topics["/camera/gimbal"][89][1].quaternion
    ahead, top = Rotation.from_quat([q.x, q.y, q.z, q.w]).apply([[1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(ahead, [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(top, [math.sin(math.radians(8.9)), math.cos(math.radians(8.9)), 0], atol=1e-12)
    assert done.counts == {"/camera/fix": 30, "/camera/gimbal": 90}
    assert done.notes[1] == (f"{tmp_path / 'a.SRT'}: 60 of 90 values of /camera/fix are repeated, not measured, and "
                             "are left out")
    assert done.warnings == ()


def test_what_is_written_is_read_as_sensors(tmp_path: Path) -> None:
    path, _ = converted(tmp_path, "a.srt", subtitles(9, each=1), namespace="/drone")
    sensors = read_sensors(path)
    assert (sensors.topics.fix, sensors.topics.attitude) == ("/drone/fix", "/drone/gimbal")
    assert (len(sensors.fixes), len(sensors.attitudes)) == (9, 9)
    lines, warnings = describe(path)
    assert any("/drone/fix" in line and "sensor_msgs/msg/NavSatFix" in line and line.endswith(" 9") for line in lines)
    assert warnings == []


def test_a_solution_of_rtklib_is_in_utc_with_its_covariance(tmp_path: Path) -> None:
    path, done = converted(tmp_path, "a.pos", POS)
    (first_ns, first), (second_ns, _) = by_rosbags(path)["/camera/fix"]
    assert (first_ns, second_ns) == (NOON_NS + 200_000_000, NOON_NS + 400_000_000)
    assert (first.status.status, first.position_covariance_type) == (2, 3)
    np.testing.assert_allclose(first.position_covariance.reshape(3, 3), np.diag([1e-4, 4e-4, 9e-4]))
    assert done.notes[-1].endswith("stamps are in UTC")


@pytest.mark.parametrize(("name", "timing", "first_ns"), [
    ("a.pos", Timing(start_ns=NOON_NS), S + 200_000_000),
    ("a.pos", Timing(clock=TelemetryClock.VIDEO), S),
    ("a.pos", Timing(offset_ns=-50_000_000), NOON_NS + 150_000_000),
    ("a.srt", Timing(), S), ("a.srt", Timing(offset_ns=7), S + 7),
    ("a.srt", Timing(clock=TelemetryClock.UTC), NOON_NS + 5 * S),
    ("a.srt", Timing(clock=TelemetryClock.UTC, start_ns=NOON_NS), NOON_NS),
    ("a.srt", Timing(start_ns=NOON_NS), S)])
def test_clocks(tmp_path: Path, name: str, timing: Timing, first_ns: int) -> None:
    path, _ = converted(tmp_path, name, POS if name == "a.pos" else subtitles(3), timing=timing)
    assert by_rosbags(path)["/camera/fix"][0][0] == first_ns


def test_a_log_that_began_before_the_video(tmp_path: Path) -> None:
    """As Airdata's: times since the beginning of the log beside dates of whole seconds."""
    rows = [f"{100 * n},2022-08-07 12:00:{n // 10:02d},{55 + n * 1e-7:.7f},-1.67" for n in range(100)]
    path, done = converted(tmp_path, "a.csv", "\n".join(["time(ms),datetime(utc),latitude,longitude", *rows]),
                           timing=Timing(start_ns=NOON_NS + 4 * S))
    times = [time_ns for time_ns, _ in by_rosbags(path)["/camera/fix"]]
    assert np.unique(np.diff(times)).tolist() == [100_000_000]
    assert times[-1] == S + 59 * S // 10
    assert any("moments before the first frame of the video are left out" in line for line in done.warnings)


def test_dates_in_the_zone_that_is_named(tmp_path: Path) -> None:
    text = "datetime,lat,lon\n2022-08-07 22:00:00,55.1234567,-1.6\n"
    brisbane = zone_named("Australia/Brisbane")
    path, _ = converted(tmp_path, "a.csv", text, zone=brisbane)
    assert by_rosbags(path)["/camera/fix"][0][0] == NOON_NS
    assert utc_named("2022-08-07 22:00:00", brisbane) == NOON_NS


@pytest.mark.parametrize(("name", "options", "warned"), [
    ("a.srt", {}, False), ("a.srt", {"timing": Timing(TelemetryClock.UTC)}, True),
    ("a.srt", {"timing": Timing(TelemetryClock.UTC), "zone": timezone.utc}, False), ("a.pos", {}, False)])
def test_dates_without_a_zone_are_warned_of(tmp_path: Path, name: str, options: dict[str, Any], warned: bool) -> None:
    _, done = converted(tmp_path, name, POS if name == "a.pos" else subtitles(3), **options)
    assert any("name no time zone and are taken as UTC" in line for line in done.warnings) == warned


def test_heights_above_the_place_of_take_off(tmp_path: Path) -> None:
    path, _ = converted(tmp_path, "a.srt", subtitles(3), home_height_m=47.0)
    assert by_rosbags(path)["/camera/fix"][0][1].altitude == pytest.approx(93.1, abs=1e-12)
    relative = "1\n00:00:00,000 --> 00:00:01,000\nGPS (8.2090123, 47.4692, 18), H 45.60m\n"
    path, done = converted(tmp_path, "b.srt", relative, force=True)
    assert by_rosbags(path)["/camera/fix"][0][1].altitude == 45.6
    assert any("heights count from the place of take-off, --home-height" in line for line in done.warnings)


def test_order_and_twins(tmp_path: Path) -> None:
    rows = "0.3,55.0000003,1,9\n0.1,55.0000001,1,9\n0.2,55.0000002,1,9\n0.1,55.0000009,1,9\n"
    path, done = converted(tmp_path, "a.csv", f"time,lat,lon,height\n{rows}")
    assert [message.latitude for _, message in by_rosbags(path)["/camera/fix"]] == [55.0000001, 55.0000002, 55.0000003]
    assert [line.partition("a.csv: ")[2] for line in done.warnings] == [
        "1 moment has the time of an earlier one and is left out",
        "its moments are not in the order of time, they are put in it"]


@pytest.mark.parametrize(("name", "text", "options", "says"), [
    ("a.srt", "1\n00:00:00,000 --> 00:00:01,000\nGPS (8.2, 47.4, 18)\n", {"timing": Timing(TelemetryClock.UTC)},
     "has no dates, so stamps in UTC need --start"),
    ("a.csv", "time,lat,lon\n1,2,3\n", {"timing": Timing(offset_ns=-9 * S)}, "all its moments lie before the first"),
    ("a.csv", "datetime,lat,lon\n2999-01-01 00:00:00,2,3\n", {}, "does not fit a ROS time"),
    ("a.csv", "time,lat,lon\n1,0,0\n2,0,0\n", {}, "holds no position that can be one; 2 of 2 positions are left out"),
    ("a.txt", "", {}, "is no telemetry by its name")])
def test_bad_input_is_refused_and_nothing_is_left(tmp_path: Path, name: str, text: str, options: dict[str, Any],
                                                  says: str) -> None:
    with pytest.raises(InputError) as caught:
        converted(tmp_path, name, text, **options)
    assert says in str(caught.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == [name]


def test_positions_of_a_receiver_with_angles_of_subtitles(tmp_path: Path) -> None:
    """As the third paper has them: fixes of PPK, attitudes of the drone itself."""
    (tmp_path / "a.pos").write_text(POS, encoding="utf-8")
    (tmp_path / "a.srt").write_text(subtitles(30), encoding="utf-8")
    paths = (tmp_path / "a.pos", tmp_path / "a.srt")
    job = Telemetry(paths, tmp_path / "out.mcap", timing=Timing(start_ns=NOON_NS))
    done = convert_telemetry(job, lambda done, total: None)
    topics = by_rosbags(job.output)
    assert [time_ns for time_ns, _ in topics["/camera/fix"]] == [S + 200_000_000, S + 400_000_000]
    assert (len(topics["/camera/gimbal"]), topics["/camera/gimbal"][0][0]) == (30, S)
    assert f"{paths[1]}: its positions are not taken, those of {paths[0]} are" in done.notes


def test_files_of_two_clocks_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.pos").write_text(POS, encoding="utf-8")
    (tmp_path / "a.srt").write_text(subtitles(30), encoding="utf-8")
    job = Telemetry((tmp_path / "a.pos", tmp_path / "a.srt"), tmp_path / "out.mcap")
    with pytest.raises(InputError, match=r"a.srt: counts in video time and .*a.pos in utc time; --start, .* makes"):
        convert_telemetry(job, lambda done, total: None)
    assert not job.output.exists()


def test_telemetry_as_the_input_of_another_command(tmp_path: Path) -> None:
    (tmp_path / "a.SRT").write_text(subtitles(3), encoding="utf-8")
    with pytest.raises(InputError, match=r"the input must be .*; `stab-ros telemetry` makes a bag of it"):
        describe(tmp_path / "a.SRT")


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "stab_ros", "telemetry", *map(str, arguments)], capture_output=True,
                          text=True, check=False, timeout=120)


def test_the_command(tmp_path: Path) -> None:
    (tmp_path / "a.srt").write_bytes(subtitles(30).encode("utf-16"))
    done = run(tmp_path / "a.srt", tmp_path / "out.mcap", "--fps", 29.97)
    assert (done.returncode, done.stdout.splitlines()) == (0, [
        "/camera/fix: 10 messages", "/camera/gimbal: 30 messages",
        "first position: 55.0000000 N 1.6700010 W, 93.401 m", f"bag: {tmp_path / 'out.mcap'}"])
    assert done.stderr.count("stab-ros: note: ") == len(done.stderr.splitlines())


@pytest.mark.parametrize(("options", "says"), [
    ((), "exists already, give --force"), (("--force", "--start", "noon"), "'noon' is no date with a time"),
    (("--force", "--time-zone", "Mars"), "'Mars' is no time zone"),
    (("--force", "--namespace", "my camera"), "is no namespace"),
    (("--force", "--offset-s", "nan"), "must be a number"),
    (("--force", "--offset-s", "1e300"), "must be a number of seconds within 1e+09")])
def test_bad_usage_is_one_line(tmp_path: Path, options: tuple[str, ...], says: str,
                               capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.pos").write_text(POS, encoding="utf-8")
    (tmp_path / "out.mcap").write_bytes(b"mine")
    with pytest.raises(SystemExit) as left:
        sys.exit(main(["telemetry", str(tmp_path / "a.pos"), str(tmp_path / "out.mcap"), *options]))
    said = capfd.readouterr().err
    assert (left.value.code, len(said.splitlines())) == (2, 1)
    assert says in said
    assert (tmp_path / "out.mcap").read_bytes() == b"mine"


def test_heights_that_are_none_and_positions_that_are_missing_are_said(tmp_path: Path) -> None:
    head = "time,latitude,longitude,height,yaw,pitch\n"
    rows = [f"{n / 10 + 1},{55 + 1e-6 * n:.6f},-1.670001,{{}},10,-90\n" for n in range(4)]
    _, high = converted(tmp_path, "high.csv", head + "".join(row.format("-1e9") for row in rows))
    assert any("4 heights are left out, the first: it is -1e+09 m" in line for line in high.warnings)
    _, nowhere = converted(tmp_path, "nowhere.csv", "".join([head, *(
        row.format("9").replace("-1.670001", "") for row in rows)]), force=True)
    assert any("there are no positions to be written, only attitudes" in line for line in nowhere.warnings)
    with pytest.raises(InputError, match=r"--home-height: 1e\+20 m, it must lie within 100000 m"):
        converted(tmp_path, "home.srt", subtitles(9), force=True, home_height_m=1e20)
    with pytest.raises(InputError, match="1 line holds no moment and is left out, the first is line 2"):
        converted(tmp_path, "never.csv", head + "soon,55,-1.67,9,10,-90\n", force=True)
