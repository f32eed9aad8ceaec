"""How `-p name:=value` and numbers are read."""

from __future__ import annotations

import argparse

import pytest

from stab_ros.cli.options import (
    assignment,
    nonnegative_float,
    nonnegative_int,
    positive_float,
    positive_int,
    seconds,
    with_negative_pairs,
)


@pytest.mark.parametrize(("text", "value"), [
    ("klt", "klt"),
    ("true", True),
    ("7", 7),
    ("0.5", 0.5),
    ("1e-3", 1e-3),
    ("-2.5E4", -2.5e4),
    ("'7'", "7"),
    ("", ""),
    ("[[[0,0],[9,0],[9,9]]]", "[[[0,0],[9,0],[9,9]]]"),
    ("'[[[0,0],[9,0],[9,9]]]'", "[[[0,0],[9,0],[9,9]]]"),
    ("masks/water.png", "masks/water.png"),
    ("a:=b", "a:=b"),
    ("2024-01-01", "2024-01-01"),
    ("{", "{"),
])
def test_values_are_yaml_scalars_or_stay_text(text: str, value: object) -> None:
    name, found = assignment(f"some.name:={text}")
    assert (name, found, type(found)) == ("some.name", value, type(value))


@pytest.mark.parametrize("text", ["name", "name=value", ":=value", ""])
def test_what_is_no_assignment_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="name:=value"):
        assignment(text)


@pytest.mark.parametrize("text", ["0", "-1", "1.5", "x", ""])
def test_a_count_is_a_whole_number_above_0(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        positive_int(text)


@pytest.mark.parametrize("text", ["0", "-1", "nan", "inf", "x", ""])
def test_a_rate_is_a_finite_number_above_0(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        positive_float(text)


def test_zero_is_a_number_where_it_is_a_default() -> None:
    assert (nonnegative_int("0"), nonnegative_int("7")) == (0, 7)
    assert (nonnegative_float("0"), nonnegative_float("2.5")) == (0.0, 2.5)


@pytest.mark.parametrize("text", ["-1", "1.5e", "x", "", "nan"])
def test_a_number_below_0_is_refused(text: str) -> None:
    for read in (nonnegative_int, nonnegative_float):
        with pytest.raises(argparse.ArgumentTypeError, match="0 or above"):
            read(text)


def test_seconds_may_be_none_at_all() -> None:
    assert (seconds("0"), seconds("2.5")) == (0.0, 2.5)


@pytest.mark.parametrize("text", ["-1", "nan", "inf", "x", ""])
def test_seconds_are_a_finite_number_not_below_0(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        seconds(text)


def test_pairs_of_negative_numbers_belong_to_their_option() -> None:
    words = ["discharge", "--from", "-16,-11.5", "--to=-16,3", "--origin", "-.5,7", "--wse", "-3", "-p", "a:=1"]
    assert with_negative_pairs(words) == ["discharge", "--from=-16,-11.5", "--to=-16,3", "--origin=-.5,7",
                                          "--wse", "-3", "-p", "a:=1"]
