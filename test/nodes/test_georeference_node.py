"""The georeference node as users run it: a separate process over DDS, whose answers are those of the engine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from georeferenced_stream import GeoreferencedStream, by_the_engine, motion, ortho_H_image, shot
from live_graph import Graph, stamp_ns

from stab_ros.core.types import Frame
from stab_ros.georeferencing.placement import Motion

NADIR: dict[str, Any] = {"orientation": "stationary_nadir", "height_m": 30.0}
MOVING: dict[str, Any] = {"orientation": "dynamic_stabilization", "height_m": 30.0}


def check(stream: GeoreferencedStream, settings: dict[str, Any], frames: Sequence[tuple[Frame, Motion | None]]) -> None:
    """That all answers and orthophotos are the engine's."""
    stream.until_answered(len(frames))
    stream.graph.until(lambda: len(stream.images) == len(stream.infos), "every orthophoto")
    assert [stamp_ns(one) for one in stream.infos] == [frame.stamp_ns for frame, _ in frames]
    engine = by_the_engine(settings)
    for (frame, told), info, image in zip(frames, stream.infos, stream.images, strict=True):
        answer = engine.frame(frame, told)
        assert answer.ortho_H_image is not None
        np.testing.assert_allclose(ortho_H_image(info), answer.ortho_H_image, rtol=1e-9, atol=1e-9)
        wanted = engine.orthophoto(answer)
        assert wanted is not None
        assert (info.width, info.height) == (image.width, image.height) == wanted.shape[::-1]
        np.testing.assert_array_equal(np.reshape(image.data, wanted.shape), wanted)


def test_stationary_camera_needs_no_tracker(graph: Graph) -> None:
    stream = GeoreferencedStream(graph, NADIR)
    frames = [(shot(number), None) for number in range(4)]
    for frame, _ in frames:
        stream.show(frame)
    check(stream, NADIR, frames)
    assert len(stream.poses) == 4
    assert stream.poses[0].header.frame_id == "map"
    assert stream.poses[0].pose.pose.position.z == pytest.approx(30)
    report = stream.until_reported(frames_placed=4, state="PLACED")
    assert float(report["gsd_m"]) == pytest.approx(30 / 380, rel=0.05)
    assert stream.node.stop() == 0


def test_frames_wait_for_their_homographies(graph: Graph) -> None:
    """Of which some come before the image, some after it and some in bulk, as at the end of a tracker's start."""
    stream = GeoreferencedStream(graph, MOVING)
    frames = [(shot(number), motion(number)) for number in range(8)]
    for frame, _ in frames[:5]:
        stream.show(frame)
    stream.until_reported(frames_waiting=5, frames_placed=0)
    for frame, told in frames:
        stream.tell(frame.stamp_ns, told)
    for frame, _ in frames[5:]:
        stream.show(frame)
    check(stream, MOVING, frames)
