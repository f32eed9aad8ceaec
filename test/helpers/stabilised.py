"""What `stab-ros stabilize` made, read by other libraries than ours, and judged by its own measure."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from conftest import Command
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

from stab_ros.core.types import FloatArray
from stab_ros.synthetic.flight import Shot

JAZZY = get_typestore(Stores.ROS2_JAZZY)
COLUMNS = ("frame,stamp_ns,status,h00,h01,h02,h10,h11,h12,h20,h21,h22,"
           "matches,inliers,rmse_px,sigma_px,reset_counter,lost_reason,reset_reason")


def run(command: Command, *arguments: object) -> tuple[str, str]:
    """Standard output and error of a command that must succeed."""
    done = command("stabilize", *arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def table(path: Path) -> list[dict[str, str]]:
    """The rows of H.csv; its header must be that of the contract."""
    assert path.read_text().splitlines()[0] == COLUMNS
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def homography(row: dict[str, str]) -> FloatArray:
    return np.array([float(row[f"h{i}{j}"]) for i in range(3) for j in range(3)]).reshape(3, 3)


def rms_px(H_a: FloatArray, H_b: FloatArray, size: tuple[int, int]) -> float:
    """RMS distance over the 9x9 grid of frame pixels."""
    x, y = np.meshgrid(np.linspace(0, size[0] - 1, 9), np.linspace(0, size[1] - 1, 9))
    points = np.stack([x.ravel(), y.ravel(), np.ones(81)])
    a, b = H_a @ points, H_b @ points
    return float(np.sqrt(np.mean(np.sum((a[:2] / a[2] - b[:2] / b[2]) ** 2, axis=0))))


def errors_px(rows: list[dict[str, str]], flight: Sequence[Shot]) -> list[float]:
    """Of all frames but the reference."""
    size = flight[0].image.shape[1], flight[0].image.shape[0]
    return [rms_px(homography(row), shot.ref_H_cur, size) for row, shot in zip(rows, flight, strict=True)][1:]


def messages(path: Path) -> dict[str, list[tuple[int, bytes]]]:
    """Log time and bytes of every message by topic, as mcap's own reader gives them."""
    found: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
    with path.open("rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            found[channel.topic].append((message.log_time, message.data))
    return found


def decoded(cdr: bytes, msgtype: str) -> Any:
    """The message as rosbags reads it."""
    return JAZZY.deserialize_cdr(cdr, msgtype)


def frames_of(path: Path) -> list[FloatArray]:
    """All frames of a video."""
    capture = cv2.VideoCapture(str(path))
    found = []
    while (frame := capture.read())[0]:
        found.append(frame[1].astype(float))
    return found
