"""The demo as the user runs it: real processes over DDS, on the recorded flight."""

from __future__ import annotations

import re
import signal
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from demo_process import processes_with, run, start, table, wait_for

from stab_ros.core.types import LostReason, State, Track
from stab_ros.demo.__main__ import GSD_M, SAMPLE, SCALE, TRUTH, WATER
from stab_ros.demo.checks import checks, frames_text
from stab_ros.demo.command import apart
from stab_ros.demo.news import News
from stab_ros.demo.replay import HOMOGRAPHY, METRICS, RAW, STABILIZED, TRACK
from stab_ros.demo.result import compare, read_answers
from stab_ros.demo.verdict import Files, reach
from stab_ros.demo.water import read_water
from stab_ros.io.bag import BagWriter, Message, open_bag
from stab_ros.io.cdr import Header, read_stamp
from stab_ros.io.homographies import read_homographies
from stab_ros.io.homography_message import homography_cdr, read_homography
from stab_ros.io.track_message import track_cdr

pytestmark = pytest.mark.thorough  # `make demo` checks its promises by itself
SIZE = 960, 540
STAMPS_NS = [row.stamp_ns for row in read_homographies(TRUTH)]
MADE = ("stabilized.mcap", "H.csv", "H_command.csv", "before_after.mp4", "before_after.png", "errors.txt",
        "velocities.png", "velocities.html", "V.csv", "section.csv", "report/index.html")
Demo = tuple[Path, str]
Alter = Callable[[Message], Message | None]


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Demo:
    """A run that went well: its folder and what it said."""
    folder = tmp_path_factory.mktemp("demo") / "demo_output"
    done = run(folder)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    return folder, done.stdout


def test_demo_shows_the_result_and_its_error(demo: Demo) -> None:
    folder, said = demo
    assert all(str(folder / name) in said and (folder / name).stat().st_size for name in MADE)
    assert "72 of 72 frames answered, 72 tracked, 49 pictures" in said
    median, p95, largest = (float(word) for word in said.split("\nstabilised ")[1].split()[:3])
    assert median <= p95 <= largest < 0.05
    assert [row["status"] for row in table(folder)] == ["TRACKED"] * 72
    assert cv2.VideoCapture(str(folder / "before_after.mp4")).get(cv2.CAP_PROP_FRAME_COUNT) == 49


def test_demo_says_what_it_does_what_holds_and_what_to_open_first(demo: Demo) -> None:
    folder, said = demo
    lines = said.splitlines()
    stages = [re.split(r"\s+", line)[0] + (" ..." if line.endswith(" ...") else "") for line in lines[:6]]
    assert stages == ["compile ...", "compile", "replay ...", "replay", "judge ...", "judge"]
    assert all(re.search(r"  \d+\.\d s$", line) for line in lines[1:6:2])
    assert sum(line.startswith("yes  ") for line in lines) == 10
    assert not any(line.startswith("NO ") for line in lines)
    assert lines[-3].startswith(f"open first: {folder / 'report' / 'index.html'}")
    assert lines[-2].split()[0] == str(folder / "before_after.mp4")
    assert lines[-1].split()[0] == str(folder / "velocities.png")


def altered(demo: Demo, folder: Path, alter: Alter) -> Files:
    """What the demo recorded, with each message as `alter` wants it, or without."""
    folder.mkdir()
    files = Files(folder)
    with open_bag(demo[0] / "stabilized.mcap") as bag, BagWriter(files.bag) as writer:
        for topic in bag.topics.values():
            writer.add_topic(topic)
        for message in map(alter, bag.messages()):
            if message is not None:
                writer.write(*message)
    return files


def without(topic: str, *frames: int) -> Alter:
    """Does not hold some messages."""
    gone = {STAMPS_NS[frame] for frame in frames}
    return lambda message: None if message.topic == topic and read_stamp(message.data) in gone else message


def moved(shift_px: float, *frames: int) -> Alter:
    """Some homographies say something else."""

    def alter(message: Message) -> Message:
        if message.topic != HOMOGRAPHY or (stamp_ns := read_stamp(message.data)) not in {STAMPS_NS[i] for i in frames}:
            return message
        ref_H_cur = read_homography(message.data)[1]
        assert ref_H_cur is not None
        ref_H_cur[0, 2] += shift_px
        track = Track(State.TRACKED, 0, stamp_ns, STAMPS_NS[0], 0, ref_H_cur=ref_H_cur)
        return message._replace(data=homography_cdr(track, Header(stamp_ns), SIZE))

    return alter


def lost(*frames: int) -> Alter:
    """Some frames are."""

    def alter(message: Message) -> Message:
        if message.topic != HOMOGRAPHY or (stamp_ns := read_stamp(message.data)) not in {STAMPS_NS[i] for i in frames}:
            return message
        track = Track(State.LOST, 0, stamp_ns, 0, 0, lost_reason=LostReason.NO_TEXTURE)
        return message._replace(data=homography_cdr(track, Header(stamp_ns), SIZE))

    return alter


CASES: list[tuple[str, Alter, list[str]]] = [
    ("nothing", lambda message: message, []),
    ("unanswered", without(HOMOGRAPHY, 30, 31, 32, 40), ["frames 30 to 32 and 40 got no answer: .*tracker_node.txt"]),
    ("unanswered in the start", without(HOMOGRAPHY, 7), ["frame 7 got no answer"]),
    ("lost", lost(50), ["frame 50 could not be tracked: ", "`stab-ros stabilize`, but differ by inf in frame 50"]),
    ("far off", moved(0.2, 33), [r"frame 33 should lie within 0.05 px of the truth, but frame 33 is 0.\d+ px off",
                                 "differ by 0.2 in frame 33"]),
    ("all a little off", moved(0.02, *range(72)), [r"95 % .* within 0.01 px .* they lie within 0.0\d+ px",
                                                  "differ by 0.02 in frame"]),
    ("another rounding", moved(1e-6, 12), ["but differ by 1e-06 in frame 12; compare .*H.csv with .*H_command.csv"]),
    ("no picture", without(STABILIZED, 60, 71), ["frames 60 and 71 came out without a picture"]),
    ("several", lambda message: lost(50)(message) if message.topic == HOMOGRAPHY else without(STABILIZED, 60)(message),
     ["not be tracked", "frame 60 came out without a picture", "differ by inf"]),
]  # fmt: skip


@pytest.mark.parametrize(("alter", "sentences"), [case[1:] for case in CASES], ids=[case[0] for case in CASES])
def test_what_does_not_hold_is_named(demo: Demo, tmp_path: Path, alter: Alter, sentences: list[str]) -> None:
    files = altered(demo, tmp_path / "altered", alter)
    answers, command = read_answers(files.bag), read_homographies(demo[0] / "H_command.csv")
    files.bag.unlink()  # 80 MB
    found = [*checks(compare(read_homographies(TRUTH), answers), answers, apart(command, answers), files.folder)]
    failures = [check.failure for check in found if check.failure]
    assert len(failures) == len(sentences), failures
    for failure, sentence in zip(failures, sentences, strict=True):
        assert re.search(sentence, failure), failure
        assert "\n" not in failure
    assert [check.text().startswith("NO ") for check in found] == [bool(check.failure) for check in found]


def test_frames_that_were_answered_in_a_silence_are_named_as_the_cause(demo: Demo, tmp_path: Path) -> None:
    def alter(message: Message) -> Message | None:
        if message.topic != TRACK or (stamp_ns := read_stamp(message.data)) not in STAMPS_NS[1:10]:
            return moved(1e-3, 9)(message)
        track = Track(State.TRACKED, 0, stamp_ns, STAMPS_NS[0], 0, ref_H_cur=np.eye(3), provisional=True)
        return message._replace(data=track_cdr(track, Header(stamp_ns)))

    files = altered(demo, tmp_path / "altered", alter)
    answers, command = read_answers(files.bag), read_homographies(demo[0] / "H_command.csv")
    files.bag.unlink()
    found = [*checks(compare(read_homographies(TRUTH), answers), answers, apart(command, answers), files.folder)]
    (failure,) = (check.failure for check in found if check.failure)
    assert "differ by 0.001 in frame 9 (9 frames were answered before enough was seen" in failure


@pytest.mark.thorough
def test_missing_measures_are_named_and_the_results_are_there(demo: Demo, tmp_path: Path) -> None:
    files = altered(demo, tmp_path / "altered", without(METRICS, 3, 70))
    verdict = reach(SAMPLE, read_homographies(TRUTH), read_water(WATER, GSD_M, SIZE), files, SCALE, "the tracker ended")
    files.bag.unlink()
    assert verdict.failures[0] == "the tracker ended"
    assert verdict.failures[1].startswith("frames 3 and 70 got no measures from the live evaluator")
    assert len(verdict.failures) == 2
    assert all((files.folder / name).stat().st_size for name in MADE if name != "stabilized.mcap")
    assert all(failure in files.errors.read_text() for failure in verdict.failures)
    assert verdict.what_to_open().startswith(f"open first: {files.errors}")


def test_without_any_picture_the_rest_is_told(demo: Demo, tmp_path: Path) -> None:
    files = altered(demo, tmp_path / "altered", lambda message: None if message.topic in (STABILIZED, RAW) else message)
    verdict = reach(SAMPLE, read_homographies(TRUTH), read_water(WATER, GSD_M, SIZE), files, SCALE, "")
    assert [failure.split(":")[0] for failure in verdict.failures[:3]] == [str(files.bag)] * 3
    assert "frames 0 and 24 to 71 came out without a picture" in verdict.failures[3]
    assert "72 of 72 frames answered" in verdict.text()
    assert len(table(files.folder)) == 72


def test_frames_in_words() -> None:
    assert frames_text([3]) == "frame 3"
    assert frames_text([3, 4, 5, 9]) == "frames 3 to 5 and 9"
    assert frames_text([0, 1, 4, 6]) == "frames 0 to 1, 4 and 6"
    assert frames_text([*range(0, 20, 2)]) == "frames 0, 2, 4, 6, 8 and 5 more"


NODES = ("tracker_node", "bag_player_node")
SECOND_NS = 10**9


def test_a_slow_machine_is_waited_for() -> None:
    """A compiled kernel is news, and a wait in which the demo itself was stopped counts no more than others."""
    news = News(NODES)
    for done in range(24):
        for _ in range(500):
            news.waited(3600 * SECOND_NS, SECOND_NS)
        assert news.on_report("camera/tracker_node", f"waiting for kernels to be compiled, {done} of 24 are",
                              {"state": "WAITING", "frames_in": "0"})
        assert news.hang == ""


def test_what_hangs_is_named() -> None:
    news = News(NODES)
    news.on_report("bag_player_node", "waiting for 2 subscribers", {"messages": "0"})
    for _ in range(601):
        news.waited(SECOND_NS, SECOND_NS)
        news.on_report("bag_player_node", "waiting for 2 subscribers", {"messages": "0"})
    assert news.hang == ("tracker_node gave no sign of life for 10 minutes; "
                         "bag_player_node said: waiting for 2 subscribers")
    news.moved()
    assert news.hang == ""


def test_that_it_is_silent_is_no_news_of_a_node() -> None:
    news = News(NODES)
    news.on_report("camera/tracker_node", "tracked", {"state": "TRACKED", "frames_in": "71"})
    news.on_report("camera/tracker_node", "no image for 2.1 s", {"state": "STALE", "frames_in": "71"})
    for i in range(30):
        assert not news.are_idle(["tracker_node"]) or i == 29
        assert not news.on_report("camera/tracker_node", f"no image for {i} s", {"state": "STALE", "frames_in": "71"})
    assert news.are_idle(["tracker_node"])
    assert not news.are_idle(NODES)


@pytest.mark.parametrize("delay_s", [0.0, 0.5])  # while the tracker's process is being made, and later
def test_interrupted_demo_leaves_no_process(tmp_path: Path, delay_s: float) -> None:
    folder = tmp_path / "demo_output"
    folder.mkdir()
    earlier = folder / "before_after.mp4"
    earlier.write_text("of an earlier run")
    with start(folder) as demo:
        wait_for((folder / "log" / "tracker_node.txt").exists, demo)
        time.sleep(delay_s)
        demo.send_signal(signal.SIGTERM)
        _, said = demo.communicate(timeout=60)
    assert (demo.returncode, said) == (130, "demo: interrupted\n")
    assert not processes_with(str(folder))
    assert not earlier.exists()


def test_demo_can_be_interrupted_while_it_compiles(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    with start(tmp_path / "demo_output", NUMBA_CACHE_DIR=str(cache)) as demo:
        wait_for(lambda: [*cache.rglob("*.nbi")], demo)
        demo.send_signal(signal.SIGINT)
        _, said = demo.communicate(timeout=60)
    assert (demo.returncode, said) == (130, "demo: interrupted\n")


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path) -> None:
    taken = tmp_path / "taken"
    taken.write_text("a file")
    done = run(taken)
    assert done.returncode == 1
    assert done.stderr == f"demo: {taken}: File exists\n"


@pytest.mark.parametrize(("rate", "says"), [("0", "must be a number above 0"), ("1e7", "out of range")])
def test_a_rate_that_cannot_be_played_is_one_line(tmp_path: Path, rate: str, says: str) -> None:
    folder = tmp_path / "demo_output"
    done = run(folder, "--rate", rate)
    assert done.returncode == 2
    assert says in done.stderr
    assert done.stderr.count("\n") == 1
    assert not folder.exists()
