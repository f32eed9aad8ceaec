"""Tables of gaugings."""

from __future__ import annotations

from pathlib import Path

import pytest

from stab_ros.core.errors import InputError
from stab_ros.discharge.rating import Gauging
from stab_ros.io.gauging_file import read_gaugings, write_gaugings


def test_what_is_written_comes_back(tmp_path: Path) -> None:
    gaugings = (Gauging(1.1, 30 / 7, 0.3, 0.05, "a, b.mcap", 1 / 70, "00ff"), Gauging(0.9, 2.0),
                Gauging(1, 2, own_sigma=0.0))
    write_gaugings(gaugings, tmp_path / "R.csv")
    assert read_gaugings(tmp_path / "R.csv") == gaugings


def test_two_columns_are_enough(tmp_path: Path) -> None:
    (tmp_path / "R.csv").write_text("\ufeffdischarge_m3_s,note,stage_m\n3,x,1\n")
    assert read_gaugings(tmp_path / "R.csv") == (Gauging(1.0, 3.0),)


def test_tables_of_before_are_read(tmp_path: Path) -> None:
    """Also with new rows of their length in a table of now: what they lack is not known."""
    row, told = "1.5,9,0.5,0.04,V.csv\n", Gauging(1.5, 9.0, 0.5, 0.04, "V.csv")
    (tmp_path / "R.csv").write_text("stage_m,discharge_m3_s,sigma_m3_s,shared_sigma,source\n" + row)
    assert read_gaugings(tmp_path / "R.csv") == (told,)
    write_gaugings([told], tmp_path / "R.csv")
    with (tmp_path / "R.csv").open("a") as file:
        file.write(row)
    assert read_gaugings(tmp_path / "R.csv") == (told, told)
    assert told.own == pytest.approx((0.5**2 / 81 - 0.04**2) ** 0.5)


@pytest.mark.parametrize(("text", "says"), [
    ("stage_m\n1\n", "no column discharge_m3_s"), ("stage_m,discharge_m3_s\n1,x\n", "line 2"),
    ("stage_m,discharge_m3_s\n1,-2\n", "above 0"), ("stage_m,discharge_m3_s\n1,inf\n", "finite"), ("", "no column"),
    ("stage_m,discharge_m3_s,own_sigma\n1,2,nan\n", "finite"), ("stage_m,discharge_m3_s,own_sigma\n1,2,1%\n", "line 2"),
])
def test_no_tables(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "R.csv").write_text(text)
    with pytest.raises(InputError, match=says):
        read_gaugings(tmp_path / "R.csv")
