"""The interface of the stabilization methods."""

from __future__ import annotations

from typing import Any, ClassVar, Protocol, runtime_checkable

from stab_ros.core.row_shifts import RowShifts
from stab_ros.core.types import NO_POINTS, BoolArray, Correspondences, FloatArray, Gray, Homography


class Method(Protocol):
    """Matches features of the reference in the current frame.

    The constructor does everything that depends on the reference alone. `match` reports every correspondence that it
    finds; the estimator and the tracker's feature trust decide which of them are static ground.

    Attributes:
        Config: frozen dataclass of `core.settings.setting` fields, the parameters `<method>.*`.
        takes_points: whether the user may provide the features (`points_px`).
        seeks_all: whether `match` searches for every feature; otherwise a detector redetects only some of them.
    """

    Config: ClassVar[type[Any]]
    takes_points: ClassVar[bool]
    seeks_all: ClassVar[bool]

    def __init__(self, reference: Gray, allowed: BoolArray, config: Any, points_px: FloatArray = NO_POINTS) -> None:
        """Selects features in the reference.

        Args:
            reference: (h, w) uint8.
            allowed: (h, w) bool, where the method may choose features.
            config: an instance of `Config`.
            points_px: (n, 2) float64, features given by the user, px, used regardless of `allowed`; with n = 0 the
                method chooses. It leaves out points that it cannot use, as without texture or too close to the border.
                The tracker then refuses the reference with an InputError that names the first of them.
        """

    @property
    def reference_px(self) -> FloatArray:
        """Positions of the features in the reference, (N, 2) float64, px; a `feature_id` is a row of it."""

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        """Correspondences between the reference and a frame.

        Args:
            current: (h, w) uint8, of the reference's size; not modified.
            guess: predicted `ref_H_cur`.
            trust: (N,) prior weight in [0, 1] of each feature: how static it has been so far.
        """


@runtime_checkable
class RowMethod(Method, Protocol):
    """A method that predicts a feature to a px or two, and so must be told of rows that have swung further."""

    def measure(self, current: Gray, ref_H_cur: Homography, rows: RowShifts | None) -> Correspondences:
        """Correspondences of all features that are found near a known place; nothing is searched for.

        Args:
            current: (h, w) uint8, of the reference's size; not modified.
            ref_H_cur: of the frame.
            rows: displacements of its rows; None: there are none.
        """
