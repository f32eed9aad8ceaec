"""The settings of the tracker that belong to no single method."""

from __future__ import annotations

from dataclasses import dataclass

from stab_ros.core.settings import Checked, setting
from stab_ros.estimation.estimators import ESTIMATORS
from stab_ros.estimation.models import MODELS
from stab_ros.imaging.warp import INTERPOLATION
from stab_ros.imaging.window import Window
from stab_ros.methods import METHODS

REFERENCES = ("fixed", "updated", "adjacent", "keyframe")


@dataclass(frozen=True)
class StabilizerConfig(Checked):
    """Settings of a `Stabilizer` that do not belong to one method; each field carries its range and meaning.

    Attributes:
        method_config: the `Config` of the method; None: its defaults.

    Raises:
        ConfigError: a value has the wrong type, is out of range or is none of the choices.
    """

    method: str = setting("direct", "Method that finds the features of the reference again", choices=tuple(METHODS))
    model: str = setting("projective", "Transformation model of the homography", choices=MODELS)
    estimator: str = setting("magsac", "Estimator that fits the homography", choices=tuple(ESTIMATORS))
    reference: str = setting("fixed", "Frame that others are registered to: the first one (fixed); a later one whose "
                             "features are carried to the first (updated); the previous one, in a chain (adjacent); or "
                             "a keyframe where the view leaves the first (keyframe)", choices=REFERENCES)
    max_keyframes: int = setting(16, "Number of keyframes kept with reference keyframe; beyond it the farthest is "
                                 "dropped", 3, 1000)
    update_every: int = setting(1, "Number of tracked frames after which reference updated detects features again", 1,
                                100000)
    on_lost: str = setting("drop", "Content of image_stabilized while lost: nothing (drop), the frame warped by the "
                           "last homography (hold), or the frame as it came (pass)", choices=("drop", "hold", "pass"))
    output_roi: str = setting("", "Region shown by image_stabilized, as 'x, y, width, height' in reference px; may "
                              'exceed the reference; "": the view of the reference')
    output_scale: float = setting(1.0, "Scale of image_stabilized relative to the reference", 0.02, 1.0)
    interpolation: str = setting("linear", "Interpolation used when warping the stabilized image",
                                 choices=tuple(INTERPOLATION))
    threshold: float = setting(0.5, "Largest residual of an inlier of the final fit, px", 0.01, 20.0)
    ransac_threshold: float = setting(3.0, "Largest residual within the consensus that ed_ransac then filters by "
                                      "threshold, px", 0.01, 50.0)
    rolling_shutter: str = setting("auto", "Rows that swing because the camera reads them one after the other while it "
                                   "vibrates: corrected in image_stabilized where the features show it (auto), or not "
                                   "looked for (off)", choices=("auto", "off"))
    start_s: float = setting(1.0, "Length of the start-up, in which frames are buffered until static ground is known, "
                             "s of header time; 0 where roi, exclude, points or static_map are given", 0.0, 60.0)
    min_inliers: int = setting(12, "A frame with fewer inliers is LOST", 1, 10000)
    min_inlier_share: float = setting(0.2, "A frame with a smaller share of trusted inliers is LOST: of the trusted "
                                      "features in view, or of half the trusted matches where the method uses a "
                                      "detector", 0.0, 1.0)
    max_sigma: float = setting(2.0, "A frame whose registration has a larger sigma_px is LOST, in thousandths of the "
                               "image's longer side; the uncertainty of the anchor frame and of an ambiguous ground "
                               "is not counted", 0.001, 100.0)
    threads: int = setting(0, "Number of threads of this process; does not change results; 0: one per core, at most 4",
                           0, 64)
    method_config: object = None

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.window

    @property
    def window(self) -> Window:
        """What `image_stabilized` shows of the reference, and at which scale."""
        return Window.of(self.output_roi, self.output_scale)
