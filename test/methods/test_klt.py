"""KLT-IV's selection of corners and its second pass; what `klt` is by default, the contract and accuracy tests show."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from truth import IDENTITY, SIZE, error_px, frame, picture, projective, translation

from stab_ros.core.errors import ConfigError
from stab_ros.core.geometry import apply
from stab_ros.core.settings import Value
from stab_ros.core.types import Gray, IdArray, Track
from stab_ros.methods.klt import Klt, KltConfig, strongest_of_quadrants
from stab_ros.parameters.engines import make_stabilizer

ALL = np.ones(SIZE[::-1], bool)
KLT_IV: dict[str, Value] = {
    "method": "klt", "klt.selection": "quadrants", "klt.share": 0.3, "klt.max_bidirectional": 1.0,
}


def tracked(current: Gray, **values: Value) -> Track:
    stabilizer = make_stabilizer(KLT_IV | {name.replace("__", "."): value for name, value in values.items()})
    stabilizer.track(frame(picture()))
    return stabilizer.track(frame(current, 1))


def counts(corners: IdArray) -> list[int]:
    right, low = corners[:, 0] >= SIZE[0] // 2, corners[:, 1] >= SIZE[1] // 2
    return [int(np.sum((right == r) & (low == b))) for b in (False, True) for r in (False, True)]


def test_every_quadrant_gives_its_own_share() -> None:
    dim = picture().astype(float)
    dim[:, : SIZE[0] // 2] = 128 + 0.3 * (dim[:, : SIZE[0] // 2] - 128)
    every, tenth = (strongest_of_quadrants(dim.astype(np.uint8), ALL, share, 0.0) for share in (1.0, 0.1))
    assert counts(tenth) == [round(0.1 * n) for n in counts(every)]
    assert min(counts(tenth)) > 10


def test_the_strongest_are_chosen() -> None:
    gray = picture()
    every, tenth = (strongest_of_quadrants(gray, ALL, share, 0.0) for share in (1.0, 0.1))
    eigenvalue = cv2.cornerMinEigenVal(gray, 5)
    for (x, y) in ((0, 0), (SIZE[0] // 2, SIZE[1] // 2)):
        inside = [c[((c >= (x, y)) & (c < (x + SIZE[0] // 2, y + SIZE[1] // 2))).all(axis=1)] for c in (every, tenth)]
        strength = [np.sort(eigenvalue[c[:, 1], c[:, 0]])[::-1] for c in inside]
        np.testing.assert_array_equal(strength[1], strength[0][: len(strength[1])])


def test_the_polygon_is_applied_after_the_choice() -> None:
    allowed = ALL.copy()
    allowed[:, 100:300] = False
    free, masked = (strongest_of_quadrants(picture(), mask, 0.1, 0.01) for mask in (ALL, allowed))
    np.testing.assert_array_equal(masked, free[allowed[free[:, 1], free[:, 0]]])
    assert 0 < len(masked) < len(free)


def test_a_flat_picture_has_no_corners() -> None:
    assert len(strongest_of_quadrants(np.full((300, 400), 90, np.uint8), ALL, 0.1, 0.01)) == 0


@pytest.mark.parametrize("passes", ["21", "21,5", "21, 11, 5"])
def test_known_motions_are_found(passes: str) -> None:
    H = projective()
    assert error_px(tracked(picture(H), klt__passes=passes), H) < 0.1


def test_a_second_pass_measures_again() -> None:
    H = translation(3.37, -2.61)
    one, two = (tracked(picture(H), klt__passes=passes) for passes in ("21", "21,5"))
    assert one.ref_H_cur is not None
    assert two.ref_H_cur is not None
    assert not np.array_equal(one.ref_H_cur, two.ref_H_cur)
    assert one.sigma_px is not None
    assert two.sigma_px is not None
    assert two.sigma_px > one.sigma_px  # smaller windows are less certain


def test_the_way_back_counts_as_a_distance() -> None:
    reference, current = picture(noise=0.0), picture(translation(2, 1), noise=25.0)
    wide, narrow = (Klt(reference, ALL, KltConfig(max_bidirectional=px)) for px in (10.0, 0.05))
    far, near = (method.match(current, IDENTITY, np.ones(len(method.reference_px))) for method in (wide, narrow))
    assert 0 < len(near) < len(far)
    np.testing.assert_array_equal(np.isin(near.feature_id, far.feature_id), True)


def test_named_points_are_followed() -> None:
    points_px, H = np.array([[60.25, 70.5], [300.0, 80.75], [90.5, 220.0], [320.1, 230.9], [3.0, 150.0]]), projective()
    method = Klt(picture(), ~ALL, KltConfig(), points_px)
    np.testing.assert_allclose(method.reference_px, points_px[:4], atol=1e-4)  # the last is too close to the border
    found = method.match(picture(H), IDENTITY, np.ones(4))
    np.testing.assert_allclose(apply(H, found.current_px), points_px[:4], atol=0.2)


@pytest.mark.parametrize("passes", ["", "21;5", "4", "21,200", "21,", "-21", "big"])
def test_passes_that_are_none_are_refused(passes: str) -> None:
    with pytest.raises(ConfigError, match="it must be whole numbers from 5 to 101"):
        make_stabilizer({"method": "klt", "klt.passes": passes})
