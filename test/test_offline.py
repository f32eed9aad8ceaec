"""`stab-ros stabilize` over every kind of input, judged by the true homographies and by other libraries' readers."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import Command
from mcap.reader import make_reader
from recordings import (
    FRAME_ID,
    IMAGE_TOPIC,
    LOG_DELAY_NS,
    OTHER_TOPIC,
    RECORDERS,
    Entry,
    camera_info,
    compressed,
    entries,
    image,
    to_cdr,
    write_folder,
    write_mcap,
)
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from stab_ros.core.synthetic import Shot
from stab_ros.core.types import FloatArray

JAZZY = get_typestore(Stores.ROS2_JAZZY)
COLUMNS = ("frame,stamp_ns,status,h00,h01,h02,h10,h11,h12,h20,h21,h22,"
           "matches,inliers,rmse_px,sigma_px,reset_counter")


def run(command: Command, *arguments: object) -> tuple[str, str]:
    """Standard output and error of a command that must succeed."""
    done = command("stabilize", *arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def table(path: Path) -> list[dict[str, str]]:
    """The rows of H.csv; its header must be that of the contract."""
    assert path.read_text().splitlines()[0] == COLUMNS
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def homography(row: dict[str, str]) -> FloatArray:
    return np.array([float(row[f"h{i}{j}"]) for i in range(3) for j in range(3)]).reshape(3, 3)


def rms_px(H_a: FloatArray, H_b: FloatArray, size: tuple[int, int]) -> float:
    """RMS distance over the 9x9 grid of frame pixels."""
    x, y = np.meshgrid(np.linspace(0, size[0] - 1, 9), np.linspace(0, size[1] - 1, 9))
    points = np.stack([x.ravel(), y.ravel(), np.ones(81)])
    a, b = H_a @ points, H_b @ points
    return float(np.sqrt(np.mean(np.sum((a[:2] / a[2] - b[:2] / b[2]) ** 2, axis=0))))


def errors_px(rows: list[dict[str, str]], flight: Sequence[Shot]) -> list[float]:
    """Of all frames but the reference."""
    size = flight[0].image.shape[1], flight[0].image.shape[0]
    return [rms_px(homography(row), shot.ref_H_cur, size) for row, shot in zip(rows, flight, strict=True)][1:]


def messages(path: Path) -> dict[str, list[tuple[int, bytes]]]:
    """Log time and bytes of every message by topic, as mcap's own reader gives them."""
    found: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
    with path.open("rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            found[channel.topic].append((message.log_time, message.data))
    return found


def decoded(cdr: bytes, msgtype: str) -> Any:
    """The message as rosbags reads it."""
    return JAZZY.deserialize_cdr(cdr, msgtype)


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
    assert set(found) == (made if namespace == "/camera" else made | {OTHER_TOPIC})
    assert all(len(found[topic]) == 10 for topic in made)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["H.csv", "out.mcap"]


@pytest.mark.parametrize("kind", ["folder", "video"])
def test_pictures_without_stamps_are_stamped_from_one_second_on(
    kind: str, recordings: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    given: dict[str, list[object]] = {"default": [], "slow": ["--fps", 8]}
    for name, options in given.items():
        run(command, recordings[kind], tmp_path / f"{name}.mcap", "--homographies", tmp_path / f"{name}.csv", *options)
    stamps = {name: [int(row["stamp_ns"]) for row in table(tmp_path / f"{name}.csv")][:3] for name in given}
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


def test_raw_images_are_kept_and_stabilised_ones_left_out_on_request(
    flight: list[Shot], recordings: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    run(command, recordings["mcap"], tmp_path / "out.mcap", "--keep-raw", "--no-image", "--limit", 4)
    found = messages(tmp_path / "out.mcap")
    raw = [to_cdr(entry) for entry in entries(flight[:4]) if entry.topic == IMAGE_TOPIC]
    assert [data for _, data in found[IMAGE_TOPIC]] == raw
    assert {topic: len(data) for topic, data in found.items()} == {
        IMAGE_TOPIC: 4, OTHER_TOPIC: 4, "/cam/homography": 4, "/cam/track": 4}


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


def test_a_compressed_topic_gives_its_namespace_and_leaves_as_bgr8(
    flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    topic = f"{IMAGE_TOPIC}/compressed"
    recorded = [Entry(topic, "sensor_msgs/msg/CompressedImage", shot.stamp_ns, compressed(shot, "png"))
                for shot in flight[:3]]
    bag = write_mcap(tmp_path / "in.mcap", recorded)
    run(command, bag, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv")
    assert max(errors_px(table(tmp_path / "H.csv"), flight[:3])) < 0.1
    data = messages(tmp_path / "out.mcap")["/cam/image_stabilized"][0][1]
    stabilised = decoded(data, "sensor_msgs/msg/Image")
    assert stabilised.encoding == "bgr8"


def test_one_of_two_image_topics_is_chosen_and_the_other_taken_over(
    flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    two = [Entry(topic, "sensor_msgs/msg/Image", shot.stamp_ns, image(shot))
           for shot in flight[:3] for topic in ("/left/image", "/right/image")]
    bag = write_mcap(tmp_path / "in.mcap", two)
    run(command, bag, tmp_path / "out.mcap", "--image-topic", "/right/image")
    found = messages(tmp_path / "out.mcap")
    assert set(found) == {"/left/image", "/right/homography", "/right/track", "/right/image_stabilized"}
    assert [data for _, data in found["/left/image"]] == [to_cdr(entry) for entry in two[::2]]


def test_topics_of_our_names_in_the_input_give_way(
    recordings: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    run(command, recordings["mcap"], tmp_path / "once.mcap", "--keep-raw", "--no-image")
    _, err = run(command, tmp_path / "once.mcap", tmp_path / "twice.mcap", "--keep-raw", "--no-image")
    assert len(err.splitlines()) == 1
    assert "once.mcap: its own /cam/homography, /cam/track gave way" in err
    assert messages(tmp_path / "twice.mcap") == messages(tmp_path / "once.mcap")


def test_pictures_that_cannot_be_decoded_are_lost_counted_and_said(
    flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    recorded = list(entries(flight[:5]))
    for number in (2, 3):  # cut off within the pixels
        entry = recorded[2 * number]
        recorded[2 * number] = Entry(entry.topic, entry.msgtype, entry.log_time_ns, to_cdr(entry)[:-1000])
    bag = write_mcap(tmp_path / "in.mcap", recorded)
    out, err = run(command, bag, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv", "--keep-raw",
                   "--video", tmp_path / "V.mp4")
    assert "5 frames: 3 tracked, 2 lost" in out
    assert len(err.splitlines()) == 1
    assert f"{bag}: 2 of 5 images of {IMAGE_TOPIC} cannot be decoded" in err
    rows = table(tmp_path / "H.csv")
    assert [row["status"] for row in rows] == ["TRACKED", "TRACKED", "LOST", "LOST", "TRACKED"]
    assert [int(row["stamp_ns"]) for row in rows] == [shot.stamp_ns for shot in flight[:5]]
    assert rms_px(homography(rows[4]), flight[4].ref_H_cur, (480, 270)) < 0.1
    found = messages(tmp_path / "out.mcap")
    assert [len(found[topic]) for topic in (IMAGE_TOPIC, "/cam/homography", "/cam/track")] == [5, 3, 3]
    assert len(frames_of(tmp_path / "V.mp4")) == 5


def test_an_image_of_a_folder_that_cannot_be_decoded_keeps_its_number(
    flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    folder = write_folder(tmp_path / "frames", flight[:4])
    whole = (folder / "frame_0001.png").read_bytes()
    (folder / "frame_0001.png").write_bytes(whole[: len(whole) // 2])
    _, err = run(command, folder, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv")
    assert "1 of 4 images" in err
    assert "frame_0001.png" in err
    assert len(err.splitlines()) == 1  # libpng's own complaint is not passed on
    rows = table(tmp_path / "H.csv")
    assert [row["status"] for row in rows] == ["TRACKED", "LOST", "TRACKED", "TRACKED"]
    assert rms_px(homography(rows[3]), flight[3].ref_H_cur, (480, 270)) < 0.1


def frames_of(path: Path) -> list[FloatArray]:
    """All frames of a video."""
    capture = cv2.VideoCapture(str(path))
    found = []
    while (frame := capture.read())[0]:
        found.append(frame[1].astype(float))
    return found


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


def test_a_lost_frame_repeats_the_one_before_in_the_video(
    flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    folder = write_folder(tmp_path / "frames", flight[:4])
    black = cv2.imencode(".png", np.zeros_like(flight[0].image))[1].tobytes()
    (folder / "frame_0002.png").write_bytes(black)
    run(command, folder, tmp_path / "out.mcap", "--video", tmp_path / "V.mp4", "--fps", 5)
    shown = frames_of(tmp_path / "V.mp4")
    assert len(shown) == 4
    assert np.abs(shown[2] - shown[1]).mean() < 3
    assert shown[2].mean() > 20
    assert cv2.VideoCapture(str(tmp_path / "V.mp4")).get(cv2.CAP_PROP_FPS) == pytest.approx(5)


@pytest.mark.parametrize(("on_lost", "images"), [("drop", 2), ("hold", 3), ("pass", 3)])
def test_a_lost_frame_is_dropped_held_or_passed(
    on_lost: str, images: int, flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    folder = write_folder(tmp_path / "frames", flight[:3])
    black = cv2.imencode(".png", np.zeros_like(flight[0].image))[1].tobytes()
    (folder / "frame_0001.png").write_bytes(black)
    out, _ = run(command, folder, tmp_path / "out.mcap", "-p", f"on_lost:={on_lost}")
    assert "3 frames: 2 tracked, 1 lost" in out
    found = messages(tmp_path / "out.mcap")
    assert len(found["/camera/image_stabilized"]) == images
    lost = decoded(found["/camera/homography"][1][1], "sensor_msgs/msg/CameraInfo")
    assert not np.any([*lost.k, *lost.r, *lost.p])


def test_a_flat_stream_is_lost_throughout_and_never_becomes_the_reference(
    flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    folder = write_folder(tmp_path / "frames", [*flight[:2], *flight[:3]])
    for number in range(2):
        flat = np.full_like(flight[0].image, 90)
        (folder / f"frame_000{number}.png").write_bytes(cv2.imencode(".png", flat)[1].tobytes())
    run(command, folder, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv", "--video", tmp_path / "V.mp4")
    rows = table(tmp_path / "H.csv")
    assert [row["status"] for row in rows] == ["LOST", "LOST", "TRACKED", "TRACKED", "TRACKED"]
    assert max(errors_px(rows[2:], flight[:3])) < 0.1
    shown = frames_of(tmp_path / "V.mp4")
    assert len(shown) == 5
    assert shown[1].max() < 5


def test_independent_noise_is_lost_in_every_row_after_the_reference(command: Command, tmp_path: Path) -> None:
    noise = np.random.default_rng(5)
    folder = tmp_path / "frames"
    folder.mkdir()
    for number in range(50):
        picture = noise.integers(0, 256, (240, 320), np.uint8)
        (folder / f"{number:03}.png").write_bytes(cv2.imencode(".png", picture)[1].tobytes())
    run(command, folder, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv")
    assert [row["status"] for row in table(tmp_path / "H.csv")][1:] == ["LOST"] * 49
    assert "nan" not in (tmp_path / "H.csv").read_text().lower()


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
        run(command, recordings["mcap"], tmp_path / f"{name}.mcap", "--homographies", csv_path, *options)
        text[name] = csv_path.read_text()
    assert text["file"] == text["line"]
    assert text["both"] == text["none"] != text["file"]


def test_lens_distortion_is_removed_with_the_camera_info_of_the_bag(
    flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    K = np.array([[400.0, 0.0, 239.5], [0.0, 400.0, 134.5], [0.0, 0.0, 1.0]])
    D = [-0.12, 0.02, 0.0, 0.0, 0.0]
    recorded = []
    for shot in flight[:4]:
        info = camera_info(K, D, (480, 270), shot.stamp_ns)
        recorded.append(Entry("/cam/camera_info", "sensor_msgs/msg/CameraInfo", shot.stamp_ns, info))
        recorded.append(Entry(IMAGE_TOPIC, "sensor_msgs/msg/Image", shot.stamp_ns + 1, distorted(shot, K, D)))
    bag = write_mcap(tmp_path / "in.mcap", recorded)
    run(command, bag, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv", "-p", "use_camera_info:=true")
    assert max(errors_px(table(tmp_path / "H.csv"), flight[:4])) < 0.15
    made = decoded(messages(tmp_path / "out.mcap")["/cam/homography"][1][1], "sensor_msgs/msg/CameraInfo")
    np.testing.assert_array_equal(made.k, K.ravel())
    np.testing.assert_array_equal(made.d, D)


def distorted(shot: Shot, K: FloatArray, D: Sequence[float]) -> object:
    """The frame as a camera with this lens would have taken it."""
    x, y = np.meshgrid(np.arange(480.0), np.arange(270.0))
    seen = np.stack([x.ravel(), y.ravel()], axis=1)[:, None]
    ideal = cv2.undistortPoints(seen, K, np.array(D), P=K).reshape(270, 480, 2).astype(np.float32)
    picture = cv2.remap(shot.image, ideal[..., 0], ideal[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    message = image(shot)
    message.data = picture.reshape(-1)
    return message


def test_a_foreign_bag_is_stabilised_by_each_of_its_image_topics(
    shared_data: Path, command: Command, tmp_path: Path
) -> None:
    bag = shared_data / "rosbag2_2025_09_10-13_03_56_0.mcap"
    for topic in ("/image", "/compressed_image"):
        out, _ = run(command, bag, tmp_path / "out.mcap", "--image-topic", topic, "--force")
        assert "1 frames: 1 tracked" in out
        before, after = messages(bag), messages(tmp_path / "out.mcap")
        assert {name: after[name] for name in before if name != topic} == {
            name: data for name, data in before.items() if name != topic}


def test_all_frames_of_the_real_video_are_tracked(shared_data: Path, command: Command, tmp_path: Path) -> None:
    out, _ = run(command, shared_data / "navizence.mp4", tmp_path / "out.mcap", "--no-image", "--limit", 40)
    assert "40 frames: 40 tracked, 0 lost" in out
