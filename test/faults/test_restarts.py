"""Cameras, trackers and subscribers that stop, are killed and come back: the stream goes on by itself."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from bag_makers import written
from diagnostic_msgs.msg import DiagnosticArray
from live_graph import Graph, image_message, values_of
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger
from stream import TrackedStream
from truth import picture, translation

from stab_ros.core.types import Frame
from stab_ros.io.saved_reference import SavedReference, load_reference, save_reference
from stab_ros.synthetic.flight import Shot
from stab_ros.tracking.static_map import StaticMap

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
S, MS = 10**9, 10**6


def test_a_camera_that_falls_silent_and_restarts(graph: Graph, flight: list[Shot]) -> None:
    stream = TrackedStream(graph, stale_s=1.0)
    stream.show(*[image_message(flight[k].image, k * 40 * MS + 1) for k in range(3)])
    stream.until_told(state="STALE", frames_tracked=3)
    stream.until_said("no image for ", level=2)
    graph.node.destroy_publisher(stream.camera)
    stream.camera = graph.speak(Image, "/image_raw")
    stream.diagnostics.clear()
    stream.show(image_message(flight[3].image, 10 * S))
    stream.until_answered(4)
    assert stream.homography(3).any()
    stream.until_said("images again after ")
    stream.until_told(state="TRACKED", frames_tracked=4, reset_counter=0)
    assert "images again after " in stream.tracker.log


def test_a_silence_within_the_start_is_no_loss(graph: Graph, flight: list[Shot]) -> None:
    """What was deferred is answered once nothing more comes."""
    stream = TrackedStream(graph, start_s=5.0, stale_s=0.5)
    stream.show(*[image_message(flight[k].image, k * 40 * MS + 1) for k in range(5)])
    stream.until_answered(5)
    assert stream.stamps == [k * 40 * MS + 1 for k in range(5)]


def test_a_killed_subscriber_holds_nobody_up(graph: Graph, flight: list[Shot], tmp_path: Path) -> None:
    """A recorder of the pictures is killed in mid-stream; the tracker, which never waits for it, answers on."""
    recorder = graph.start("bag_recorder_node", output=str(tmp_path / "out.mcap"),
                           topics=["/homography", "/image_stabilized"])
    stream = TrackedStream(graph, queue_depth=1, wait_for_subscribers=2)
    for k in range(5):
        stream.show(image_message(flight[k].image, k + 1))
        stream.until_answered(k + 1)
    assert recorder.stop(signal.SIGKILL) == -signal.SIGKILL
    for k in range(5, 10):
        stream.show(image_message(flight[k].image, k + 1))
        stream.until_answered(k + 1)
    assert stream.stamps == list(range(1, 11))
    stream.until_told(frames_tracked=10, frames_dropped=0)


def test_a_killed_tracker_goes_on_against_the_same_reference(
    graph: Graph, flight: list[Shot], tmp_path: Path
) -> None:
    kept = tmp_path / "reference.mcap"
    stream = TrackedStream(graph, reference_path=str(kept), start_s=0.1, stale_s=1.0)
    graph.call(Trigger, "/tracker_node/reset_reference", Trigger.Request())
    stream.show(*[image_message(flight[k].image, 1000 + k * 40 * MS) for k in range(5)])
    stream.until_answered(5)
    graph.until(kept.exists, "the saved reference")
    assert stream.tracker.stop(signal.SIGKILL) == -signal.SIGKILL
    before = len(stream.answers)
    stream.restart()
    assert "resuming from the reference of stamp 1000 ns" in stream.tracker.log
    tracks = graph.listen(DiagnosticArray, "/tracker_node/track")
    graph.until(lambda: graph.node.count_publishers("/tracker_node/track"), "discovery")
    references = graph.listen(Image, "/tracker_node/reference_image", LATCHED)
    graph.until(lambda: references, "the reference, latched again")
    assert bytes(references[-1].data) == flight[0].image.tobytes()
    for k in range(5, 10):
        stream.show(image_message(flight[k].image, 1000 + k * 40 * MS))
    stream.until_answered(before + 5)
    for k in range(5, 10):
        found, true = stream.homography(before + k - 5), flight[k].ref_H_cur
        assert np.abs(found @ [479.0, 269.0, 1.0] - true @ [479.0, 269.0, 1.0]).max() < 0.15
    graph.until(lambda: tracks, "a track")
    told = values_of(tracks[-1])
    assert (told["reference_stamp_ns"], told["reset_counter"]) == ("1000", "0")
    assert graph.call(Trigger, "/tracker_node/reset_reference", Trigger.Request()).success
    before_reset = kept.stat().st_mtime_ns
    stream.show(*[image_message(picture(translation(0.5 * k, 0.0), (480, 270)), S + k * 40 * MS) for k in range(6)])
    stream.until_answered(before + 11)
    graph.until(lambda: kept.stat().st_mtime_ns != before_reset, "the new reference saved")


def test_a_restarted_tracker_undistorts_as_before(graph: Graph, flight: list[Shot], tmp_path: Path) -> None:
    """It knows the camera of its reference, and does not take another one's description."""
    kept = tmp_path / "reference.mcap"
    stream = TrackedStream(graph, reference_path=str(kept), use_camera_info=True)
    infos = graph.speak(CameraInfo, "/camera_info", LATCHED)
    K = [400.0, 0.0, 240.0, 0.0, 400.0, 135.0, 0.0, 0.0, 1.0]
    infos.publish(CameraInfo(width=480, height=270, distortion_model="plumb_bob", d=[-0.1, 0.01, 0, 0, 0], k=K))
    stream.show(image_message(flight[0].image, 1), image_message(flight[1].image, 2))
    stream.until_answered(2)
    stream.tracker.stop(signal.SIGKILL)
    graph.node.destroy_publisher(infos)
    other = graph.node.create_publisher(CameraInfo, "/camera_info", LATCHED)
    other.publish(CameraInfo(width=480, height=270, distortion_model="plumb_bob", d=[0.3, 0.0, 0, 0, 0], k=K))
    stream.restart()
    stream.show(image_message(flight[1].image, 2))
    stream.until_answered(3)
    np.testing.assert_allclose(stream.homography(2), stream.homography(1), atol=2e-3)
    assert list(stream.answers[2].d) == list(stream.answers[1].d)
    graph.until(lambda: "camera_info has changed, the camera that took the reference is kept" in stream.tracker.log,
                "the warning")


def saved(path: Path, flight: list[Shot]) -> None:
    everything = StaticMap.of_mask(np.ones(flight[0].image.shape, bool))
    save_reference(path, SavedReference(Frame(flight[0].image, "mono8", 5), everything, 3))


def test_a_saved_reference_waits_for_the_compiler_and_may_be_given_up(
    graph: Graph, flight: list[Shot], tmp_path: Path
) -> None:
    kept = tmp_path / "reference.mcap"
    saved(kept, flight)
    graph.environment["NUMBA_CACHE_DIR"] = str(tmp_path / "cache")
    tracker = graph.start("tracker_node", reference_path=str(kept))
    graph.until(lambda: "compiling kernels" in tracker.log, "the compiler at work")
    taken, reason = graph.set_parameter("/tracker_node", "roi", "[[[0, 0], [9, 0], [9, 9]]]")
    assert not taken
    assert "the saved reference is not in force yet" in reason
    assert graph.call(Trigger, "/tracker_node/reset_reference", Trigger.Request()).success
    assert graph.set_parameter("/tracker_node", "threshold", 1.0) == (True, "")
    graph.until(lambda: "ready" in tracker.log, "the tracker ready")
    assert "resuming from" not in tracker.log


def words(path: Path, _flight: list[Shot]) -> None:
    path.write_bytes(b"no recording")


def other_bag(path: Path, _flight: list[Shot]) -> None:
    written(path)


def cut_off(path: Path, flight: list[Shot]) -> None:
    saved(path, flight)
    path.write_bytes(path.read_bytes()[:-1000])


@pytest.mark.parametrize(("make", "parameter", "says"), [
    (words, "", "is not an MCAP file"),
    (other_bag, "", "holds no reference that a tracker has saved"),
    (cut_off, "", "holds no reference that a tracker has saved"),
    (saved, "use_camera_info:=true", "was saved with use_camera_info false"),
    (saved, "roi:=[[[900,900],[950,900],[950,950]]]", "roi"),
    (saved, "points_file:=none.csv", "none.csv"),
])
def test_a_reference_that_does_not_fit_is_refused_and_kept(
    graph: Graph, flight: list[Shot], tmp_path: Path, make: Callable[[Path, list[Shot]], None], parameter: str,
    says: str
) -> None:
    kept = tmp_path / "reference.mcap"
    make(kept, flight)
    before = kept.read_bytes()
    more = ["-p", parameter] if parameter else []
    tracker = graph.run("tracker_node", ["--ros-args", "-p", f"reference_path:={kept}", *more])
    assert tracker.wait() == 2
    (line,) = tracker.log.splitlines()
    assert says in line
    assert kept.read_bytes() == before


def test_a_saved_reference_comes_back_as_it_was(flight: list[Shot], tmp_path: Path) -> None:
    path = tmp_path / "reference.mcap"
    assert load_reference(path) is None
    saved(path, flight)
    saved(path, flight)  # over the old one
    found = load_reference(path)
    assert found is not None
    assert np.array_equal(found.frame.image, flight[0].image)
    assert (found.frame.stamp_ns, found.frame.encoding, found.reset_counter) == (5, "mono8", 3)
    assert found.static_map.picture().all()
    assert [file.name for file in tmp_path.iterdir()] == ["reference.mcap"]
