"""`stab-ros stabilize` where frames are lost: each has its reason, and the run ends with the most frequent one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from conftest import Command
from recordings import Entry, entries, to_cdr, write_mcap
from stabilised import decoded, messages, run, table
from truth import flat, random_noise

from stab_ros.core.types import Gray
from stab_ros.synthetic.flight import Shot

SIZE = (480, 270)


def bag_with(path: Path, flight: Sequence[Shot], shown: dict[int, Gray], cut: Sequence[int] = ()) -> Path:
    """The flight, in which some frames show something else and others are cut off within their pixels."""
    shots = [replace(shot, image=shown.get(number, shot.image)) for number, shot in enumerate(flight)]
    recorded = list(entries(shots))
    for number in cut:
        entry = recorded[2 * number]
        recorded[2 * number] = Entry(entry.topic, entry.msgtype, entry.log_time_ns, to_cdr(entry)[:-1000])
    return write_mcap(path, recorded)


def track_values(path: Path) -> list[dict[str, str]]:
    """What the bag's messages on `track` say."""
    arrays = [decoded(data, "diagnostic_msgs/msg/DiagnosticArray") for _, data in messages(path)["/cam/track"]]
    return [{one.key: one.value for one in array.status[0].values} for array in arrays]


def test_reasons_are_in_table_bag_summary_and_warning(flight: list[Shot], command: Command, tmp_path: Path) -> None:
    covered = flat(size=SIZE)
    covered[:60, :100] = flight[4].image[:60, :100]
    shown = {2: flat(size=SIZE), 4: covered, 5: random_noise(size=SIZE), 6: np.zeros(SIZE[::-1], np.uint8)}
    bag = bag_with(tmp_path / "in.mcap", flight, shown, cut=[8])
    out, err = run(command, bag, tmp_path / "out.mcap", "--homographies", tmp_path / "H.csv")
    expected = ["", "", "no texture", "", "no texture", "no features found", "no texture", "", "unusable image", ""]
    rows = table(tmp_path / "H.csv")
    assert [row["lost_reason"] for row in rows] == expected
    assert [row["status"] == "LOST" for row in rows] == [bool(reason) for reason in expected]
    values = track_values(tmp_path / "out.mcap")
    assert [one["lost_reason"] for one in values] == [one for one in expected if one != "unusable image"]
    assert out.splitlines()[1] == "lost 5 of 10: 3 no texture, 1 no features found, 1 unusable image"
    last = err.splitlines()[-1]
    assert last.startswith(f"stab-ros: warning: {bag}: 5 of 10 frames are lost, most often no texture (3): ")
    assert "exposure" in last


def test_too_uncertain_frames_are_said_with_a_simpler_model(
    flight: list[Shot], command: Command, tmp_path: Path
) -> None:
    bag = bag_with(tmp_path / "in.mcap", flight, {})
    out, err = run(command, bag, tmp_path / "out.mcap", "-p", "max_sigma:=0.001")
    assert "lost 9 of 10: 9 too uncertain\n" in out
    assert len(err.splitlines()) == 1
    assert "9 of 10 frames are lost, most often too uncertain (9): " in err
    assert "model:=similarity" in err


def test_a_frame_now_and_then_is_counted_but_no_warning(flight: list[Shot], command: Command, tmp_path: Path) -> None:
    rocking = [*flight, *flight[-2:0:-1], *flight[1:4]]
    shots = [replace(shot, stamp_ns=flight[0].stamp_ns + 40_000_000 * number) for number, shot in enumerate(rocking)]
    bag = bag_with(tmp_path / "in.mcap", shots, {12: flat(size=SIZE)})
    out, err = run(command, bag, tmp_path / "out.mcap")
    assert "21 frames: 20 tracked, 1 lost" in out
    assert "lost 1 of 21: 1 no texture\n" in out
    assert err == ""
