"""Why a frame is lost: of all attempts, the reason of the one that came furthest."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from truth import IDENTITY, SIZE, flat, frame, picture, random_noise, translation

from stab_ros.core.types import Correspondences, Fit, FloatArray, Gray, LostReason, State, Track
from stab_ros.parameters.engines import make_stabilizer
from stab_ros.tracking.anchor_pose import AT_REFERENCE
from stab_ros.tracking.registration import Registration
from stab_ros.tracking.settings import StabilizerConfig
from stab_ros.tracking.support import Support

UNMATCHED = {LostReason.NO_FEATURES, LostReason.FEW_INLIERS}
MIRRORED = np.array([[-1.0, 0, SIZE[0] - 1], [0, 1, 0], [0, 0, 1]])


def reason(image: Gray, **values: bool | float | str) -> LostReason | None:
    """Of the frame after the reference."""
    stabilizer = make_stabilizer(values)
    assert stabilizer.track(frame(picture())).lost_reason is None
    return stabilizer.track(frame(image, 1)).lost_reason


@pytest.mark.parametrize("method", ["direct", "klt", "sift"])
def test_the_reason_names_what_the_frame_lacks(method: str) -> None:
    moved = picture(translation(3, 2))
    assert reason(moved, method=method) is None
    assert reason(flat(), method=method) is LostReason.NO_TEXTURE
    assert reason(moved, method=method, max_sigma=0.001) is LostReason.UNCERTAIN


@pytest.mark.parametrize("method", ["direct", "klt"])
def test_most_of_the_reference_covered_leaves_too_few_inliers(method: str) -> None:
    """In pieces: an area that agrees by itself would be enough."""
    covered, noise = picture(translation(3, 2)), random_noise()
    for x in range(15, covered.shape[1], 100):
        covered[:, x : x + 70] = noise[:, x : x + 70]
    assert reason(covered, method=method, min_inlier_share=0.1) is None
    assert reason(covered, method=method, min_inlier_share=0.9) is LostReason.FEW_INLIERS


def test_another_scene_is_not_matched() -> None:
    assert reason(random_noise()) in UNMATCHED
    assert reason(picture(seed=2)) in UNMATCHED


def test_without_a_textured_frame_there_is_no_reference() -> None:
    stabilizer = make_stabilizer({})
    assert stabilizer.track(frame(flat())).lost_reason is LostReason.NO_TEXTURE


def test_frames_of_the_start_have_reasons_too() -> None:
    images = [picture(), picture(translation(1, 0)), flat(), picture(translation(2, 0)), picture(seed=2),
              picture(translation(3, 0))]
    stabilizer = make_stabilizer({"start_s": 1.0})
    tracks = [track for number, image in enumerate(images) for track in stabilizer.answers(frame(image, number))]
    tracks += stabilizer.finish()
    assert [track.tracked for track in tracks] == [True, True, False, True, False, True]
    assert tracks[2].lost_reason is LostReason.NO_TEXTURE
    assert tracks[4].lost_reason in UNMATCHED


def fit_of(ref_H_cur: FloatArray, inliers: int, variance: float) -> Fit:
    return Fit(ref_H_cur, np.ones(inliers, bool), variance * np.eye(8), 0.1)


@pytest.mark.parametrize(("fit", "expected"), [
    (fit_of(IDENTITY, 20, 1e-12), None),
    (fit_of(IDENTITY, 20, 1.0), LostReason.UNCERTAIN),
    (fit_of(IDENTITY, 19, 1.0), LostReason.FEW_INLIERS),
    (fit_of(MIRRORED, 19, 1.0), LostReason.IMPLAUSIBLE),
])
def test_a_fit_is_rejected_by_the_camera_the_number_and_the_uncertainty(
    fit: Fit, expected: LostReason | None
) -> None:
    registration = Registration(StabilizerConfig(min_inliers=5, min_inlier_share=0.2), SIZE)
    n = len(fit.inlier)
    pairs = Correspondences(np.arange(n), np.zeros((n, 2)), np.zeros((n, 2)), np.tile(np.eye(2), (n, 1, 1)))
    support = Support(agreeing=float(n), expected=100.0, solid=0.0)
    assert registration.rejected(fit, AT_REFERENCE, pairs, np.ones(n), support) is expected


def test_what_came_further_is_the_reason() -> None:
    far = [LostReason.NO_TEXTURE, LostReason.NO_FEATURES, LostReason.FEW_INLIERS, LostReason.IMPLAUSIBLE,
           LostReason.UNCERTAIN]
    for nearer, further in itertools.pairwise(far):
        assert nearer.or_further(further) is further.or_further(nearer) is further


def test_lost_and_reason_belong_together() -> None:
    with pytest.raises(ValueError, match="LOST"):
        Track(State.LOST, 0, 1, 1, 0)
    with pytest.raises(ValueError, match="TRACKED"):
        Track(State.TRACKED, 0, 1, 1, 0, ref_H_cur=IDENTITY, lost_reason=LostReason.UNCERTAIN)
