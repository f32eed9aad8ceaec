"""Where numba looks for compiled kernels: as by itself, but a folder that can only be read will do, too.

As that of an image or a package that root has warmed up, where the node runs as somebody else. It must hold code of
this source for this machine; if it does not, numba takes the next place that can be written. The classes are named in
`numba.config.CACHE_LOCATOR_CLASSES`, which numba has since 0.62; before, it wants folders that can be written.
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
# what reading an index or code that is damaged, or of another version, may raise
UNUSABLE = (RuntimeError, OSError, EOFError, ValueError, TypeError, AttributeError, LookupError, ImportError,
            MemoryError, pickle.PickleError)


class Given:
    """The folder of NUMBA_CACHE_DIR."""

    @staticmethod
    def from_function(function: Callable[..., Any], file: str) -> Any:
        """What numba asks for; None if there is no such folder, or nothing is in it and it cannot be written."""
        return _located(caching.UserProvidedCacheLocator, function, file) if config.CACHE_DIR else None


class BesideTheSource:
    """`__pycache__`."""

    @staticmethod
    def from_function(function: Callable[..., Any], file: str) -> Any:
        """What numba asks for; None if nothing is there and it cannot be written."""
        return _located(caching.InTreeCacheLocator, function, file)


def _located(locator: Any, function: Callable[..., Any], file: str) -> Any:
    found = locator(function, file)
    return found if _holds(found, function) else locator.from_function(function, file)


def _holds(found: Any, function: Callable[..., Any]) -> bool:
    """Whether there is code of this source, numba and processor; what is damaged counts as none."""
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
    """The file in which numba lists what it has kept of a function."""
    module = Path(function.__code__.co_filename).stem
    version = f"py{sys.version_info[0]}{sys.version_info[1]}{getattr(sys, 'abiflags', '')}"
    return Path(folder, f"{module}.{function.__qualname__}-{function.__code__.co_firstlineno}.{version}.nbi")


def forget(dispatcher: Any) -> None:
    """What was kept of a function, if that can be written. Raises OSError."""
    _index(dispatcher.stats.cache_path, dispatcher.py_func).unlink(missing_ok=True)


@contextmanager
def readable() -> Iterator[None]:
    """Within it, kernels are also found where they cannot be written, unless the user has chosen the places."""
    before = getattr(config, _SETTING, None)
    if before == "":
        setattr(config, _SETTING, f"{__name__}.Given,{__name__}.BesideTheSource,UserWideCacheLocator")
    try:
        yield
    finally:
        if before == "":
            setattr(config, _SETTING, before)
