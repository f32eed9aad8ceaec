"""H.csv: what is written is read back to the last bit, and what is no such table is refused by name and line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stab_ros.core.errors import InputError
from stab_ros.core.types import FloatArray, LostReason, State, Track
from stab_ros.io.homographies import COLUMNS, TRACK_COLUMNS, HomographyWriter, read_homographies

FINITE = st.floats(allow_nan=False, allow_infinity=False)
HEADER = ",".join(COLUMNS)


def track(H: FloatArray | None) -> Track:
    if H is None:
        return Track(State.LOST, 0, 5, 5, 0, matches=3, lost_reason=LostReason.NO_FEATURES)
    return Track(State.TRACKED, 0, 5, 5, 0, 30, 20, H, np.eye(8), 0.125, 0.25)


@settings(deadline=None)
@given(H=arrays(np.float64, (3, 3), elements=FINITE))
def test_homographies_come_back_to_the_last_bit(H: FloatArray, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("table") / "H.csv"
    with HomographyWriter(path) as writer:
        writer.write(0, track(H))
        writer.write(1, track(None))
    tracked, lost = read_homographies(path)
    assert (tracked.frame, tracked.stamp_ns, lost.frame) == (0, 5, 1)
    np.testing.assert_array_equal(tracked.ref_H_cur, H)
    assert lost.ref_H_cur is None


def test_the_table_is_that_of_the_contract(tmp_path: Path) -> None:
    with HomographyWriter(tmp_path / "H.csv") as writer:
        writer.write(7, track(np.diag([1.5, 1.0, 1.0])))
        writer.write(8, track(None))
        flushed = (tmp_path / "H.csv").read_text()
    assert flushed.splitlines() == [
        f"{HEADER},{','.join(TRACK_COLUMNS)}",
        "7,5,TRACKED,1.5,0.0,0.0,0.0,1.0,0.0,0.0,0.0,1.0,30,20,0.125,0.25,0,,",
        "8,5,LOST,,,,,,,,,,3,0,,,0,no features found,",
    ]


def test_a_table_that_a_spreadsheet_has_saved_is_read(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_bytes(b"\xef\xbb\xbf" + f"{HEADER}\r\n0,1,TRACKED,1,0,2,0,1,3,0,0,1\r\n".encode())
    (row,) = read_homographies(path)
    np.testing.assert_array_equal(row.ref_H_cur, [[1, 0, 2], [0, 1, 3], [0, 0, 1]])


@pytest.mark.parametrize(("text", "says"), [
    ("", "no column frame"),
    (HEADER.replace(",", ";"), "separated by commas"),
    ("frame,stamp_ns\n0,1\n", "no column status"),
    (f"{HEADER}\n0,1,TRACKED,1,0,0,0,1,0,0,0\n", "line 2"),
    (f"{HEADER}\n0,1,LOST,,,,,,,,,\n1,2,TRACKED,1,0,x,0,1,0,0,0,1\n", "line 3"),
    (f"{HEADER}\n0,1,TRACKED,nan,0,0,0,1,0,0,0,1\n", "finite"),
    (f"{HEADER}\nzero,1,LOST,,,,,,,,,\n", "line 2 is not a row of homographies: frame is 'zero', it must be "
     "a whole number"),
    (f"{HEADER}\n0,1.79592E+18,LOST,,,,,,,,,\n", "stamp_ns is '1.79592E+18', it must be a whole number, as it was "
     "written: a spreadsheet rounds"),
])
def test_what_is_no_table_is_refused(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        read_homographies(path)
    assert says in str(refused.value)
    assert "truth.csv" in str(refused.value)


@pytest.mark.parametrize("content", [b"\xff\xfe\x00binary", None])
def test_what_is_no_text_is_refused(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"truth\.csv"):
        read_homographies(path)
