"""Shared by the measurements over DDS: processes on their own domain, samples of them, and the bag they play."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any

import cv2
import numpy as np
from scenes import Scene

from stab_ros.core.types import Frame
from stab_ros.io.bag import BagWriter, topic_of
from stab_ros.io.cdr import COMPRESSED_IMAGE, IMAGE, header_of
from stab_ros.io.compressed_message import Codec, compressed_cdr
from stab_ros.io.image_message import image_cdr
from stab_ros.io.topics import RAW_COMPRESSED_TOPIC, RAW_TOPIC


@dataclass(frozen=True)
class ProcessSample:
    """A process at a time: its processor time so far, its RssAnon and its open file descriptors."""

    time_ns: int
    processor_s: float
    anonymous_mb: float
    descriptors: int

    @staticmethod
    def of(pid: int) -> ProcessSample:
        folder = Path("/proc") / str(pid)
        ticks = sum(map(int, (folder / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()[11:13]))
        status = (folder / "status").read_text(encoding="utf-8").partition("RssAnon:")[2].split()
        return ProcessSample(time.time_ns(), ticks / os.sysconf("SC_CLK_TCK"), int(status[0]) / 1024,
                             len(list((folder / "fd").iterdir())))


def start_python(domain: int, *arguments: str, stdout: int | IO[Any] | None = None,
                 stderr: int | IO[Any] | None = None) -> subprocess.Popen[bytes]:
    """A Python process on a DDS domain of this machine."""
    environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    return subprocess.Popen([sys.executable, *arguments], env=environment, stdout=stdout, stderr=stderr)


def stopped(process: subprocess.Popen[bytes]) -> bytes:
    """What a process has printed, once it is asked to end."""
    process.send_signal(signal.SIGINT)
    return process.communicate()[0]


def encoded(frame: Frame, encoding: str) -> Frame:
    """A mono8 frame as mono8 or bgr8."""
    if encoding == "mono8":
        return frame
    return replace(frame, image=np.asarray(cv2.cvtColor(frame.image, cv2.COLOR_GRAY2BGR)), encoding=encoding)


def there_and_back(scene: Scene) -> Iterator[Frame]:
    """The frames of a scene, so that the end of the loop meets its beginning."""
    for frame, _ in scene.back_and_forth(2 * (len(scene.frames) - 1)):
        yield frame


def write_loop(path: Path, frames: Iterable[Frame], compressed: bool = False) -> None:
    """A bag with these frames on `image_raw`, or as JPEG on `image_raw/compressed`."""
    topic = RAW_COMPRESSED_TOPIC if compressed else RAW_TOPIC
    with BagWriter(path) as writer:
        writer.add_topic(topic_of(topic, COMPRESSED_IMAGE if compressed else IMAGE))
        for frame in frames:
            image, head = (frame.image, frame.encoding), header_of(frame)
            data = compressed_cdr(*image, head, Codec()) if compressed else image_cdr(*image, head)
            writer.write(topic, frame.stamp_ns, frame.stamp_ns, data)
