"""Tables and videos that get their final name only when they are complete (as `BagWriter` does)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stab_ros.core.errors import InputError, WorkError
from stab_ros.io.input_kind import Kind, check_input, kind_of
from stab_ros.io.output_path import final_path

_VIDEO = ".mp4"


def check_output(path: Path, suffix: str, source: Path, force: bool) -> None:
    """Checks, before any work, that there is an input and that `path` can become an output file.

    Raises:
        InputError: there is no input; or the output has a wrong suffix, exists (without `force`), is part of the input,
            or has no folder to stand in.
    """
    check_input(source)
    if path.suffix.lower() != suffix:
        raise InputError(f"{path}: an output of this kind must be called *{suffix}")
    if _within(path, source):
        raise InputError(f"{path}: is the input itself, the output must be another file")
    if suffix == _VIDEO and not _is_utf8(path):
        raise InputError(f"{path}: the name of a video must be UTF-8")
    if path.is_dir():
        raise InputError(f"{path}: is a folder, the output must be a file")
    if path.exists() and not force:
        raise InputError(f"{path}: exists already, give --force to overwrite it or another name")
    if not path.parent.is_dir():
        raise InputError(f"{path}: cannot be written, {path.parent} is not a folder; it must be one that exists")


def _is_utf8(path: Path) -> bool:
    """OpenCV crashes on any other name."""
    try:
        str(path.absolute()).encode()
    except UnicodeEncodeError:
        return False
    return True


def _within(path: Path, source: Path) -> bool:
    """No output may be written into the folder of a bag; beside the images of a folder it may."""
    inside = source.resolve() in path.resolve().parents and source.is_dir() and kind_of(source) is Kind.BAG
    return inside or path.resolve() == source.resolve()


def partial_of(path: Path) -> Path:
    """The name until completion: `OUTPUT.mcap.partial`, but `V.partial.mp4` (FFmpeg goes by the suffix)."""
    return path.with_suffix(".partial.mp4") if path.suffix == _VIDEO else path.with_name(path.name + ".partial")


@contextmanager
def completed(path: Path) -> Iterator[Path]:
    """Yields the path to write to; renamed to `path` at the end, removed on bad input, kept on any other error.

    Raises:
        InputError: nothing can be written in this folder.
        WorkError: the finished file cannot be renamed.
    """
    path = final_path(path)
    partial = partial_of(path)
    try:
        partial.write_bytes(b"")
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); its folder must be writable") from error
    try:
        yield partial
    except InputError:
        partial.unlink(missing_ok=True)
        raise
    try:
        partial.replace(path)
    except OSError as error:
        raise WorkError(f"{path}: cannot be written ({error.strerror}); the result is {partial}") from error
