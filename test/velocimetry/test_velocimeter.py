"""The engine of velocimetry, with a method that follows given pixels, so that only what is around it is tested."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from control_scene import Scene

from stab_ros.core.geometry import apply, jacobian, normalized, shift
from stab_ros.core.types import BoolArray, FloatArray, Frame, Homography
from stab_ros.georeferencing.georeferencer import Georeferenced
from stab_ros.georeferencing.moved import ReferencePlace, placed_by_motion
from stab_ros.georeferencing.orientation import Unplaced
from stab_ros.georeferencing.placement import Motion, Placement, Sighting
from stab_ros.velocimetry.method import Method
from stab_ros.velocimetry.pictures import Stream
from stab_ros.velocimetry.pixel_plane import PixelPlane
from stab_ros.velocimetry.placed_frame import PlacedFrame
from stab_ros.velocimetry.placing import Picture, placed_frame
from stab_ros.velocimetry.vectors import Vectors
from stab_ros.velocimetry.velocimeter import Measured, Velocimeter
from stab_ros.velocimetry.zone import Zone

SIZE = (640, 360)
VIEW = Scene(SIZE).view
PIXELS = np.array([[100.0, 80], [320, 200], [600, 340], [20, 300]])
STEP_NS = 40_000_000


class FollowPixels:
    """A `Method` whose features lie at the same pixels of every picture; an interval is two frames."""

    def __init__(self, follows: bool = True) -> None:
        self.follows = follows
        self.frames: list[PlacedFrame] = []
        self.dropped = {"one": 3}
        self.doubts = {"all": "one is doubtful"}

    def add(self, frame: PlacedFrame) -> Vectors | None:
        self.frames.append(frame)
        return self.finish() if len(self.frames) > 1 else None

    def finish(self) -> Vectors | None:
        if len(self.frames) < 2:
            return None
        first, last = self.frames[0], self.frames[-1]
        self.frames = [last]
        start_ns, end_ns = (np.full(len(PIXELS), frame.stamp_ns) for frame in (first, last))
        dt_s = (last.stamp_ns - first.stamp_ns) / 1e9
        by_first, by_last = (jacobian(frame.plane_H_image, PIXELS) for frame in (first, last))
        own = by_first @ first.covariance @ by_first.transpose(0, 2, 1) + (
            by_last @ last.covariance @ by_last.transpose(0, 2, 1))
        shared = (by_last @ last.shared - by_first @ first.shared) / dt_s
        return Vectors(first.to_plane(PIXELS), last.to_plane(PIXELS), start_ns, end_ns, own / dt_s**2, shared,
                       np.arange(len(PIXELS)))


def frame(number: int) -> Frame:
    return Frame(np.zeros(SIZE[::-1], np.uint8), "mono8", 10**9 + number * STEP_NS, "cam")


def motion(number: int, resets: int = 0) -> Motion:
    return Motion(shift(-0.5 * number, 0.25 * number), np.diag(np.arange(1.0, 9)) * 1e-12, resets)


def by_pixels(number: int, told: Motion | None) -> Georeferenced:
    """The answer without georeference."""
    one = frame(number)
    sighting = Sighting(one.stamp_ns, one.image, None if told is None else told.ref_H_cur,
                        None if told is None else told.covariance)
    return Georeferenced(one, 0.0, PixelPlane().place(sighting))


def measured(told: list[Motion | None], stream: Stream, allowed: BoolArray | None = None,
             stamps: list[int] | None = None, follows: bool = True) -> list[Measured]:
    def method(_zone: Zone) -> Method:
        return FollowPixels(follows)

    engine, found = Velocimeter(stream, method, lambda _size, _first: allowed), list[Measured]()
    for number, one in zip(stamps or range(len(told)), told, strict=True):
        found += engine.add(by_pixels(number, one), one)
    return [*found, *engine.finish()]


def test_pixels_of_the_reference_without_georeference() -> None:
    one, = measured([motion(0), motion(1)], Stream("px"))
    np.testing.assert_allclose(one.vectors.start_m, PIXELS, atol=1e-12)
    np.testing.assert_allclose(one.vectors.end_m, PIXELS + np.array([-0.5, 0.25]), atol=1e-12)  # y down
    np.testing.assert_allclose(one.vectors.velocity_m_s, np.tile([-12.5, 6.25], (4, 1)), rtol=1e-12)
    told = motion(1).covariance
    assert told is not None
    np.testing.assert_allclose(one.placed.covariance, told, rtol=1e-12, atol=1e-25)


def test_stabilised_images_show_the_same_places_with_the_same_error() -> None:
    """What was a pixel of the frame is another one of the stabilised image, and lies where it did."""
    told, window_H_ref = motion(3), normalized(np.array([[1, 0, -8.0], [0, 1, 5], [0, 0, 1]]))
    placement = PixelPlane().place(Sighting(0, frame(0).image, told.ref_H_cur, told.covariance))
    assert isinstance(placement, Placement)
    image_H_cur = window_H_ref @ told.ref_H_cur
    raw = placed_frame(0, placement, Picture(frame(0).image, np.eye(3)), told, "px")
    warped = placed_frame(0, placement, Picture(frame(0).image, np.linalg.inv(image_H_cur)), told, "px")
    at = apply(image_H_cur, PIXELS)
    np.testing.assert_allclose(warped.to_plane(at), raw.to_plane(PIXELS), atol=1e-9)
    J, K = jacobian(raw.plane_H_image, PIXELS), jacobian(warped.plane_H_image, at)
    np.testing.assert_allclose(J @ raw.covariance @ J.transpose(0, 2, 1),
                               K @ warped.covariance @ K.transpose(0, 2, 1), rtol=1e-6)


@pytest.mark.parametrize(("level_scales", "wse_m", "scale_wse_m"), [
    (True, 0.0, 0.0), (True, 54.2, 54.2), (False, 54.2, 54.2), (False, 0.0, np.nan)])
def test_where_the_scale_is_given_a_level_that_nobody_told_has_none(level_scales: bool, wse_m: float,
                                                                    scale_wse_m: float) -> None:
    def method(_zone: Zone) -> Method:
        return FollowPixels()

    engine, found = Velocimeter(Stream("px", level_scales=level_scales), method, lambda _size, _new: None), []
    for number in range(2):
        found += engine.add(replace(by_pixels(number, motion(number)), wse_m=wse_m), motion(number))
    one, = [*found, *engine.finish()]
    np.testing.assert_equal((one.wse_m, one.scale_wse_m), (wse_m, scale_wse_m))


def test_lost_frames_are_left_out() -> None:
    one, = measured([motion(0), None, motion(2)], Stream("px"))
    assert one.dropped == {"one": 3}
    assert (one.vectors.end_ns - one.vectors.start_ns == 2 * STEP_NS).all()
    np.testing.assert_allclose(one.vectors.velocity_m_s, np.tile([-12.5, 6.25], (4, 1)), rtol=1e-12)


def test_no_vector_spans_two_references() -> None:
    found = measured([motion(0), motion(1), motion(2, 1), motion(3, 1)], Stream("px"))
    spans = [(one.vectors.start_ns[0] - 10**9, one.vectors.end_ns[0] - 10**9) for one in found]
    assert spans == [(0, STEP_NS), (2 * STEP_NS, 3 * STEP_NS)]


def test_time_may_go_back() -> None:
    found = measured([motion(0), motion(1), motion(0), motion(1)], Stream("px"), stamps=[5, 6, 2, 3])
    assert [one.stamp_ns for one in found] == [10**9 + 6 * STEP_NS, 10**9 + 3 * STEP_NS]


def test_only_where_velocities_are_wanted() -> None:
    allowed = np.zeros(SIZE[::-1], bool)
    allowed[:, :400] = True
    one, = measured([motion(0), motion(1)], Stream("px"), allowed)
    assert one.vectors.track_id.tolist() == [0, 1, 3]


@pytest.mark.parametrize(("follows", "ids"), [(True, [0, 3]), (False, [0, 1, 3])])
def test_what_is_measured_in_the_middle_may_reach_out(follows: bool, ids: list[int]) -> None:
    """The second vector leads from x = 320 to 300."""
    allowed = np.zeros(SIZE[::-1], bool)
    allowed[:, :315] = True
    one, = measured([motion(0), motion(40)], Stream("px"), allowed, follows=follows)
    assert one.vectors.track_id.tolist() == ids
    assert one.doubts == {"all": "one is doubtful"}


def test_frames_without_an_error_do_not_follow_those_with_one() -> None:
    unsure = replace(motion(1), covariance=None)
    one, = measured([motion(0), unsure, motion(2)], Stream("px"))
    assert (one.vectors.end_ns - one.vectors.start_ns == 2 * STEP_NS).all()
    one, = measured([replace(motion(0), covariance=None), motion(1)], Stream("px"))
    assert not one.vectors.covariance.any()


@pytest.mark.parametrize("who", ["reference", "homographies"])
def test_what_is_shared_and_what_is_not(who: str) -> None:
    """Velocities of 300 draws of the errors, against their predicted covariance."""
    rng, camera = np.random.default_rng(3), VIEW.camera
    map_H_ref = normalized(np.linalg.inv(VIEW.image_H_map(0.0)))
    columns = np.diag([1e-4, 1e-4, 0.05, 1e-4, 1e-4, 0.05, 1e-6, 1e-6]) * (who == "reference")
    own = np.diag([1e-5, 1e-5, 0.05, 1e-5, 1e-5, 0.05, 1e-8, 1e-8]) ** 2 * (who == "homographies")
    told = [Motion(H, own) for H in (shift(1.0, -2.0), np.array([[1.01, 0.01, 9], [0, 1, 4], [1e-6, 0, 1]]))]

    def answers(reference: Homography, motions: list[FloatArray]) -> list[Georeferenced]:
        place = ReferencePlace(normalized(reference), columns, 0.0)
        found = []
        for number, H in enumerate(motions):
            one = frame(number)
            sighting = Sighting(one.stamp_ns, one.image, normalized(H), own)
            answer = placed_by_motion(camera, True, place, sighting, {}, ())
            assert not isinstance(answer, Unplaced)
            found.append(Georeferenced(one, 0.0, answer))
        return found

    def vectors(reference: Homography, motions: list[FloatArray]) -> Vectors:
        engine = Velocimeter(Stream("m"), lambda _zone: FollowPixels(), lambda _size, _first: None)
        for answer, one in zip(answers(reference, motions), told, strict=True):
            found = engine.add(answer, one)
        return found[0].vectors

    exact = [one.ref_H_cur for one in told]
    predicted = vectors(map_H_ref, exact)
    assert bool(predicted.covariance.any()) is (who == "homographies")
    assert bool(predicted.shared.any()) is (who == "reference")
    drawn = []
    for _ in range(300):
        errors = [np.append(rng.normal(0, np.sqrt(np.diag(own))), 0).reshape(3, 3) for _ in exact]
        of_reference = np.append(columns @ rng.normal(size=8), 0).reshape(3, 3)
        motions = [H + error for H, error in zip(exact, errors, strict=True)]
        drawn.append(vectors(map_H_ref + of_reference, motions).velocity_m_s)
    for number, total in enumerate(predicted.total_covariance):
        spread = np.cov(np.array(drawn)[:, number].T)
        ratio = np.linalg.eigvals(np.linalg.solve(total, spread)).real
        assert (np.abs(ratio - 1) < 0.3).all()
