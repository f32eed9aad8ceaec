"""Stabilises a folder of images, a video or a bag: `python stabilise_folder.py INPUT OUTPUT_FOLDER`.

Writes each frame in the place of the reference as a PNG, and the homographies as `H.csv`.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import cv2

from stab_ros import Frame, HomographyWriter, InputError, Stabilizer, Track, make_stabilizer, open_source


def tracked(stabilizer: Stabilizer, source: Path) -> Iterator[tuple[Frame, Track]]:
    """Each frame with its track, in order; the frames of the first second wait until the static ground is known."""
    waiting: list[Frame] = []
    with open_source(source) as opened:
        for picture in opened.frames():
            if isinstance(picture.decoded, Frame):  # else it is the reason why the image cannot be decoded
                waiting.append(picture.decoded)
                yield from ((waiting.pop(0), track) for track in stabilizer.answers(picture.decoded))
    yield from zip(waiting, stabilizer.finish(), strict=True)


def main(source: Path, output: Path) -> None:
    """Does the work."""
    stabilizer = make_stabilizer({"method": "direct"})
    output.mkdir(parents=True, exist_ok=True)
    with HomographyWriter(output / "H.csv") as table:
        for frame, track in tracked(stabilizer, source):
            table.write(track.index, track)
            image = stabilizer.warp(frame, track)
            if image is not None:  # None: the frame is lost
                cv2.imwrite(str(output / f"{track.index:05}.png"), image)


if __name__ == "__main__":
    try:
        main(Path(sys.argv[1]), Path(sys.argv[2]))
    except InputError as error:
        sys.exit(str(error))
