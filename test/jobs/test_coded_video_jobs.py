"""Coded video through the commands: every message a row, homographies as of the pictures, bytes as they were."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from coded_video import (
    COMPRESSED_VIDEO,
    FFMPEG_PACKET,
    KEY_EVERY,
    TOPIC,
    Message,
    Packet,
    as_they_come,
    compressed_video,
    encoded,
    ffmpeg_packet,
    protobuf_video,
    write_coded,
)
from conftest import Command
from mcap.reader import make_reader
from stabilised import homography, table

from stab_ros.core.geometry import rms_distance
from stab_ros.io.source import open_source
from stab_ros.synthetic.flight import Shot

SIZE = (480, 270)


@pytest.fixture(scope="module")
def packets(flight: list[Shot]) -> list[Packet]:
    """Of good quality, with B-frames."""
    return encoded(flight, bf="2", preset="medium", crf="12")


def stamps_ns(flight: list[Shot]) -> list[int]:
    return [shot.stamp_ns for shot in flight]


def recorded(path: Path) -> list[tuple[str, int, bytes]]:
    with path.open("rb") as file:
        return [(channel.topic, message.log_time, message.data) for _, channel, message in
                make_reader(file).iter_messages()]


def test_stabilize_a_video_that_begins_between_key_frames(
        flight: list[Shot], packets: list[Packet], command: Command, tmp_path: Path) -> None:
    bag = write_coded(tmp_path / "in.mcap", packets[3:], stamps_ns(flight), compressed_video("h264"))
    done = command("stabilize", bag, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv", "--keep-raw")
    assert done.returncode == 0, done.stderr
    assert f"2 of 7 images of {TOPIC} cannot be used, which counts as lost (unusable image); the first: " in done.stderr
    assert "h264 video: no key frame has come before it" in done.stderr
    rows = table(tmp_path / "H.csv")
    assert [row["status"] for row in rows] == ["LOST"] * 2 + ["TRACKED"] * 5
    assert [int(row["stamp_ns"]) for row in rows[2:]] == stamps_ns(flight)[KEY_EVERY:]
    reference = np.linalg.inv(flight[KEY_EVERY].ref_H_cur)
    for row, shot in zip(rows[2:], flight[KEY_EVERY:], strict=True):
        assert rms_distance(homography(row), reference @ shot.ref_H_cur, SIZE) < 0.2
    kept = [message for message in recorded(tmp_path / "out.mcap") if message[0] == TOPIC]
    assert kept == recorded(bag)
    done = command("evaluate", tmp_path / "out.mcap", "--json", tmp_path / "metrics.json")
    assert done.returncode == 0, done.stderr
    assert list(json.loads((tmp_path / "metrics.json").read_text())["topics"]) == [TOPIC, "/cam/image_stabilized"]


@pytest.mark.parametrize(("message", "msgtype"), [
    (compressed_video("h264"), COMPRESSED_VIDEO), (protobuf_video("h264"), "foxglove.CompressedVideo")],
    ids=["cdr", "protobuf"])
def test_the_log_time_can_be_taken_for_the_stamp(message: Message, msgtype: str, flight: list[Shot],
                                                 command: Command, tmp_path: Path) -> None:
    plain = encoded(flight)
    bag = write_coded(tmp_path / "in.mcap", plain, stamps_ns(flight), message, msgtype)
    done = command("stabilize", bag, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv", "--keep-raw",
                   "--time", "log")
    assert done.returncode == 0, done.stderr
    logged = [log_time_ns for _, log_time_ns, _ in recorded(bag)]
    assert [int(row["stamp_ns"]) for row in table(tmp_path / "H.csv")] == logged
    with open_source(tmp_path / "out.mcap", TOPIC) as source:  # what was kept has the stamps of its homographies
        assert [picture.stamp_ns for picture in source.frames()] == logged


@pytest.mark.thorough
@pytest.mark.parametrize("number", [list, as_they_come], ids=["of pictures", "of packets"])
def test_both_clocks_of_b_frames_measure_the_same(number: Callable[[Sequence[Packet]], list[Packet]],
                                                  flight: list[Shot], packets: list[Packet], command: Command,
                                                  tmp_path: Path) -> None:
    bag = write_coded(tmp_path / "in.mcap", number(packets), stamps_ns(flight), compressed_video("h264"))
    logged = [log_time_ns for _, log_time_ns, _ in recorded(bag)]
    measured = []
    for words, expected in (((), stamps_ns(flight)), (("--time", "log"), logged)):
        done = command("stabilize", bag, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv", "--keep-raw",
                       "--force", *words)
        assert (done.returncode, done.stderr) == (0, "")
        rows = table(tmp_path / "H.csv")
        assert [int(row["stamp_ns"]) for row in rows] == expected
        for row, shot in zip(rows, flight, strict=True):
            assert rms_distance(homography(row), shot.ref_H_cur, SIZE) < 0.2
        for clock in ("header", "log"):
            done = command("evaluate", tmp_path / "out.mcap", "--csv", tmp_path / "E.csv", "--force", "--time", clock)
            assert (done.returncode, done.stderr) == (0, "")
            measured.append((tmp_path / "E.csv").read_text())
    assert measured[0].count("\n") > len(flight)
    assert len({without_stamps(text) for text in measured}) == 1


def without_stamps(text: str) -> str:
    return re.sub(r"\b\d{10,}\b", "stamp", text)


def test_convert_keeps_the_bytes_of_a_coded_video(
        flight: list[Shot], packets: list[Packet], command: Command, tmp_path: Path) -> None:
    bag = write_coded(tmp_path / "in.mcap", packets, stamps_ns(flight), ffmpeg_packet("libx264"), FFMPEG_PACKET)
    assert command("convert", bag, tmp_path / "out.mcap").returncode == 0
    assert recorded(tmp_path / "out.mcap") == recorded(bag)


def test_info_says_size_and_codec(flight: list[Shot], packets: list[Packet], command: Command, tmp_path: Path) -> None:
    for first, said in ((0, "480x270 bgr8, coded as h264"),
                        (3, "480x270 bgr8, coded as h264, begins 2 images before its first key frame")):
        bag = write_coded(tmp_path / "a.mcap", packets[first:], stamps_ns(flight), compressed_video("h264"))
        assert f"  {TOPIC}: {said}\n" in command("info", bag).stdout
    bag = write_coded(tmp_path / "a.mcap", packets[3:5], stamps_ns(flight), compressed_video("h264"))
    out = command("info", bag).stdout
    assert "the first image cannot be decoded (h264 video: no key frame has come before it" in out


def test_topics_of_image_transport_name_the_namespace(
        flight: list[Shot], packets: list[Packet], command: Command, tmp_path: Path) -> None:
    bag = write_coded(tmp_path / "in.mcap", packets[:3], stamps_ns(flight), ffmpeg_packet("libx264"), FFMPEG_PACKET,
                      topic="/cam/image_raw/ffmpeg")
    assert command("stabilize", bag, tmp_path / "out.mcap").returncode == 0
    assert {"/cam/homography", "/cam/track", "/cam/image_stabilized"} <= {
        topic for topic, _, _ in recorded(tmp_path / "out.mcap")}
