"""/dev/shm of 64 MB, which is what a container gets: said at the start with the fix, and 1080p works."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from ailing import HELPERS, needs_root, with_shared_memory
from live_graph import Graph, graph_in, image_message, stamp_ns
from sensor_msgs.msg import Image
from stream import TrackedStream
from truth import picture, translation

FRAMES, SIZE = 60, (1920, 1080)


@needs_root
def test_the_tracker_works_at_1080p(tmp_path: Path) -> None:
    """This file again, as a program in a machine of its own."""
    words = [sys.executable, __file__, str(tmp_path)]
    done = subprocess.run(with_shared_memory(64, words), capture_output=True, text=True, timeout=240, check=False,
                          env={**os.environ, "PYTHONPATH": HELPERS, "ROS_LOG_DIR": str(tmp_path),
                               "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"})
    assert done.returncode == 0, done.stdout + done.stderr


def live(graph: Graph) -> None:
    shown = [picture(translation(0.7 * k, 0.3 * k), SIZE) for k in range(4)]
    pictures: list[Image] = graph.listen(Image, "/image_stabilized", 100)
    stream = TrackedStream(graph, qos=1, queue_depth=1, wait_for_subscribers=1)
    for number in range(FRAMES):
        before = len(stream.answers)
        stream.show(image_message(shown[number % 4], number + 1))
        stream.until_answered(before + 1)
    stream.until_told(frames_tracked=FRAMES, frames_dropped=0, frames_lost=0)
    graph.until(lambda: pictures and stamp_ns(pictures[-1]) == FRAMES, "the newest stabilised picture")
    assert "/dev/shm is smaller than 512 MiB, large images may be lost or late" in stream.tracker.log
    assert "docker run --shm-size=512m" in stream.tracker.log


if __name__ == "__main__":
    with graph_in(Path(sys.argv[1])) as the_graph:
        live(the_graph)
