"""How the images of a folder are turned: all as the EXIF orientation of the first says.

A viewer turns each by its own, but a camera that looks down does not know which side is up: within one flight the
orientation may jump while the picture on the sensor does not.
"""

from __future__ import annotations

from stab_ros.core.text import counted
from stab_ros.io.image_metadata import TURNS, UPRIGHT


class Orientation:
    """The EXIF orientation of the first image, and which others say something else."""

    def __init__(self) -> None:
        self._first: tuple[str, int] | None = None  # name and orientation
        self._others: list[str] = []

    def take(self, name: str, orientation: int) -> int:
        """The orientation that an image of this name gets; `orientation`: its own."""
        self._first = self._first or (name, orientation)
        if orientation != self._first[1]:
            self._others.append(name)
        return self._first[1]

    @property
    def remark(self) -> str:
        """What became of the images; an empty string: they are as stored."""
        name, orientation = self._first or ("", UPRIGHT)
        how = TURNS.get(orientation, "left as stored")
        if self._others:
            return (f"all images are {how}, as the EXIF orientation of {name} says; "
                    f"{counted(len(self._others), 'has', 'have')} another, the first of them {self._others[0]}")
        return "" if orientation == UPRIGHT else f"the images are {how}, as their EXIF orientation says"
