"""The values that flow through the engine; frozen, and valid once constructed.

Coordinates: x right, y down, the centre of the top left pixel at (0, 0). `ref_H_cur` maps pixel centres of the
current frame to pixels of the reference frame, `[x_ref, y_ref, 1] ~ H [x, y, 1]`, normalised to h22 = 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Gray: TypeAlias = NDArray[np.uint8]  # (h, w)
Image: TypeAlias = NDArray[Any]  # (h, w) or (h, w, channels), uint8 or uint16
Homography: TypeAlias = NDArray[np.floating[Any]]  # (3, 3) float64, h22 = 1
FloatArray: TypeAlias = NDArray[np.floating[Any]]
BoolArray: TypeAlias = NDArray[np.bool_]
IdArray: TypeAlias = NDArray[np.int64]

NO_POINTS: FloatArray = np.empty((0, 2))  # the user names none
NO_POINTS.flags.writeable = False

CHANNELS = {"mono8": 1, "mono16": 1, "bgr8": 3, "rgb8": 3, "bgra8": 4, "rgba8": 4}


class State(Enum):
    """What became of a frame."""

    TRACKED = "TRACKED"
    LOST = "LOST"


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture of the stream, decoded: `encoding` is one of CHANNELS, `stamp_ns` the header stamp."""

    image: Image
    encoding: str
    stamp_ns: int
    frame_id: str = ""

    def __post_init__(self) -> None:
        channels = CHANNELS.get(self.encoding)
        if channels is None:
            raise ValueError(f"encoding {self.encoding!r} is not one of {', '.join(CHANNELS)}")
        shape = self.image.shape[:2] if channels == 1 else (*self.image.shape[:2], channels)
        dtype = np.uint16 if self.encoding == "mono16" else np.uint8
        if self.image.shape != shape or self.image.dtype != dtype:
            raise ValueError(f"a {self.encoding} image of {self.image.shape} {self.image.dtype} is not {shape} {dtype}")

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.image.shape[1], self.image.shape[0]

    @property
    def kind(self) -> str:
        """Size and encoding, in words."""
        return f"{self.size[0]}x{self.size[1]} {self.encoding}"

    def is_like(self, other: Frame) -> bool:
        """Whether the two can be of one stream."""
        return (self.size, self.encoding) == (other.size, other.encoding)


@dataclass(frozen=True, eq=False)
class Correspondences:
    """What every method reports: N features, where they are in the reference and in the current frame.

    feature_id: (N,) int64, stable over the frames of one reference, within [0, Method.features).
    reference_px, current_px: (N, 2) float64.
    information: (N, 2, 2) float64, inverse covariance of the reference-side displacement, 1/px^2.
    ref_H_cur: where the method put the frame to find them, for a fit to start from; None: it needed no such place.
    """

    feature_id: IdArray
    reference_px: FloatArray
    current_px: FloatArray
    information: FloatArray
    ref_H_cur: Homography | None = None

    def __post_init__(self) -> None:
        n = len(self.feature_id)
        shapes = (self.reference_px.shape, self.current_px.shape, self.information.shape)
        if shapes != ((n, 2), (n, 2), (n, 2, 2)):
            raise ValueError(f"{n} correspondences with arrays of {shapes}")

    def __len__(self) -> int:
        return len(self.feature_id)

    def __getitem__(self, keep: BoolArray | IdArray | slice) -> Correspondences:
        return Correspondences(self.feature_id[keep], self.reference_px[keep], self.current_px[keep],
                               self.information[keep], self.ref_H_cur)


@dataclass(frozen=True, eq=False)
class Fit:
    """A homography fitted to correspondences.

    inlier: (N,) bool over the correspondences.
    covariance: (8, 8) of h00, h01, h02, h10, h11, h12, h20, h21 (h22 = 1 is fixed).
    rmse_px: root mean square distance of the inliers, reference side.
    consensus: how many correspondences the consensus of the estimator's RANSAC held, before any were dropped from it
    (FS of Zhang et al. 2023; the inliers are FP, their share in percent is CMR); None where it has no such stage.
    """

    ref_H_cur: Homography
    inlier: BoolArray
    covariance: FloatArray
    rmse_px: float
    consensus: int | None = None


@dataclass(frozen=True, eq=False)
class Track:
    """The answer for one frame. While LOST, `ref_H_cur`, `covariance`, `rmse_px` and `sigma_px` are None.

    index: the frame's number in the stream, from 0. reset_counter: how often the reference was replaced.
    sigma_px: one-sigma uncertainty of `ref_H_cur`, RMS over the 9x9 grid of the frame (`geometry.grid_rms`).
    provisional: given before enough was seen of a start to tell what is ground.
    """

    state: State
    index: int
    stamp_ns: int
    reference_stamp_ns: int
    reset_counter: int
    matches: int = 0
    inliers: int = 0
    ref_H_cur: Homography | None = None
    covariance: FloatArray | None = None
    rmse_px: float | None = None
    sigma_px: float | None = None
    provisional: bool = False

    @property
    def tracked(self) -> bool:
        return self.state is State.TRACKED


@dataclass(frozen=True, eq=False)
class Stabilized:
    """A frame's track, and the frame in the reference's place (None: lost and `on_lost` is drop)."""

    track: Track
    image: Image | None
