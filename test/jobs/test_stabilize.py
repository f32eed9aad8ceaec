"""`stab-ros stabilize` over every kind of input, judged by the true homographies and by other libraries' readers."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import Command
from recordings import (
    FRAME_ID,
    IMAGE_TOPIC,
    LOG_DELAY_NS,
    OTHER_TOPIC,
    RECORDERS,
    Entry,
    compressed,
    entries,
    image,
    to_cdr,
    write_mcap,
)
from rosbags.highlevel import AnyReader
from stabilised import JAZZY, decoded, errors_px, frames_of, homography, messages, run, table

from stab_ros.core.types import Gray, Image
from stab_ros.synthetic.flight import Shot


@pytest.mark.parametrize("kind", list(RECORDERS))
def test_every_kind_of_input_comes_out_as_true_homographies_in_a_bag(
    kind: str, flight: list[Shot], recordings: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    out, err = run(command, recordings[kind], tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv")
    assert "10 frames: 10 tracked, 0 lost" in out
    assert err == ""  # no progress bar, no warning

    rows = table(tmp_path / "H.csv")
    assert [row["status"] for row in rows] == ["TRACKED"] * 10
    assert [row["frame"] for row in rows] == [str(number) for number in range(10)]
    assert max(errors_px(rows, flight)) < 0.1

    namespace = "/camera" if kind in ("folder", "video") else "/cam"
    made = {f"{namespace}/{name}" for name in ("homography", "track", "image_stabilized")}
    found = messages(tmp_path / "out.mcap")
    once, others = {f"{namespace}/static_map"}, set() if namespace == "/camera" else {OTHER_TOPIC}
    assert set(found) == made | once | others
    assert all(len(found[topic]) == 10 for topic in made)
    assert all(len(found[topic]) == 1 for topic in once)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["H.csv", "out.mcap"]


@pytest.mark.parametrize("kind", ["folder", "video"])
def test_pictures_without_stamps_are_stamped_from_one_second_on(
    kind: str, recordings: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    given: dict[str, list[object]] = {"default": [], "slow": ["--fps", 8]}
    for name, options in given.items():
        run(command, recordings[kind], tmp_path / f"{name}.mcap", "--homographies", tmp_path / f"{name}.csv",
            "--limit", 3, *options)
    stamps = {name: [int(row["stamp_ns"]) for row in table(tmp_path / f"{name}.csv")] for name in given}
    assert stamps == {"default": [10**9, 1_040_000_000, 1_080_000_000], "slow": [10**9, 1_125_000_000, 1_250_000_000]}


def test_bag_and_table_say_the_same_and_the_image_is_warped_by_it(
    flight: list[Shot], recordings: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    run(command, recordings["mcap"], tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv")
    rows = table(tmp_path / "H.csv")
    images = 0
    with AnyReader([tmp_path / "out.mcap"], default_typestore=JAZZY) as reader:
        for connection, log_time_ns, data in reader.messages():
            message = decoded(data, connection.msgtype)
            if connection.topic == OTHER_TOPIC:
                continue
            stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            number = [shot.stamp_ns for shot in flight].index(stamp_ns)
            assert log_time_ns == stamp_ns + LOG_DELAY_NS
            assert message.header.frame_id == FRAME_ID
            H = homography(rows[number])
            if connection.topic == "/cam/homography":
                K, R, P = (np.reshape(a, (3, -1)) for a in (message.k, message.r, message.p))
                found = P[:, :3] @ R @ np.linalg.inv(K)
                np.testing.assert_allclose(found / found[2, 2], H, atol=1e-12)
                assert (message.width, message.height) == (480, 270)
            elif connection.topic == "/cam/image_stabilized":
                assert message.encoding == "mono8"
                warped = cv2.warpPerspective(flight[number].image, H, (480, 270)).astype(int)
                close = np.abs(warped - message.data.reshape(270, 480)) <= 1
                assert close[8:-8, 8:-8].mean() > 0.95
                images += 1
    assert images == 10


def test_the_other_topics_are_taken_over_byte_for_byte(
    flight: list[Shot], recordings: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    expected = [(entry.log_time_ns, to_cdr(entry)) for entry in entries(flight) if entry.topic == OTHER_TOPIC]
    for kind in ("mcap", "rosbag2_sqlite3", "rosbag1"):
        run(command, recordings[kind], tmp_path / f"{kind}.mcap", "--no-image")
        assert messages(tmp_path / f"{kind}.mcap")[OTHER_TOPIC] == expected, kind


def test_raw_images_of_a_bag_are_kept_byte_for_byte(
    flight: list[Shot], recordings: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    run(command, recordings["mcap"], tmp_path / "out.mcap", "--keep-raw", "--no-image", "--limit", 4)
    found = messages(tmp_path / "out.mcap")
    raw = [to_cdr(entry) for entry in entries(flight[:4]) if entry.topic == IMAGE_TOPIC]
    assert [data for _, data in found[IMAGE_TOPIC]] == raw
    assert {topic: len(data) for topic, data in found.items()} == {
        IMAGE_TOPIC: 4, OTHER_TOPIC: 4, "/cam/homography": 4, "/cam/track": 4, "/cam/static_map": 1}


@pytest.mark.parametrize("kind", ["rosbag1", "folder", "video"])
def test_all_options_go_together(kind: str, recordings: dict[str, Path], command: Command, tmp_path: Path) -> None:
    run(command, recordings[kind], tmp_path / "out.mcap", "--limit", 4, "--fps", 8, "--no-image", "--keep-raw",
        "--video", tmp_path / "V.mp4", "--homographies", tmp_path / "H.csv", "-p", "on_lost:=hold")
    namespace, others = ("/cam", [OTHER_TOPIC]) if kind == "rosbag1" else ("/camera", [])
    names = [f"{namespace}/{name}" for name in ("homography", "image_raw", "track")] + others
    found = {topic: len(data) for topic, data in messages(tmp_path / "out.mcap").items()}
    assert found == dict.fromkeys(names, 4) | {f"{namespace}/static_map": 1}
    rows = table(tmp_path / "H.csv")
    step_ns = int(rows[3]["stamp_ns"]) - int(rows[2]["stamp_ns"])
    assert (len(rows), step_ns) == (4, 200_000_000 if kind == "rosbag1" else 125_000_000)  # a bag has its own stamps
    assert len(frames_of(tmp_path / "V.mp4")) == 4
    assert cv2.VideoCapture(str(tmp_path / "V.mp4")).get(cv2.CAP_PROP_FPS) == pytest.approx(8)


def test_raw_images_of_a_video_are_kept_as_messages(
    flight: list[Shot], recordings: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    run(command, recordings["video"], tmp_path / "out.mcap", "--keep-raw", "--limit", 2)
    (_, _), (log_time_ns, data) = messages(tmp_path / "out.mcap")["/camera/image_raw"]
    message = decoded(data, "sensor_msgs/msg/Image")
    assert (log_time_ns, message.encoding) == (1_040_000_000, "bgr8")
    np.testing.assert_array_equal(message.data.reshape(270, 480, 3)[:, :, 1], flight[1].image)


def test_the_same_bytes_come_out_twice(recordings: dict[str, Path], command: Command, tmp_path: Path) -> None:
    for name in ("a", "b"):
        run(command, recordings["mcap"], tmp_path / f"{name}.mcap", "--homographies", tmp_path / f"{name}.csv")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    assert messages(tmp_path / "a.mcap") == messages(tmp_path / "b.mcap")


def test_existing_output_is_replaced_with_force(
    recordings: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    for name in ("out.mcap", "H.csv", "V.mp4"):
        (tmp_path / name).write_text("old")
    outputs = (tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv", "--video", tmp_path / "V.mp4")
    run(command, recordings["mcap"], *outputs, "--force", "--limit", 2)
    assert len(table(tmp_path / "H.csv")) == 2
    assert len(messages(tmp_path / "out.mcap")["/cam/homography"]) == 2
    assert len(frames_of(tmp_path / "V.mp4")) == 2


@pytest.mark.parametrize("depth", [8, 16])
def test_a_compressed_topic_gives_its_namespace_and_its_images_stay_grey(
    flight: list[Shot], command: Command, tmp_path: Path, depth: int
) -> None:
    topic = f"{IMAGE_TOPIC}/compressed"
    shots = [dataclasses.replace(shot, image=of_depth(shot.image, depth)) for shot in flight[:3]]
    recorded = [Entry(topic, "sensor_msgs/msg/CompressedImage", shot.stamp_ns, compressed(shot, "png"))
                for shot in shots]
    bag = write_mcap(tmp_path / "in.mcap", recorded)
    run(command, bag, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv")
    assert max(errors_px(table(tmp_path / "H.csv"), flight[:3])) < 0.1
    data = messages(tmp_path / "out.mcap")["/cam/image_stabilized"][0][1]
    stabilised = decoded(data, "sensor_msgs/msg/Image")
    assert stabilised.encoding == f"mono{depth}"
    assert stabilised.data.tobytes() == shots[0].image.tobytes()


def of_depth(gray: Gray, depth: int) -> Image:
    return gray if depth == 8 else gray.astype(np.uint16) * 257


def test_one_of_two_image_topics_is_chosen_and_the_other_taken_over(
    flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    two = [Entry(topic, "sensor_msgs/msg/Image", shot.stamp_ns, image(shot))
           for shot in flight[:3] for topic in ("/left/image", "/right/image")]
    bag = write_mcap(tmp_path / "in.mcap", two)
    run(command, bag, tmp_path / "out.mcap", "--image-topic", "/right/image")
    found = messages(tmp_path / "out.mcap")
    assert set(found) == {"/left/image", "/right/homography", "/right/track", "/right/image_stabilized",
                          "/right/static_map"}
    assert [data for _, data in found["/left/image"]] == [to_cdr(entry) for entry in two[::2]]


def test_topics_of_our_names_in_the_input_give_way(
    recordings: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    run(command, recordings["mcap"], tmp_path / "once.mcap", "--keep-raw", "--no-image", "--limit", 4)
    _, err = run(command, tmp_path / "once.mcap", tmp_path / "twice.mcap", "--keep-raw", "--no-image")
    assert len(err.splitlines()) == 1
    assert "once.mcap: its own /cam/homography, /cam/static_map, /cam/track gave way" in err
    assert messages(tmp_path / "twice.mcap") == messages(tmp_path / "once.mcap")


def test_the_video_shows_the_stabilised_frames_at_the_rate_of_the_stamps(
    flight: list[Shot], recordings: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    run(command, recordings["rosbag2_sqlite3"], tmp_path / "out.mcap", "--video", tmp_path / "V.mp4")
    rate_hz = 1e9 / (flight[1].stamp_ns - flight[0].stamp_ns)
    assert cv2.VideoCapture(str(tmp_path / "V.mp4")).get(cv2.CAP_PROP_FPS) == pytest.approx(rate_hz, abs=0.01)
    shown = frames_of(tmp_path / "V.mp4")
    assert len(shown) == 10
    for frame, (_, data) in zip(shown, messages(tmp_path / "out.mcap")["/cam/image_stabilized"], strict=True):
        pixels = decoded(data, "sensor_msgs/msg/Image").data
        assert np.corrcoef(frame[:, :, 1].ravel(), pixels)[0, 1] > 0.95


def test_parameters_come_from_a_file_and_the_command_line_has_the_last_word(
    recordings: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    config = tmp_path / "tracker.yaml"
    config.write_text("/**:\n  ros__parameters:\n    method: klt\n    on_lost: hold\n")
    given: dict[str, list[object]] = {
        "file": ["--config", config],
        "line": ["-p", "method:=klt"],
        "both": ["--config", config, "-p", "method:=direct"],
        "none": [],
    }
    text = {}
    for name, options in given.items():
        csv_path = tmp_path / f"{name}.csv"
        run(command, recordings["mcap"], tmp_path / f"{name}.mcap", "--homographies", csv_path, "--limit", 3, *options)
        text[name] = csv_path.read_text()
    assert text["file"] == text["line"]
    assert text["both"] == text["none"] != text["file"]


def test_a_foreign_bag_is_stabilised_by_each_of_its_image_topics(
    shared_data: Path, command: Command, tmp_path: Path
) -> None:
    bag = shared_data / "rosbag2_2025_09_10-13_03_56_0.mcap"
    for topic in ("/image", "/compressed_image"):
        out, _ = run(command, bag, tmp_path / "out.mcap", "--image-topic", topic, "--force")
        assert "1 frame: 1 tracked" in out
        before, after = messages(bag), messages(tmp_path / "out.mcap")
        assert {name: after[name] for name in before if name != topic} == {
            name: data for name, data in before.items() if name != topic}


def test_all_frames_of_the_real_video_are_tracked(shared_data: Path, command: Command, tmp_path: Path) -> None:
    out, _ = run(command, shared_data / "navizence.mp4", tmp_path / "out.mcap", "--no-image", "--limit", 40)
    assert "40 frames: 40 tracked, 0 lost" in out
