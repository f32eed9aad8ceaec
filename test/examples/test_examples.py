"""The examples do what they say: as programs of their own, over DDS where they are nodes."""

from __future__ import annotations

import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from example_process import EXAMPLES, running
from flights import SIZE
from geometry_msgs.msg import Vector3Stamped
from image_publisher import FRAMES, SPEED_M_S, shots
from image_publisher import flight as flown
from live_graph import Graph, image_message, stamp_ns
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float64, UInt64

from stab_ros import read_homographies, rms_distance
from stab_ros.synthetic.flight import Shot

WINDOW = "[180, 95, 120, 80]"  # water


def _told(answers: list[Any], of_ns: int) -> bool:
    return bool(answers) and stamp_ns(answers[-1]) == of_ns


def publish(images: Any) -> None:
    for shot in shots():
        images.publish(image_message(shot.image, shot.stamp_ns))


def test_a_folder_is_stabilised(flight: list[Shot], tmp_path: Path) -> None:
    source, output = tmp_path / "frames", tmp_path / "stabilised"
    source.mkdir()
    for shot in flight:
        cv2.imwrite(str(source / f"{shot.index:03}.png"), shot.image)
    words = [sys.executable, str(EXAMPLES / "stabilise_folder.py"), str(source), str(output)]
    subprocess.run(words, check=True, timeout=300)
    rows = read_homographies(output / "H.csv")
    assert len(rows) == len([*output.glob("*.png")]) == len(flight)
    size = (flight[0].image.shape[1], flight[0].image.shape[0])
    for row, shot in zip(rows, flight, strict=True):
        assert row.ref_H_cur is not None
        assert rms_distance(row.ref_H_cur, shot.ref_H_cur, size) < 0.1
        picture = cv2.imread(str(output / f"{row.frame:05}.png"), cv2.IMREAD_GRAYSCALE)
        assert picture is not None
        assert np.abs(picture.astype(float) - flight[0].image)[40:-40, 40:-40].mean() < 12


def test_an_input_that_is_missing_is_one_line(tmp_path: Path) -> None:
    words = [sys.executable, str(EXAMPLES / "stabilise_folder.py"), str(tmp_path / "none"), str(tmp_path / "out")]
    failed = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60)
    assert failed.returncode == 1
    assert failed.stderr.startswith(f"{tmp_path / 'none'}: no such file or folder")
    assert failed.stderr.count("\n") == 1


def test_velocimetry_measures_the_water_and_not_the_drone(graph: Graph) -> None:
    measured: list[Any] = graph.listen(Vector3Stamped, "/velocimetry_node/velocity", 100)
    graph.start("tracker_node", queue_depth=0, wait_for_subscribers=1)
    with running(graph, "velocimetry_node.py", "-p", f"gsd_m:={flown().gsd_m}", "-p", f"window:={WINDOW}"):
        images = graph.speak(Image, "/image_raw", 300)
        graph.until(lambda: images.get_subscription_count() == 2, "the tracker and the velocimeter")
        publish(images)
        graph.until(lambda: len(measured) == FRAMES - 1, "a velocity of each pair")
    assert [stamp_ns(one) for one in measured] == [shot.stamp_ns for shot in shots()[1:]]
    assert abs(np.median([one.vector.x for one in measured]) - SPEED_M_S) < 0.05 * SPEED_M_S
    assert abs(np.median([one.vector.y for one in measured])) < 0.05 * SPEED_M_S


@pytest.mark.parametrize(("parameters", "tracker", "fewest", "most"), [
    (("start_s:=1.0", "rate_hz:=30.0"), {}, FRAMES, FRAMES),
    pytest.param(("queue:=10",), {}, 1, FRAMES - 15, marks=pytest.mark.thorough),  # the start's images are gone
    (("queue:=10",), {"answer_start": "at_once"}, FRAMES, FRAMES),
])
def test_pairs_by_stamp(
    graph: Graph, parameters: tuple[str, ...], tracker: dict[str, Any], fewest: int, most: int
) -> None:
    answers: list[Any] = graph.listen(CameraInfo, "/homography", 100)
    pairs: list[Any] = graph.listen(UInt64, "/pair_node/pairs", 100)
    graph.start("tracker_node", queue_depth=0, wait_for_subscribers=2, **tracker)
    with running(graph, "pair_by_stamp.py", *(word for one in parameters for word in ("-p", one))):
        images = graph.speak(Image, "/image_raw", 300)
        graph.until(lambda: images.get_subscription_count() == 2, "the tracker and the pairing node")
        for shot in shots():
            images.publish(image_message(shot.image, shot.stamp_ns))
            if tracker:  # as a camera that is no faster than the tracker
                graph.until(partial(_told, answers, shot.stamp_ns), "its answer")
        graph.until(lambda: len(answers) == FRAMES and pairs and pairs[-1].data >= fewest, "every frame answered")
    assert fewest <= pairs[-1].data <= most


def test_two_nodes_in_one_process(graph: Graph) -> None:
    answers: list[Any] = graph.listen(CameraInfo, "/cam/homography", 100)
    drifts: list[Any] = graph.listen(Float64, "/cam/drift_node/drift_px", 100)
    with running(graph, "composed.py", "-r", "__ns:=/cam", "-p", "queue_depth:=0", "-p", "wait_for_subscribers:=2"):
        images = graph.speak(Image, "/cam/image_raw", 300)
        publish(images)
        graph.until(lambda: len(answers) == len(drifts) == FRAMES, "every frame answered, by both nodes")
    assert drifts[0].data == 0
    assert 0.1 < max(one.data for one in drifts) < max(SIZE)
