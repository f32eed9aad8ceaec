"""Where numba looks for compiled kernels: as by itself, but a folder that can only be read will do, too.

As that of an image or a package that root has warmed up, where the node runs as somebody else. The classes are named in
`numba.config.CACHE_LOCATOR_CLASSES`, which numba has since 0.62; before, it wants folders that can be written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numba import config
from numba.core import caching

_SETTING = "CACHE_LOCATOR_CLASSES"


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
    return found if _holds(found.get_cache_path(), function, file) else locator.from_function(function, file)


def _holds(folder: str, function: Callable[..., Any], file: str) -> bool:
    """Whether code of the function is there, and not older than its source."""
    pattern = f"*.{function.__qualname__}-{function.__code__.co_firstlineno}.*.nbi"
    written = [path.stat().st_mtime for path in Path(folder).glob(pattern)]
    return bool(written) and max(written) >= Path(file).stat().st_mtime


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
