"""The options of the command line, and how their values are read."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Sequence
from typing import Any, NoReturn

import yaml

from stab_ros.core.text import one_line

BAG = "an .mcap, a rosbag2 folder or a ROS 1 .bag"
INPUT = "an .mcap, a rosbag2 folder, a ROS 1 .bag, a video or a folder of images"


_NEGATIVE_PAIR = re.compile(r"-[\d.][^,]*,")


class Parser(argparse.ArgumentParser):
    """A parser that reports a usage error in one line, exit code 2."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {one_line(message)}; see {self.prog} --help\n")


def with_negative_pairs(words: Sequence[str]) -> list[str]:
    """Words of a command line in which pairs as -12.5,-30 belong to the option before; argparse takes them for one."""
    joined = list[str]()
    for word in words:
        if joined and joined[-1].startswith("--") and "=" not in joined[-1] and _NEGATIVE_PAIR.match(word):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def command(commands: Any, name: str, does: str) -> argparse.ArgumentParser:
    """The parser of a new command of `commands`; `does` is its help text."""
    parser: argparse.ArgumentParser = commands.add_parser(name, help=does, description=f"{does[0].upper()}{does[1:]}.")
    return parser


def add_force(parser: argparse.ArgumentParser) -> None:
    """The option --force."""
    parser.add_argument("--force", action="store_true", help="overwrite output that exists")


def add_time(parser: argparse.ArgumentParser) -> None:
    """The option --time."""
    parser.add_argument("--time", choices=("header", "log"), default="header",
                        help="the time of an image of a bag: its header stamp (default), or when it was logged; it "
                        "takes the place of the stamp in all that is written of the image")


def positive_int(text: str) -> int:
    """For argparse: an integer above 0."""
    if not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"{text!r} must be a whole number above 0")
    return int(text)


def nonnegative_int(text: str) -> int:
    """For argparse: an integer, 0 or above."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} must be a whole number, 0 or above")
    return int(text)


def nonnegative_float(text: str) -> float:
    """For argparse: a finite number, 0 or above."""
    number = _number(text)
    if number is None or not 0 <= number < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} must be a number, 0 or above")
    return number


def positive_float(text: str) -> float:
    """For argparse: a finite number above 0."""
    number = _number(text)
    if number is None or not 0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} must be a number above 0")
    return number


def seconds(text: str) -> float:
    """For argparse: a finite number, 0 or above."""
    number = _number(text)
    if number is None or not 0 <= number < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} must be a number of seconds, 0 or above")
    return number


def finite(text: str) -> float:
    """For argparse: a finite number."""
    number = _number(text)
    if number is None or not math.isfinite(number):
        raise argparse.ArgumentTypeError(f"{text!r} must be a number")
    return number


def namespace(text: str) -> str:
    """For argparse: a namespace of ROS, without the slash at its end."""
    if not re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)*/?", text):
        raise argparse.ArgumentTypeError(f"{text!r} is no namespace, it must be as /camera")
    return text.rstrip("/")


def names(text: str) -> tuple[str, ...]:
    """For argparse: at least one name, separated by commas."""
    found = tuple(name.strip() for name in text.split(","))
    if not all(found):
        raise argparse.ArgumentTypeError(f"{text!r} must be names between commas, as in direct,klt")
    return found


def assignment(text: str) -> tuple[str, object]:
    """For argparse: `name:=value` as in ROS; the value is a YAML scalar, any other text a string."""
    name, separator, value = text.partition(":=")
    if not separator or not name:
        raise argparse.ArgumentTypeError(f"{text!r} must be name:=value")
    return name, _scalar(value)


def _scalar(text: str) -> bool | int | float | str:
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError:
        return text
    if isinstance(value, str):  # YAML 1.1 requires a dot in 1e-3, ROS does not
        number = _number(value) if value == text.strip() else None
        return value if number is None else number
    return value if isinstance(value, (bool, int, float)) else text


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
