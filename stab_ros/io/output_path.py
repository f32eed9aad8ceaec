"""Where an output is written to."""

from __future__ import annotations

from pathlib import Path


def final_path(path: Path) -> Path:
    """The file that a symbolic link leads to, which is replaced in place of the link; any other path is itself."""
    try:
        return path.resolve() if path.is_symlink() else path
    except OSError:  # as where a name is too long, which opening it will say
        return path
