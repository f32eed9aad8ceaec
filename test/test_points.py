"""Points that the user names: every spelling of the table that is clear, and one line for all else."""

from __future__ import annotations

from pathlib import Path

import pytest

from stab_ros.core.errors import InputError
from stab_ros.io.points import read_points


@pytest.mark.parametrize("text", [
    "name,x,y\nV1,10,20.5\nleft bank,1e2,7\n",
    "\ufeffname,x,y\r\nV1,10,20.5\r\nleft bank,100,7\r\n",
    'y,x,name,note\n20.5,10,V1,"a, b"\n7, 100, left bank,\n',
])
def test_a_table_of_points(tmp_path: Path, text: str) -> None:
    path = tmp_path / "points.csv"
    path.write_bytes(text.encode())
    assert read_points(path) == (("V1", 10.0, 20.5), ("left bank", 100.0, 7.0))


@pytest.mark.parametrize(("content", "says"), [
    (b"", "no column name"),
    (b"name,x\nV1,10\n", "no column y"),
    (b"name,x,y\n", "holds no point"),
    (b"name,x,y\nV1,10\n", "line 2"),
    (b"name,x,y\nV1,10,nan\n", "line 2"),
    (b"name,x,y\nV1,10,20\n,10,20\n", "line 3"),
    (b"name,x,y\nV1,10,ten\n", "line 2"),
    (b"name,x,y\nV1,10,20\nV1,30,40\n", "V1 twice"),
    (b"name,x,y\n\xff\xfe,1,2\n", "not a table"),
    (b'name,x,y\n"V1,1,2\n', "not a table"),
])
def test_what_is_no_table_of_points(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "points.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=says) as refused:
        read_points(path)
    assert str(path) in str(refused.value)


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_points(tmp_path / "none.csv")
