"""The images of a folder by their names: which files are images, in which order, and what about that may surprise."""

from __future__ import annotations

import itertools
import os
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from stab_ros.core.text import are, counted

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm", ".pnm", ".jp2")
UNREAD_SUFFIXES = (".gif", ".heic", ".heif", ".avif", ".jxl", ".exr", ".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf",
                   ".orf", ".rw2")  # of pictures that are not read
_BAG_SUFFIXES = (".mcap", ".bag", ".db3")
_NUMBER = re.compile("([0-9]+)")
_NAMED = 3  # as examples
_JOINTS = " -_.("  # between a name and its number


def image_files(folder: Path) -> list[Path]:
    """The images of a folder, in the order of the numbers in their names: frame2 before frame10.

    Left out are hidden files, as the companions `._IMG_0001.JPG` that a Mac adds, folders, and what lies beside a
    numbered series without a number, as `average.png`.
    """
    files = _with_suffix(folder, IMAGE_SUFFIXES)
    beside = set(_beside_series(files))
    return sorted((file for file in files if file not in beside), key=lambda file: (_natural(file.name), file.name))


def unread_kinds(folder: Path) -> list[str]:
    """Suffixes of pictures in the folder that cannot be read, and stand for none of its images, as `.gif`."""
    images = {file.stem for file in _with_suffix(folder, IMAGE_SUFFIXES)}
    return sorted({file.suffix.lower() for file in _with_suffix(folder, UNREAD_SUFFIXES) if file.stem not in images})


def name_remarks(folder: Path, files: Sequence[Path]) -> list[str]:
    """What a user may not expect of the `image_files` of a folder, one line each."""
    found = (_order(files), _counter(files), _series(files), _without_number(folder), _hidden(folder),
             _left_out(folder), _bag_beside(folder))
    return [f"{folder}: {remark}" for remark in found if remark]


def _beside_series(files: Sequence[Path]) -> list[Path]:
    """Images without a number beside a larger numbered series; `view` belongs to `view1`, `view (2)`."""
    others, longest = _unnumbered(files)
    return others if len(others) < longest else []


def _unnumbered(files: Sequence[Path]) -> tuple[list[Path], int]:
    """Images without a number whose names do not begin those with one, and how long the longest numbered series is."""
    stems = [file.stem.lower() for file in files if _NUMBER.search(file.stem)]
    begins = {_NUMBER.split(stem)[0].rstrip(_JOINTS) for stem in stems}
    others = [file for file in files
              if not _NUMBER.search(file.stem) and file.stem.lower().rstrip(_JOINTS) not in begins]
    return others, max(Counter(_NUMBER.sub("#", stem) for stem in stems).values(), default=0)


def _without_number(folder: Path) -> str:
    others, longest = _unnumbered(_with_suffix(folder, IMAGE_SUFFIXES))
    if not others or longest < 2:
        return ""
    names = sorted(file.name for file in others)
    named = ", ".join(names[:_NAMED]) + (", ..." if len(names) > _NAMED else "")
    what = f"{counted(len(names), 'image')} without a number in the name, {named}"
    became = f"{are(len(names))} left out" if len(names) < longest else "count as frames"
    return f"{what}, {became}; {longest} others have one"


def _hidden(folder: Path) -> str:
    with os.scandir(folder) as entries:
        names = sorted(entry.name for entry in entries
                       if entry.name.startswith(".") and entry.name.lower().endswith(IMAGE_SUFFIXES))
    return f"{counted(len(names), 'hidden file')}, as {names[0]}, {are(len(names))} left out" if names else ""


def _with_suffix(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    with os.scandir(folder) as entries:
        return [folder / entry.name for entry in entries
                if entry.name.lower().endswith(suffixes) and not entry.name.startswith(".") and not entry.is_dir()]


def _natural(name: str) -> list[tuple[int, int]]:
    """Sorts as the text does, but with a number in the place of its digits."""
    return [key for place, part in enumerate(_NUMBER.split(name))
            for key in ([(ord("0"), int(part))] if place % 2 else [(ord(letter), 0) for letter in part])]


def _order(files: Sequence[Path]) -> str:
    plain = sorted(files, key=lambda file: file.name)
    first = next((pair for pair in zip(files, plain, strict=True) if pair[0] != pair[1]), None)
    if first is None:
        return ""
    return (f"the images are in the order of the numbers in their names, {first[0].name} before {first[1].name}, "
            "and not in alphabetical order")


def _counter(files: Sequence[Path]) -> str:
    """A counter of three digits or more that began again: one gap, and none at either end of its range."""
    found = [_counted(file) for file in files]
    if len(files) < 3 or len({head for head, _ in found}) > 1:
        return ""
    numbers = [number for _, number in found]
    steps = [after - before for before, after in itertools.pairwise(numbers)]
    *_, usual, gap = sorted(steps)
    at, end = steps.index(gap), 10 ** max(3, len(str(numbers[-1])))
    if numbers[0] > max(1, usual) or numbers[-1] + usual < end or gap < max(end // 2, 10 * usual):
        return ""
    return (f"the numbers jump from {files[at].name} to {files[at + 1].name}; if the counter of the camera went from "
            f"{files[-1].name} on to {files[0].name}, rename the images up to {files[at].name} so that they come last")


def _counted(file: Path) -> tuple[str, int]:
    """The last number in the name, and what is before it; no number is -1."""
    parts = _NUMBER.split(file.stem)
    return ("".join(parts[:-2]).lower(), int(parts[-2])) if len(parts) > 1 else (file.stem, -1)


def _series(files: Sequence[Path]) -> str:
    """Names of several patterns, as of two cameras or two flights."""
    patterns = [_NUMBER.sub("#", file.stem) + file.suffix for file in files]
    shown = {pattern.lower(): pattern for pattern in reversed(patterns)}  # IMG_1.JPG and IMG_2.jpg are one series
    counts = Counter(pattern.lower() for pattern in patterns).most_common()
    found = [f"{shown[pattern]} ({count})" for pattern, count in counts if "#" in pattern]
    if len(found) < 2:
        return ""
    named = ", ".join(found[:_NAMED]) + (", ..." if len(found) > _NAMED else "")
    return f"the names of the images follow {len(found)} patterns, {named}; all are frames of one recording"


def _left_out(folder: Path) -> str:
    kinds = unread_kinds(folder)
    if not kinds:
        return ""
    return f"*{', *'.join(kinds)} files are left out, images must be {', '.join(IMAGE_SUFFIXES)}"


def _bag_beside(folder: Path) -> str:
    bags = _with_suffix(folder, _BAG_SUFFIXES)
    return f"is taken as a folder of images, {bags[0].name} in it is left out; give it by its name" if bags else ""
