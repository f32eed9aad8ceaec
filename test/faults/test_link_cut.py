"""Two hosts whose link is cut for ten seconds and mended: the stream resumes by itself, and the gap is told."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from ailing import HELPERS, needs_links
from live_graph import graph_in, image_message, next_domain
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image
from stream import TrackedStream
from truth import picture, translation
from two_hosts import plug, two_hosts

CUT_S, RATE_HZ = 10.0, 10.0
CAMERA = "--camera"


@needs_links
def test_the_stream_resumes_and_the_gap_is_told(tmp_path: Path) -> None:
    """This file again as two programs: a camera on one host; tracker and who listens to it on the other."""
    name = f"stab{os.getpid() % 10000}"
    environment = {**os.environ, "PYTHONPATH": HELPERS, "ROS_LOG_DIR": str(tmp_path),
                   "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_DOMAIN_ID": str(next_domain())}
    with two_hosts(name) as (there, here):
        camera = subprocess.Popen([*there, sys.executable, __file__, CAMERA, str(tmp_path)], env=environment)
        try:
            done = subprocess.run([*here, sys.executable, __file__, name, str(tmp_path)], env=environment,
                                  capture_output=True, text=True, timeout=240, check=False)
        finally:
            camera.send_signal(signal.SIGTERM)
            camera.wait(20)
    print(done.stdout)
    assert done.returncode == 0, done.stderr


def fly(name: str, folder: Path) -> None:
    """Where the tracker is. The cable is on the other side."""
    with graph_in(folder, int(os.environ["ROS_DOMAIN_ID"])) as graph:
        stream = TrackedStream(graph, speak=False, queue_depth=1, stale_s=1.0)
        stream.until_answered(20)
        plug(name, "down")
        stream.until_told(state="STALE")
        time.sleep(CUT_S)
        answered, last = len(stream.answers), stream.stamps[-1]
        stream.diagnostics.clear()
        plug(name, "up")
        stream.until_answered(answered + 20)
        assert stream.stamps == sorted(stream.stamps)
        gap_s = (stream.stamps[answered] - last) / 1e9
        assert gap_s > CUT_S
        stream.until_said("images again after ")
        assert "images again after " in stream.tracker.log
        stream.until_told(state="TRACKED", reset_counter=0)
        assert all(stream.homography(k).any() for k in range(len(stream.answers)))
        print(f"resumed after {gap_s:.1f} s without images, {CUT_S:g} s of them cut; told: {stream.told}")


def film(folder: Path) -> None:
    """Where the camera is: at most ten pictures a second until it is stopped, with the times at which they are made."""
    shown = [picture(translation(0.7 * k, 0.3 * k), (480, 270)) for k in range(10)]
    with graph_in(folder, int(os.environ["ROS_DOMAIN_ID"])) as graph:
        camera = graph.node.create_publisher(Image, "/image_raw", QoSProfile(depth=1))
        start_ns = time.monotonic_ns()
        for number in range(1, 10_000):
            time.sleep(1 / RATE_HZ)
            camera.publish(image_message(shown[number % 10], time.monotonic_ns() - start_ns))


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if sys.argv[1] == CAMERA:
        film(Path(sys.argv[2]))
    else:
        fly(sys.argv[1], Path(sys.argv[2]))
