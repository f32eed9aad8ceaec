"""The tracker's log tells once of a reference what share of the picture is fixed to the camera."""

from __future__ import annotations

import pytest
from live_graph import Graph, image_message
from sensor_msgs.msg import CameraInfo, Image
from truth import letterboxed


@pytest.mark.thorough
def test_bars_with_text_are_told_once(graph: Graph) -> None:
    answers = graph.listen(CameraInfo, "/homography", 500)
    tracker = graph.start("tracker_node", queue_depth=0, start_s=0.5, wait_for_subscribers=1)
    camera = graph.speak(Image, "/image_raw", 300)
    images = letterboxed(60)
    for number, image in enumerate(images):
        camera.publish(image_message(image, (1 + number) * 40_000_000))
    graph.until(lambda: len(answers) == len(images), "all answers")
    graph.until(lambda: "is fixed to the camera" in tracker.log, "the share that is fixed to the camera")
    told = [line for line in tracker.log.splitlines() if "fixed to the camera" in line]
    assert len(told) == 1
    assert "[INFO]" in told[0]
