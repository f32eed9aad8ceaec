"""A camera over rigid water, and a tracker whose answers must be those of the engine."""

from __future__ import annotations

import time
from functools import cache
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from flights import SIZE, trap
from live_graph import Graph, NodeProcess, image_message, stamp_ns, values_of
from sensor_msgs.msg import CameraInfo, Image

from stab_ros.core.types import FloatArray, Frame
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.synthetic.flight import Flight, Shot

FRAMES = 32
SPEED_M_S = 1.0  # of the water


@cache
def flight() -> Flight:
    """Rigid water over 70 % of the picture: judged on too little, it is what everything is compared with."""
    return Flight(trap("kolubara", SPEED_M_S), SIZE, FRAMES)


@cache
def shots() -> list[Shot]:
    return list(flight())


@cache
def by_the_engine() -> list[FloatArray]:
    stabilizer = make_stabilizer({})
    frames = [Frame(shot.image, "mono8", shot.stamp_ns) for shot in shots()]
    tracks = [track for frame in frames for track in stabilizer.answers(frame)] + stabilizer.finish()
    return [track.ref_H_cur for track in tracks if track.ref_H_cur is not None]


class ImagePublisher:
    """Publishes the flight to a tracker that keeps every frame, and hears its answers."""

    def __init__(self, graph: Graph, **parameters: Any) -> None:
        self._graph, self._shown = graph, 0
        self.answers: list[Any] = graph.listen(CameraInfo, "/homography", 500)
        self.tracks: list[Any] = graph.listen(DiagnosticArray, "/tracker_node/track", 500)
        self.reports: list[Any] = graph.listen(DiagnosticArray, "/diagnostics")
        self.tracker: NodeProcess = graph.start("tracker_node", queue_depth=0, wait_for_subscribers=1, **parameters)
        self._images: Any = graph.speak(Image, "/image_raw", 300)

    def show(self, count: int, every_s: float = 0.0) -> None:
        for shot in shots()[self._shown : self._shown + count]:
            self._images.publish(image_message(shot.image, shot.stamp_ns))
            time.sleep(every_s)
        self._shown += count

    def until_answered(self, count: int) -> None:
        self._graph.until(lambda: len(self.answers) >= count and len(self.tracks) >= count, f"{count} answers")

    def until_said(self, words: str) -> None:
        self._graph.until(lambda: any(words in one.status[0].message for one in self.reports), f"{words!r} being said")

    def check_engine(self) -> None:
        """That all answers are the engine's."""
        self.until_answered(FRAMES)
        assert [stamp_ns(one) for one in self.answers] == [shot.stamp_ns for shot in shots()]
        for answer, H in zip(self.answers, by_the_engine(), strict=True):
            np.testing.assert_allclose(np.reshape(answer.r, (3, 3)), H, rtol=0, atol=1e-9)
        assert [values_of(one)["provisional"] for one in self.tracks] == ["false"] * FRAMES
