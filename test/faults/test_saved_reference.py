"""`~/save_reference`: what is saved leads to the same homographies, and what cannot be saved is told in one line."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ailing import needs_root, small_disk
from live_graph import Graph, image_message, stamp_ns
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from stab_ros.core.types import FloatArray, Frame
from stab_ros.io.saved_reference import load_reference
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.flight import Shot

WATER = "[[[0, 0], [200, 0], [200, 100], [0, 100]]]"


class Tracked:
    """A tracker that answers each frame at once."""

    def __init__(self, graph: Graph, **parameters: Any) -> None:
        self._graph = graph
        self._answers: list[Any] = graph.listen(CameraInfo, "homography")
        self.process = graph.start("tracker_node", queue_depth=0, start_s=0.0, wait_for_subscribers=1, **parameters)
        self._images: Any = graph.speak(Image, "image_raw")

    def homographies(self, shots: list[Shot]) -> list[FloatArray]:
        before = len(self._answers)
        for shot in shots:
            self._images.publish(image_message(shot.image, shot.stamp_ns))
        self._graph.until(lambda: len(self._answers) == before + len(shots), "every frame answered")
        assert [stamp_ns(one) for one in self._answers[before:]] == [shot.stamp_ns for shot in shots]
        return [np.reshape(one.r, (3, 3)) for one in self._answers[before:]]

    def save(self) -> tuple[bool, str]:
        answer = self._graph.call(Trigger, "tracker_node/save_reference", Trigger.Request())
        assert "\n" not in answer.message
        return answer.success, answer.message


def frames(shots: list[Shot]) -> list[Frame]:
    return [Frame(shot.image, "mono8", shot.stamp_ns) for shot in shots]


def test_what_is_saved_leads_to_the_same_homographies(graph: Graph, flight: list[Shot], tmp_path: Path) -> None:
    kept = tmp_path / "kept.mcap"
    tracker = Tracked(graph, reference_path=str(kept), exclude=WATER)
    tracker.homographies(flight[:5])
    kept.unlink()
    assert tracker.save() == (True, f"the reference of stamp {flight[0].stamp_ns} ns is saved in {kept}")
    assert tracker.process.stop() == 0
    graph.until(lambda: not graph.node.count_subscribers("image_raw"), "the tracker gone")

    values: dict[str, Any] = {"start_s": 0.0, "exclude": WATER}
    before, resumed = make_stabilizer(values), make_stabilizer(values)
    for frame in frames(flight[:5]):
        before.answers(frame)
    assert before.reference is not None
    assert before.static_map is not None
    found = load_reference(kept)
    assert found is not None
    assert np.array_equal(found.static_map.picture(), before.static_map.picture())
    resumed.resume(before.reference, before.static_map, before.reset_counter)
    expected = [track.ref_H_cur for frame in frames(flight[5:]) for track in resumed.answers(frame)]
    again = Tracked(graph, reference_path=str(kept), exclude=WATER)
    for H, true in zip(again.homographies(flight[5:]), expected, strict=True):
        assert true is not None
        np.testing.assert_allclose(H, true, rtol=0, atol=1e-9)


def test_without_a_file_it_is_told_what_to_set(graph: Graph) -> None:
    assert Tracked(graph).save() == (
        False, "reference_path names no file; start the tracker with -p reference_path:=FILE.mcap")


def test_without_a_reference_or_a_folder_nothing_is_saved(graph: Graph, flight: list[Shot], tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    tracker = Tracked(graph, reference_path=str(folder / "kept.mcap"))
    taken, reason = tracker.save()
    assert not taken
    assert "there is no reference yet" in reason
    tracker.homographies(flight[:2])
    shutil.rmtree(folder)
    taken, reason = tracker.save()
    assert not taken
    assert str(folder) in reason
    tracker.homographies(flight[2:4])  # goes on
    folder.mkdir()
    assert tracker.save()[0]
    assert [one.name for one in folder.iterdir()] == ["kept.mcap"]


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    with small_disk(tmp_path / "disk", 600) as folder:
        yield folder


@needs_root
def test_a_full_disk_leaves_the_file_of_before(graph: Graph, flight: list[Shot], disk: Path) -> None:
    kept = disk / "kept.mcap"
    tracker = Tracked(graph, reference_path=str(kept))
    tracker.homographies(flight[:2])
    assert tracker.save()[0]
    before = kept.read_bytes()
    (disk / "other").write_bytes(bytes(550_000 - len(before)))
    taken, reason = tracker.save()
    assert not taken
    assert reason == f"{kept}: No space left on device; nothing has changed there"
    assert kept.read_bytes() == before
    assert sorted(one.name for one in disk.iterdir()) == ["kept.mcap", "other"]
