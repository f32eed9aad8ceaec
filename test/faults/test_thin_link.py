"""`image_stabilized/compressed` of 1080p at 30 Hz over a link of 20 Mbit/s, which takes one or two a second."""

from __future__ import annotations

import numpy as np
import pytest
from ailing import needs_links
from scenes import HD, render
from thin_link import Link, watch

LINK = Link(mbit_s=20, queue_bytes=1_000_000)
LARGE = ("image_stabilized.compressed.jpeg_quality:=100",)  # 1.4 MB a picture
SECONDS = 20.0


@needs_links
@pytest.mark.parametrize("viewer", ["best_effort", "reliable"])
def test_pictures_are_no_later_at_the_end_and_the_tracker_goes_on(viewer: str) -> None:
    """Counted in pictures and frames, as all is slower on a busy machine; without the first half, in which nodes start.

    With a backlog, the last picture would be 30 pictures old. A tracker that waits for the link answers one frame a
    picture.
    """
    seen = watch(render("kolubara", HD, 5), LINK, viewer, SECONDS, LARGE)
    assert len(seen.pictures) > 10
    stamps_ns, late_ms, _ = np.array(seen.pictures[len(seen.pictures) // 2:], float).T
    assert np.all(np.diff(stamps_ns) > 0)
    interval_ms = np.median(np.diff(stamps_ns / 1e6 + late_ms))
    assert late_ms.max() < 6 * interval_ms
    meanwhile = [stamp_ns for stamp_ns, _ in seen.homographies if stamps_ns[0] <= stamp_ns <= stamps_ns[-1]]
    assert len(meanwhile) > 2 * len(stamps_ns)
