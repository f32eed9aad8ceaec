"""Bad input: exit code 2, one line that names what is wrong, and a folder that looks as it did before."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import Command
from recordings import (
    IMAGE_TOPIC,
    OTHER_TOPIC,
    Entry,
    camera_info,
    entries,
    image,
    to_cdr,
    write_folder,
    write_mcap,
    write_video,
)

from stab_ros.synthetic.flight import Shot

# fills a folder, and gives the arguments of the command that must refuse it
Arrange = Callable[[Path, Sequence[Shot]], Sequence[object]]


@dataclass(frozen=True)
class Case:
    """says: what the line must contain."""

    name: str
    arrange: Arrange
    says: Sequence[str]


def stabilize(source: object, *options: object) -> list[object]:
    return ["stabilize", source, "out.mcap", *options]


def good(folder: Path, shots: Sequence[Shot]) -> Path:
    return write_mcap(folder / "good.mcap", list(entries(shots[:2])))


def with_options(*options: object) -> Arrange:
    """A sound bag and options that do not fit."""
    return lambda folder, shots: stabilize(good(folder, shots), *options)


def with_file(name: str, content: bytes) -> Arrange:
    """One file as the input."""

    def arrange(folder: Path, shots: Sequence[Shot]) -> list[object]:
        (folder / name).write_bytes(content)
        return stabilize(name)

    return arrange


def with_bag(make: Callable[[Sequence[Shot]], list[Entry]], *options: object) -> Arrange:
    """A bag of these messages."""
    return lambda folder, shots: stabilize(write_mcap(folder / "in.mcap", make(shots)).name, *options)


def undecodable(shots: Sequence[Shot]) -> list[Entry]:
    return [Entry(e.topic, e.msgtype, e.log_time_ns, to_cdr(e)[:-9] if e.topic == IMAGE_TOPIC else e.message)
            for e in entries(shots[:2])]


def without_images(shots: Sequence[Shot]) -> list[Entry]:
    return [entry for entry in entries(shots[:2]) if entry.topic == OTHER_TOPIC]


def two_cameras(shots: Sequence[Shot]) -> list[Entry]:
    topics = ("/left/image_raw", "/right/image_raw")
    return [Entry(topic, "sensor_msgs/msg/Image", 1, image(shots[0])) for topic in topics]


def cut_video(folder: Path, shots: Sequence[Shot]) -> list[object]:
    """An mp4 without its end, where its index is."""
    whole = folder / "whole.mp4"
    writer = cv2.VideoWriter(str(whole), cv2.VideoWriter.fourcc(*"mp4v"), 25, (480, 270))
    for shot in shots[:3]:
        writer.write(cv2.cvtColor(shot.image, cv2.COLOR_GRAY2BGR))
    writer.release()
    (folder / "cut.mp4").write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    return stabilize("cut.mp4")


def two_sizes(folder: Path, shots: Sequence[Shot]) -> list[object]:
    write_folder(folder / "frames", shots[:3])
    cv2.imwrite(str(folder / "frames" / "frame_0002.png"), shots[2].image[:-10])
    return stabilize("frames", "--homographies", "H.csv", "--video", "V.mp4")


def undecodable_folder(folder: Path, shots: Sequence[Shot]) -> list[object]:
    write_folder(folder / "frames", shots[:1])
    (folder / "frames" / "frame_0000.png").write_bytes(b"no picture")
    return stabilize("frames")


def empty_folder(folder: Path, _: Sequence[Shot]) -> list[object]:
    (folder / "frames").mkdir()
    return stabilize("frames")


def existing(name: str, *options: object) -> Arrange:
    """An output that exists."""

    def arrange(folder: Path, shots: Sequence[Shot]) -> list[object]:
        (folder / name).write_text("precious")
        return stabilize(good(folder, shots), *options)

    return arrange


def output(path: str, *options: object) -> Arrange:
    """An output path that does not do; `file` is a file."""

    def arrange(folder: Path, shots: Sequence[Shot]) -> list[object]:
        (folder / "file").write_text("a file, no folder")
        return ["stabilize", good(folder, shots), path, *options]

    return arrange


def folder_as_output(folder: Path, shots: Sequence[Shot]) -> list[object]:
    (folder / "out.mcap").mkdir()
    return stabilize(good(folder, shots), "--force")


def camera_of_another_size(shots: Sequence[Shot]) -> list[Entry]:
    info = camera_info(np.diag([400.0, 400.0, 1.0]), [], (640, 480), 1)
    return [Entry("/cam/camera_info", "sensor_msgs/msg/CameraInfo", 1, info), *entries(shots[:2])]


def uncalibrated(shots: Sequence[Shot]) -> list[Entry]:
    info = camera_info(np.zeros((3, 3)), [], (480, 270), 1)
    return [Entry("/cam/camera_info", "sensor_msgs/msg/CameraInfo", 1, info), *entries(shots[:2])]


def config_for_others(folder: Path, shots: Sequence[Shot]) -> list[object]:
    (folder / "other.yaml").write_text("/cam/evaluator_node:\n  ros__parameters:\n    method: klt\n")
    return stabilize(good(folder, shots), "--config", "other.yaml")


def exclude_outside(folder: Path, shots: Sequence[Shot]) -> list[object]:
    return stabilize(good(folder, shots), "-p", "exclude:=[[[0,0],[5000,0],[5000,5000],[0,5000]]]")


def evaluate(*options: object) -> Arrange:
    """A sound bag and options of evaluate that do not fit."""
    return lambda folder, shots: ["evaluate", good(folder, shots), *options]


def outside(folder: Path, shots: Sequence[Shot]) -> list[object]:
    (folder / "points.csv").write_text("name,x,y\nfar,9999,10\n")
    return ["evaluate", good(folder, shots), "--points", "points.csv"]


def full_folder(folder: Path, shots: Sequence[Shot]) -> list[object]:
    (folder / "report").mkdir()
    (folder / "report" / "notes.txt").write_text("mine")
    return ["evaluate", good(folder, shots), "--report", "report"]


def beside_outputs(*arguments: str) -> Arrange:
    """An input that is not there, and outputs that are."""

    def arrange(folder: Path, _: Sequence[Shot]) -> list[object]:
        (folder / "report").mkdir()
        for name in ("out.mcap", "H.csv", "J.json", "M.csv", "report/index.html"):
            (folder / name).write_text("precious")
        return list(arguments)

    return arrange


def words_only(folder: Path, shots: Sequence[Shot]) -> list[object]:
    others = [entry for entry in entries(shots[:2]) if entry.topic == OTHER_TOPIC]
    return ["evaluate", write_mcap(folder / "words.mcap", others)]


CASES = [
    Case("missing file", lambda _f, _s: stabilize("none.mcap"), ["none.mcap", "no such file"]),
    Case("missing folder", lambda _f, _s: stabilize("none/"), ["none", "no such file or folder"]),
    Case("empty mcap", with_file("empty.mcap", b""), ["empty.mcap"]),
    Case("empty ROS 1 bag", with_file("empty.bag", b""), ["empty.bag"]),
    Case("empty video", with_file("empty.mp4", b""), ["empty.mp4", "cannot be decoded"]),
    Case("text called mcap", with_file("text.mcap", b"this is text\n" * 50), ["text.mcap"]),
    Case("text called bag", with_file("text.bag", b"this is text\n" * 50), ["text.bag"]),
    Case("text called mp4", with_file("text.mp4", b"this is text\n" * 50), ["text.mp4", "cannot be decoded"]),
    Case("text file", with_file("notes.txt", b"this is text\n" * 50), ["notes.txt", "a video file"]),
    Case("one image", with_file("one.png", b"x"), ["one.png", "folder"]),
    Case("no readable image", with_bag(undecodable, "--homographies", "H.csv", "--video", "V.mp4"),
         ["in.mcap", "not one image", IMAGE_TOPIC]),
    Case("no images", with_bag(without_images), ["in.mcap", "no images"]),
    Case("no messages", with_bag(lambda _: []), ["in.mcap"]),
    Case("several image topics", with_bag(two_cameras), ["--image-topic", "/left/image_raw", "/right/image_raw"]),
    Case("unknown topic", with_options("--image-topic", "/nope"), ["good.mcap", "/nope", IMAGE_TOPIC]),
    Case("topic without images", with_options("--image-topic", OTHER_TOPIC), [OTHER_TOPIC, IMAGE_TOPIC]),
    Case("unknown method", with_options("-p", "method:=magic"), ["method", "magic", "direct"]),
    Case("unknown parameter", with_options("-p", "on_loss:=drop"), ["on_loss", "on_lost"]),
    Case("value of a wrong type", with_options("-p", "use_camera_info:=7"), ["use_camera_info", "7", "bool"]),
    Case("value out of range", with_options("-p", "min_inlier_share:=1e3"), ["min_inlier_share", "range"]),
    Case("value that is no number", with_options("-p", "min_inlier_share:=.nan"), ["min_inlier_share"]),
    Case("no assignment", with_options("-p", "method=klt"), ["method=klt", "name:=value"]),
    Case("polygon that is none", with_options("-p", "roi:=[[1,2],3"), ["roi"]),
    Case("nothing left to track", exclude_outside, ["exclude"]),
    Case("unknown preset", with_options("-p", "method:=klt-iv"), ["method", "did you mean klt_iv"]),
    Case("missing points", with_options("-p", "points_file:=none.csv"), ["none.csv"]),
    Case("points that are none", with_options("-p", "manual_points:=[1,2]"), ["manual_points", "[[x, y], ...]"]),
    Case("too few points", with_options("-p", "manual_points:=[[99,99],[200,99],[200,200]]", "-p", "min_inliers:=3"),
         ["3 points", "projective", "at least 4"]),
    Case("points outside the frame", with_options("-p", "manual_points:=[[99,99],[200,99],[200,200],[480,99]]", "-p",
                                                  "min_inliers:=4"), ["(480, 99)", "outside the reference of 480x270"]),
    Case("missing config", with_options("--config", "none.yaml"), ["none.yaml"]),
    Case("no camera_info", with_options("-p", "use_camera_info:=true"), ["good.mcap", "/cam/camera_info"]),
    Case("camera_info of another size", with_bag(camera_of_another_size, "-p", "use_camera_info:=true"),
         ["in.mcap", "/cam/camera_info", "640x480", "480x270"]),
    Case("uncalibrated camera", with_bag(uncalibrated, "-p", "use_camera_info:=true"),
         ["in.mcap", "/cam/camera_info", "not calibrated"]),
    Case("config for other nodes", config_for_others, ["other.yaml", "/cam/evaluator_node", "tracker_node"]),
    Case("undecodable video", cut_video, ["cut.mp4", "cannot be decoded"]),
    Case("two sizes", two_sizes, ["frames", "frame_0002.png", "480x260", "480x270"]),
    Case("folder of undecodable images", undecodable_folder, ["frames", "not one image"]),
    Case("empty folder", empty_folder, ["frames"]),
    Case("bag exists", existing("out.mcap"), ["out.mcap", "exists", "--force"]),
    Case("table exists", existing("H.csv", "--homographies", "H.csv"), ["H.csv", "exists", "--force"]),
    Case("video exists", existing("V.mp4", "--video", "V.mp4"), ["V.mp4", "exists", "--force"]),
    Case("missing output folder", output("none/out.mcap"), ["none/out.mcap"]),
    Case("file as output folder", output("file/out.mcap"), ["file/out.mcap"]),
    Case("file as folder of the table", output("out.mcap", "--homographies", "file/H.csv"), ["file/H.csv"]),
    Case("file system that cannot be written", output("/proc/out.mcap"), ["/proc/out.mcap", "cannot be written"]),
    Case("table that cannot be written", output("out.mcap", "--homographies", "/proc/H.csv"), ["/proc/H.csv"]),
    Case("video that cannot be written", output("out.mcap", "--video", "/proc/V.mp4"), ["/proc/V.mp4"]),
    Case("folder as output", folder_as_output, ["out.mcap", "folder"]),
    Case("output is the input", output("good.mcap", "--force"), ["good.mcap", "input"]),
    Case("output of another kind", output("out.bag"), ["out.bag", ".mcap"]),
    Case("limit that is none", with_options("--limit", "0"), ["--limit", "0"]),
    Case("rate that is none", with_options("--fps", "-3"), ["--fps"]),
    Case("unknown option", with_options("--frobnicate"), ["--frobnicate", "--help"]),
    Case("unknown command", lambda _f, _s: ["stabilise", "a", "b"], ["stabilise"]),
    Case("no command", lambda _f, _s: [], ["--help"]),
    Case("info of nothing", lambda _f, _s: ["info", "none.mcap"], ["none.mcap"]),
    Case("convert nothing", lambda _f, _s: ["convert", "none.mp4", "out.mcap"], ["none.mp4"]),
    Case("convert an unknown topic", lambda f, s: ["convert", good(f, s), "out.mcap", "--topic", "/nope"],
         ["/nope", IMAGE_TOPIC]),
    Case("convert a bag at a rate", lambda f, s: ["convert", good(f, s), "out.mcap", "--fps", 3],
         ["good.mcap", "--fps"]),
    Case("evaluate nothing", lambda _f, _s: ["evaluate", "none.mcap"], ["none.mcap"]),
    Case("evaluate an unknown topic", evaluate("--image-topic", "/nope"), ["/nope", IMAGE_TOPIC]),
    Case("evaluate with an unknown parameter", evaluate("-p", "rmse_evry:=2"), ["rmse_evry", "rmse_every"]),
    Case("evaluate with even windows", evaluate("-p", "window_px:=30"), ["window_px", "odd"]),
    Case("evaluate with limits that contradict", evaluate("-p", "rmse_warn_px:=9.0"), ["rmse_warn_px", "error"]),
    Case("evaluate with points that are not there", evaluate("--points", "none.csv"), ["none.csv"]),
    Case("evaluate with points outside", outside, ["far", "image"]),
    Case("evaluate into no folder", evaluate("--json", "nowhere/J.json"), ["nowhere"]),
    Case("evaluate into another kind", evaluate("--csv", "M.txt"), ["M.txt", ".csv"]),
    Case("report into a full folder", full_folder, ["report", "--force"]),
    Case("evaluate a bag of words", words_only, ["words.mcap", "sensor_msgs/msg/Image"]),
    Case("nothing to stabilise, and outputs that exist",
         beside_outputs("stabilize", "none.mcap", "out.mcap", "--homographies", "H.csv"),
         ["none.mcap", "no such file"]),
    Case("nothing to convert, and an output that exists", beside_outputs("convert", "none.mp4", "out.mcap"),
         ["none.mp4", "no such file"]),
    Case("nothing to recover, and an output that exists", beside_outputs("recover", "none.mcap", "out.mcap"),
         ["none.mcap", "no such file"]),
    Case("nothing to evaluate, and outputs that exist",
         beside_outputs("evaluate", "none.mcap", "--json", "J.json", "--report", "report"),
         ["none.mcap", "no such file"]),
    Case("nothing to report on, and a report that exists",
         beside_outputs("evaluate", "none.mcap", "--report", "report"), ["none.mcap", "no such file"]),
    Case("nothing to compare, and outputs that exist", beside_outputs("compare", "none.mcap", "--csv", "M.csv"),
         ["none.mcap", "no such file"]),
    Case("recover nothing", lambda _f, _s: ["recover", "none.mcap", "out.mcap"], ["none.mcap"]),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name.replace(" ", "-"))
def test_bad_input_is_refused_in_one_line_and_leaves_nothing(
    case: Case, flight: list[Shot], command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = case.arrange(tmp_path, flight)
    before = listing(tmp_path)
    monkeypatch.chdir(tmp_path)
    done = command(*arguments)
    assert done.returncode == 2, done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr
    for words in case.says:
        assert words in done.stderr
    assert done.stdout == ""
    assert listing(tmp_path) == before


def listing(folder: Path) -> dict[str, tuple[int, int]]:
    """Every file with its size and time of change."""
    return {str(path.relative_to(folder)): (path.stat().st_size, path.stat().st_mtime_ns)
            for path in sorted(folder.rglob("*")) if path.is_file()}


def test_a_video_stream_is_not_judged_by_its_topic_name(
    flight: list[Shot], executable: Command, tmp_path: Path
) -> None:
    write_video(tmp_path / "in.avi", flight[:2])
    done = executable("stabilize", "in.avi", "out.mcap", "--image-topic", "/cam/image_raw", cwd=tmp_path)
    assert done.returncode == 2
    assert "/camera/image_raw" in done.stderr
