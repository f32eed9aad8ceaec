"""Value types of the tracker: frozen dataclasses that are validated on construction.

Coordinates: x to the right, y down, with the centre of the top left pixel at (0, 0). `ref_H_cur` maps pixels of the
current frame to pixels of the reference: `[x_ref, y_ref, 1] ~ H [x, y, 1]`, normalized to h22 = 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stab_ros.core.row_shifts import RowShifts

Gray: TypeAlias = NDArray[np.uint8]  # (h, w)
Image: TypeAlias = NDArray[Any]  # (h, w) or (h, w, channels), uint8, uint16 or float32
Homography: TypeAlias = NDArray[np.floating[Any]]  # (3, 3) float64, h22 = 1
FloatArray: TypeAlias = NDArray[np.floating[Any]]
Float32Array: TypeAlias = NDArray[np.float32]
BoolArray: TypeAlias = NDArray[np.bool_]
IdArray: TypeAlias = NDArray[np.int64]

NO_POINTS: FloatArray = np.empty((0, 2))  # no points given by the user
NO_POINTS.flags.writeable = False

CHANNELS = {"mono8": 1, "mono16": 1, "32FC1": 1, "bgr8": 3, "bgr16": 3, "rgb8": 3, "bgra8": 4, "rgba8": 4}
_DEEP = {"mono16": np.uint16, "bgr16": np.uint16, "32FC1": np.float32}  # the dtypes of more than 8 bits
_WARPED = {"bgr16": "bgr8"}


class State(Enum):
    """Whether a frame was registered to the reference."""

    TRACKED = "TRACKED"
    LOST = "LOST"


class LostReason(Enum):
    """Why a frame was not registered, in the order of how far its registration came."""

    INTERNAL = "internal error"  # of the tracker itself
    UNUSABLE = "unusable image"  # it cannot be decoded, or does not fit the stream
    UNANSWERED = "no answer"  # it was never tracked, so nothing is known of it
    STARTING = "start under way"  # a node was to answer at once, before the ground is chosen
    NO_TEXTURE = "no texture"
    NO_FEATURES = "no features found"
    FEW_INLIERS = "too few inliers"
    IMPLAUSIBLE = "implausible"  # no camera moves so
    UNCERTAIN = "too uncertain"

    def or_further(self, other: LostReason) -> LostReason:
        """Compares how far two registrations of one frame came.

        Args:
            other: of the other one.

        Returns:
            The reason of the one that came further.
        """
        return max(self, other, key=list(LostReason).index)


class ResetReason(Enum):
    """Why homographies begin anew, and `reset_counter` rises."""

    SIZE = "other size"
    DEPTH = "other bit depth"
    GIVEN_UP = "reference matched nothing"
    GROUND = "other ground"  # the reference stays, another of its planes is taken for ground
    ASKED = "asked for"


@dataclass(frozen=True, eq=False)
class Frame:
    """One image of a stream, decoded.

    Attributes:
        image: (h, w) or (h, w, channels); uint16 for mono16 and bgr16, float32 for 32FC1, uint8 otherwise.
        encoding: one of `CHANNELS`, as in sensor_msgs/image_encodings: mono8, mono16, 32FC1, bgr8, bgr16, rgb8, bgra8,
            rgba8.
        stamp_ns: the header stamp, ns: when the image was taken.
        frame_id: the header's coordinate frame.

    Raises:
        ValueError: the encoding is unknown, or shape or dtype of the image do not fit it.
    """

    image: Image
    encoding: str
    stamp_ns: int
    frame_id: str = ""

    def __post_init__(self) -> None:
        channels = CHANNELS.get(self.encoding)
        if channels is None:
            raise ValueError(f"encoding {self.encoding!r} is not one of {', '.join(CHANNELS)}")
        shape = self.image.shape[:2] if channels == 1 else (*self.image.shape[:2], channels)
        dtype = _DEEP.get(self.encoding, np.uint8)
        if self.image.shape != shape or self.image.dtype != dtype:
            raise ValueError(f"a {self.encoding} image of {self.image.shape} {self.image.dtype} is not {shape} {dtype}")

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.image.shape[1], self.image.shape[0]

    @property
    def warped_encoding(self) -> str:
        """The encoding of the frame once it is warped to the reference: its own, but bgr8 for bgr16."""
        return _WARPED.get(self.encoding, self.encoding)

    @property
    def kind(self) -> str:
        """Size and encoding in words, for messages."""
        return f"{self.size[0]}x{self.size[1]} {self.encoding}"

    def is_like(self, other: Frame) -> bool:
        """Compares size and bit depth; one camera's images may be gray, in colour or with alpha by turns.

        Args:
            other: another frame.

        Returns:
            Whether the two frames can belong to one stream.
        """
        return (self.size, self.image.dtype) == (other.size, other.image.dtype)


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Correspondences of N features between the reference and the current frame.

    Attributes:
        feature_id: (N,) int64, rows of `Method.reference_px`; the same feature keeps its id in all frames of one
            reference.
        reference_px: (N, 2) float64, positions in the reference.
        current_px: (N, 2) float64, positions in the current frame.
        information: (N, 2, 2) float64, inverse covariance of the reference-side displacement, 1/px^2.
        ref_H_cur: homography at which the method measured them, an initial value for the fit; None if it used none.

    Raises:
        ValueError: arrays of other shapes.
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
    """A homography fitted to N correspondences.

    Attributes:
        ref_H_cur: (3, 3) float64.
        inlier: (N,) bool.
        covariance: (8, 8) of h00, h01, h02, h10, h11, h12, h20, h21 (h22 = 1 is fixed).
        rmse_px: root mean square distance of the inliers, reference side.
        consensus: size of the estimator's RANSAC consensus set before inliers are selected from it (FS of Zhang et al.
            2023, where the inliers are FP and their share in percent is CMR); None without such a stage.
        model: the simpler transformation model that took the place of the one asked for, as the inliers did not support
            it; "": none.
        rows: displacements of the frame's rows, added to its pixels before the homography; None: there are none.
    """

    ref_H_cur: Homography
    inlier: BoolArray
    covariance: FloatArray
    rmse_px: float
    consensus: int | None = None
    model: str = ""
    rows: RowShifts | None = None


@dataclass(frozen=True, eq=False)
class Track:
    """The answer for one frame.

    While LOST, `ref_H_cur`, `covariance`, `rmse_px` and `sigma_px` are None.

    Attributes:
        state: TRACKED or LOST.
        index: number of the frame in the stream, from 0.
        stamp_ns: the header stamp of the frame, ns.
        reference_stamp_ns: the header stamp of the reference, ns.
        reset_counter: how often the reference had been replaced.
        matches: number of correspondences that the method reported.
        inliers: number of those that agree with the homography.
        ref_H_cur: (3, 3) float64 with h22 = 1; maps pixels of the frame to pixels of the reference.
        covariance: (8, 8) float64, covariance of h00, h01, h02, h10, h11, h12, h20, h21.
        rmse_px: root mean square distance of the inliers, in pixels of the reference.
        sigma_px: one-sigma uncertainty of `ref_H_cur`, RMS over the 9x9 grid of the frame, px.
        provisional: whether the frame was answered before static ground was decided.
        lost_reason: why the frame is LOST; None while TRACKED.
        rows: displacements of the frame's rows by a rolling shutter, to be added to pixels of the frame before
            `ref_H_cur` maps them; None: none are seen. `covariance` then includes what the homography alone leaves.
        simpler_model: the transformation model that took the place of the one asked for, as `Fit.model`.
        reset_reason: why `reset_counter` rose last; None: it has not, as far as is known.

    Raises:
        ValueError: LOST without a reason, or TRACKED with one.
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
    lost_reason: LostReason | None = None
    rows: RowShifts | None = None
    simpler_model: str = ""
    reset_reason: ResetReason | None = None

    def __post_init__(self) -> None:
        if self.tracked is not (self.lost_reason is None):
            raise ValueError(f"a {self.state.value} frame with the reason {self.lost_reason}")

    @property
    def tracked(self) -> bool:
        """Whether `ref_H_cur` is known."""
        return self.state is State.TRACKED


@dataclass(frozen=True, eq=False)
class Stabilized:
    """A frame's track and its warped image.

    Attributes:
        track: the answer for the frame.
        image: the frame in the place of the reference; None: it is lost and `on_lost` is `drop`.
    """

    track: Track
    image: Image | None
