"""Locations of numba's cache of compiled kernels, including folders that are read-only.

By default numba uses writable folders only. A cache in a container image or in an installed package may be read-only
for the user who runs the node. Such a folder is used if it has code of this source for this processor; otherwise numba
uses the next writable location. The classes are listed in `numba.config.CACHE_LOCATOR_CLASSES` (numba 0.62 and later;
earlier versions need writable folders).
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numba
from numba import config
from numba.core import caching
from numba.core.registry import cpu_target

_SETTING = "CACHE_LOCATOR_CLASSES"
# exceptions when reading an index or code that is damaged or of another version
UNUSABLE = (RuntimeError, OSError, EOFError, ValueError, TypeError, AttributeError, LookupError, ImportError,
            MemoryError, pickle.PickleError)


class UserProvided:
    """The folder of NUMBA_CACHE_DIR."""

    @staticmethod
    def from_function(function: Callable[..., Any], file: str) -> Any:
        """The cache locator; None without such a folder, or if it is neither usable nor writable."""
        return _located(caching.UserProvidedCacheLocator, function, file) if config.CACHE_DIR else None


class InTree:
    """The folder `__pycache__` next to the source."""

    @staticmethod
    def from_function(function: Callable[..., Any], file: str) -> Any:
        """The cache locator; None if the folder is neither usable nor writable."""
        return _located(caching.InTreeCacheLocator, function, file)


def _located(locator: Any, function: Callable[..., Any], file: str) -> Any:
    found = locator(function, file)
    return found if _holds(found, function) else locator.from_function(function, file)


def _holds(found: Any, function: Callable[..., Any]) -> bool:
    """Whether the cache has code of this source, numba version and processor; a damaged cache has none."""
    try:
        with _index(found.get_cache_path(), function).open("rb") as file:
            if pickle.load(file) != numba.__version__:
                return False
            stamp, kept = pickle.load(file)
        machine = cpu_target.target_context.codegen().magic_tuple()
        return bool(stamp == found.get_source_stamp() and any(key[1] == machine for key in kept))
    except UNUSABLE:
        return False


def _index(folder: str, function: Callable[..., Any]) -> Path:
    """Numba's index file of a function."""
    module = Path(function.__code__.co_filename).stem
    version = f"py{sys.version_info[0]}{sys.version_info[1]}{getattr(sys, 'abiflags', '')}"
    return Path(folder, f"{module}.{function.__qualname__}-{function.__code__.co_firstlineno}.{version}.nbi")


def forget(dispatcher: Any) -> None:
    """Deletes the cached code of a function.

    Raises:
        OSError: the cache is not writable.
    """
    _index(dispatcher.stats.cache_path, dispatcher.py_func).unlink(missing_ok=True)


@contextmanager
def readable() -> Iterator[None]:
    """Context in which kernels are also loaded from read-only folders, unless the user configured the locators."""
    before = getattr(config, _SETTING, None)
    if before == "":
        setattr(config, _SETTING, f"{__name__}.UserProvided,{__name__}.InTree,UserWideCacheLocator")
    try:
        yield
    finally:
        if before == "":
            setattr(config, _SETTING, before)
