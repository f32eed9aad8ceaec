"""Frames that are lost in flight: each says why on `track`, and the log says it once for each loss."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray
from live_graph import Graph, image_message, values_of
from stream import TrackedStream
from truth import flat, random_noise

from stab_ros.synthetic.flight import Shot

MS = 10**6
SIZE = (480, 270)


def test_every_lost_frame_has_a_reason_and_the_log_says_it_once(graph: Graph, flight: list[Shot]) -> None:
    tracks = graph.listen(DiagnosticArray, "/tracker_node/track", 500)
    stream = TrackedStream(graph)
    images = [flight[0].image, flight[1].image, *(flat(level, size=SIZE) for level in (90, 91, 92)), flight[2].image,
              random_noise(size=SIZE)]
    stream.show(*(image_message(image, (1 + number) * 40 * MS) for number, image in enumerate(images)))
    graph.until(lambda: len(tracks) == len(images), "all answers")
    assert [values_of(one)["lost_reason"] for one in tracks] == [
        "", "", "no texture", "no texture", "no texture", "", "no features found"]
    assert "lost: no features found" in stream.until_told(state="LOST", frames_lost=4, lost_reason="no features found")
    log = stream.tracker.log
    assert log.count("LOST") == 1  # the second loss came within seconds of the first
    assert f"frames are LOST from stamp {120 * MS} ns on: no texture: " in log
    assert f"tracked again from stamp {240 * MS} ns on, after 3 lost frames" in log
