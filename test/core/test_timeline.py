"""Time made of header stamps: that of the stamps, until a clock is set."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from truth import picture, translation

from stab_ros.core.timeline import Advance, Timeline
from stab_ros.core.types import Frame
from stab_ros.parameters.table import stabilizer_config
from stab_ros.tracking.stabilizer import Stabilizer

S, DAY = 10**9, 86_400 * 10**9


def followed(*stamps: int) -> tuple[list[Advance], list[int]]:
    timeline, steps, times = Timeline(), [], []
    for stamp in stamps:
        steps.append(timeline.take(stamp))
        times.append(timeline.now_ns)
    return steps, times


@given(st.lists(st.integers(1, 50 * S), min_size=1, max_size=20))
def test_a_sound_stream_is_its_own_time(steps: list[int]) -> None:
    stamps = np.cumsum([1_700_000_000 * S, *steps]).tolist()
    judged, times = followed(*stamps)
    assert times == stamps
    assert set(judged) == {Advance.STEADY}


STEADY, ZERO, SAME, BACK, AHEAD = Advance


@pytest.mark.parametrize(("stamps", "steps", "times"), [
    ([5 * S, 6 * S, 6 * S], [STEADY, STEADY, SAME], [5 * S, 6 * S, 6 * S]),
    ([5 * S, 7 * S, 6 * S, 8 * S], [STEADY, STEADY, BACK, STEADY], [5 * S, 7 * S, 6 * S, 8 * S]),
    ([5 * S, 5 * S + DAY, 6 * S + DAY], [STEADY, AHEAD, STEADY], [5 * S, 5 * S, 6 * S]),
    ([5 * S, 5 * S + DAY, 6 * S], [STEADY, AHEAD, BACK], [5 * S, 5 * S, 5 * S]),
    ([5 * S, 0, 6 * S], [STEADY, ZERO, STEADY], [5 * S, 5 * S, 6 * S]),
    ([0, 0, 7 * DAY, 7 * DAY + S], [ZERO, ZERO, STEADY, STEADY], [0, 0, 0, S]),
    ([-5 * S, -4 * S, 0, 1 * S], [STEADY, STEADY, ZERO, STEADY], [-5 * S, -4 * S, -4 * S, S]),
])
def test_odd_stamps(stamps: list[int], steps: list[Advance], times: list[int]) -> None:
    assert followed(*stamps) == (steps, times)


@pytest.mark.parametrize("jump_ns", [DAY, -DAY, 61 * S])
@pytest.mark.parametrize("start_s", [0.0, 0.3])
def test_a_clock_that_is_set_changes_no_answer_by_much(jump_ns: int, start_s: float) -> None:
    """Only the prediction of one frame begins anew; a start goes on as if nothing had happened."""
    size = (320, 240)
    frames = [Frame(picture(translation(0.6 * k, 0.2 * k), size), "mono8", 10 * DAY + k * S // 25) for k in range(14)]
    jumped = [replace(one, stamp_ns=one.stamp_ns + jump_ns * (k > 6)) for k, one in enumerate(frames)]
    found = []
    for stream in (frames, jumped):
        engine = Stabilizer(stabilizer_config({"start_s": start_s}))
        tracks = [track for frame in stream for track in engine.answers(frame)] + engine.finish()
        assert [track.stamp_ns for track in tracks] == [frame.stamp_ns for frame in stream]
        found.append([track.ref_H_cur for track in tracks])
    for H, other in zip(*found, strict=True):
        assert H is not None
        assert other is not None
        np.testing.assert_allclose(H, other, atol=0.01)
