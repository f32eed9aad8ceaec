"""What every stabilisation method is to the tracker."""

from __future__ import annotations

from typing import Any, ClassVar, Protocol

from stab_ros.core.types import NO_POINTS, BoolArray, Correspondences, FloatArray, Gray, Homography


class Method(Protocol):
    """Finds features of the reference again in the current frame.

    Everything that depends on the reference alone is done in the constructor, once. Reports all it found: which of it
    is static ground is the estimator's and `core.static_features`' to decide.
    """

    Config: ClassVar[type[Any]]  # frozen dataclass of `core.config.setting` fields: parameters `<name>.*`
    takes_points: ClassVar[bool]  # whether the user may name the features
    seeks_all: ClassVar[bool]  # whether each is looked for; else a detector finds again what it finds

    def __init__(self, reference: Gray, allowed: BoolArray, config: Any, points_px: FloatArray = NO_POINTS) -> None:
        """reference: (h, w) uint8. allowed: (h, w) bool, where features may lie that the method chooses.

        points_px: (n, 2) float64, the features that the user names, wherever `allowed`; none: the method chooses.
        One that is of no use (too near the border, no texture) is left out; the engine says which.
        """

    @property
    def reference_px(self) -> FloatArray:
        """Where the reference's features lie, (features, 2) float64; a feature_id is a row of it."""

    def match(self, current: Gray, guess: Homography, trust: FloatArray) -> Correspondences:
        """The features found in `current`, (h, w) uint8, of the reference's size; it is not modified.

        guess: ref_H_cur as predicted. trust: (features,) in [0, 1], how static each feature has proved so far.
        """
