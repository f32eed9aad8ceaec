"""`stab-ros stabilize` where pictures are damaged, empty, distorted or of changing size: what is lost, what is said."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import Command
from recordings import (
    IMAGE_TOPIC,
    RECORDERS,
    Entry,
    camera_info,
    entries,
    image,
    to_cdr,
    write_folder,
    write_mcap,
)
from stabilised import decoded, errors_px, frames_of, homography, messages, rms_px, run, table

from stab_ros.core.types import FloatArray
from stab_ros.synthetic.flight import Shot


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
    assert f"{bag}: 2 of 5 images of {IMAGE_TOPIC} cannot be used" in err
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


@pytest.mark.parametrize("kind", ["folder", "video", "mcap"])
@pytest.mark.parametrize("level", [0, 90])
def test_nothing_but_flat_pictures_is_no_error_but_said(
    kind: str, level: int, flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    blank = [replace(shot, image=np.full_like(shot.image, level)) for shot in flight[:3]]
    source = RECORDERS[kind](tmp_path, blank)
    out, err = run(command, source, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv")
    assert "3 frames: 0 tracked, 3 lost" in out
    assert len(err.splitlines()) == 1
    assert f"warning: {source}: not one image" in err
    assert "flat, black" in err
    assert [row["status"] for row in table(tmp_path / "H.csv")] == ["LOST"] * 3


@pytest.mark.thorough
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


CORNER, SMALL = (60, 30), (320, 200)  # of a window in the flight's pictures, px


def windowed(shot: Shot) -> Shot:
    """The same frame from a camera that sees less; H in its own pixels."""
    (x, y), (width, height) = CORNER, SMALL
    shift = np.array([[1, 0, x], [0, 1, y], [0, 0, 1.0]])
    H = np.linalg.inv(shift) @ shot.ref_H_cur @ shift
    return replace(shot, image=shot.image[y : y + height, x : x + width].copy(), ref_H_cur=H / H[2, 2])


def since(reference: Shot, shot: Shot) -> FloatArray:
    """The true homography to another reference."""
    H = np.linalg.inv(reference.ref_H_cur) @ shot.ref_H_cur
    return np.asarray(H / H[2, 2])


def test_pictures_of_another_size_have_a_reference_of_their_own(
    flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    shots = [*flight[:3], *map(windowed, flight[3:6]), *flight[6:8]]
    bag = write_mcap(tmp_path / "in.mcap", list(entries(shots)))
    out, err = run(command, bag, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv",
                   "--video", tmp_path / "V.mp4")
    assert out.splitlines()[0].split(",")[0] == "8 frames: 8 tracked"
    assert len(err.splitlines()) == 1
    assert "at frame 3 (the images have another size, 320x200 mono8), at frame 6 (" in err
    rows = table(tmp_path / "H.csv")
    assert [row["reset_counter"] for row in rows] == list("00011122")
    assert [row["reset_reason"] for row in rows] == [""] * 3 + ["other size"] * 5
    references = [shots[first] for first in (0, 0, 0, 3, 3, 3, 6, 6)]
    sizes = [(480, 270)] * 3 + [SMALL] * 3 + [(480, 270)] * 2
    for row, shot, reference, size in zip(rows, shots, references, sizes, strict=True):
        assert rms_px(homography(row), since(reference, shot), size) < 0.15

    found = messages(tmp_path / "out.mcap")
    for topic, msgtype in (("homography", "CameraInfo"), ("image_stabilized", "Image")):
        made = [decoded(data, f"sensor_msgs/msg/{msgtype}") for _, data in found[f"/cam/{topic}"]]
        assert [(message.width, message.height) for message in made] == sizes
    shown = frames_of(tmp_path / "V.mp4")
    assert [frame.shape for frame in shown] == [(270, 480, 3)] * 8
    assert shown[3][:, :20].max() < 30  # beside the narrower picture
    enlarged = cv2.resize(shots[3].image, (432, 270))
    assert np.corrcoef(shown[3][:, 24:-24, 1].ravel(), enlarged.ravel())[0, 1] > 0.95


K = np.array([[400.0, 0.0, 239.5], [0.0, 400.0, 134.5], [0.0, 0.0, 1.0]])
REGION = "roi:=[[[390,10],[470,10],[470,260],[390,260]]]"  # no part of it lies in a picture of the small size


@pytest.mark.parametrize(("option", "reason"), [("use_camera_info:=true", "camera_info is for 480x270 px"),
                                                (REGION, "roi")])
def test_a_picture_of_a_size_that_does_not_fit_is_lost_but_not_the_work(
    option: str, reason: str, flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    info = Entry("/cam/camera_info", "sensor_msgs/msg/CameraInfo", 1, camera_info(K, [], (480, 270), 1))
    shots = [*flight[:2], windowed(flight[2]), *flight[3:5]]
    bag = write_mcap(tmp_path / "in.mcap", [info, *entries(shots)])
    out, err = run(command, bag, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv", "-p", option)
    assert "5 frames: 4 tracked, 1 lost" in out
    assert len(err.splitlines()) == 1
    assert f"{bag}: 1 of 5 images of {IMAGE_TOPIC} cannot be used" in err
    assert reason in err
    rows = table(tmp_path / "H.csv")
    assert [row["status"] for row in rows] == ["TRACKED", "TRACKED", "LOST", "TRACKED", "TRACKED"]
    assert {row["reset_counter"] for row in rows} == {"0"}
    found = messages(tmp_path / "out.mcap")
    assert [len(found[f"/cam/{name}"]) for name in ("homography", "track", "image_stabilized")] == [4, 4, 4]


@pytest.mark.parametrize(("model", "D"), [
    ("plumb_bob", [-0.12, 0.02, 0.0, 0.0, 0.0]),
    ("rational_polynomial", [0.25, -0.05, 0.001, -0.001, 0.01, 0.37, 0.02, -0.01]),
    ("equidistant", [-0.03, 0.012, -0.004, 0.001]),
])
def test_lens_distortion_is_removed_with_the_camera_info_of_the_bag(
    model: str, D: list[float], flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    recorded = []
    for shot in flight[:4]:
        info = camera_info(K, D, (480, 270), shot.stamp_ns, model)
        recorded.append(Entry("/cam/camera_info", "sensor_msgs/msg/CameraInfo", shot.stamp_ns, info))
        recorded.append(Entry(IMAGE_TOPIC, "sensor_msgs/msg/Image", shot.stamp_ns + 1, distorted(shot, K, D, model)))
    bag = write_mcap(tmp_path / "in.mcap", recorded)
    run(command, bag, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv", "-p", "use_camera_info:=true")
    assert max(errors_px(table(tmp_path / "H.csv"), flight[:4])) < 0.15
    made = decoded(messages(tmp_path / "out.mcap")["/cam/homography"][1][1], "sensor_msgs/msg/CameraInfo")
    np.testing.assert_array_equal(made.k, K.ravel())
    np.testing.assert_array_equal(made.d, D)
    assert made.distortion_model == model


def distorted(shot: Shot, K: FloatArray, D: Sequence[float], model: str) -> object:
    """The frame as a camera with this lens would have taken it."""
    x, y = np.meshgrid(np.arange(480.0), np.arange(270.0))
    seen = np.stack([x.ravel(), y.ravel()], axis=1)[:, None]
    straightened = cv2.fisheye.undistortPoints if model == "equidistant" else cv2.undistortPoints
    ideal = straightened(seen, K, np.array(D), P=K).reshape(270, 480, 2).astype(np.float32)
    picture = cv2.remap(shot.image, ideal[..., 0], ideal[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    message = image(shot)
    message.data = picture.reshape(-1)
    return message
