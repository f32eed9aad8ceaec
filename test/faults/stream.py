"""A camera, a tracker of its images, and what the tracker says: over DDS, as on board."""

from __future__ import annotations

from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from live_graph import Graph, stamp_ns, values_of
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image

from stab_ros.core.types import FloatArray

_SETTINGS: dict[str, Any] = {"queue_depth": 0, "start_s": 0.0, "stale_s": 60.0, "wait_for_subscribers": 1}


class TrackedStream:
    """The tracker keeps all frames and answers at once, unless `parameters` say otherwise.

    speak: whether the camera is ours.
    """

    def __init__(self, graph: Graph, qos: QoSProfile | int = 300, speak: bool = True, **parameters: Any) -> None:
        self._graph, self._parameters = graph, {**_SETTINGS, **parameters}  # `program` may be among them
        self.answers: list[Any] = graph.listen(CameraInfo, "/homography", 500)
        self.diagnostics: list[Any] = graph.listen(DiagnosticArray, "/diagnostics")
        self.tracker = graph.start("tracker_node", **self._parameters)
        self.camera: Any = graph.speak(Image, "/image_raw", qos) if speak else None

    def restart(self) -> None:
        """A new tracker with the same parameters; the camera goes on when it listens."""
        self.diagnostics.clear()
        self.tracker = self._graph.start("tracker_node", **self._parameters)
        self._graph.until(lambda: "ready" in self.tracker.log and self.camera.get_subscription_count() == 1,
                          "the new tracker")

    def show(self, *messages: Any) -> None:
        for message in messages:
            self.camera.publish(message)

    def until_answered(self, count: int) -> None:
        """So many answers in all."""
        self._graph.until(lambda: len(self.answers) >= count, f"{count} answers")

    def until_told(self, **values: object) -> str:
        """The message of the first report that tells these values, whenever it came."""
        wanted = {name: str(value) for name, value in values.items()}

        def found() -> list[str]:
            return [one.status[0].message for one in self._own_reports() if wanted.items() <= values_of(one).items()]

        self._graph.until(found, f"a report of {wanted}")
        return found()[0]

    def _own_reports(self) -> list[Any]:
        """Of the tracker; other nodes report too."""
        return [one for one in self.diagnostics if one.status[0].name == "tracker_node"]

    @property
    def told(self) -> dict[str, str]:
        """The values of the last report."""
        reports = self._own_reports()
        return values_of(reports[-1]) if reports else {}

    def until_said(self, words: str, level: int = 1) -> None:
        """In the message of a report of that level or worse."""
        self._graph.until(lambda: any(words in one.status[0].message and one.status[0].level >= bytes([level])
                                      for one in self._own_reports()), f"a report that says {words!r}")

    @property
    def stamps(self) -> list[int]:
        """Of the answers, ns."""
        return [stamp_ns(answer) for answer in self.answers]

    def homography(self, number: int) -> FloatArray:
        """ref_H_cur of an answer; zeros while LOST."""
        return np.array(self.answers[number].r, float).reshape(3, 3)
