"""The nodes as users run them: separate processes over DDS."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Command
from diagnostic_msgs.msg import DiagnosticArray
from flights import moved, trap
from live_graph import Graph, image_message, stamp_ns, values_of
from rcl_interfaces.srv import GetParameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from recordings import IMAGE_TOPIC
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from stab_ros.io.bag import open_bag
from stab_ros.io.cdr import read_stamp
from stab_ros.io.homography_message import read_homography
from stab_ros.synthetic.camera_path import Gust, Pose
from stab_ros.synthetic.flight import Flight, Shot

CONFIG = Path(__file__).parents[2] / "config" / "tracker.yaml"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def messages(path: Path, topic: str) -> list[bytes]:
    with open_bag(path) as bag:
        return [message.data for message in bag.messages([topic])]


def tracks(path: Path, topic: str) -> list[tuple[int, dict[str, str]]]:
    read = [deserialize_message(data, DiagnosticArray) for data in messages(path, topic)]
    return [(stamp_ns(one), values_of(one)) for one in read]


@pytest.mark.parametrize("start_s", [0.0, 0.5, 5.0])  # no start, one that ends in mid-stream, and with the stream
def test_live_gives_what_the_command_gives(
    start_s: float, graph: Graph, recordings: dict[str, Path], executable: Command, tmp_path: Path
) -> None:
    recorded, offline = tmp_path / "live.mcap", tmp_path / "offline.mcap"
    outputs = ["/cam/homography", "/cam/image_stabilized", "/cam/tracker_node/track"]
    answers = graph.listen(CameraInfo, "/cam/homography")
    recorder = graph.start("bag_recorder_node", output=str(recorded), topics=outputs)
    tracker = graph.start("tracker_node", "/cam", queue_depth=0, wait_for_subscribers=2, start_s=start_s)
    player = graph.start("bag_player_node", bag=str(recordings["mcap"]), wait_for_subscribers=1, rate=100.0)
    assert player.wait() == 0
    sent = [read_stamp(data) for data in messages(recordings["mcap"], IMAGE_TOPIC)]
    graph.until(lambda: len(answers) == len(sent), "every frame answered")
    assert (tracker.stop(), recorder.stop(signal.SIGTERM)) == (0, 0)

    assert executable("stabilize", recordings["mcap"], offline, "-p", f"start_s:={start_s}").returncode == 0
    live = dict(map(read_homography, messages(recorded, "/cam/homography")))
    same = dict(map(read_homography, messages(offline, "/cam/homography")))
    assert list(live) == list(same) == sent
    for stamp, H in same.items():
        other = live[stamp]
        assert H is not None
        assert other is not None
        np.testing.assert_allclose(other, H, rtol=0, atol=1e-9)
    images, all_images = messages(recorded, "/cam/image_stabilized"), messages(offline, "/cam/image_stabilized")
    assert [read_stamp(data) for data in all_images] == sent
    at_hand = [stamp == sent[0] or stamp >= sent[0] + start_s * 1e9 for stamp in sent]  # when their answer was known
    assert images == [data for data, known in zip(all_images, at_hand, strict=True) if known]
    assert tracks(recorded, "/cam/tracker_node/track") == tracks(offline, "/cam/track")


@pytest.mark.parametrize(
    ("module", "number"), [("numpy", signal.SIGINT), ("rclpy", signal.SIGTERM), ("numba", signal.SIGINT)])
def test_signal_during_start(graph: Graph, module: str, number: int) -> None:
    tracker = graph.start("tracker_node")
    libraries = Path(f"/proc/{tracker.process.pid}/maps")
    graph.until(lambda: f"/{module}/" in libraries.read_text(), f"{module} being loaded")
    assert tracker.stop(number) == 0
    assert "Traceback" not in tracker.log


@pytest.mark.parametrize(
    ("name", "arguments", "said"),
    [
        ("tracker_node", ["-p", "method:=magic"], "method: 'magic' is unknown, it must be one of"),
        ("tracker_node", ["-p", "roi:=[[[0, 0], [1, 0]]]"], "roi: a polygon needs at least 3 points"),
        ("tracker_node", ["-p", "roi:=[0, 410]"], "roi: the value must be JSON"),  # what rcl leaves of nested lists
        ("tracker_node", ["-p", "method:=ssim_s"], "method: 'ssim_s' is unknown, did you mean ssims"),
        ("tracker_node", ["-p", "points_file:=missing.csv"], "missing.csv"),
        ("tracker_node", ["-p", "exclude:=missing.png"], "exclude: 'missing.png' is neither"),
        ("tracker_node", ["--params-file", "missing.yaml"], "missing.yaml"),
        ("bag_player_node", [], "bag: no recording is named"),
        ("bag_player_node", ["-p", "bag:=missing.mcap"], "missing.mcap: no such file"),
        ("bag_recorder_node", [], "output: no file is named"),
        ("bag_recorder_node", ["-p", "output:=/dev/null/out.mcap"], "/dev/null/out.mcap"),
        ("bag_recorder_node", ["-p", "output:=out.mcap", "-p", "topics:=3"], "topics: 3 must be a list of names"),
    ],
)
def test_bad_parameters_are_one_line_and_exit_code_2(graph: Graph, name: str, arguments: list[str], said: str) -> None:
    node = graph.run(name, ["--ros-args", *arguments])
    assert node.wait() == 2
    (line,) = node.log.splitlines()
    assert line.startswith(f"{name}: ")
    assert said in line


@pytest.mark.thorough
def test_unknown_parameter_is_named(graph: Graph) -> None:
    tracker = graph.start("tracker_node", metod="klt")
    graph.until(lambda: "ready" in tracker.log, "the tracker ready")
    assert "parameter metod is unknown and has no effect; did you mean method or model?" in tracker.log


def test_parameters_change_at_run_time(graph: Graph, flight: list[Shot]) -> None:
    graph.start("tracker_node", queue_depth=0, wait_for_subscribers=1)
    diagnostics = graph.listen(DiagnosticArray, "/diagnostics", 1)
    answers = graph.listen(CameraInfo, "/homography")
    camera = graph.speak(Image, "/image_raw")
    camera.publish(image_message(flight[0].image, 1))
    graph.until(lambda: len(answers) == 1, "the reference")
    assert graph.set_parameter("/tracker_node", "method", "klt") == (True, "")
    assert graph.set_parameter("/tracker_node", "threshold", 2) == (True, "")
    refusals: dict[str, float | str] = {
        "method": "magic", "on_lost": "", "threshold": -1.0, "min_inliers": 1.5, "queue_depth": 0,
        "roi": "[[[9000, 9000], [9100, 9000], [9100, 9100]]]", "exclude": "[[[0, 0], [1, 1]]]",
    }
    for name, value in refusals.items():
        taken, reason = graph.set_parameter("/tracker_node", name, value)
        assert not taken
        assert name in reason or "Wrong parameter type" in reason
    camera.publish(image_message(flight[1].image, 2))
    graph.until(lambda: len(answers) == 2, "an answer of the new method")
    assert any(answers[1].k)
    graph.until(lambda: diagnostics and values_of(diagnostics[-1])["frames_in"] == "2", "the report")
    assert values_of(diagnostics[-1])["method"] == "klt"


def test_a_preset_is_chosen_at_the_start(graph: Graph) -> None:
    given: dict[str, Any] = {"method": "ssims", "ssim.area": 15}
    tracker = graph.start("tracker_node", **given)
    diagnostics = graph.listen(DiagnosticArray, "/diagnostics")
    graph.until(lambda: diagnostics, "diagnostics")
    assert values_of(diagnostics[-1])["method"] == "ssims"
    request = GetParameters.Request(names=["method", "model", "ssim.search", "ssim.area"])
    shown = graph.call(GetParameters, "/tracker_node/get_parameters", request).values
    assert [one.string_value or one.integer_value for one in shown] == ["ssims", "projective", 21, 15]
    taken, reason = graph.set_parameter("/tracker_node", "method", "ssims_basento")
    assert not taken
    assert "the preset ssims_basento can only be chosen at the start" in reason
    assert graph.set_parameter("/tracker_node", "model", "affine") == (True, "")
    assert tracker.stop() == 0


@pytest.mark.thorough
def test_one_parameter_file_serves_node_and_command(
    graph: Graph, recordings: dict[str, Path], executable: Command, tmp_path: Path
) -> None:
    written = CONFIG.read_text()
    assert written.count("method: direct") == 1
    config, table = tmp_path / "tracker.yaml", tmp_path / "H.csv"
    config.write_text(written.replace("method: direct", "method: klt\n    klt.levels: 2\n    queue_depth: 0"))
    tracker = graph.run("tracker_node", ["--ros-args", "-r", "__ns:=/cam", "--params-file", str(config)])
    diagnostics = graph.listen(DiagnosticArray, "/diagnostics")
    graph.until(lambda: diagnostics, "a report")
    assert values_of(diagnostics[0])["method"] == "klt"
    assert "has no effect" not in tracker.log

    tables = []
    for options in (["--config", config], ["-p", "method:=klt", "-p", "klt.levels:=2"]):
        outputs = (tmp_path / "out.mcap", "--homographies", table, "--force", "--no-image")
        assert executable("stabilize", recordings["mcap"], *outputs, "--limit", 2, *options).returncode == 0
        tables.append(table.read_text())
    assert tables[0] == tables[1]
    as_is = tmp_path / "as_is.mcap", "--config", CONFIG, "--limit", 1
    assert executable("stabilize", recordings["mcap"], *as_is).returncode == 0


def test_reset_makes_the_next_frame_the_latched_reference(graph: Graph, flight: list[Shot]) -> None:
    graph.start("tracker_node", "/cam", queue_depth=0, wait_for_subscribers=1)
    answers = graph.listen(CameraInfo, "/cam/homography")
    tracks = graph.listen(DiagnosticArray, "/cam/tracker_node/track")
    camera = graph.speak(Image, "/cam/image_raw")
    for number in (0, 1):
        camera.publish(image_message(flight[number].image, number))
    graph.until(lambda: len(answers) == 2, "two answers")
    assert graph.call(Trigger, "/cam/tracker_node/reset_reference", Trigger.Request()).success
    camera.publish(image_message(flight[5].image, 5))
    graph.until(lambda: len(answers) == 3, "the answer after the reset")
    assert np.allclose(answers[0].r, np.eye(3).ravel())
    assert not np.allclose(answers[1].r, np.eye(3).ravel())
    assert np.allclose(answers[2].r, np.eye(3).ravel())

    late = graph.listen(Image, "/cam/tracker_node/reference_image", LATCHED)
    graph.until(lambda: late, "the latched reference")
    assert stamp_ns(late[0]) == 5
    assert bytes(late[0].data) == flight[5].image.tobytes()
    graph.until(lambda: len(tracks) == 3, "three tracks")
    assert [values_of(one)["reset_counter"] for one in tracks] == ["0", "0", "1"]
    assert [values_of(one)["reference_stamp_ns"] for one in tracks] == ["0", "0", "5"]


@pytest.mark.thorough
def test_two_cameras(graph: Graph, flight: list[Shot]) -> None:
    for name in ("/left", "/right"):
        graph.start("tracker_node", name, queue_depth=0, wait_for_subscribers=1)
    answers = {name: graph.listen(CameraInfo, f"{name}/homography") for name in ("/left", "/right")}
    cameras = {name: graph.speak(Image, f"{name}/image_raw") for name in ("/left", "/right")}
    for number in (0, 1):
        cameras["/left"].publish(image_message(flight[number].image, number))
        cameras["/right"].publish(image_message(np.fliplr(flight[number].image), 100 + number))
    graph.until(lambda: all(len(heard) == 2 for heard in answers.values()), "two answers for each camera")
    assert [stamp_ns(one) for one in answers["/left"]] == [0, 1]
    assert [stamp_ns(one) for one in answers["/right"]] == [100, 101]
    left, right = (np.array(answers[name][1].r).reshape(3, 3) for name in ("/left", "/right"))
    assert left[0, 2] * right[0, 2] < 0  # the mirrored camera drifts the other way


def test_state_goes_from_waiting_to_stale(graph: Graph, flight: list[Shot]) -> None:
    graph.start("tracker_node", stale_s=0.05)
    diagnostics = graph.listen(DiagnosticArray, "/diagnostics", 1)
    graph.until(lambda: diagnostics and diagnostics[-1].status[0].message == "waiting for images on /image_raw",
                "a tracker that is ready")
    assert values_of(diagnostics[-1])["state"] == "WAITING"
    graph.speak(Image, "/image_raw").publish(image_message(flight[0].image, 1))
    graph.until(lambda: values_of(diagnostics[-1])["state"] == "STALE", "the state STALE")
    assert diagnostics[-1].status[0].message.startswith("no image for ")


def test_debug_image_is_made_for_who_listens(graph: Graph, flight: list[Shot]) -> None:
    graph.start("tracker_node", queue_depth=0, start_s=0.0)
    images = graph.listen(Image, "/tracker_node/debug_image")
    camera = graph.speak(Image, "/image_raw")
    graph.until(lambda: graph.node.count_publishers("/tracker_node/debug_image"), "discovery")
    for number in (0, 1):
        camera.publish(image_message(flight[number].image, number))
    graph.until(lambda: images and stamp_ns(images[-1]) == 1, "the debug image")
    height, width = flight[0].image.shape
    assert (images[-1].height, images[-1].width, images[-1].encoding) == (height, width, "bgr8")


def test_the_static_map_is_latched_and_ambiguous_ground_is_reported(graph: Graph) -> None:
    """One bank, rigid water, a camera that drifts with it: tracked, with a warning of ambiguous ground."""
    scene = moved(trap("kolubara", 0.3, 0.0, width=1.2, centre=0.9), Gust(-1.5, 4.0, Pose(x_m=1.0)))
    flight = Flight(scene, (480, 270), 40, seed=3)
    diagnostics = graph.listen(DiagnosticArray, "/diagnostics")
    answers = graph.listen(CameraInfo, "/homography")
    graph.start("tracker_node", queue_depth=0, wait_for_subscribers=1)
    camera = graph.speak(Image, "/image_raw")
    graph.until(lambda: camera.get_subscription_count() == 1, "the tracker listens")
    for shot in flight:
        camera.publish(image_message(shot.image, shot.stamp_ns))
    graph.until(lambda: len(answers) == len(flight), "every frame answered")
    assert [stamp_ns(one) for one in answers] == [shot.stamp_ns for shot in flight]

    maps = graph.listen(Image, "/tracker_node/static_map", LATCHED)
    graph.until(lambda: maps, "the map, although it came before us")
    assert (maps[0].width, maps[0].height, maps[0].encoding) == (480, 270, "mono8")
    assert set(maps[0].data) == {0, 255}
    graph.until(lambda: any("ambiguous" in one.status[0].message for one in diagnostics), "the warning")
    warning = next(one for one in diagnostics if "ambiguous" in one.status[0].message)
    assert warning.status[0].level == b"\x01"
    assert 0.1 < float(values_of(warning)["rival_share"]) < 0.9
