"""Work is shared among threads, and nobody can tell by the result."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from truth import SIZE, frame, picture, random_noise

from stab_ros.core.geometry import shift
from stab_ros.core.threads import available, in_parallel, use_threads
from stab_ros.core.types import Frame
from stab_ros.parameters.engines import make_stabilizer, reconfigure


@pytest.fixture(autouse=True)
def _by_default() -> Iterator[None]:
    yield
    use_threads(0)


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize(("count", "least"), [(0, 1), (1, 1), (7, 3), (1000, 1), (1000, 600)])
def test_every_item_is_done_once(threads: int, count: int, least: int) -> None:
    use_threads(threads)
    done, spans = np.zeros(count, int), list[tuple[int, int]]()

    def work(first: int, last: int) -> None:
        done[first:last] += 1
        spans.append((first, last))

    in_parallel(work, count, least)
    assert (done == 1).all()
    assert len(spans) == max(1, min(threads, count // least))
    assert all(last - first >= min(least, count) for first, last in spans)


def test_parts_run_side_by_side() -> None:
    use_threads(2)
    meeting = threading.Barrier(2, timeout=30)

    def meet(_first: int, _last: int) -> None:
        meeting.wait()

    in_parallel(meet, 2, 1)


@pytest.mark.parametrize("part", [0, 1])
def test_what_a_part_raises_comes_out(part: int) -> None:
    use_threads(2)

    def work(first: int, _last: int) -> None:
        if first == part:
            raise ArithmeticError

    with pytest.raises(ArithmeticError):
        in_parallel(work, 2, 1)


def test_opencv_is_bounded_too() -> None:
    make_stabilizer({"threads": 1})
    assert cv2.getNumThreads() == 1
    stabilizer = make_stabilizer({"threads": 2})
    assert cv2.getNumThreads() == 2
    reconfigure(stabilizer, {"threads": 1})
    assert cv2.getNumThreads() == 1
    make_stabilizer({})
    assert cv2.getNumThreads() == min(4, available())


def flight() -> list[Frame]:
    """With a frame that is lost, and a jump after it."""
    images = [picture(shift(0.4 * k, 0.3 * k)) for k in range(10)]
    images += [random_noise(1), picture(shift(24.0, 9.0)), picture(shift(24.3, 9.4))]
    return [frame(image, number) for number, image in enumerate(images)]


@pytest.mark.parametrize("start_s", [0.0, 0.3])
def test_homographies_and_pictures_are_the_same(start_s: float) -> None:
    answers = []
    for threads in (1, 2):
        stabilizer = make_stabilizer({"threads": threads, "start_s": start_s})
        frames = flight()
        tracks = [track for one in frames for track in stabilizer.answers(one)] + stabilizer.finish()
        answers.append([(track, stabilizer.warp(frames[track.index], track)) for track in tracks])
    assert len(answers[0]) == len(flight())
    for (one, shown), (two, also) in zip(*answers, strict=True):
        assert one.state is two.state
        assert one.sigma_px == two.sigma_px
        if one.ref_H_cur is not None and two.ref_H_cur is not None and shown is not None and also is not None:
            np.testing.assert_array_equal(one.ref_H_cur, two.ref_H_cur)
            np.testing.assert_array_equal(shown, also)
            assert shown.shape[1::-1] == SIZE
