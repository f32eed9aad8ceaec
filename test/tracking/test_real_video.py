"""Over real drone video, where it lies beside the repository: two ways that share nothing must agree."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from conftest import SHARED_DATA

from stab_ros.core.geometry import rms_distance
from stab_ros.core.types import Frame, Gray, Homography, State, Track
from stab_ros.parameters.engines import make_stabilizer

VIDEO = SHARED_DATA / "navizence.mp4"
FRAMES = 30
SIFT_FRAMES = (5, 11, 17, 23, 29)

pytestmark = pytest.mark.skipif(not VIDEO.is_file(), reason="no real data beside the repository")


@pytest.fixture(scope="module")
def pictures() -> list[Gray]:
    """The first thirty frames of navizence, 1920x1080."""
    capture = cv2.VideoCapture(str(VIDEO))
    found = [capture.read()[1] for _ in range(FRAMES)]
    capture.release()
    return [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in found]


def tracked(pictures: list[Gray], subset: str = "all", method: str = "direct") -> list[Track]:
    stabilizer = make_stabilizer({"method": method, "direct.subset": subset})
    return [stabilizer.track(Frame(p, "mono8", 10**9 + k * 40_000_000)) for k, p in enumerate(pictures)]


@pytest.fixture(scope="module")
def tracks(pictures: list[Gray]) -> list[Track]:
    return tracked(pictures)


def median_apart_px(ones: list[Homography | None], others: list[Homography | None], size: tuple[int, int]) -> float:
    apart = [rms_distance(a, b, size) for a, b in zip(ones, others, strict=True) if a is not None and b is not None]
    assert len(apart) == len(ones)
    return float(np.median(apart))


def by_sift(reference: Gray, others: list[Gray]) -> list[Homography | None]:
    """ref_H_cur of each by SIFT, ratio test and MAGSAC++, all of them OpenCV's."""
    sift, found = cv2.SIFT.create(5000), []
    points_r, of_r = sift.detectAndCompute(reference, None)
    for current in others:
        points_c, of_c = sift.detectAndCompute(current, None)
        pairs = [best for best, second in cv2.BFMatcher(cv2.NORM_L2).knnMatch(of_c, of_r, k=2)
                 if best.distance < 0.75 * second.distance]
        current_px = np.array([points_c[m.queryIdx].pt for m in pairs])
        reference_px = np.array([points_r[m.trainIdx].pt for m in pairs])
        found.append(cv2.findHomography(current_px, reference_px, cv2.USAC_MAGSAC, 0.5, None, 10000, 0.9999)[0])
    return found


def test_every_frame_is_tracked(tracks: list[Track]) -> None:
    assert [track.state for track in tracks] == [State.TRACKED] * FRAMES
    sigma_px = [track.sigma_px for track in tracks if track.sigma_px is not None]
    assert np.median(sigma_px) < 0.08  # a third of what is tracked was copied by the codec
    assert np.max(sigma_px) < 0.15  # in the first frame the water has not moved off yet
    assert tracks[-1].ref_H_cur is not None
    assert rms_distance(tracks[-1].ref_H_cur, np.eye(3), (1920, 1080)) > 1  # the camera did move


def test_two_disjoint_halves_of_the_patches_agree(pictures: list[Gray]) -> None:
    halves = [[track.ref_H_cur for track in tracked(pictures, half)][1:] for half in ("even", "odd")]
    assert median_apart_px(halves[0], halves[1], (1920, 1080)) <= 0.03


def test_an_independent_estimate_agrees(pictures: list[Gray], tracks: list[Track]) -> None:
    ours = [tracks[k].ref_H_cur for k in SIFT_FRAMES]
    theirs = by_sift(pictures[0], [pictures[k] for k in SIFT_FRAMES])
    assert median_apart_px(ours, theirs, (1920, 1080)) <= 0.08


def test_klt_agrees(pictures: list[Gray], tracks: list[Track]) -> None:
    chosen = pictures[:10]
    klt = [track.ref_H_cur for track in tracked(chosen, method="klt")]
    assert median_apart_px(klt[1:], [track.ref_H_cur for track in tracks[1:10]], (1920, 1080)) <= 0.2
