"""`stab-ros evaluate` on recordings: its JSON and CSV against an evaluator run by hand, and against known residuals."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from bag_makers import with_compressed
from conftest import Command
from recordings import IMAGE_TOPIC, Entry, compressed, entries, image, write_mcap
from truth import IDENTITY, frame, picture, translation, unmoved

from stab_ros.cli import main
from stab_ros.core.geometry import rms_distance
from stab_ros.core.types import Frame, Gray, Homography
from stab_ros.evaluation.evaluator import Arrival, Evaluator
from stab_ros.evaluation.frame_metrics import UNITS
from stab_ros.evaluation.settings import EvaluatorConfig
from stab_ros.io.bag import BagWriter, open_bag, topic_of
from stab_ros.io.cdr import CAMERA_INFO, IMAGE, header_of
from stab_ros.io.homography_message import homography_cdr, read_homography
from stab_ros.io.image_message import image_cdr, read_image
from stab_ros.synthetic.flight import Shot

CONTRACT = ("rmsd_reference", "rmsd_previous", "displacement_reference_px", "displacement_previous_px",
            "rmse_reference_px", "rmse_previous_px", "checkpoints")
STABILIZED = "/cam/image_stabilized"
SIZE = (480, 360)


@pytest.fixture(scope="module")
def stabilized(flight: list[Shot], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small flight, raw and stabilised in one bag."""
    folder = tmp_path_factory.mktemp("stabilised")
    raw = write_mcap(folder / "raw.mcap", list(entries(flight)))
    assert main(["stabilize", str(raw), str(folder / "both.mcap"), "--keep-raw"]) == 0
    return folder / "both.mcap"


def unrest_px(shot: Shot) -> float:
    """How far the camera has really moved since the first frame."""
    return rms_distance(shot.ref_H_cur, IDENTITY, (shot.image.shape[1], shot.image.shape[0]))


def evaluated(command: Command, *arguments: object) -> tuple[dict[str, Any], str]:
    """The JSON and what was said of a command that must succeed."""
    path = Path(str(arguments[0])).parent / "out.json"
    done = command("evaluate", *arguments, "--json", path, "--force")
    assert done.returncode == 0, done.stderr
    return json.loads(path.read_text(encoding="utf-8")), done.stdout + done.stderr


def test_raw_and_stabilised_are_judged_side_by_side(stabilized: Path, flight: list[Shot], command: Command) -> None:
    found, said = evaluated(command, stabilized, "-p", "rmse_every:=1")
    assert found["frames"] == 10
    assert list(found["topics"]) == [IMAGE_TOPIC, STABILIZED]
    raw, steady = found["topics"].values()
    for name in CONTRACT:
        assert set(steady[name]) >= {"median", "p95", "max", "count"}
        assert name in said
    assert steady["displacement_reference_px"]["count"] == 9
    assert raw["per_frame"][-1]["rmse_reference_px"] == pytest.approx(unrest_px(flight[-1]), rel=0.15)
    assert steady["rmse_reference_px"]["median"] < 0.3
    assert steady["displacement_reference_px"]["median"] < 0.4 < raw["displacement_reference_px"]["median"]
    assert {"region", "u_px", "v_px", "magnitude_px"} <= set(steady["svf"][0])
    assert {"x", "y", "a", "b", "r2"} <= set(steady["points"][0])
    assert [row["frame"] for row in steady["per_frame"]] == list(range(10))


def test_the_command_gives_what_the_evaluator_gives(stabilized: Path, command: Command) -> None:
    found, _ = evaluated(command, stabilized, "-p", "rmse_every:=4")
    evaluator = Evaluator(EvaluatorConfig(rmse_every=4))
    rows = found["topics"][STABILIZED]["per_frame"]
    for index, (steady, ref_H_cur) in enumerate(read_pairs(stabilized)):
        by_hand = evaluator.step(Arrival(index, steady.stamp_ns, ref_H_cur, False, steady))
        assert rows[index]["outcome"] == by_hand.outcome.value
        assert {name: rows[index][name] for name in UNITS} == {name: by_hand[name] for name in UNITS}


def read_pairs(path: Path) -> Iterator[tuple[Frame, Homography | None]]:
    with open_bag(path) as bag:
        homographies = dict(read_homography(message.data) for message in bag.messages({"/cam/homography"}))
        for message in bag.messages({STABILIZED}):
            steady = read_image(message.data, IMAGE)
            yield steady, homographies[steady.stamp_ns]


def test_homographies_that_were_recorded_late_find_their_pictures(stabilized: Path, command: Command,
                                                                  tmp_path: Path) -> None:
    late = tmp_path / "late.mcap"
    with open_bag(stabilized) as bag, BagWriter(late) as writer:
        for delay_ns, topic, msgtype in ((0, STABILIZED, IMAGE), (10**10, "/cam/homography", CAMERA_INFO)):
            writer.add_topic(topic_of(topic, msgtype))
            for message in bag.messages({topic}):
                writer.write(topic, message.log_time_ns + delay_ns, message.log_time_ns, message.data)
    rows = [evaluated(command, path, "--image-topic", STABILIZED)[0]["topics"][STABILIZED]["per_frame"]
            for path in (stabilized, late)]
    assert rows[0] == rows[1]
    assert len(rows[1]) == 10


@pytest.mark.parametrize("replaced", [(STABILIZED,), (IMAGE_TOPIC, STABILIZED)])
def test_compressed_pictures_are_judged_as_raw_ones(replaced: tuple[str, ...], stabilized: Path, command: Command,
                                                    tmp_path: Path) -> None:
    """As a recorder on the far side of a thin link keeps them; PNG, so that the figures are the same."""
    small = with_compressed(stabilized, tmp_path / "small.mcap", replaced)
    found, expected = (list(evaluated(command, path)[0]["topics"].items()) for path in (small, stabilized))
    assert [name.removesuffix("/compressed") for name, _ in found] == [IMAGE_TOPIC, STABILIZED]
    assert found[1][0] == f"{STABILIZED}/compressed"
    assert [figures for _, figures in found] == [figures for _, figures in expected]


def test_of_pictures_recorded_in_two_ways_the_raw_ones_are_judged(stabilized: Path, command: Command,
                                                                  tmp_path: Path) -> None:
    both = with_compressed(stabilized, tmp_path / "both.mcap", (STABILIZED,), kept=(STABILIZED,))
    assert list(evaluated(command, both, "--limit", 3)[0]["topics"]) == [IMAGE_TOPIC, STABILIZED]


def test_statistics_are_those_of_the_frames(stabilized: Path, command: Command) -> None:
    found, _ = evaluated(command, stabilized)
    for topic in found["topics"].values():
        for name in CONTRACT:
            values = [row[name] for row in topic["per_frame"] if row[name] is not None]
            expected = [*np.percentile(values, [50, 95]), max(values), len(values)]
            assert [topic[name][key] for key in ("median", "p95", "max", "count")] == pytest.approx(expected)


def test_the_table_of_frames_holds_the_same(stabilized: Path, command: Command, tmp_path: Path) -> None:
    found, _ = evaluated(command, stabilized, "--csv", tmp_path / "M.csv")
    with (tmp_path / "M.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    told = [(topic, row) for topic, figures in found["topics"].items() for row in figures["per_frame"]]
    assert len(rows) == len(told) == 20
    for cells, (topic, row) in zip(rows, told, strict=True):
        assert (cells["topic"], cells["frame"], cells["outcome"]) == (topic, str(row["frame"]), row["outcome"])
        for name in UNITS:
            assert cells[name] == ("" if row[name] is None else repr(float(row[name])))
    names = [point["name"] for point in found["topics"][STABILIZED]["points"]]
    of_points = [float(rows[-1][f"rmsd_reference.{name}"]) for name in names if rows[-1][f"rmsd_reference.{name}"]]
    assert of_points


@pytest.mark.parametrize("kind", ["rosbag2_sqlite3", "rosbag1", "folder", "video"])
def test_every_kind_of_input_is_judged(kind: str, recordings: dict[str, Path], flight: list[Shot],
                                       command: Command) -> None:
    found, _ = evaluated(command, recordings[kind], "-p", "rmse_every:=9")
    (figures,) = found["topics"].values()
    assert figures["frames_measured"] == 9
    assert figures["per_frame"][-1]["rmse_reference_px"] == pytest.approx(unrest_px(flight[-1]), rel=0.2)


def written(path: Path, images: list[Gray], topic: str, lost: tuple[int, ...] | None = None) -> Path:
    """A bag of stabilised pictures; with homographies unless `lost` is None."""
    with BagWriter(path) as writer:
        writer.add_topic(topic_of(topic, IMAGE))
        if lost is not None:
            writer.add_topic(topic_of("/cam/homography", CAMERA_INFO))
        for index, gray in enumerate(images):
            one = frame(gray, index)
            if lost is not None:
                track = unmoved(one, index, lost=index in lost)
                cdr = homography_cdr(track, header_of(one), one.size)
                writer.write("/cam/homography", one.stamp_ns, one.stamp_ns, cdr)
            if index not in (lost or ()):
                writer.write(topic, one.stamp_ns, one.stamp_ns, image_cdr(gray, "mono8", header_of(one)))
    return path


def residual(distance_px: float, count: int, noise: float = 0.0) -> list[Gray]:
    """A reference, and pictures that stand off by `distance_px` in all directions."""
    shifts = [distance_px * np.array([np.cos(angle), np.sin(angle)]) for angle in np.linspace(0.3, 5.5, count)]
    return [picture(IDENTITY, SIZE, noise=noise), *(picture(translation(-x, -y), SIZE, noise=noise) for x, y in shifts)]


@pytest.mark.parametrize("distance_px", [0.2, 1.0, 4.0])
def test_what_another_tool_has_stabilised(distance_px: float, command: Command, tmp_path: Path) -> None:
    path = written(tmp_path / "other.mcap", residual(distance_px, 4), "/other/steady")
    found, _ = evaluated(command, path, "-p", "rmse_every:=1")
    figures = found["topics"]["/other/steady"]
    found_px = figures["displacement_reference_px"]["median"]
    assert found_px == pytest.approx(distance_px, abs=max(0.05, 0.15 * distance_px))
    assert figures["rmse_reference_px"]["median"] == pytest.approx(distance_px, abs=0.1)
    assert all(one["magnitude_px"] == pytest.approx(distance_px, abs=0.05) for one in figures["svf"] if one["vectors"])


def test_lost_frames_are_counted_and_left_out(command: Command, tmp_path: Path) -> None:
    path = written(tmp_path / "lost.mcap", residual(0.0, 5, noise=1), STABILIZED, lost=(2, 3))
    found, said = evaluated(command, path)
    figures = found["topics"][STABILIZED]
    outcomes = [row["outcome"] for row in figures["per_frame"]]
    assert outcomes == ["REFERENCE", "MEASURED", "LOST", "LOST", "MEASURED", "MEASURED"]
    assert (figures["frames_lost"], figures["displacement_reference_px"]["count"]) == (2, 3)
    assert figures["displacement_previous_px"]["count"] == 2, "a lost frame lies between"
    assert figures["findings"]["error"] == 2
    assert "frame 2 " in said


def test_metres_and_points_of_the_user(stabilized: Path, command: Command, tmp_path: Path) -> None:
    points = tmp_path / "points.csv"
    points.write_text("name,x,y\nrock,100,60\nlog,300,200\n", encoding="utf-8")
    found, said = evaluated(command, stabilized, "--points", points, "-p", "gsd_m:=0.01", "-p", "fps:=24")
    figures = found["topics"][STABILIZED]
    assert [(one["name"], one["x"], one["y"]) for one in figures["points"]] == [("rock", 100, 60), ("log", 300, 200)]
    in_px, in_m_s = figures["displacement_previous_px"], figures["velocity_error_m_s"]
    assert in_m_s["median"] == pytest.approx(in_px["median"] * 0.01 * 24)
    assert "velocity_error_m_s" in said


def test_a_part_one_topic_and_a_file_of_parameters(stabilized: Path, command: Command, tmp_path: Path) -> None:
    config = tmp_path / "both.yaml"
    config.write_text("/**:\n  ros__parameters:\n    method: klt\n    points: 5\n"
                      "/cam/evaluator_node:\n  ros__parameters:\n    rmse_every: 2\n    stale_s: 3.0\n"
                      "/cam/tracker_node:\n  ros__parameters:\n    model: affine\n", encoding="utf-8")
    found, _ = evaluated(command, stabilized, "--image-topic", STABILIZED, "--limit", 5, "--config", config)
    assert list(found["topics"]) == [STABILIZED]
    figures = found["topics"][STABILIZED]
    assert len(figures["points"]) <= 5
    assert figures["frames_measured"] == 4
    assert figures["checkpoints"]["count"] == 3  # frames 1, 2 and 4


def test_the_same_recording_gives_the_same_figures(stabilized: Path, command: Command) -> None:
    assert evaluated(command, stabilized) == evaluated(command, stabilized)


def test_a_picture_that_cannot_be_decoded_costs_itself(flight: list[Shot], command: Command, tmp_path: Path) -> None:
    topic, msgtype = "/cam/image_raw/compressed", "sensor_msgs/msg/CompressedImage"
    messages = [Entry(topic, msgtype, shot.stamp_ns, compressed(shot, "png")) for shot in flight[:5]]
    messages[2].message.data = messages[2].message.data[:100]
    found, said = evaluated(command, write_mcap(tmp_path / "in.mcap", messages))
    (figures,) = found["topics"].values()
    assert figures["frames_measured"] == 3
    assert figures["frames_no_image"] == 1
    assert "warning" in said
    assert "1 of 5 images" in said


def test_a_flat_stream_has_no_figures_and_says_so(command: Command, tmp_path: Path) -> None:
    flat = [np.full(SIZE[::-1], 90, np.uint8)] * 3
    found, said = evaluated(command, written(tmp_path / "flat.mcap", flat, "/cam/steady"))
    (figures,) = found["topics"].values()
    assert figures["points"] == []
    assert figures["displacement_reference_px"] == {"median": None, "p95": None, "max": None, "count": 0}
    assert "no place for a verification point" in said


def test_several_cameras_take_a_choice(flight: list[Shot], command: Command, tmp_path: Path) -> None:
    messages = [Entry(topic, "sensor_msgs/msg/Image", shot.stamp_ns, image(shot))
                for shot in flight[:2] for topic in ("/left/image_raw", "/right/image_raw")]
    path = write_mcap(tmp_path / "two.mcap", messages)
    refused = command("evaluate", path)
    assert refused.returncode == 2
    assert "/left/image_raw, /right/image_raw" in refused.stderr
    found, _ = evaluated(command, path, "--image-topic", "/right/image_raw", "--image-topic", "/left/image_raw")
    assert sorted(found["topics"]) == ["/left/image_raw", "/right/image_raw"]


def test_brightness_is_told(command: Command, tmp_path: Path) -> None:
    images = [picture(IDENTITY, SIZE), picture(IDENTITY, SIZE, gain=1.05)]
    found, said = evaluated(command, written(tmp_path / "light.mcap", images, "/cam/steady"))
    assert found["topics"]["/cam/steady"]["brightness_change"]["max"] == pytest.approx(0.05, abs=0.01)
    assert "brightness changed by +5" in said


def test_json_has_no_nan(command: Command, tmp_path: Path) -> None:
    """Half of the reference is out of sight: regions and points there have no value."""
    moved = cv2.warpPerspective(picture(translation(200, 0), SIZE), translation(200, 0), SIZE)
    found, _ = evaluated(command, written(tmp_path / "half.mcap", [picture(IDENTITY, SIZE), moved], "/cam/steady"))
    (figures,) = found["topics"].values()
    assert any(region["u_px"] is None for region in figures["svf"])
    assert all(math.isfinite(value) for value in numbers(found))


def numbers(tree: Any) -> Iterator[float]:
    if isinstance(tree, dict):
        tree = list(tree.values())
    if isinstance(tree, list):
        for one in tree:
            yield from numbers(one)
    elif isinstance(tree, float):
        yield tree


def test_report_and_its_folder(stabilized: Path, command: Command, tmp_path: Path) -> None:
    done = command("evaluate", stabilized, "--report", tmp_path / "report", "--limit", 4)
    assert done.returncode == 0, done.stderr
    names = sorted(path.name for path in (tmp_path / "report").iterdir())
    assert names == ["index.html", "metrics.csv", "metrics.json"]
    again = command("evaluate", stabilized, "--report", tmp_path / "report", "--limit", 4)
    assert again.returncode == 2
    assert "--force" in again.stderr
